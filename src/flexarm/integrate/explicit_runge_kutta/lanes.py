"""Compiled stepping of explicit Runge-Kutta methods for eight runs at once, one in each lane.

Each lane has its own time, step, step control, torque and samples. A lane whose run has ended
continues with the next run. The steps are those of ``explicit``; only the order of the calls
differs, because all lanes evaluate the dynamics together.

Not supported, and left to ``explicit``: loads, contacts, joint stops. A run that fails, or that
needs too many steps, ends with its status, and its samples are incomplete.
"""

from __future__ import annotations

from flexarm.integrate.base import Tolerance
from flexarm.integrate.explicit_runge_kutta.lane_data import (
    LaneDrive,
    LaneMemory,
    LaneMethod,
    LaneRuns,
)
from flexarm.integrate.memory import (
    EVALUATIONS,
    NORM,
    REJECTED,
    SAMPLES,
    STEP,
    STEPS,
    TIME,
)
from flexarm.integrate.samples import dense_weights
from flexarm.integrate.status import DIVERGED, DONE, INERTIA_LOST, PAUSED
from flexarm.integrate.steps import (
    LONGEST,
    choose_step,
    combine,
    error_sizes,
    motion_sizes,
    norm_of,
    retry_shorter,
    step_landing,
)
from flexarm.integrate.torque import piece_of
from flexarm.kernels.columns import FREE, JOINT_UW
from flexarm.kernels.compilation.cache import apart, inner, merged, unlocked
from flexarm.kernels.compilation.packs import LANES, PackArray, chosen
from flexarm.kernels.kinematics import link_terms
from flexarm.kernels.layout import ArmConstants, Sizes
from flexarm.kernels.recursion.inward import inward
from flexarm.kernels.recursion.outward import outward


@inner
def _fill_samples(
    sizes: Sizes, runs: LaneRuns, k: int, state: PackArray, lane: int, t: float
) -> None:
    """Fill the samples of run k up to time t with the state of its lane."""
    while runs.counts[k, SAMPLES] < runs.sample_times.shape[0] and (
        runs.sample_times[runs.counts[k, SAMPLES]] <= t
    ):
        for level in range(2):
            for i in range(len(sizes.bodies)):
                for j in range(1 + len(sizes.modes)):
                    value = state.array[level, i, j, lane]
                    runs.samples[k, runs.counts[k, SAMPLES], level, i, j] = value
        runs.counts[k, SAMPLES] += 1


@apart
def _begin_run(
    sizes: Sizes, drive: LaneDrive, runs: LaneRuns, memory: LaneMemory, lane: int, k: int
) -> None:
    """Put run k into a lane."""
    memory.run[lane] = k
    memory.fresh[lane] = 1
    for level in range(2):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                memory.state.array[level, i, j, lane] = runs.state[k, level, i, j]
    _fill_samples(sizes, runs, k, memory.state, lane, runs.clock[k, TIME])


@apart
def _end_run(sizes: Sizes, runs: LaneRuns, memory: LaneMemory, lane: int, status: int) -> None:
    """Take the run out of a lane."""
    k = memory.run[lane]
    runs.status[k] = status
    memory.run[lane] = -1
    memory.fresh[lane] = 0
    for level in range(2):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                runs.state[k, level, i, j] = memory.state.array[level, i, j, lane]


@apart
def _begin_steps(method: LaneMethod, drive: LaneDrive, runs: LaneRuns, memory: LaneMemory) -> None:
    """Choose the end of the next step of each lane, and find its piece of the torque."""
    for lane in range(LANES):
        k = memory.run[lane]
        if k < 0:
            continue
        t = runs.clock[k, TIME]
        h = runs.clock[k, STEP]
        if method.adaptive:
            h = min(h, LONGEST / runs.fastest[k])
        stops = drive.stops[drive.places[k, 4] : drive.places[k, 5]]
        end, h, lands = step_landing(stops, t, h, runs.until)
        memory.end[lane] = end
        memory.lands[lane] = lands
        memory.step.array[0, lane] = h
        breaks = drive.breaks[drive.places[k, 0] : drive.places[k, 1]]
        if memory.fresh[lane] == 1:
            memory.piece[lane] = piece_of(breaks, t, False)
        while memory.piece[lane] < breaks.shape[0] - 2 and breaks[memory.piece[lane] + 1] <= t:
            memory.piece[lane] += 1


