"""Starting values of a run for an arm alone, and of another motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import FlexarmError
from flexarm.cases.scenario.motions import motion_of
from flexarm.model import ArmSpec, Scenario
from flexarm.model.file_format.content import content_of

_DURATION, _ANGLE = 2.0, 0.5


def scenario_around(arm: ArmSpec) -> Scenario:
    """Return a scenario of an arm: all joints turn, by the torques of the rigid arm."""
    joints = Arm(arm).joints
    motion = _joints(np.zeros(joints), np.full(joints, _ANGLE)) if joints else None
    drive = {"kind": "rigid_inverse_dynamics" if joints else "none"}
    run = {"duration": 1.5 * _DURATION}
    return Scenario(arm=arm, motion=motion, drive=drive, run=run)  # type: ignore[arg-type]


def motion_of_kind(scenario: Scenario, kind: str) -> dict[str, Any]:
    """Return a motion of a kind between the ends of the scenario's motion.

    The arm's own joints turn by half a radian if the scenario has no motion. A kind without
    starting values is returned alone, so that the records report what is wrong.
    """
    arm = Arm(scenario.arm)
    start, end = ends_of(arm, scenario)
    if kind == "joint":
        return _joints(start, end) | _timing(scenario)
    if kind == "pressed":
        path = scenario.motion
        plain = path is not None and path.kind != "pressed"
        inner = content_of(path) if plain else motion_of_kind(scenario, "line")
        normal = {} if scenario.contacts else {"normal": [-1.0, 0.0]}
        return {"kind": kind, "path": inner, "force": 1.0, **normal}
    rigid = arm.rigid()
    first, last = (rigid.tip(rigid.rest(angles))[:2] for angles in (start, end))
    middle = 0.5 * (first + last) + 0.1 * np.array([1.0, -1.0]) * (last - first)[::-1]
    shapes: dict[str, Callable[[], dict[str, Any]]] = {
        "line": lambda: {"start": _point(first), "end": _point(last)},
        "circle": lambda: {
            "center": _point(0.9 * first),
            "start": _point(first),
            "angle": round(2 * np.pi, 4),
        },
        "spline": lambda: {"points": [_point(first), _point(middle), _point(last)]},
        "via_points": lambda: {"points": [_point(first), _point(middle), _point(last)]},
    }
    return (
        {"kind": kind, **shapes[kind]()} | _timing(scenario) if kind in shapes else {"kind": kind}
    )


def ends_of(arm: Arm, scenario: Scenario) -> tuple[FloatArray, FloatArray]:
    """Return the joint angles (joints,) rad at the start and at the end of the motion."""
    try:
        motion: Any = motion_of(arm, scenario)
        if motion is not None:
            return np.asarray(motion.joint_angle(0.0)), np.asarray(motion.joint_angle(1e9))
    except FlexarmError:  # the motion leaves the reach: start anew
        pass
    return np.full(arm.joints, 0.3), np.full(arm.joints, 0.3 + _ANGLE)


def _joints(start: FloatArray, end: FloatArray) -> dict[str, Any]:
    ends = {name: [short(v) for v in values] for name, values in (("start", start), ("end", end))}
    return {"kind": "joint", **ends, "duration": _DURATION}


def _timing(scenario: Scenario) -> dict[str, Any]:
    motion = getattr(scenario.motion, "path", scenario.motion)
    return {"duration": getattr(motion, "duration", _DURATION)}


def _point(point: FloatArray) -> list[float]:
    return [round(float(v), 4) + 0.0 for v in point]


def short(value: float) -> float:
    """Round to three digits."""
    return float(f"{float(value) + 0.0:.3g}")
