"""Arm of a result, its rigid counterpart, and their shapes over time; without Matplotlib."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_dataset, check_kind, check_nonnegative
from flexarm.base.errors import InputError, ModelError, Problem
from flexarm.model import Scenario, arm_spec_of_text, scenario_of_text

if TYPE_CHECKING:
    import xarray as xr

FloatArray = NDArray[np.float64]

#: Points drawn along a link.
STATIONS = 25
#: Limit on the samples of an envelope; more would take seconds.
_MOST_SAMPLES = 4000
_MOST_MAGNIFIED = 1e4


def check_drawable(name: str, value: object) -> xr.Dataset:
    """Validate that the arm of a result can be drawn, and return the result."""
    result = check_dataset(name, value)
    if not {"q", "joint_angle"} <= set(result.data_vars) or not result["time"].size:
        rule = "be a result of simulate"
        raise InputError(Problem(name, rule, "a dataset without the coordinates of an arm"))
    arm = arm_of(name, result)
    if result["q"].shape[1:] != (arm.dof,):
        rule = f"have the {arm.dof} coordinates of its arm"
        raise InputError(Problem(name, rule, f"q of shape {result['q'].shape}"))
    if not np.isfinite(result["q"].values).all():
        raise InputError(Problem(name, "contains NaN or infinite coordinates"))
    return result


def check_magnify(value: object) -> float:
    """Validate and return a factor on the bending of links."""
    return check_nonnegative("magnify", value, _MOST_MAGNIFIED)


def arm_of(name: str, result: xr.Dataset) -> Arm:
    """Return the arm of a result, from its attribute ``arm``."""
    text = result.attrs.get("arm")
    if not isinstance(text, str):
        raise InputError(Problem(name, "has no attribute 'arm' with the text of its arm"))
    try:
        return _arm(text)
    except ModelError as error:
        rule = f"has an invalid attribute 'arm': {str(error.problems[0]).rstrip('.')}"
        raise InputError(Problem(name, rule)) from None


@lru_cache(maxsize=8)
def _arm(text: str) -> Arm:
    return Arm(arm_spec_of_text(text, "result"))


def scenario_of(result: xr.Dataset) -> Scenario | None:
    """Return the scenario of a result, or None."""
    text = result.attrs.get("scenario")
    try:
        return scenario_of_text(text, "result") if isinstance(text, str) else None
    except ModelError:  # written by another version: draw the motion without its reference
        return None


def rigid_result(rigid: object, arm: Arm, result: xr.Dataset) -> RigidMotion | None:
    """Return the motion of the rigid counterpart for a plot, or None.

    ``rigid`` is True for the rigid arm at the joint angles of the result, or a result of the rigid
    arm, such as that of ``arm.rigid()`` with the same torques.
    """
    if isinstance(rigid, bool | np.bool_):
        if not rigid:
            return None
        rigid_counterpart = arm.rigid()
        angles = result["joint_angle"].values
        q = np.zeros((len(angles), rigid_counterpart.dof))
        q[:, rigid_counterpart.joint_index] = angles
        return RigidMotion(rigid_counterpart, result["time"].values, q)
    import xarray as xr

    own = check_kind("rigid", rigid, xr.Dataset, "True, False or a result of simulate")
    own = check_drawable("rigid", own)
    return RigidMotion(arm_of("rigid", own), own["time"].values, own["q"].values)


class RigidMotion:
    """Motion to draw: an arm, times (T,) s and coordinates q (T, dof)."""

    def __init__(self, arm: Arm, time: FloatArray, q: FloatArray) -> None:
        self.arm, self.time, self.q = arm, time, q

    def shapes(self, times: FloatArray, stations: int = STATIONS) -> FloatArray:
        """Return the shapes at times (k,) s, (k, links, stations, 2) m."""
        return shapes_of(self.arm, at_times(self.time, self.q, times), stations=stations)


def at_times(time: FloatArray, values: FloatArray, times: FloatArray) -> FloatArray:
    """Interpolate values (T, ...) linearly at other times (k,)."""
    flat = values.reshape(len(values), -1)
    found = [np.interp(times, time, column) for column in flat.T]
    return np.array(found).T.reshape(len(times), *values.shape[1:])


def shapes_of(
    arm: Arm, q: FloatArray, magnify: float = 1.0, stations: int = STATIONS
) -> FloatArray:
    """Return shapes (k, links, stations, 2) m; magnified ones keep lengths (linear theory)."""
    if magnify != 1.0:
        linear = Arm(arm.spec.model_copy(update={"theory": "linear"}))
        arm = linear if linear.dof == arm.dof else arm
        q = q.copy()
        for piece in arm.assembly.pieces:
            q[:, piece.modal] *= magnify
    return np.array([arm.shape(row, stations) for row in q])


def deflections(arm: Arm, result: xr.Dataset, stations: int = STATIONS) -> FloatArray:
    """Return deflections from the root tangent of each link, (T, links, stations) m."""
    q, angle = result["q"].values, result["link_angle"].values
    if len(q) > _MOST_SAMPLES:
        chosen = np.linspace(0, len(q) - 1, _MOST_SAMPLES).round().astype(int)
        q, angle = q[chosen], angle[chosen]
    points = shapes_of(arm, q, stations=stations)
    away = points - points[:, :, :1]
    sine, cosine = np.sin(angle)[..., None], np.cos(angle)[..., None]
    across: FloatArray = cosine * away[..., 1] - sine * away[..., 0]
    return across