@merged
def _torques(
    sizes: Sizes, drive: LaneDrive, runs: LaneRuns, memory: LaneMemory, c: float, ends: bool,
    from_left: bool,
) -> None:  # fmt: skip
    """Set the torques at the fraction c of each lane's step; ``ends``: exactly at its end."""
    for lane in range(LANES):
        k = memory.run[lane]
        if k < 0:
            continue
        t = runs.clock[k, TIME] + c * memory.step.array[0, lane]
        if ends:
            t = memory.end[lane]
        first = drive.places[k, 0]
        last = drive.places[k, 1] - first - 2  # last piece
        piece = memory.piece[lane]
        while piece < last and (
            drive.breaks[first + piece + 1] < t
            or (drive.breaks[first + piece + 1] == t and not from_left)
        ):
            piece += 1
        x = t - drive.breaks[first + piece]
        piece += drive.places[k, 2]
        for i in range(len(sizes.bodies)):
            memory.torque.array[i, lane] = drive.coefficients[piece, 0, i] + x * (
                drive.coefficients[piece, 1, i]
                + x * (drive.coefficients[piece, 2, i] + x * drive.coefficients[piece, 3, i])
            )


@merged
def _derivatives(
    sizes: Sizes, constants: ArmConstants, memory: LaneMemory, point: PackArray, stage: int
) -> None:
    """Write the time derivatives of all lanes into ``stages[stage]``."""
    work = memory.work
    link_terms(sizes, constants, point, work)
    inward(sizes, constants, point, memory.torque, work)
    outward(sizes, constants, memory.loads, work)
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            memory.stages[stage, 0, i, j] = point[1, i, j]
            memory.stages[stage, 1, i, j] = work.acceleration[i, j]


@inner
def _copy(sizes: Sizes, source: PackArray, target: PackArray) -> None:
    for level in range(2):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                target[level, i, j] = source[level, i, j]


@inner
def _keep_first_stage(sizes: Sizes, memory: LaneMemory, stage: int, mask: PackArray) -> None:
    """Copy ``stages[stage]`` to the first stage in the lanes of a mask."""
    for level in range(2):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                memory.stages[0, level, i, j] = chosen(
                    mask[0], memory.stages[stage, level, i, j], memory.stages[0, level, i, j]
                )


@apart
def _measure(sizes: Sizes, tolerance: Tolerance, method: LaneMethod, memory: LaneMemory) -> None:
    """Compute the errors of a controlled step, or the plausibility of a fixed one."""
    h = memory.step[0]
    if method.adaptive:
        worst, low, check = error_sizes(
            sizes, tolerance, memory.state, memory.new, memory.stages, method.error, h
        )
        memory.norm[0] = worst
        memory.norm[1] = low
        memory.norm[2] = check
    else:
        largest, check = motion_sizes(sizes, tolerance, memory.new, h)
        memory.norm[0] = largest
        memory.norm[1] = 0.0
        memory.norm[2] = check


@merged
def _inertia_left(sizes: Sizes, constants: ArmConstants, memory: LaneMemory, lane: int) -> bool:
    lowest = 1.0
    for i in range(len(sizes.bodies)):
        if constants.body[i, FREE] != 0.0:
            lowest = min(lowest, memory.work.body.array[i, JOINT_UW, lane])
    return lowest > 0.0


@apart
def _judge(
    sizes: Sizes, constants: ArmConstants, method: LaneMethod, runs: LaneRuns, memory: LaneMemory,
) -> bool:  # fmt: skip
    """Accept or reject the step of each lane; return whether a sample lies inside one."""
    between = False
    for lane in range(LANES):
        memory.accepted.array[0, lane] = 0.0
        k = memory.run[lane]
        if k < 0:
            continue
        status = DONE
        norm = norm_of(
            memory.norm.array[0, lane], memory.norm.array[1, lane], memory.norm.array[2, lane]
        )
        if method.adaptive:
            runs.clock[k, NORM] = norm
            if not norm <= 1.0:
                runs.counts[k, EVALUATIONS] -= 1  # ``explicit`` evaluates an accepted end only
                status = retry_shorter(
                    runs.clock[k], runs.counts[k], method.order, memory.step.array[0, lane],
                    runs.fastest[k],
                )  # fmt: skip
        elif not norm <= 1.0:
            status = DIVERGED
        if status == DONE and not _inertia_left(sizes, constants, memory, lane):
            status = INERTIA_LOST
        if status == DONE:
            memory.accepted.array[0, lane] = 1.0
            due = runs.counts[k, SAMPLES]
            if due < runs.sample_times.shape[0] and runs.sample_times[due] < memory.end[lane]:
                between = True
        elif status != PAUSED:
            _end_run(sizes, runs, memory, lane, status)
    return between


