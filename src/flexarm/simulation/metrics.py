"""Performance metrics of closed-loop runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm import Arm
from flexarm.control.base import Reference
from flexarm.integrate.base import FloatArray
from flexarm.motion import Motion

if TYPE_CHECKING:
    import xarray as xr


class Metric(NamedTuple):
    """One metric of a run: name, unit and meaning."""

    name: str
    unit: str
    meaning: str


METRICS = (
    Metric("tip_error_rms", "m", "distance of the tip from its reference while this moves, RMS"),
    Metric("tip_error_peak", "m", "largest distance of the tip from its reference, all the run"),
    Metric("tip_error_settled", "m", "mean tip from its goal, after the motion"),
    Metric("residual_vibration", "m", "largest distance of the tip from its mean, likewise"),
    Metric("joint_error_rms", "rad", "joint angles from their reference while this moves, RMS"),
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
    Metric("controller_time", "s", "computing time of the controller for one sample"),
)


def tip_reference(arm: Arm, reference: Reference, times: FloatArray) -> FloatArray:
    """Return the reference position of the tip (T, 2) m, that of the rigid model by default."""
    tip = getattr(reference, "tip", None)
    if tip is not None:
        return np.asarray(tip(times))
    rigid = arm.rigid()
    angles = _joint_angles(reference, times, rigid.joints)
    return np.array([rigid.tip(rigid.rest(angle))[:2] for angle in angles])


def metrics_of(
    result: xr.Dataset, arm: Arm, reference: Reference, settling: float = 0.0
) -> dict[str, float]:
    """Return ``METRICS`` of a closed-loop result; NaN if the run or the reference lacks the data.

    Args:
        arm: arm whose rigid model the reference is for.
        reference: with ``end_time`` (s), as motions have it, or moving to the end of the run.
        settling: time (s) after the end of the motion to exclude from the metrics of the time
            after it.

    The first four are relative to the tip of the rigid model along the reference, so they include
    the sag under gravity.
    """
    times = result["time"].values
    start = float(getattr(reference, "start_time", 0.0))
    end = float(getattr(reference, "end_time", np.inf))
    moving = (times >= start) & (times <= end)
    after = times >= end + settling
    tip = result["tip"].values
    missed = tip - tip_reference(arm, reference, times)
    distance = np.hypot(*missed.T)
    desired = _joint_angles(reference, times[moving], arm.joints)
    joints = result["joint_angle"].values[moving] - desired
    torque = result["torque"].values
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
    if moving.any():
        missed_force = _force_error(result, reference, times, moving)
        if missed_force is not None:
            values["force_error_rms"] = _rms(missed_force)
            values["force_error_peak"] = float(abs(missed_force).max())
    calls = result.attrs.get("controller_calls", 0)
    if calls:
        values["controller_time"] = result.attrs["controller_seconds"] / calls
    return values


def _joint_angles(reference: Reference, times: FloatArray, joints: int) -> FloatArray:
    """Return the joint angles (T, joints) of a reference at times (T,), rad."""
    if isinstance(reference, Motion) and times.size:
        # One call for all times is up to a thousand times as fast as one call per time.
        return np.asarray(reference.joint_angle(times))
    angles = [np.asarray(reference.joint_angle(float(t))) for t in times]
    return np.array(angles).reshape(-1, joints)


def _force_error(
    result: xr.Dataset, reference: Reference, times: FloatArray, moving: NDArray[np.bool_]
) -> FloatArray | None:
    """Return the error of the normal contact force during the motion, N; None without one."""
    force, normal = getattr(reference, "contact_force", None), getattr(reference, "normal", None)
    if force is None or normal is None or "contact_force" not in result:
        return None
    now = times[moving]
    on_arm = result["contact_force"].values[moving, 0]
    desired = np.array([force(float(t)) for t in now])
    across = np.array([normal(float(t)) for t in now])
    missed: FloatArray = np.sum(across * on_arm, axis=1) - desired
    return missed


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
