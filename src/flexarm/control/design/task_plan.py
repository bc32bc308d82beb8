"""Requested motion and force of the tip, computed for many sample times at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.control.contract.base import Reference
from flexarm.control.contract.feedforward import SampledFeedforward, numbers
from flexarm.control.hardware.measurement import FloatArray
from flexarm.motion.geometry.inverse_kinematics import rigid_chain, tip_jacobian, tip_jacobian_rate


class TaskReference(NamedTuple):
    """Requested tip motion, force and joint motion at one instant, for the rigid model."""

    x: float  # of the tip, m, world axes
    y: float
    x_rate: float  # m/s
    y_rate: float
    x_acceleration: float  # m/s^2
    y_acceleration: float
    force: float  # N, on the surface
    normal_x: float  # of the surface, pointing away from it; 0, 0 without a force
    normal_y: float
    angle: FloatArray  # (joints,) rad
    rate: FloatArray  # (joints,) rad/s
    acceleration: FloatArray  # (joints,) rad/s^2
    pressing: FloatArray  # (joints,) N m, in addition to the torque of the rigid model, (F.3)


#: Number of scalar fields of ``TaskReference``.
NUMBERS = 9


class TaskPlan:
    """Plan of the requested tip motion along a reference.

    A reference with ``vectorized`` true accepts arrays of times, and is evaluated at many sample
    times at once. A reference without ``contact_force``, ``normal`` and ``pressing_torque``
    requests no force.
    """

    def __init__(self, arm: Arm, sample_time: float) -> None:
        self._chain = rigid_chain(arm)
        self._joints = arm.joints
        self._sample_time = sample_time
        self._reference: Any = None
        self._rows: SampledFeedforward | None = None

    def reset(self) -> None:
        """Clear the reference."""
        self._reference = self._rows = None

    def row(self, t: float, reference: Reference) -> FloatArray:
        """Return the numbers of the request at t (s), in the order of ``TaskReference``."""
        if self._rows is None or reference is not self._reference:
            self._reference = reference
            self._rows = SampledFeedforward(Rows(self.rows, reference), self._sample_time)
        return self._rows(t)

    def request(self, row: FloatArray) -> TaskReference:
        """Return the request with the numbers of a row."""
        n = self._joints
        a, b, c, d = (NUMBERS + k * n for k in range(4))
        of_tip: Any = row[:NUMBERS].tolist()
        arrays: Any = (row[a:b], row[b:c], row[c:d], row[d : d + n])
        return TaskReference(*of_tip, *arrays)

    def _row(
        self, angle: FloatArray, rate: FloatArray, acceleration: FloatArray, of: Any, t: FloatArray
    ) -> FloatArray:
        """Return rows of ``TaskReference`` from joint motions (T, joints)."""
        lengths, turned = self._chain.lengths, angle + self._chain.offset
        J, J_rate = tip_jacobian(lengths, turned), tip_jacobian_rate(lengths, turned, rate)
        velocity = np.einsum("tij,tj->ti", J, rate)
        tip_acceleration = np.einsum("tij,tj->ti", J, acceleration)
        tip_acceleration += np.einsum("tij,tj->ti", J_rate, rate)
        # The arrays have the type of the angles, which are symbols in exported controllers.
        force, normal = (np.zeros_like(angle, shape=(len(t), count)) for count in (1, 2))
        pressing = np.zeros_like(angle)
        if hasattr(of, "contact_force"):
            force[:, 0] = values_of(of, "contact_force", t)
            normal[:] = values_of(of, "normal", t)
            pressing[:] = values_of(of, "pressing_torque", t)
        of_tip = (self._chain.tip(angle), velocity, tip_acceleration, force, normal)
        return np.concatenate([*of_tip, angle, rate, acceleration, pressing], axis=1)

    def rows(self, reference: Any, t: FloatArray) -> FloatArray:
        """Return rows (T, numbers) at times (T,)."""
        angle = values_of(reference, "joint_angle", t)
        rate = values_of(reference, "joint_rate", t)
        acceleration = values_of(reference, "joint_acceleration", t)
        return self._row(angle, rate, acceleration, reference, t)


class Rows:
    """Rows of numbers along a reference as a function of time, for ``SampledFeedforward``.

    Args:
        rows: function of the reference and times (T,) that returns rows (T, n).
        reference: the reference.
    """

    def __init__(self, rows: Callable[[Any, FloatArray], FloatArray], reference: Any) -> None:
        self._rows, self._reference = rows, reference
        self.vectorized = bool(getattr(reference, "vectorized", False))

    def __call__(self, t: Any) -> FloatArray:
        """Return the row (n,) at t (s), or the rows (T, n) at times (T,)."""
        times = np.atleast_1d(np.asarray(t, dtype=np.float64))
        rows = self._rows(self._reference, times)
        return rows if np.ndim(t) else rows[0]


def values_of(reference: Any, name: str, t: FloatArray) -> FloatArray:
    """Evaluate one method of a reference at times (T,)."""
    function = getattr(reference, name)
    if getattr(reference, "vectorized", False):
        return np.asarray(function(t), dtype=np.float64)
    return np.concatenate([numbers(function(now))[None] for now in t.tolist()])
