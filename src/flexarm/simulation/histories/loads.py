"""Loads, base acceleration and prescribed joint motion over time, as piecewise cubics."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.actions import Environment, parts_of
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import check_joint
from flexarm.base.arguments import check_choice, check_function, check_times, warn_of_degrees
from flexarm.base.errors import InputError, Problem, check_array, public_call, shown
from flexarm.base.late import interpolate
from flexarm.base.user_functions import call
from flexarm.integrate.base import FloatArray
from flexarm.kernels.columns import FREE
from flexarm.kernels.layout import ArmConstants, Contacts, Loads
from flexarm.model import AccelerationTable, FactorTable, Load
from flexarm.model.environment import is_table
from flexarm.model.quantities import Number
from flexarm.motion import Motion
from flexarm.simulation.histories.piecewise import PiecewiseCubic, Row, function_history

#: Boundary conditions of a table of angles, and their names in SciPy.
ENDS = {"rest": "clamped", "free": "not-a-knot"}


@dataclass(frozen=True)
class PrescribedAngle:
    """A joint angle as a function of time, with its derivatives.

    Args:
        angle, rate, acceleration: functions of time (s): rad, rad/s, rad/s^2 of the relative
            joint angle. They must be consistent, because the simulation starts from angle and rate
            and integrates the acceleration.
        breaks: times at which the acceleration jumps or has a kink.
    """

    angle: Callable[[float], float]
    rate: Callable[[float], float]
    acceleration: Callable[[float], float]
    breaks: tuple[float, ...] = ()

    @public_call
    def __post_init__(self) -> None:
        for name in ("angle", "rate", "acceleration"):
            check_function(name, getattr(self, name))
        check_array("breaks", self.breaks, (-1,))

    @classmethod
    @public_call
    def hold(cls, angle: Number) -> PrescribedAngle:
        """Lock the joint at an angle (rad)."""
        nothing = partial(constant, 0.0)
        return cls(partial(constant, angle), nothing, nothing)

    @classmethod
    @public_call
    def table(cls, times: ArrayLike, angles: ArrayLike, ends: str = "rest") -> PrescribedAngle:
        """Return the cubic spline through a table of angles, with a continuous acceleration.

        Args:
            times: (k,) s, increasing, at least two.
            angles: (k,) rad.
            ends: "rest": the joint is at rest at both ends and keeps its angle beyond them;
                "free": the rates there follow from the angles, and the run must end within them.

        Raises:
            InputError: if the shapes do not match, the times do not increase, or ``ends`` is
                unknown; during a run, if it exceeds a table with free ends.
        """
        knots = check_array("times", times, (-1,))
        values = check_array("angles", angles, (knots.size,))
        warn_of_degrees(angles=values)
        check_choice("ends", ends, ENDS)
        if knots.size < 2 or np.any(np.diff(knots) <= 0.0):
            rule = "be at least two, in increasing order"
            raise InputError(Problem("times", rule, shown(knots.tolist())))
        spline = interpolate.CubicSpline(knots, values, bc_type=ENDS[ends])
        angle, rate, acceleration = (_SplinePart(spline, k, ends == "rest") for k in range(3))
        return cls(angle, rate, acceleration, tuple(knots.tolist()))


def constant(value: Any, t: float) -> Any:
    """Return the same value at every time; defined in the module so that it can be pickled."""
    return value


@dataclass(frozen=True, eq=False)
class _SplinePart:
    """Spline or one of its derivatives as a function of a time or an array of times."""

    vectorized: ClassVar[bool] = True

    spline: Any
    order: int
    rests: bool  # whether the spline is constant beyond its ends; otherwise undefined there

    def __call__(self, t: ArrayLike) -> Any:
        times = check_times("t", t)
        first, last = self.spline.x[0], self.spline.x[-1]
        margin = 1e-9 * (last - first)
        if not self.rests and (np.min(times) < first - margin or np.max(times) > last + margin):
            rule = "cover the run from 0 to its end with ends='free'"
            raise InputError(Problem("times", rule, f"{first:.9g} to {last:.9g}"))
        values = self.spline(np.clip(times, first, last), self.order)
        if self.rests and self.order:
            values = np.where((times >= first) & (times < last), values, 0.0)
        return values


Prescribed = Mapping[int, PrescribedAngle | Motion]


def prescribe(
    arm: Arm,
    prescribed: Prescribed,
    state: FloatArray,
    history: PiecewiseCubic,
    duration: float,
    relative: float,
    breaks: ArrayLike = (),
    spacing: float | None = None,
) -> PiecewiseCubic:
    """Replace torques by prescribed accelerations, and set the initial motion in ``state``."""
    for joint, motion in prescribed.items():
        index = check_joint(arm, "each key of prescribed", joint)
        own = _of_joint(motion, index, f"prescribed[{joint}]")
        _check_derivatives(own, f"prescribed[{joint}]", duration)
        body = arm.assembly.joint_body[index]
        name = f"prescribed[{joint}]"
        start = [call(f"{name}.angle", own.angle, 0.0), call(f"{name}.rate", own.rate, 0.0)]
        state[:, body, 0] = check_array(name, start, (2,))
        name = f"prescribed[{joint}].acceleration"
        known = np.concatenate([own.breaks, check_array("breaks", breaks, (-1,))])
        row = _row(motion, own, index)
        column = function_history(row, duration, 1, relative, known, name, spacing=spacing)
        history = history.with_column(index, column)
    return history


def _row(
    motion: PrescribedAngle | Motion, own: PrescribedAngle, index: int
) -> Callable[[float], ArrayLike]:
    """Return the joint's acceleration as a function to (1,), vectorized if the motion is."""
    if isinstance(motion, PrescribedAngle):
        return Row(own.acceleration)

    def rows(t: ArrayLike) -> FloatArray:
        return motion.joint_acceleration(t)[..., index : index + 1]

    rows.vectorized = True  # type: ignore[attr-defined]
    return rows


