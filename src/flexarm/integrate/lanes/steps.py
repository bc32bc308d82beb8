"""Common functions of the lane steppers: runs in lanes, torques, step control.

Each lane has its own time, step, step control, torque and samples. A lane whose run has ended
continues with the next run. The rules are those of ``integrate.steps``, whose functions are called
with packs, or for one lane after another.

Not supported: joint stops. A run that fails, or that needs too many steps, ends
with its status, and its samples are incomplete.
"""

from __future__ import annotations

from typing import Any

from flexarm.integrate.base import Tolerance
from flexarm.integrate.lanes.contacts import contacts_of_lane, fill_contacts
from flexarm.integrate.lanes.data import LaneDrive, LaneMemory, LaneRuns, StepControl
from flexarm.integrate.memory import AHEAD, EVALUATIONS, NORM, REJECTED, SAMPLES, STEP, STEPS, TIME
from flexarm.integrate.nearness import fix_branches, step_on
from flexarm.integrate.status import DIVERGED, DONE, INERTIA_LOST, PAUSED
from flexarm.integrate.steps import (
    choose_step,
    error_sizes,
    judge_contacts,
    motion_sizes,
    norm_of,
    retry_shorter,
    step_landing,
)
from flexarm.integrate.torque import loads_in, piece_of
from flexarm.kernels.columns import FREE, JOINT_INERTIA
from flexarm.kernels.compilation.cache import apart, inner, merged
from flexarm.kernels.compilation.packs import LANES, PackArray, chosen, fill_lane
from flexarm.kernels.layout import ArmConstants, Loads, Sizes


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


@inner
def arm_of(runs: LaneRuns, k: int) -> int:
    """Return the row of the arm of run k."""
    row: int = min(k, runs.unit.shape[0] - 1)
    return row


@inner
def _fill_constants(constants: ArmConstants, rows: ArmConstants, lane: int, row: int) -> None:
    """Copy the constants of an arm into a lane, as far as the lanes have constants of their own."""
    fill_lane(constants.arm, lane, rows.arm, row)
    fill_lane(constants.body, lane, rows.body, row)
    fill_lane(constants.mode, lane, rows.mode, row)
    fill_lane(constants.centrifugal, lane, rows.centrifugal, row)
    fill_lane(constants.shortening, lane, rows.shortening, row)


@inner
def _fill_loads(loads: Loads, rows: Loads, lane: int, row: int) -> None:
    """Copy the loads of a run into a lane, and their places if the lanes have arms of their own."""
    fill_lane(loads.weight, lane, rows.weight, row)
    fill_lane(loads.lever, lane, rows.lever, row)
    fill_lane(loads.rows, lane, rows.rows, row)
    fill_lane(loads.slopes, lane, rows.slopes, row)
    fill_lane(loads.shortening, lane, rows.shortening, row)
    fill_lane(loads.value, lane, rows.value, row)
    fill_lane(loads.base_acceleration, lane, rows.base_acceleration, row)


@apart
def _begin_run(sizes: Sizes, runs: LaneRuns, memory: LaneMemory, lane: int, k: int) -> None:
    """Put run k into a lane."""
    memory.run[lane] = k
    memory.fresh[lane] = 1
    for level in range(2):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                memory.state.array[level, i, j, lane] = runs.state[k, level, i, j]
    arm = arm_of(runs, k)
    _fill_constants(memory.constants, runs.constants, lane, arm)
    _fill_constants(memory.softened, runs.constants, lane, arm)
    fill_lane(memory.unit, lane, runs.unit, arm)
    _fill_loads(memory.loads, runs.loads, lane, arm)
    fill_contacts(runs, memory, lane, k, arm)
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
def begin_lanes(memory: LaneMemory) -> None:
    """Empty all lanes."""
    for lane in range(LANES):
        memory.run[lane] = -1
        memory.fresh[lane] = 0


@apart
def fill_lanes(
    sizes: Sizes, runs: LaneRuns, memory: LaneMemory, following: int, evaluations: int
) -> tuple[int, int, int]:
    """Put the following runs into empty lanes, and count the evaluations of the next steps.

    Runs that have reached their ``until`` are left out.

    Returns the number of the following run, the number of lanes with a run, and the number of
    those that need the derivative at their time; they are marked in ``memory.accepted``.
    """
    busy = 0
    fresh = 0
    count = runs.status.shape[0]
    for lane in range(LANES):
        if memory.run[lane] < 0:
            while following < count and runs.clock[following, TIME] >= runs.until[following]:
                following += 1
        if memory.run[lane] < 0 and following < count:
            _begin_run(sizes, runs, memory, lane, following)
            following += 1
        if memory.run[lane] >= 0:
            busy += 1
            runs.counts[memory.run[lane], EVALUATIONS] += evaluations + memory.fresh[lane]
        fresh += memory.fresh[lane]
        memory.accepted.array[0, lane] = memory.fresh[lane]
    return following, busy, fresh


@apart
def begin_steps(control: StepControl, drive: LaneDrive, runs: LaneRuns, memory: LaneMemory) -> None:
    """Choose the end of the next step of each lane, and find its piece of the torque."""
    for lane in range(LANES):
        k = memory.run[lane]
        if k < 0:
            continue
        t = runs.clock[k, TIME]
        h = min(runs.clock[k, STEP], control.longest / runs.fastest[k])
        stops = drive.stops[drive.places[k, 4] : drive.places[k, 5]]
        end, h, lands = step_landing(stops, t, h, runs.until[k])
        memory.end[lane] = end
        memory.lands[lane] = lands
        memory.step.array[0, lane] = h
        breaks = drive.breaks[drive.places[k, 0] : drive.places[k, 1]]
        if memory.fresh[lane] == 1:
            memory.piece[lane] = piece_of(breaks, t, False)
            memory.fresh[lane] = 0
        while memory.piece[lane] < breaks.shape[0] - 2 and breaks[memory.piece[lane] + 1] <= t:
            memory.piece[lane] += 1