@apart
def _samples_inside(sizes: Sizes, method: LaneMethod, runs: LaneRuns, memory: LaneMemory) -> None:
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
            method.dense.shape[0] > method.error.shape[1]
            and due < runs.sample_times.shape[0]
            and runs.sample_times[due] < memory.end[lane]
        ):
            runs.counts[k, EVALUATIONS] += rows - method.error.shape[1]
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


@apart
def _end_steps(
    sizes: Sizes, method: LaneMethod, runs: LaneRuns, memory: LaneMemory, max_steps: int
) -> None:
    """Make the ends of the accepted steps the states of their lanes, and choose the next steps."""
    stages = method.error.shape[1] - 1
    for level in range(2):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                memory.state[level, i, j] = chosen(
                    memory.accepted[0], memory.new[level, i, j], memory.state[level, i, j]
                )
    _keep_first_stage(sizes, memory, stages, memory.accepted)
    for lane in range(LANES):
        k = memory.run[lane]
        if k < 0:
            continue
        if memory.accepted.array[0, lane] != 0.0:
            t = memory.end[lane]
            _fill_samples(sizes, runs, k, memory.state, lane, t)
            runs.clock[k, TIME] = t
            runs.counts[k, STEPS] += 1
            lands = memory.lands[lane] == 1
            if method.adaptive:
                choose_step(runs.clock[k], memory.step.array[0, lane], method.order, lands)
            if t >= runs.until:
                _end_run(sizes, runs, memory, lane, DONE)
                continue
            if lands:  # the torque may jump here, and the last slope is the one from the left
                memory.fresh[lane] = 1
        if runs.counts[k, STEPS] + runs.counts[k, REJECTED] >= max_steps:
            _end_run(sizes, runs, memory, lane, PAUSED)


@unlocked
def advance_lanes(
    sizes: Sizes,
    constants: ArmConstants,
    tolerance: Tolerance,
    method: LaneMethod,
    drive: LaneDrive,
    runs: LaneRuns,
    memory: LaneMemory,
    max_steps: int,
) -> None:
    """Advance all runs to ``runs.until``, or until they fail or have made ``max_steps`` steps."""
    rows = method.dense.shape[0]
    s = method.error.shape[1] - 1
    following = 0
    for lane in range(LANES):
        memory.run[lane] = -1
        memory.fresh[lane] = 0
    while True:
        busy = 0
        fresh = 0
        for lane in range(LANES):
            if memory.run[lane] < 0 and following < runs.status.shape[0]:
                _begin_run(sizes, drive, runs, memory, lane, following)
                following += 1
            if memory.run[lane] >= 0:
                busy += 1
                runs.counts[memory.run[lane], EVALUATIONS] += s + memory.fresh[lane]
            fresh += memory.fresh[lane]
        if busy == 0:
            return
        _begin_steps(method, drive, runs, memory)
        for lane in range(LANES):
            memory.accepted.array[0, lane] = memory.fresh[lane]
        # Stage 0 is that of the last step, except in fresh lanes. Stages beyond s are for samples.
        stage = 1
        if fresh > 0:
            stage = 0
        limit = s + 1
        while stage < limit:
            if stage == 0:
                _copy(sizes, memory.state, memory.point)
            else:
                combine(
                    sizes, memory.state, memory.stages, method.A, stage, stage, memory.step[0],
                    memory.point,
                )  # fmt: skip
            if stage == s:
                _copy(sizes, memory.point, memory.new)
            c = method.c[stage]
            from_left = stage > 0 and (c == 1.0 or stage > s)
            _torques(sizes, drive, runs, memory, c, stage == s, from_left)
            # The dynamics is inlined only here, because its code is long. All other stages follow
            # from the first one, so the fresh ones are put in place before.
            written = stage
            if stage == 0:
                written = s
            _derivatives(sizes, constants, memory, memory.point, written)
            if stage == 0:
                _keep_first_stage(sizes, memory, s, memory.accepted)
                for lane in range(LANES):
                    memory.fresh[lane] = 0
            if stage == s:
                _measure(sizes, tolerance, method, memory)
                if _judge(sizes, constants, method, runs, memory):
                    limit = rows
            stage += 1
        _samples_inside(sizes, method, runs, memory)
        _end_steps(sizes, method, runs, memory, max_steps)
