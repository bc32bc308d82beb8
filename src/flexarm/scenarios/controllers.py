"""Controllers of scenario files; the keys of a drive are the arguments of the class."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from inspect import Parameter, signature
from typing import Any

from flexarm.arm import Arm
from flexarm.control.base import Controller
from flexarm.controllers import CONTROLLERS
from flexarm.errors import InputError, Problem
from flexarm.estimation.extended_kalman import ExtendedKalmanFilter
from flexarm.model import Hardware
from flexarm.model.drives import ControllerDrive
from flexarm.motion import Motion
from flexarm.scenarios.file_errors import problems_under
from flexarm.scenarios.initial_state import Start, feedforward


@dataclass(frozen=True, eq=False)
class DriveContext:
    """Objects of the scenario that the keys of a drive refer to.

    Attributes:
        arm: the controllers' model of the arm.
        motion: of the rigid model, or None.
        start: of the run.
        hardware: of the scenario, or None.
    """

    arm: Arm
    motion: Motion | None
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
        if name == "kind" or value is None:  # the class's own default
            continue
        make = _MADE.get(name)
        given |= {name: value} if make is None else make(value, around)
    kind: Any = CONTROLLERS[drive.kind]  # type: ignore[attr-defined]
    needed = signature(kind).parameters.get("arm")
    if needed is not None and needed.default is Parameter.empty:
        given["arm"] = around.arm
    made: Controller = kind(**given)
    return made


def _feedforward(asked: str, around: DriveContext) -> dict[str, Any]:
    motion = around.motion if asked == "rigid_inverse_dynamics" else None
    return {"feedforward": feedforward(around.arm, motion, around.start)}


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
    options = {name: getattr(spec, name) for name in type(spec).model_fields}
    options["instruments"] = list(instruments)
    with problems_under("estimator"):
        return {"estimator": ExtendedKalmanFilter(around.arm, **options)}


#: Functions that convert the value of a key to arguments, for keys that are not arguments.
_MADE: dict[str, Callable[[Any, DriveContext], dict[str, Any]]] = {
    "estimator": _estimator,
    "feedforward": _feedforward,
    "gravity": _gravity,
    "inner": _inner,
}
