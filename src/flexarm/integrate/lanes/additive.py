"""Compiled stepping of additive Runge-Kutta methods in lanes.

The steps are those of ``implicit.additive``, with the symbols there; only the order of the calls
differs, because all lanes evaluate the dynamics together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.integrate.base import System, Tolerance
from flexarm.integrate.implicit.additive import drag_at, shift_forces, soften_for
from flexarm.integrate.lanes.contacts import begin_contacts, touch_lanes
from flexarm.integrate.lanes.data import LaneDrive, LaneMemory, LaneRuns, StepControl
from flexarm.integrate.lanes.steps import (
    arm_of,
    begin_lanes,
    begin_steps,
    copy_packs,
    drives_of_lanes,
    end_steps,
    fill_lanes,
    judge_steps,
    keep_first_stage,
    measure_steps,
)
from flexarm.integrate.memory import SAMPLES, TIME
from flexarm.integrate.samples import between_ends
from flexarm.integrate.sums import combine
from flexarm.kernels.columns import FLEX_BIAS
from flexarm.kernels.compilation.cache import apart, merged, unlocked
from flexarm.kernels.compilation.packs import LANES
from flexarm.kernels.forces.external import push_loads
from flexarm.kernels.kinematics import link_terms
from flexarm.kernels.layout import Array, Sizes
from flexarm.kernels.recursion.inward import inward
from flexarm.kernels.recursion.outward import outward


class AdditiveLanes(NamedTuple):
    """Coefficients of an ``AdditiveTableau``."""

    control: StepControl
    explicit: Array  # (s + 1, s)
    implicit: Array  # (s + 1, s)
    c: Array  # (s + 1,)


@apart
def _slopes(system: System, memory: LaneMemory, stage: int) -> None:
    """Write the time derivatives at ``memory.point`` into ``stages[stage]``."""
    sizes, constants, work = system.sizes, system.constants, system.work
    link_terms(sizes, constants, memory.point, work)
    if memory.loads.contacts.body.shape[0] > 0:
        touch_lanes(sizes, constants, memory, memory.point)
    push_loads(sizes, memory.loads, memory.point, work)
    inward(sizes, constants, memory.point, memory.torque, work)
    outward(sizes, constants, memory.loads, work)
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            memory.stages[stage, 0, i, j] = memory.point[1, i, j]
            memory.stages[stage, 1, i, j] = work.acceleration[i, j]


@merged
def _implicit_stage(system: System, memory: LaneMemory, gamma: float, stage: int) -> None:
    """Write the derivatives of the implicit state of a stage into ``stages[stage]``."""
    sizes, work, softened, known = system.sizes, system.work, memory.softened, memory.known
    reach = memory.step[0] * gamma
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            known[0, i, j] += reach * known[1, i, j]
    shift_forces(system, softened, memory.point, known, memory.torque)
    link_terms(sizes, softened, memory.point, work)
    if memory.loads.contacts.body.shape[0] > 0:
        touch_lanes(sizes, softened, memory, memory.point)
    push_loads(sizes, memory.loads, memory.point, work)
    for i in range(len(sizes.bodies)):
        for j in range(len(sizes.modes)):
            work.mode[i, j, FLEX_BIAS] -= work.force[i, 1 + j]
    inward(sizes, softened, memory.point, memory.torque, work)
    outward(sizes, softened, memory.loads, work)
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            change = work.acceleration[i, j]
            memory.stages[stage, 0, i, j] = known[1, i, j] + reach * change
            memory.stages[stage, 1, i, j] = change


@apart
def _samples_inside(
    sizes: Sizes, tolerance: Tolerance, runs: LaneRuns, memory: LaneMemory, damps: bool
) -> None:
    """Fill the samples inside the accepted steps by ``between_ends``."""
    for lane in range(LANES):
        if memory.accepted.array[0, lane] == 0.0:
            continue
        k = memory.run[lane]
        h = memory.step.array[0, lane]
        due = runs.counts[k, SAMPLES]
        unit = runs.unit[arm_of(runs, k)]
        allowed = Tolerance(tolerance.absolute, tolerance.relative, unit, runs.fastest[k])
        while due < runs.sample_times.shape[0] and runs.sample_times[due] < memory.end[lane]:
            x = (runs.sample_times[due] - runs.clock[k, TIME]) / h
            between_ends(
                sizes, allowed, damps, memory.state.array[:, :, :, lane],
                memory.new.array[:, :, :, lane], memory.stages.array[:, :, :, :, lane], x, h,
                runs.samples[k, due],
            )  # fmt: skip
            due += 1
            runs.counts[k, SAMPLES] = due


@unlocked
def advance_additive_lanes(
    system: System,
    tolerance: Tolerance,
    method: AdditiveLanes,
    drive: LaneDrive,
    runs: LaneRuns,
    memory: LaneMemory,
    max_steps: int,
) -> None:
    """Advance all runs to their ``until``, or until they fail or have made ``max_steps`` steps.

    ``system`` has packs in its workspace; its drive is not used.
    """
    sizes = system.sizes
    # Typed constants: with literals, the compiler would build each callee for every value.
    zero = int(np.int64(0))
    from_left = bool(np.bool_(True))
    damps = from_left  # vibrations that a step does not resolve
    at_end = bool(np.bool_(True))
    s = method.control.error.shape[1] - 1
    gamma = method.implicit[1, 1]
    following = zero
    begin_lanes(memory)
    while True:
        following, busy, fresh = fill_lanes(sizes, runs, memory, following, s)
        if busy == 0:
            return
        begin_steps(method.control, drive, runs, memory)
        state, stages, h = memory.state, memory.stages, memory.step[0]
        if fresh > 0:
            copy_packs(sizes, state, memory.point)
            drives_of_lanes(sizes, drive, runs, memory, 0.0, not at_end, not from_left)
            _slopes(system, memory, s)
            keep_first_stage(sizes, memory, s)
            begin_contacts(runs, memory)
        reach = h * gamma
        drag_at(system, memory.softened, state)
        soften_for(system, memory.softened, reach, reach * h * gamma)
        for k in range(1, s):
            combine(sizes, state, stages, method.explicit, k, k, h, memory.point)
            combine(sizes, state, stages, method.implicit, k, k, h, memory.known)
            c = method.c[k]
            drives_of_lanes(sizes, drive, runs, memory, c, not at_end, c == 1.0)
            _implicit_stage(system, memory, gamma, k)
        combine(sizes, state, stages, method.explicit, s, s, h, memory.point)
        copy_packs(sizes, memory.point, memory.new)
        drives_of_lanes(sizes, drive, runs, memory, 1.0, at_end, from_left)
        _slopes(system, memory, s)
        measure_steps(sizes, tolerance, method.control, memory)
        judge_steps(sizes, method.control, runs, memory)
        _samples_inside(sizes, tolerance, runs, memory, damps)
        end_steps(sizes, method.control, runs, memory, max_steps)
