"""Controllers of scenario files; the keys of a drive are the arguments of the class."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from inspect import Parameter, signature
from typing import Any

from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem
from flexarm.cases.scenario.file_errors import problems_under
from flexarm.cases.scenario.initial_state import Start, with_holding
from flexarm.cases.scenario.references import Followed, torque_of
from flexarm.control.contract.base import Controller
from flexarm.control.filters.estimator import StateEstimator
from flexarm.control.filters.extended_kalman import ExtendedKalmanFilter
from flexarm.control.filters.moving_horizon import MovingHorizonEstimator
from flexarm.control.filters.unscented_kalman import UnscentedKalmanFilter
from flexarm.control.laws import CONTROLLERS
from flexarm.model import Hardware
from flexarm.model.drives import ControllerDrive, FlexibleTorqueDrive, RigidInverseDynamicsDrive
from flexarm.motion import Motion


@dataclass(frozen=True, eq=False)
class DriveContext:
    """Objects of the scenario that the keys of a drive refer to.

    Attributes:
        arm: the controllers' model of the arm.
        motion: of the rigid model, or None.
        followed: the reference of the controller, with its torque.
        start: of the run.
        hardware: of the scenario, or None.
    """

    arm: Arm
    motion: Motion | None
    followed: Followed
    start: Start
    hardware: Hardware | None


def controller_of(drive: ControllerDrive, around: DriveContext) -> Controller:
    """Create the controller that a drive describes.

    Raises:
        InputError: if a value does not fit the arm; problems have the names of the drive's keys.
    """
    given: dict[str, Any] = {}
    for name in type(drive).model_fields:
        value = getattr(drive, name)
        if name == "feedforward":
            value = feedforward_kind(drive, around)
        if name in ("kind", "reference") or value is None:  # the class's own default
            continue
        make = _MADE.get(name)
        given |= {name: value} if make is None else make(value, around)
    kind: Any = CONTROLLERS[drive.kind]  # type: ignore[attr-defined]
    needed = signature(kind).parameters.get("arm")
    if needed is not None and needed.default is Parameter.empty:
        given["arm"] = around.arm
    made: Controller = kind(**given)
    return made


def feedforward_kind(drive: Any, around: DriveContext) -> str:
    """Return the kind of feedforward of a drive: the given one, or by default the reference.

    Gravity compensation replaces it, and so does the model of computed torque on a rigid arm.
    """
    if drive.feedforward is not None:
        return str(drive.feedforward)
    compensated = getattr(drive, "gravity", "none") != "none"
    modelled = drive.kind == "computed_torque" and around.followed.initial is None
    return "none" if compensated or modelled else "reference"


def _feedforward(asked: str, around: DriveContext) -> dict[str, Any]:
    torque = None
    if asked == "reference":
        torque = around.followed.torque
    elif asked != "none" and around.motion is not None:
        torque = torque_of(around.arm, FEEDFORWARDS[asked](), around.motion).torque
    return {"feedforward": with_holding(torque, around.start)}


def _gravity(asked: str, around: DriveContext) -> dict[str, Any]:
    return {"arm": None if asked == "none" else around.arm, "sag": asked == "sag"}


def _inner(drive: ControllerDrive, around: DriveContext) -> dict[str, Any]:
    with problems_under("inner"):
        return {"inner": controller_of(drive, around)}


def _estimator(spec: Any, around: DriveContext) -> dict[str, Any]:
    instruments = spec.instruments
    if instruments is None:
        instruments = (around.hardware and around.hardware.instruments) or ()
    if not instruments:
        rule = "are required, because the hardware has none"
        raise InputError(Problem("estimator.instruments", rule))
    kind = FILTERS[spec.kind]
    names = [name for name in type(spec).model_fields if name in signature(kind).parameters]
    options = {name: getattr(spec, name) for name in names}
    options["instruments"] = list(instruments)
    with problems_under("estimator"):
        return {"estimator": kind(around.arm, **options)}


#: Drives without feedback whose torque can be a feedforward, by the value of the key.
FEEDFORWARDS: dict[str, Callable[[], Any]] = {
    "rigid_inverse_dynamics": RigidInverseDynamicsDrive,
    "flexible_torque": FlexibleTorqueDrive,
}

#: Estimators, by the kind of a filter.
FILTERS: dict[str, Callable[..., StateEstimator]] = {
    "extended": ExtendedKalmanFilter,
    "unscented": UnscentedKalmanFilter,
    "moving_horizon": MovingHorizonEstimator,
}

#: Functions that convert the value of a key to arguments, for keys that are not arguments.
_MADE: dict[str, Callable[[Any, DriveContext], dict[str, Any]]] = {
    "estimator": _estimator,
    "feedforward": _feedforward,
    "gravity": _gravity,
    "inner": _inner,
}
