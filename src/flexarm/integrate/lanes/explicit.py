"""Compiled stepping of explicit Runge-Kutta methods in lanes.

The steps are those of ``explicit_runge_kutta.explicit``; only the order of the calls differs,
because all lanes evaluate the dynamics together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.integrate.base import Tolerance
from flexarm.integrate.lanes.contacts import begin_contacts, touch_lanes
from flexarm.integrate.lanes.data import LaneDrive, LaneMemory, LaneRuns, StepControl
from flexarm.integrate.lanes.steps import (
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
from flexarm.integrate.memory import EVALUATIONS, SAMPLES, TIME
from flexarm.integrate.samples import dense_weights
from flexarm.integrate.sums import combine
from flexarm.kernels.compilation.cache import apart, merged, unlocked
from flexarm.kernels.compilation.packs import LANES
from flexarm.kernels.forces.external import push_loads
from flexarm.kernels.kinematics import link_terms
from flexarm.kernels.layout import ArmConstants, Array, Sizes
from flexarm.kernels.recursion.inward import inward
from flexarm.kernels.recursion.outward import outward


class ExplicitLanes(NamedTuple):
    """Coefficients of a ``tableau.Tableau``."""

    control: StepControl
    A: Array  # (r, r)
    c: Array  # (r,)
    dense: Array  # (r, d)


@merged
def _derivatives(sizes: Sizes, constants: ArmConstants, memory: LaneMemory, stage: int) -> None:
    """Write the time derivatives at ``memory.point`` into ``stages[stage]``."""
    point, work = memory.point, memory.work
    link_terms(sizes, constants, point, work)
    if memory.loads.contacts.body.shape[0] > 0:
        touch_lanes(sizes, constants, memory, point)
    push_loads(sizes, memory.loads, point, work)
    inward(sizes, constants, point, memory.torque, work)
    outward(sizes, constants, memory.loads, work)
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            memory.stages[stage, 0, i, j] = point[1, i, j]
            memory.stages[stage, 1, i, j] = work.acceleration[i, j]


@apart
def _samples_inside(
    sizes: Sizes, method: ExplicitLanes, runs: LaneRuns, memory: LaneMemory
) -> None:
    """Fill the samples inside the accepted steps by dense output."""
    rows = method.dense.shape[0]
    for lane in range(LANES):
        if memory.accepted.array[0, lane] == 0.0:
            continue
        k = memory.run[lane]
        t = runs.clock[k, TIME]
        h = memory.step.array[0, lane]
        due = runs.counts[k, SAMPLES]
        if (
            method.dense.shape[0] > method.control.error.shape[1]
            and due < runs.sample_times.shape[0]
            and runs.sample_times[due] < memory.end[lane]
        ):
            runs.counts[k, EVALUATIONS] += rows - method.control.error.shape[1]
        while due < runs.sample_times.shape[0] and runs.sample_times[due] < memory.end[lane]:
            dense_weights(method.dense, (runs.sample_times[due] - t) / h, memory.weights)
            for level in range(2):
                for i in range(len(sizes.bodies)):
                    for j in range(1 + len(sizes.modes)):
                        total = 0.0
                        for row in range(rows):
                            slope = memory.stages.array[row, level, i, j, lane]
                            total += memory.weights[0, row] * slope
                        start = memory.state.array[level, i, j, lane]
                        runs.samples[k, due, level, i, j] = start + h * total
            due += 1
            runs.counts[k, SAMPLES] = due


@unlocked
def advance_explicit_lanes(
    sizes: Sizes,
    constants: ArmConstants,
    tolerance: Tolerance,
    method: ExplicitLanes,
    drive: LaneDrive,
    runs: LaneRuns,
    memory: LaneMemory,
    max_steps: int,
) -> None:
    """Advance all runs to their ``until``, or until they fail or have made ``max_steps`` steps."""
    rows = method.dense.shape[0]
    s = method.control.error.shape[1] - 1
    following = int(np.int64(0))
    begin_lanes(memory)
    while True:
        following, busy, fresh = fill_lanes(sizes, runs, memory, following, s)
        if busy == 0:
            return
        begin_steps(method.control, drive, runs, memory)
        # Stage 0 is that of the last step, except in fresh lanes. Stages beyond s are for samples.
        stage = 1
        if fresh > 0:
            stage = 0
        limit = s + 1
        while stage < limit:
            if stage == 0:
                copy_packs(sizes, memory.state, memory.point)
            else:
                combine(
                    sizes, memory.state, memory.stages, method.A, stage, stage, memory.step[0],
                    memory.point,
                )  # fmt: skip
            if stage == s:
                copy_packs(sizes, memory.point, memory.new)
            c = method.c[stage]
            from_left = stage > 0 and (c == 1.0 or stage > s)
            drives_of_lanes(sizes, drive, runs, memory, c, stage == s, from_left)
            # The dynamics is inlined only here, because its code is long. The derivative at the
            # time of a fresh lane is put into stage 0 of this lane alone.
            written = stage
            if stage == 0:
                written = s
            _derivatives(sizes, constants, memory, written)
            if stage == 0:
                keep_first_stage(sizes, memory, s)
                begin_contacts(runs, memory)
            if stage == s:
                measure_steps(sizes, tolerance, method.control, memory)
                if judge_steps(sizes, method.control, runs, memory):
                    limit = rows
            stage += 1
        _samples_inside(sizes, method, runs, memory)
        end_steps(sizes, method.control, runs, memory, max_steps)