def _of_joint(motion: PrescribedAngle | Motion, index: int, name: str) -> PrescribedAngle:
    if isinstance(motion, PrescribedAngle):
        return motion
    if not isinstance(motion, Motion):
        hint = "Use fa.PrescribedAngle.hold(angle) to lock a joint."
        raise InputError(Problem(name, "be a PrescribedAngle or a motion", shown(motion), hint))

    def part(of: Callable[[float], ArrayLike]) -> Callable[[float], float]:
        return lambda t: float(np.asarray(of(t))[index])

    motions = motion.joint_angle, motion.joint_rate, motion.joint_acceleration
    angle, rate, acceleration = map(part, motions)
    return PrescribedAngle(angle, rate, acceleration, tuple(motion.breaks))


def _check_derivatives(own: PrescribedAngle, name: str, duration: float) -> None:
    """Raise if a rate or an acceleration is not the derivative of the angle or the rate.

    The derivatives are estimated by central differences over 1e-5 of the run, at a few times away
    from breaks. Their error is far below the tolerance of 1 %.
    """
    step = 1e-5 * duration
    times = [
        t
        for t in duration * np.linspace(0.031, 0.957, 9)
        if all(abs(t - b) > 2.0 * step for b in own.breaks)
    ]
    pairs = (("rate", own.angle, own.rate), ("acceleration", own.rate, own.acceleration))
    for kind, value, slope in pairs:
        values = [
            [call(name, value, t - step), call(name, value, t + step), call(name, slope, t)]
            for t in times
        ]
        if not values:
            continue
        before, after, slopes = check_array(f"{name}.{kind}", values, (-1, 3)).T
        differences = (after - before) / (2.0 * step)
        rounding = 1e-9 * float(np.max(np.abs(before))) / duration
        if np.max(np.abs(differences - slopes)) > 0.01 * np.max(np.abs(differences)) + rounding:
            worst = int(np.argmax(np.abs(differences - slopes)))
            rule = f"be the derivative ({differences[worst]:.6g} at t = {times[worst]:.6g} s)"
            raise InputError(Problem(f"{name}.{kind}", rule, shown(float(slopes[worst]))))


