"""An optimal motion with its torque, and the errors that remain in the full model."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import FlexarmError, LargeDeflectionWarning
from flexarm.linear import equilibrium, modes
from flexarm.motion.dynamics.dynamics_along import MotionTorque
from flexarm.motion.geometry.inverse_kinematics import RigidChain, rigid_chain
from flexarm.motion.motion import JointState, TabulatedMotion, quintic_table
from flexarm.planning.optimize.task import UNITS, Bound, Plan, Quantities, Task
from flexarm.simulation.batch.reductions import Reduction, reduced
from flexarm.simulation.calls.result import make_result
from flexarm.simulation.calls.run import simulate
from flexarm.simulation.histories.piecewise import PiecewiseCubic

if TYPE_CHECKING:
    import xarray as xr
    from scipy.interpolate import PPoly


@dataclass(frozen=True, eq=False)
class Remaining:
    """Errors of an optimal motion in the simulation of the full model, without feedback.

    Attributes:
        residual_vibration: largest distance of the tip from its mean after the end, m.
        tip_error: distance of that mean from the tip at rest, m.
        joint_error: largest distance of a joint from its last angle at the end, rad.
        excess: for each limit the largest excess of a value during the motion, in the unit of the
            limit; negative if all values are within it.
    """

    residual_vibration: float
    tip_error: float
    joint_error: float
    excess: dict[str, float]

    def __str__(self) -> str:
        lines = [
            f"residual vibration of the tip: {self.residual_vibration:.3g} m",
            f"mean tip after the end: {self.tip_error:.3g} m from its goal",
            f"joints at the end: within {self.joint_error:.3g} rad",
        ]
        for name, excess in self.excess.items():
            side = "exceeds its limit" if excess > 0.0 else "within its limit"
            lines.append(f"{name}: {side} by {abs(excess):.3g}{UNITS[name]}")
        return "\n".join(lines)


@dataclass(frozen=True, eq=False)
class OptimalTorque(MotionTorque):
    """Torque of an optimal motion, callable with the time; before and after, it holds the arm."""

    motion: OptimalMotion  # the motion
    history: PiecewiseCubic = field(repr=False)  # the torque as piecewise cubics

    def _at(self, times: FloatArray) -> FloatArray:
        duration = self.motion.duration
        return self.history.at(np.clip(times, -duration, 2.0 * duration))


@dataclass(frozen=True, eq=False)
class OptimalMotion(TabulatedMotion):
    """An optimal motion: joint angles over time with their torque, from rest to rest.

    It is a motion like those of `joint_motion`: a reference of controllers, and of `simulate`.

    Attributes:
        arm: the arm.
        objective: "time", "energy" or "vibration".
        duration: s.
        initial, final: (dof,) coordinates at rest before and after the motion.
        modes: number of the lowest vibrations that are at rest at the end.
        iterations: iterations of IPOPT.
        run: result of `simulate` for the full model under the torque, to some time after the end.
        remaining: what remains of vibration and of errors there, and the limits.
    """

    #: Entries of ``flexarm.citation``.
    references: ClassVar[str] = "Betts2010 WaechterBiegler2006 AnderssonEtAl2019"

    arm: Arm = field(repr=False)
    objective: str
    duration: float
    initial: FloatArray = field(repr=False)
    final: FloatArray = field(repr=False)
    modes: int
    iterations: int
    run: xr.Dataset = field(repr=False)
    remaining: Remaining = field(repr=False)
    _plan: Plan = field(repr=False)
    _history: PiecewiseCubic = field(repr=False)
    _table: PPoly = field(repr=False)
    chain: RigidChain = field(repr=False)
    start_time: float = 0.0

    def __repr__(self) -> str:
        return (
            f"<flexarm.OptimalMotion: least {self.objective}, {self.duration:.4g} s, "
            f"{self.joints} joints, {self.intervals} intervals, residual vibration "
            f"{self.remaining.residual_vibration:.2g} m>"
        )

    @property
    def intervals(self) -> int:
        """Number of intervals of the collocation."""
        return self._plan.intervals

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times of the nodes, s."""
        return tuple(self._plan.times.tolist())

    @property
    def torque(self) -> OptimalTorque:
        """Torque of the motion, for ``simulate``: (joints,) N m as a function of time."""
        return OptimalTorque(self, self._history)


class OptimizationError(FlexarmError, RuntimeError):
    """No optimal motion was found.

    Attributes:
        reason: status of IPOPT, or the limit that the full model violates.
        hint: a sentence with a remedy.
        last: the last iterate, an ``xarray.Dataset`` over time; it is not a solution.
    """

    def __init__(self, reason: str, hint: str, last: xr.Dataset) -> None:
        super().__init__(reason, hint, last)
        self.reason = reason
        self.hint = hint
        self.last = last

    def __str__(self) -> str:
        return f"no optimal motion found: {self.reason}. {self.hint}"


def last_iterate(task: Task, plan: Plan) -> xr.Dataset:
    """Return coordinates, joint angles and torques at the nodes of a plan, as a dataset."""
    torque = np.concatenate([plan.torque[:, 0], plan.torque[-1:, 1]])
    joint = task.arm.joint_index
    channels = {
        "joint_angle": plan.q[:, joint],
        "joint_rate": plan.rate[:, joint],
        "torque": torque,
        "q": plan.q,
        "qd": plan.rate,
    }
    return make_result(task.arm, plan.times, channels, {"duration": plan.duration})


def tabulated(task: Task, plan: Plan) -> tuple[PPoly, RigidChain]:
    """Return the joint angles of a plan as polynomials of degree 5, and the rigid chain.

    Accelerations at the nodes are those of the equations of motion.
    """
    arm, joint = task.arm, task.arm.joint_index
    starts = plan.q[:-1], plan.rate[:-1], plan.torque[:, 0]
    ends = plan.q[1:], plan.rate[1:], plan.torque[:, 1]
    acceleration = np.array(
        [
            [arm.forward_dynamics(*state)[joint] for state in zip(*side, strict=True)]
            for side in (starts, ends)
        ]
    )
    angle, rate = plan.q[:, joint], plan.rate[:, joint]
    first = JointState(angle[:-1], rate[:-1], acceleration[0])
    last = JointState(angle[1:], rate[1:], acceleration[1])
    rests = np.array([task.start.q[joint], task.end.q[joint]])
    return quintic_table(plan.times, first, last, rests), rigid_chain(arm)


#: Simulated time after the end: periods of the slowest vibration with locked joints, and limits of
#: it as fractions of the duration.
_PERIODS, _SHORTEST, _LONGEST = 3.0, 0.2, 2.0
#: Samples per interval, and per period of the fastest vibration, at which the limits are checked.
_SAMPLES = 10


def simulated(task: Task, plant: Arm, plan: Plan) -> xr.Dataset:
    """Simulate the full model under the torque of a plan, and for some time after its end."""
    joint_angles = task.arm.joint_angles(task.start.q)
    hertz = modes(plant, task.arm.joint_angles(task.end.q), joints="locked").frequency_hz
    slowest = float(np.min(hertz[hertz > 0.0], initial=np.inf))
    after = float(np.clip(_PERIODS / slowest, _SHORTEST * plan.duration, _LONGEST * plan.duration))
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
