"""First guess of an optimal motion: a shaped motion of the joints, followed exactly."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import LargeDeflectionWarning
from flexarm.control.design.input_shaping import shaped
from flexarm.motion import Motion, joint_motion, rigid_torque
from flexarm.planning.optimize.plan import GAUSS, Plan
from flexarm.planning.optimize.task import Task
from flexarm.simulation.calls.run import simulate

if TYPE_CHECKING:
    import xarray as xr

#: Fraction of the limits of torques and rates that the guess uses.
_USED = 0.9
#: Modes for which it is shaped, and the least part of the duration that is left for the motion.
_SHAPED, _LEAST = 2, 0.4
#: Factors of the search for a duration, and its largest number of steps.
_LONGER, _SHORTER, _STEPS = 1.4, 0.9, 80
#: Samples of the motion per interval of the plan.
_SAMPLES = 20


def straight_motion(task: Task) -> Motion:
    """Return a smooth motion of the joints that nearly keeps limits of torques and joint rates."""
    return _quintic(task, _shortest(task) if task.duration is None else task.duration)


def shaped_guess(task: Task, straight: Motion) -> Motion:
    """Return the straight motion, shaped; if the duration is given, after making it shorter."""
    longer = _shaped(task, straight)
    if task.duration is None:
        return longer
    left = 2.0 * straight.duration - longer.duration
    return _shaped(task, _quintic(task, left)) if left > _LEAST * task.duration else straight


def _quintic(task: Task, duration: float) -> Motion:
    start, end = (task.arm.joint_angles(rest.q) for rest in (task.start, task.end))
    return joint_motion(task.arm, start, end, duration)


def _shaped(task: Task, motion: Motion) -> Motion:
    count = min(len(task.elastic), _SHAPED)
    return shaped(motion, task.arm, "zv", modes=count) if count else motion


def _shortest(task: Task) -> float:
    """Return a duration for which the torques of the rigid arm are nearly within their limits."""
    most = [b.upper for b in task.bounds if b.name == "joint_rate"]

    def within(duration: float) -> bool:
        motion = _quintic(task, duration)
        times = np.linspace(0.0, duration, 50)
        torque = np.abs(rigid_torque(task.arm, motion)(times))
        rate = np.abs(motion.joint_rate(times))
        fast = any(np.any(rate > _USED * limit) for limit in most)
        return not fast and not np.any(torque > _USED * task.torque)

    duration = 1.0
    for _ in range(_STEPS):
        if within(duration):
            break
        duration *= _LONGER
    for _ in range(_STEPS):
        if not within(_SHORTER * duration):
            break
        duration *= _SHORTER
    return duration


def plan_of(task: Task, motion: Motion, intervals: int) -> Plan:
    """Return the plan in which the motors follow a motion, by a simulation of the arm."""
    from scipy.interpolate import CubicSpline

    arm, begin, duration = task.arm, motion.start_time, motion.duration
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LargeDeflectionWarning)  # only the result matters
        run = simulate(
            arm,
            motion.end_time,
            prescribed={int(number): motion for number in arm.joint_numbers},
            initial=_on(task, motion),
            rate=_SAMPLES * intervals / duration,
            progress=False,
        )
    times = run.time.values
    torque = CubicSpline(times, run.torque.values)
    at_nodes = torque(begin + duration * np.linspace(0.0, 1.0, intervals + 1))
    ends = np.stack([at_nodes[:-1], at_nodes[1:]], axis=1)
    if not task.continuous:
        ends[:] = ends.mean(axis=1, keepdims=True)
    return Plan(duration, *states_of(run, begin, duration, intervals), ends)


def states_of(
    run: xr.Dataset, begin: float, duration: float, intervals: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return q, dq/ds at the nodes and d2q/ds2 at the stages of a plan, from a simulation.

    Args:
        begin, duration: of the plan in the simulation, s.
    """
    from scipy.interpolate import CubicHermiteSpline, CubicSpline

    times = run.time.values
    state = CubicHermiteSpline(times, run.q.values, run.qd.values)
    rate = CubicSpline(times, run.qd.values)
    nodes = begin + duration * np.linspace(0.0, 1.0, intervals + 1)
    stages = (nodes[:-1, None] + duration / intervals * GAUSS.c).ravel()
    curve = rate(stages, 1).reshape(intervals, len(GAUSS.c), -1)
    return state(nodes), duration * rate(nodes), duration**2 * curve


def _on(task: Task, motion: Motion) -> FloatArray:
    """Return the coordinates of the start, with the joints where the motion begins."""
    q = task.start.q.copy()
    q[task.arm.joint_index] = motion.joint_angle(0.0)
    return q
