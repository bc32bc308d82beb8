"""Motions, references and torques of scenarios: those of the flexible arm or of the rigid one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.errors import (
    AccuracyWarning,
    FlexarmError,
    LargeDeflectionWarning,
    warn_caller,
    without_warnings,
)
from flexarm.cases.scenario.file_errors import problems_under
from flexarm.control.design.input_shaping import shaped
from flexarm.integrate.base import FloatArray
from flexarm.linear.bent_references import (
    PressedMotion,
    pressed_motion,
    quasi_static_reference,
)
from flexarm.model import Scenario, drives
from flexarm.model.arm.spec import UNDRIVEN
from flexarm.model.scenarios.motions import ForceTable, PlainMotionSpec, PressedMotionSpec
from flexarm.model.surfaces import RoundWall, Surface, Wall
from flexarm.motion import (
    Motion,
    TimingLaw,
    circle_motion,
    joint_motion,
    line_motion,
    quintic,
    rigid_torque,
    smoothed,
    spline_motion,
    via_point_motion,
)
from flexarm.motion.dynamics.dynamics_along import driven_of
from flexarm.simulation.inversion.tip_inversion import tip_inversion
from flexarm.simulation.inversion.torques import flexible_torque

#: Functions of the Python interface by kind; their arguments have the names of the keys.
MOTION_FUNCTIONS: dict[str, Callable[..., Motion]] = {
    "line": line_motion,
    "via_points": via_point_motion,
    "spline": spline_motion,
    "circle": circle_motion,
    "joint": joint_motion,
}

#: Types of motion that a scenario may request.
TaskReference = Motion | PressedMotion


def motion_of(arm: Arm, scenario: Scenario) -> TaskReference | None:
    """Create the motion of a scenario."""
    spec = scenario.motion
    if isinstance(spec, PressedMotionSpec):
        with problems_under("path"):
            path = _plain(arm, spec.path)
        force = spec.force
        surface = scenario.contacts[0].surface if scenario.contacts else None
        return pressed_motion(
            arm,
            path,
            _over_time(force) if isinstance(force, ForceTable) else force,
            spec.normal if spec.normal is not None else _normal(surface, path),
            duration=max(scenario.run.duration, path.end_time),
            friction=spec.friction,
            interval=spec.interval,
        )
    return None if spec is None else _plain(arm, spec)


def _plain(arm: Arm, spec: PlainMotionSpec) -> Motion:
    make = MOTION_FUNCTIONS[spec.kind]
    around = {"kind", "shaping", "smoothing"}
    motion = make(arm, **{k: getattr(spec, k) for k in type(spec).model_fields.keys() - around})
    if spec.shaping is not None:
        options = {name: getattr(spec.shaping, name) for name in type(spec.shaping).model_fields}
        with problems_under("shaping"):
            motion = shaped(motion, arm, **options)
    if spec.smoothing is not None:
        with problems_under("smoothing"):
            motion = smoothed(motion, spec.smoothing.duration, spec.smoothing.window)
    return motion


def _over_time(table: ForceTable) -> Callable[[float], float]:
    """Return the force over time, with a quintic between two values and zero slope at each."""
    # The deflection of the arm follows the force: a kink of the force is a jump of the joint rates.
    return partial(_eased, np.array(table.times), np.array(table.values), quintic())


def _eased(times: FloatArray, values: FloatArray, law: TimingLaw, t: float) -> float:
    if len(times) == 1:
        return float(values[0])
    k = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2))
    part = float(law((t - times[k]) / (times[k + 1] - times[k])).s)
    return float(values[k] + part * (values[k + 1] - values[k]))


def _normal(surface: Surface | None, path: Motion) -> Any:
    """Return the normal of a surface: a direction, or for a circle a function along the path."""
    if isinstance(surface, Wall):
        return surface.normal
    assert isinstance(surface, RoundWall)  # checked when the file is read
    return partial(_away_from, np.array(surface.center), -1.0 if surface.inside else 1.0, path)


def _away_from(center: FloatArray, sign: float, path: Motion, t: float) -> FloatArray:
    return np.asarray(sign * (path.tip(t) - center))


#: Function of time (s) that returns torques (joints,), N m.
TorqueFunction = Callable[[Any], Any]
#: Orders of `quasi_static_reference` by the kind of a reference or drive.
_ORDERS = {"static": 0, "quasi_static": 1, "integral_manifold": 2}


@dataclass(frozen=True, eq=False)
class Followed:
    """Reference of a drive along a motion."""

    motion: TaskReference | None  # the reference, or None without a motion
    #: "static", "quasi_static", "integral_manifold", "tip_inversion", "rigid", "pressed" or "none";
    #: after "rigid" the reason, if the flexible reference does not exist
    kind: str = "none"
    torque: TorqueFunction | None = None  # torque of the reference, or None
    #: coordinates (dof,) of the arm at rest at the start of a flexible reference
    initial: FloatArray | None = None


def reference_of(arm: Arm, drive: drives.ControllerDrive, motion: TaskReference | None) -> Followed:
    """Return the reference that a controller follows along a motion."""
    if motion is None:
        return Followed(None)
    if isinstance(motion, PressedMotion):
        return Followed(motion, "pressed", motion.holding_torque, motion.initial)
    kind = drive.reference_kind
    if kind in (None, "sag"):
        if arm.dof == arm.n_joints or (kind == "sag" and not any(arm.spec.gravity)):
            return _rigid(arm, motion, followed=True)
        try:
            return _quasi_static(arm, motion, "quasi_static" if kind is None else "static")
        except FlexarmError as error:
            if any(arm.spec.gravity):
                text = "the drive keeps the sag of the links, because no static reference exists"
                warn_caller(f"{text}: {error}", AccuracyWarning)
            return _rigid(arm, motion, f": {error}", followed=True)
    with problems_under("reference"):
        if kind in _ORDERS:
            return _quasi_static(arm, motion, kind)
        if kind == "tip_inversion":
            inverse = tip_inversion(arm, motion)
            return Followed(inverse.reference, kind, inverse.torque, inverse.initial)
    return _rigid(arm, motion, followed=True)


def torque_of(arm: Arm, drive: Any, motion: Motion) -> Followed:
    """Return the torque of a drive without feedback, with the motion that it is for.

    Raises:
        InputError, SimulationError, InversionError: if the torque does not exist.
    """
    match drive:
        case drives.RigidInverseDynamicsDrive():
            return _rigid(arm, motion)
        case drives.QuasiStaticDrive() | drives.IntegralManifoldDrive():
            return _quasi_static(arm, motion, drive.kind)
        case drives.FlexibleTorqueDrive():
            torque = flexible_torque(arm, motion)
            return Followed(motion, drive.kind, torque, torque.initial)
    assert isinstance(drive, drives.TipInversionDrive)
    options = {name: getattr(drive, name) for name in type(drive).model_fields if name != "kind"}
    inverse = tip_inversion(arm, motion, **options)
    return Followed(motion, drive.kind, inverse.torque, inverse.initial)


def _rigid(arm: Arm, motion: Motion, reason: str = "", followed: bool = False) -> Followed:
    """Return a motion with its rigid torque; without it if a controller only follows the motion of
    an arm whose joints do not determine the rigid posture, or do not close its loops."""
    if followed and not driven_of(motion) and not set(UNDRIVEN).isdisjoint(arm.spec.features):
        return Followed(motion, f"rigid{reason}")
    return Followed(motion, f"rigid{reason}", rigid_torque(arm, motion))


def _quasi_static(arm: Arm, motion: Motion, kind: str = "quasi_static") -> Followed:
    with without_warnings(LargeDeflectionWarning):  # the run warns of its states
        bent = quasi_static_reference(arm, motion, order=_ORDERS[kind])
    return Followed(bent, kind, bent.torque, bent.initial)
