"""Performance metrics of runs along a reference."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.late import xr
from flexarm.control.contract.base import Reference
from flexarm.integrate.base import FloatArray
from flexarm.motion import Motion

#: Divisor instead of zero: torques that never change have no activity.
_NONE = np.finfo(float).tiny


class Metric(NamedTuple):
    """One metric of a run: name, unit and meaning."""

    name: str
    unit: str
    meaning: str

    @property
    def display(self) -> tuple[float, str]:
        """Factor and unit of tables and pictures, which show lengths in mm."""
        return (1e3, "mm") if self.unit == "m" else (1.0, self.unit)


def length_unit(largest: float) -> tuple[float, str]:
    """Return factor and unit in which lengths up to ``largest`` (m) are read: mm, or m from 1 m."""
    return (1.0, "m") if largest >= 1.0 else (1e3, "mm")


def length_text(length: float) -> str:
    """Return a length (m) with its unit."""
    factor, unit = length_unit(length)
    return f"{factor * length:.3g} {unit}"


METRICS = (
    Metric("tip_error_rms", "m", "distance of the tip from its reference while this moves, RMS"),
    Metric("tip_error_peak", "m", "largest distance of the tip from its reference, all the run"),
    Metric("tip_error_settled", "m", "mean tip from its goal, after the motion"),
    Metric("residual_vibration", "m", "largest distance of the tip from its mean, likewise"),
    Metric(
        "joint_error_rms",
        "rad",
        "joint angles from their reference, those of the rigid arm, while this moves, RMS",
    ),
    Metric("torque_rms", "N m", "root of the mean sum of squares of the torques"),
    Metric("torque_peak", "N m", "largest torque of any joint"),
    Metric(
        "force_error_rms",
        "N",
        "normal force of the first contact from its reference while this moves, RMS",
    ),
    Metric(
        "force_error_peak", "N", "largest difference of that force from its reference, likewise"
    ),
    Metric(
        "torque_activity",
        "1",
        "mean change of the torques between samples, relative to their range: 1 if they jump",
    ),
    Metric("growth", "1/s", "largest real part of the poles of the sampled loop"),
    Metric("saturation", "1", "largest share of the run with a motor at its limit"),
    Metric("controller_time", "s", "computing time of the controller for one sample"),
)
#: Channels from which metrics are computed; the last ones exist for runs with contacts and for arms
#: with a base that moves.
MEASURED = ("tip", "joint_angle", "torque", "contact_force", "base_position")


def tip_reference(arm: Arm, reference: Reference, times: FloatArray) -> FloatArray:
    """Return the reference position of the tip (T, 2) m, that of the rigid model by default."""
    tip = getattr(reference, "tip", None)
    if tip is not None:
        return np.asarray(tip(times))
    rigid = arm.rigid()
    angles = reference_angles(reference, times, rigid.n_joints)
    return np.array([rigid.tip(rigid.rest(angle))[:2] for angle in angles])


def on_base(points: FloatArray, base: FloatArray | None) -> FloatArray:
    """Return points (T, 2) m on a base at x, y and angle (T, 3), given on the base at the origin.

    ``base`` is None for arms on a fixed base.
    """
    if base is None:
        return points
    cos, sin = np.cos(base[:, 2]), np.sin(base[:, 2])
    x, y = points.T
    turned = np.stack([cos * x - sin * y, sin * x + cos * y], axis=1)
    return np.asarray(base[:, :2] + turned)


def tip_error(arm: Arm, reference: Reference, result: xr.Dataset) -> FloatArray:
    """Return the distance (T,) m of the tip of a result from that of a reference of an arm."""
    base = result["base_position"].values if "base_position" in result else None
    desired = on_base(tip_reference(arm, reference, result["time"].values), base)
    return np.asarray(np.hypot(*(result["tip"].values - desired).T))


def metrics_of(
    result: xr.Dataset, arm: Arm, reference: Reference, settling: float = 0.0
) -> dict[str, float]:
    """Return ``METRICS`` of a closed-loop result; NaN where the run or the reference lacks data."""
    channels = {name: result[name].values for name in MEASURED if name in result}
    values = Goal(arm, reference, result["time"].values, settling).metrics(channels)
    if "saturation" in result:
        values["saturation"] = float(result["saturation"].max())
    values["growth"] = float(result.attrs.get("loop_growth", np.nan))
    calls = result.attrs.get("controller_calls")
    if calls:
        values["controller_time"] = result.attrs["controller_seconds"] / calls
    return values


class Goal:
    """Reference of runs at the times of their samples, from which their metrics are computed.

    Args:
        arm: arm whose rigid model the reference is for.
        reference: with ``end_time`` (s), as motions have it, or moving to the end of the run.
        times: (samples,) s.
        settling: time (s) after the end of the motion to exclude from the metrics of the time
            after it.

    The first four metrics are relative to the tip of the rigid model along the reference, so they
    include the sag under gravity. A base that moves carries this tip where the run has the base.
    """

    def __init__(
        self, arm: Arm, reference: Reference, times: FloatArray, settling: float = 0.0
    ) -> None:
        start = float(getattr(reference, "start_time", 0.0))
        end = float(getattr(reference, "end_time", np.inf))
        self._reference, self._times = reference, times
        self._moving = (times >= start) & (times <= end)
        self._after = times >= end + settling
        self._tip = tip_reference(arm, reference, times)
        self._joint_angle = reference_angles(reference, times[self._moving], arm.n_joints)

    def metrics(self, channels: Mapping[str, FloatArray]) -> dict[str, float]:
        """Return the metrics of a run without controller, from its channels ``MEASURED``."""
        moving, after = self._moving, self._after
        tip, torque = channels["tip"], channels["torque"]
        missed = tip - on_base(self._tip, channels.get("base_position"))
        distance = np.hypot(*missed.T)
        joints = channels["joint_angle"][moving] - self._joint_angle
        values = dict.fromkeys((metric.name for metric in METRICS), np.nan)
        if moving.any():
            values["tip_error_rms"] = _rms(distance[moving])
            values["joint_error_rms"] = _rms(np.hypot.reduce(joints, axis=1))
        values["tip_error_peak"] = float(distance.max())
        if after.any():
            values["tip_error_settled"] = float(np.hypot(*missed[after].mean(axis=0)))
            about = tip[after] - tip[after].mean(axis=0)
            values["residual_vibration"] = float(np.hypot(*about.T).max())
        values["torque_rms"] = _rms(np.hypot.reduce(torque, axis=1))
        values["torque_peak"] = float(abs(torque).max())
        turned = np.abs(np.diff(torque, axis=0)).mean(axis=0) if len(torque) > 1 else 0.0 * torque
        values["torque_activity"] = float(
            np.sum(turned) / max(np.sum(np.ptp(torque, axis=0)), _NONE)
        )
        force: Any = getattr(self._reference, "contact_force", None)
        normal: Any = getattr(self._reference, "normal", None)
        if moving.any() and "contact_force" in channels and None not in (force, normal):
            now = self._times[moving].tolist()
            across = np.array([normal(t) for t in now])
            felt = np.sum(across * channels["contact_force"][moving, 0], axis=1)
            error = felt - np.array([force(t) for t in now])
            values["force_error_rms"] = _rms(error)
            values["force_error_peak"] = float(abs(error).max())
        return values


def reference_angles(reference: Reference, times: FloatArray, joints: int) -> FloatArray:
    """Return the joint angles (T, joints) of a reference at times (T,), rad."""
    if isinstance(reference, Motion) and times.size:
        # One call for all times is up to a thousand times as fast as one call per time.
        return np.asarray(reference.joint_angle(times))
    angles = [np.asarray(reference.joint_angle(float(t))) for t in times]
    return np.array(angles).reshape(-1, joints)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
