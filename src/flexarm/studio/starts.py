"""Starting values: a run for an arm alone, and those of another motion, drive or damping."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from flexarm.arm import Arm
from flexarm.assembly.assemble import FloatArray
from flexarm.errors import FlexarmError
from flexarm.linear import modes
from flexarm.model import ArmSpec, Scenario
from flexarm.model.wording import Path
from flexarm.scenarios.motions import motion_of

#: Kinds with starting values.
DAMPINGS = ("none", "modal", "rayleigh")
MOTIONS = ("line", "circle", "spline", "via_points", "joint")
DRIVES = ("none", "rigid_inverse_dynamics", "joint_pd", "joint_pid", "computed_torque")

_DURATION, _ANGLE, _RATIO = 2.0, 0.5, 0.01
#: Bandwidth of a joint loop, as a fraction of the lowest frequency with locked joints, and rad/s
#: for a rigid arm.
_BANDWIDTH, _RIGID_BANDWIDTH = 0.4, 5.0
_SAMPLE_TIME = 0.001
#: Limit on the change of a joint rate in one sample by its own rate gain.
_RATE_STEP = 0.3


def scenario_around(arm: ArmSpec) -> Scenario:
    """Return a scenario of an arm: all joints turn, by the torques of the rigid arm."""
    joints = Arm(arm).joints
    motion = _joints(np.zeros(joints), np.full(joints, _ANGLE)) if joints else None
    drive = {"kind": "rigid_inverse_dynamics" if joints else "none"}
    run = {"duration": 1.5 * _DURATION}
    return Scenario(arm=arm, motion=motion, drive=drive, run=run)  # type: ignore[arg-type]


def start_of_kind(scenario: Scenario, path: Path, kind: Any) -> Any:
    """Return starting values of a motion, drive or damping of a kind, for its place in a scenario.

    A kind without starting values is returned alone, so that the records report what is wrong.
    """
    if path == ("motion",) and kind in MOTIONS:
        return motion_of_kind(scenario, kind)
    if path == ("drive",) and kind in DRIVES:
        return drive_of_kind(scenario, kind)
    if path[-1:] == ("damping",) and kind in DAMPINGS:
        return damping_of_kind(kind)
    return {"kind": kind}


def damping_of_kind(kind: str) -> dict[str, Any] | None:
    """Return the description of a link's damping of a kind, "none" for None."""
    values = {"modal": {"ratio": _RATIO}, "rayleigh": {"stiffness_coefficient": 0.001}}
    return {"kind": kind, **values[kind]} if kind in values else None


def motion_of_kind(scenario: Scenario, kind: str) -> dict[str, Any] | None:
    """Return a motion of a kind between the ends of the scenario's motion.

    The arm's own joints turn by half a radian if the scenario has no motion.
    """
    arm = Arm(scenario.arm)
    start, end = _ends(arm, scenario)
    if kind == "joint":
        return _joints(start, end) | _timing(scenario)
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
    return {"kind": kind, **shapes[kind]()} | _timing(scenario)


def drive_of_kind(scenario: Scenario, kind: str) -> dict[str, Any]:
    """Return a drive of a kind, with gains well below the vibration of the arm."""
    if kind in ("none", "rigid_inverse_dynamics"):
        return {"kind": kind}
    arm = Arm(scenario.arm)
    angles, _ = _ends(arm, scenario)
    bandwidth = _bandwidth(arm, angles)
    rigid = arm.rigid()
    inertia = np.diag(rigid.mass_matrix(rigid.rest(angles)))
    # Light flexible links beside a joint accelerate faster than the inertia of the arm suggests.
    quickest = np.diag(np.linalg.inv(arm.mass_matrix(arm.rest(angles))))[arm.joint_index]
    derivative = np.minimum(1.4 * inertia * bandwidth, _RATE_STEP / (quickest * _SAMPLE_TIME))
    if kind == "computed_torque":
        frequency = float(np.min(derivative / inertia)) / (2.0 * np.pi * 1.4)
        return {"kind": kind, "frequency_hz": _short(frequency), "damping_ratio": 0.7}
    gains = {
        "proportional": [_short(value) for value in derivative * bandwidth / 1.4],
        "derivative": [_short(value) for value in derivative],
    }
    more = {"integral": 0.0} if kind == "joint_pid" else {}
    return {"kind": kind, **gains, **more, "feedforward": "rigid_inverse_dynamics"}


def _bandwidth(arm: Arm, angles: FloatArray) -> float:
    found = modes(arm, angles).frequency_hz
    found = found[found > 0.0]
    return float(_BANDWIDTH * 2.0 * np.pi * found[0]) if found.size else _RIGID_BANDWIDTH


def _ends(arm: Arm, scenario: Scenario) -> tuple[FloatArray, FloatArray]:
    """Return the joint angles (joints,) rad at the start and at the end of the motion."""
    try:
        motion: Any = motion_of(arm, scenario)
        if motion is not None:
            return np.asarray(motion.joint_angle(0.0)), np.asarray(motion.joint_angle(1e9))
    except FlexarmError:  # the motion leaves the reach: start anew
        pass
    return np.full(arm.joints, 0.3), np.full(arm.joints, 0.3 + _ANGLE)


def _joints(start: FloatArray, end: FloatArray) -> dict[str, Any]:
    ends = {name: [_short(v) for v in values] for name, values in (("start", start), ("end", end))}
    return {"kind": "joint", **ends, "duration": _DURATION}


def _timing(scenario: Scenario) -> dict[str, Any]:
    motion = scenario.motion
    return {"duration": getattr(motion, "duration", _DURATION)}


def _point(point: FloatArray) -> list[float]:
    return [round(float(v), 4) + 0.0 for v in point]


def _short(value: float) -> float:
    """Round to three digits."""
    return float(f"{float(value) + 0.0:.3g}")
