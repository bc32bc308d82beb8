"""First derivative of a call, judgement of a step at its end, and start of the next step.

For methods of Runge and Kutta, whose last stage is the derivative at the end of the step. Calls of
kernels apart pass some hundred words, so features that an arm does not have are not called.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flexarm.integrate.base import System, Tolerance
from flexarm.integrate.closures import closures_depend
from flexarm.integrate.joint_stops import fix_stops
from flexarm.integrate.memory import CHANGED, EVALUATIONS, WHOLE, Memory
from flexarm.integrate.nearness import begin_branches, fix_branches, step_on
from flexarm.integrate.samples import count_first, end_step
from flexarm.integrate.status import CLOSURES_DEPEND, DONE, INERTIA_LOST
from flexarm.integrate.steps import choose_step, inertia_left, judge_contacts
from flexarm.integrate.stick_events import end_sticking, judge_sticking
from flexarm.integrate.torque import slope_at
from flexarm.kernels.compilation.cache import merged
from flexarm.kernels.layout import Array

# Typed constants: with literals, the compiler would build each callee for every value.
_FIRST_STAGE: Any = np.int64(0)
_FROM_LEFT: Any = np.bool_(True)
_FROM_RIGHT: Any = np.bool_(False)
_SETTLES, _STAYS = _FROM_LEFT, _FROM_RIGHT


@merged
def begin_steps(system: System, memory: Memory, stages: Array, t: float, adaptive: bool) -> None:
    """Write the derivative at t into ``stages[0]``, and fix which stops and contacts push."""
    contacts = system.drive.loads.contacts
    begin_branches(contacts, adaptive)
    if adaptive and len(system.sizes.joint_laws) > 0:
        fix_stops(system, memory, True)
    slope_at(system, t, _FROM_RIGHT, memory.state, memory.torque, stages, _FIRST_STAGE, _SETTLES)
    count_first(memory)
    if contacts.body.shape[0] > 0:
        step_on(contacts)
        fix_branches(contacts, memory.clock, memory.counts)


@merged
def judge_end(
    system: System, tolerance: Tolerance, memory: Memory, stages: Array, s: int, t: float,
    t_new: float, h: float, adaptive: bool, known: bool,
) -> int:  # fmt: skip
    """Check contacts, inertia and sticking at the end ``memory.new`` of a step of length h from t.

    Returns a code as ``steps.judge_step`` does.

    Args:
        known: whether ``stages[s]`` is the derivative at the end; otherwise it is computed.
    """
    contacts = system.drive.loads.contacts
    if not known:
        slope_at(system, t_new, _FROM_LEFT, memory.new, memory.torque, stages, s, _STAYS)
        memory.counts[EVALUATIONS] += 1
    status = DONE
    if contacts.body.shape[0] > 0:
        status = judge_contacts(contacts, memory.clock, memory.counts, h, adaptive)
    if status == DONE and not inertia_left(system):
        status = INERTIA_LOST
    if status == DONE and len(system.sizes.closures) > 0 and closures_depend(system):
        status = CLOSURES_DEPEND
    if status == DONE and len(system.sizes.joint_laws) > 0:
        status = judge_sticking(system, tolerance.fastest, memory, stages, s, t, h, adaptive)
    return status


@merged
def next_step(
    system: System, memory: Memory, stages: Array, s: int, t_new: float, h: float, lands: bool,
    adaptive: bool, order: int, until: float,
) -> None:  # fmt: skip
    """Make the end of an accepted step of length h the state of the run, and choose the next step.

    Args:
        lands: whether the step ends at a stop of the drive, where a force may change.
    """
    sizes, clock, contacts = system.sizes, memory.clock, system.drive.loads.contacts
    if adaptive:
        choose_step(clock, h, order, lands)
    if clock[CHANGED] + clock[WHOLE] > 0.0:
        end_sticking(system, memory, stages, s, t_new, _FROM_LEFT)
    end_step(sizes, memory, memory.new, t_new)
    for level in range(2):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                stages[0, level, i, j] = stages[s, level, i, j]
    if adaptive and contacts.body.shape[0] > 0:
        lands = fix_branches(contacts, clock, memory.counts) or lands
    if adaptive and len(sizes.joint_laws) > 0:
        lands = fix_stops(system, memory, False) or lands
    if lands and t_new < until:  # the last stage is the derivative from the left
        memory.counts[EVALUATIONS] += slope_at(
            system, t_new, _FROM_RIGHT, memory.state, memory.torque, stages, _FIRST_STAGE, _SETTLES
        )
