"""Motion of a scenario as an object of the Python interface."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.cases.scenario.file_errors import problems_under
from flexarm.control.design.input_shaping import shaped
from flexarm.integrate.base import FloatArray
from flexarm.linear.reference_motions.pressed import PressedMotion, pressed_motion
from flexarm.model import Scenario
from flexarm.model.environment import RoundWall, Surface, Wall
from flexarm.model.scenarios.motions import ForceTable, PlainMotionSpec, PressedMotionSpec
from flexarm.motion import (
    Motion,
    TimingLaw,
    circle_motion,
    joint_motion,
    line_motion,
    quintic,
    smoothed,
    spline_motion,
    via_point_motion,
)

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
    """Create the motion of a scenario.

    Raises:
        InputError: if the motion leaves the arm's reach, or the deflected arm cannot follow;
            problems have the names of the motion's keys.
    """
    spec = scenario.motion
    if isinstance(spec, PressedMotionSpec):
        return _pressed(arm, spec, scenario)
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


def _pressed(arm: Arm, spec: PressedMotionSpec, scenario: Scenario) -> PressedMotion:
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


def _over_time(table: ForceTable) -> Callable[[float], float]:
    """Return the force over time, with a quintic between two values and zero slope at each.

    The deflection of the arm follows the force: a kink of the force is a jump of the joint rates.
    """
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
    away: FloatArray = sign * (path.tip(t) - center)
    return away
