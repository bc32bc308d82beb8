"""Simulation of a plan with the full model, and the errors that remain there."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import LargeDeflectionWarning
from flexarm.linear import equilibrium, modes
from flexarm.planning.optimize.limits import Bound, Quantities
from flexarm.planning.optimize.plan import Plan
from flexarm.planning.optimize.solution import Remaining
from flexarm.planning.optimize.task import Task
from flexarm.simulation.batch.reductions import Reduction, reduced
from flexarm.simulation.calls.run import simulate

if TYPE_CHECKING:
    import xarray as xr

#: Simulated time after the end: periods of the slowest vibration with locked joints, and limits of
#: it as fractions of the duration.
_PERIODS, _SHORTEST, _LONGEST = 3.0, 0.2, 2.0
#: Samples per interval, and per period of the fastest vibration, at which the limits are checked.
_SAMPLES = 10


def simulated(task: Task, plant: Arm, plan: Plan) -> xr.Dataset:
    """Simulate the full model under the torque of a plan, and for some time after its end."""
    joint_angles = task.arm.joint_angles(task.start.q)
    after = _settling(task, plant, plan.duration)
    periods = np.max(task.vibrations, initial=0.0) * plan.duration / (2.0 * np.pi)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LargeDeflectionWarning)  # once, for the last plan
        return simulate(
            plant,
            plan.duration + after,
            torque=plan.torque_history(task.start.torque, task.end.torque),
            initial=equilibrium(plant, joint_angles).q,
            rate=_SAMPLES * max(plan.intervals, int(np.ceil(periods))) / plan.duration,
            progress=False,
        )


def excess_of(bound: Bound, run: xr.Dataset, duration: float) -> FloatArray:
    """Return the largest excess (k,) of a bound during the motion; negative within it."""
    moving = run.sel(time=slice(None, duration * (1.0 + 1e-9)))
    strain = moving.strain.values.T if "strain" in moving else np.zeros((0, moving.time.size))
    state = Quantities(
        moving.joint_angle.values.T, moving.joint_rate.values.T, strain, moving.tip.values.T
    )
    return bound.excess(np.array(bound.value(state)))


def remaining(task: Task, plant: Arm, plan: Plan, run: xr.Dataset) -> Remaining:
    """Return what remains of vibration and of errors in a run."""
    after = run.time.values >= plan.duration
    vibration = Reduction("residual", "tip", after=plan.duration)
    angles = task.arm.joint_angles(task.end.q)
    goal = plant.tip(equilibrium(plant, angles).q)[:2]
    at_end = run.joint_angle.values[after][0] - angles
    excess = {b.name: float(np.max(excess_of(b, run, plan.duration))) for b in task.bounds}
    if np.any(np.isfinite(task.torque)):
        excess["torque"] = float(np.max(np.abs(plan.torque).max(axis=(0, 1)) - task.torque))
    if task.continuous:
        rate = np.abs(np.diff(plan.torque, axis=1)).max(axis=(0, 1)) / np.diff(plan.times)[0]
        excess["torque_rate"] = float(np.max(rate - task.torque_rate))
    return Remaining(
        float(reduced(vibration, run.time.values, {"tip": run.tip.values})),
        float(np.hypot(*(run.tip.values[after].mean(axis=0) - goal))),
        float(np.abs(at_end).max()),
        excess,
    )


def _settling(task: Task, plant: Arm, duration: float) -> float:
    """Return the simulated time after the end, s."""
    hertz = modes(plant, task.arm.joint_angles(task.end.q), joints="locked").frequency_hz
    slowest = float(np.min(hertz[hertz > 0.0], initial=np.inf))
    return float(np.clip(_PERIODS / slowest, _SHORTEST * duration, _LONGEST * duration))
