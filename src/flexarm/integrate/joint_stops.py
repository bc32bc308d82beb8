"""Joint stops in steps: which of them push, and the steps that end where they change.

The torque of a stop (R.33) is that of a one-sided spring, see ``switching``. The error estimate of
a step may not detect its corner, because stages inside the stop may have zero weight in it.
"""

from __future__ import annotations

import math

from flexarm.integrate.base import System
from flexarm.integrate.memory import IMPACTS, Memory
from flexarm.integrate.switching import begin_pushing, pushes, step_to_change
from flexarm.kernels.columns import (
    FREE,
    JOINT_INERTIA,
    LOWER_PUSHES,
    LOWER_STOP,
    STOP_DAMPING,
    STOP_STIFFNESS,
    STOPS_FIXED,
)
from flexarm.kernels.compilation.cache import apart, merged
from flexarm.kernels.compilation.numbers import real
from flexarm.kernels.layout import Array

#: Rounding error of a joint angle, rad.
_SLACK = 1e-14


@merged
def _stiffness(system: System, i: int) -> float:
    c = system.constants
    stiffness: float = real(c.body[i, STOP_STIFFNESS] * c.body[i, FREE])
    return stiffness


@merged
def _time(system: System, i: int, stiffness: float) -> float:
    """Return the time (s) in which the stops of the joint of body i reverse it."""
    inertia = max(real(system.work.body[i, JOINT_INERTIA]), 0.0)
    return math.sqrt(inertia / stiffness)


@merged
def _gap(system: System, state: Array, i: int, side: int) -> tuple[float, float]:
    """Return the angle (rad) from the lower (0) or upper (1) stop of body i, and its rate."""
    sign = 1.0 - 2.0 * side
    angle = real(state[0, i, 0]) - real(system.constants.body[i, LOWER_STOP + side])
    return sign * angle, sign * real(state[1, i, 0])


@apart
def fix_stops(system: System, memory: Memory, begins: bool) -> bool:
    """Fix which stops push at ``memory.state``; return whether any has changed.

    Args:
        system: one with laws of joints.
        begins: whether the fixed stops are not those of the step before.
    """
    work = system.work
    changed = False
    for i in range(len(system.sizes.bodies)):
        stiffness = _stiffness(system, i)
        if stiffness <= 0.0:
            continue
        work.body[i, STOPS_FIXED] = 1.0
        damping = real(system.constants.body[i, STOP_DAMPING])
        for side in range(2):
            angle, rate = _gap(system, memory.state, i, side)
            now = pushes(angle, rate, damping)
            if begins or now != (real(work.body[i, LOWER_PUSHES + side]) > 0.0):
                work.body[i, LOWER_PUSHES + side] = 1.0 if now else 0.0
                if not begins:
                    changed = True
                    memory.counts[IMPACTS] += 1
                    if now:
                        begin_pushing(memory.clock, _time(system, i, stiffness))
    return changed


@merged
def step_to_stop(system: System, memory: Memory, h: float) -> float:
    """Return the step length at which a stop begins or ceases to push, or h if none does.

    ``memory.state`` and ``memory.new`` are the ends of a step of length h; the last evaluation of
    the dynamics must be the one at ``new``.
    """
    sizes, work = system.sizes, system.work
    longest = h
    if len(sizes.joint_laws) > 0:
        for i in range(len(sizes.bodies)):
            stiffness = _stiffness(system, i)
            if stiffness <= 0.0:
                continue
            damping = real(system.constants.body[i, STOP_DAMPING])
            for side in range(2):
                g0, r0 = _gap(system, memory.state, i, side)
                g1, r1 = _gap(system, memory.new, i, side)
                longest = step_to_change(
                    memory.clock, h, longest, _time(system, i, stiffness), g0, r0, g1, r1,
                    damping, real(work.body[i, LOWER_PUSHES + side]) > 0.0, _SLACK,
                )  # fmt: skip
    return longest