def constants_with(arm: Arm, prescribed: Sequence[int]) -> ArmConstants:
    """Return the constants of a run, with joints, by number from 1, marked as not free.

    They are those of this run alone if friction holds joints, because a run marks those that stick.
    """
    constants = arm.assembly.run_constants
    if not prescribed and not arm.assembly.has_sticking:
        return constants
    body = constants.body.copy()
    body[arm.assembly.joint_body[np.isin(arm.joint_numbers, prescribed)], FREE] = 0.0
    return constants._replace(body=body)


@dataclass(frozen=True, eq=False)
class LoadHistory:
    """Placed loads of a run and their factors over time."""

    owners: list[Load]  # the load that each placed part belongs to
    placed: Loads  # the parts, placed on the arm
    factors: PiecewiseCubic  # factors (parts,) and base acceleration (2,) over time, in one row

    def stops_with(self, torque: PiecewiseCubic) -> FloatArray:
        """Return the times (s) at which the loads or a torque history are not smooth, sorted."""
        stops = np.concatenate([torque.stops, self.factors.stops])
        return np.unique(stops) if stops.size else stops


def load_history(
    arm: Arm,
    environment: Environment,
    duration: float,
    relative: float,
    contacts: Contacts | None = None,
    breaks: ArrayLike = (),
    spacing: float | None = None,
    known: dict[tuple[int, ...], PiecewiseCubic] | None = None,
) -> LoadHistory:
    """Place the loads and approximate their time dependence; tables are represented exactly."""
    loads, base_acceleration = environment.loads, _base(environment.base_acceleration)
    moving = callable(base_acceleration) or isinstance(base_acceleration, AccelerationTable)
    still = Environment(loads, None if moving else base_acceleration)
    placed = still.placed(arm)
    if contacts is not None:
        placed = placed._replace(contacts=contacts)
    owners = parts_of(arm, loads)
    known, key = {} if known is None else known, tuple(map(id, owners))
    if not moving and all(load.factor is None for load in loads):
        known.setdefault(key, PiecewiseCubic.constant(np.zeros(0)))
    if key in known:
        return LoadHistory(owners, placed, known[key])
    if callable(base_acceleration):
        name = "base_acceleration"
        check_function(name, base_acceleration)
        base = function_history(base_acceleration, duration, 2, relative, breaks, name, spacing)
    elif isinstance(base_acceleration, AccelerationTable):
        base = interpolated(base_acceleration)
    else:
        base = PiecewiseCubic.constant(placed.base_acceleration)

    def factor(load: Load) -> PiecewiseCubic:
        """Return the factor of a load over time, in one column."""
        if load.factor is None:
            return PiecewiseCubic.constant(np.ones(1))
        if isinstance(load.factor, FactorTable):
            return interpolated(load.factor)
        assert callable(load.factor)
        row, name = Row(load.factor), "Load.factor"
        return function_history(row, duration, 1, relative, breaks, name, spacing)

    followed = {id(load): factor(load) for load in loads}
    columns = [followed[id(load)] for load in owners]
    known[key] = PiecewiseCubic.joined([*columns, base])
    return LoadHistory(owners, placed, known[key])


def _base(given: Any) -> Any:
    """Return the acceleration of the base with a pair (times, values) as a checked table."""
    if not is_table(given):
        return given
    try:
        return AccelerationTable(times=given[0], values=given[1])
    except InputError as error:
        own = "base_acceleration"
        named = (replace(p, where="", name=f"{own}.{p.name}") for p in error.problems)
        raise InputError(*named) from None


def interpolated(table: FactorTable | AccelerationTable) -> PiecewiseCubic:
    """Interpolate a table linearly, in one column, or in two for an acceleration."""
    times = np.array(table.times)
    return PiecewiseCubic.table(times, np.array(table.values).reshape(times.size, -1))