@inner
def _stage_time(runs: LaneRuns, memory: LaneMemory, lane: int, c: float, ends: bool) -> float:
    """Return the time at the fraction c of a lane's step; ``ends``: exactly at its end."""
    t: float = runs.clock[memory.run[lane], TIME] + c * memory.step.array[0, lane]
    if ends:
        t = memory.end[lane]
    return t


@apart
def _loads_of_lanes(
    drive: LaneDrive, runs: LaneRuns, memory: LaneMemory, c: float, ends: bool, from_left: bool
) -> None:
    """Set the loads and the base acceleration at the fraction c of each lane's step."""
    value: Any = memory.loads.value
    base: Any = memory.loads.base_acceleration
    for lane in range(LANES):
        if memory.run[lane] >= 0:
            t = _stage_time(runs, memory, lane, c, ends)
            loads_in(drive, t, from_left, value.array[:, :, lane], base.array[:, lane])


@merged
def drives_of_lanes(
    sizes: Sizes, drive: LaneDrive, runs: LaneRuns, memory: LaneMemory, c: float, ends: bool,
    from_left: bool,
) -> None:  # fmt: skip
    """Set torques and loads at the fraction c of each lane's step; ``ends``: exactly at its end."""
    for lane in range(LANES):
        k = memory.run[lane]
        if k < 0:
            continue
        t = _stage_time(runs, memory, lane, c, ends)
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
    if drive.factor_coefficients.shape[2] > 0:
        _loads_of_lanes(drive, runs, memory, c, ends, from_left)


@inner
def copy_packs(sizes: Sizes, source: PackArray, target: PackArray) -> None:
    for level in range(2):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                target[level, i, j] = source[level, i, j]


@inner
def keep_first_stage(sizes: Sizes, memory: LaneMemory, stage: int) -> None:
    """Copy ``stages[stage]`` to the first stage in the lanes marked in ``accepted``."""
    for level in range(2):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                memory.stages[0, level, i, j] = chosen(
                    memory.accepted[0],
                    memory.stages[stage, level, i, j],
                    memory.stages[0, level, i, j],
                )


@apart
def measure_steps(
    sizes: Sizes, tolerance: Tolerance, control: StepControl, memory: LaneMemory
) -> None:
    """Compute the errors of a controlled step, or the plausibility of a fixed one.

    Also compute the lowest articulated inertia of the free joints at the end of the step.
    """
    h = memory.step[0]
    constants = memory.constants
    deepest = -memory.work.body[0, JOINT_INERTIA]
    deepest = chosen(constants.body[0, FREE], deepest, -1.0)
    for i in range(1, len(sizes.bodies)):
        depth = chosen(constants.body[i, FREE], -memory.work.body[i, JOINT_INERTIA], -1.0)
        deepest = max(deepest, depth)
    memory.norm[3] = -deepest
    if control.adaptive:
        worst, low, check = error_sizes(
            sizes, tolerance, memory.state, memory.new, memory.stages, control.error, h
        )
        memory.norm[0] = worst
        memory.norm[1] = low
        memory.norm[2] = check
    else:
        largest, check = motion_sizes(sizes, tolerance, memory.new, h)
        memory.norm[0] = largest
        memory.norm[1] = 0.0
        memory.norm[2] = check


@apart
def judge_steps(sizes: Sizes, control: StepControl, runs: LaneRuns, memory: LaneMemory) -> bool:
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
        if control.adaptive:
            runs.clock[k, NORM], runs.clock[k, AHEAD] = norm, 0.0
            if not norm <= 1.0:
                if control.error[0, control.error.shape[1] - 1] == 0.0:
                    runs.counts[k, EVALUATIONS] -= 1  # single runs evaluate accepted ends only
                status = retry_shorter(
                    runs.clock[k], runs.counts[k], control.order, memory.step.array[0, lane],
                    runs.fastest[k],
                )  # fmt: skip
        elif not norm <= 1.0:
            status = DIVERGED
        if status == DONE and memory.loads.contacts.body.shape[0] > 0:
            own, h = contacts_of_lane(memory, lane), memory.step.array[0, lane]
            clock, counts = runs.clock[k], runs.counts[k]
            status = judge_contacts(own, clock, counts, h, control.adaptive)
            if status == DONE:
                step_on(own)
        if status == DONE and not memory.norm.array[3, lane] > 0.0:
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
def end_steps(
    sizes: Sizes, control: StepControl, runs: LaneRuns, memory: LaneMemory, max_steps: int
) -> None:
    """Make the ends of the accepted steps the states of their lanes, and choose the next steps."""
    stages = control.error.shape[1] - 1
    for level in range(2):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                memory.state[level, i, j] = chosen(
                    memory.accepted[0], memory.new[level, i, j], memory.state[level, i, j]
                )
    keep_first_stage(sizes, memory, stages)
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
            if control.adaptive:
                choose_step(runs.clock[k], memory.step.array[0, lane], control.order, lands)
                own = contacts_of_lane(memory, lane)
                lands = fix_branches(own, runs.clock[k], runs.counts[k]) or lands
            if t >= runs.until[k]:
                _end_run(sizes, runs, memory, lane, DONE)
                continue
            if lands:  # a force may change here, and the last slope is the one from the left
                memory.fresh[lane] = 1
        if runs.counts[k, STEPS] + runs.counts[k, REJECTED] >= max_steps:
            _end_run(sizes, runs, memory, lane, PAUSED)
