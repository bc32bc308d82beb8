"""Tip of a rigid model at a surface: its dynamics, and the requested motion and force."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.control.contract.base import Reference, SampledFeedforward, numbers
from flexarm.control.hardware.measurement import FloatArray
from flexarm.kernels.controller_terms.task_dynamics import task_dynamics, tip_torque
from flexarm.motion.geometry.inverse_kinematics import rigid_chain, tip_jacobian, tip_jacobian_rate


class TaskState(NamedTuple):
    """State of the rigid model, overwritten by the next one; tip vectors in world axes."""

    motion: FloatArray  # (3, 2): position m, velocity m/s, acceleration at qdd = 0 m/s^2
    jacobian: FloatArray  # (2, joints) m
    mass: FloatArray  # (joints, joints) kg m^2
    bias_torque: FloatArray  # (joints,) N m: torque at qdd = 0


class TaskSpace:
    """Kinematics and dynamics of the rigid model at its tip, without checks of arguments.

    Attributes:
        joints: number of joints.
    """

    _tip_torque = staticmethod(tip_torque)

    def __init__(self, arm: Arm) -> None:
        assembly = arm.rigid().assembly
        self._kernels = kernels = KernelView(assembly.constants)
        moved = KernelView(assembly.constants, complex)
        self.joints = count = arm.joints
        self._state = TaskState(
            np.zeros((3, 2)), np.zeros((2, count)), np.zeros((count, count)), np.zeros(count)
        )
        self._angle, self._rate = np.zeros(arm.joints), np.zeros(arm.joints)
        self._arguments = (
            assembly.joint_body,
            self._angle,
            self._rate,
            kernels.loads,
            kernels.zeros(2),
            kernels.zeros(),
            kernels.work,
            moved.zeros(2),
            *moved.pose_arrays(),
            np.zeros((2, assembly.bodies)),
            np.zeros(kernels.shape * 2),
            *self._state,
        )

    def at(self, angle: FloatArray, rate: FloatArray) -> TaskState:
        """Return the state at joint angles (rad) and rates (rad/s), (joints,) each."""
        self._angle[:], self._rate[:] = angle, rate
        self._kernels.call(task_dynamics, *self._arguments)
        return self._state

    def torque(
        self,
        state: TaskState,
        acceleration: tuple[float, float],
        push: tuple[float, float],
        posture: FloatArray,
        added: FloatArray,
    ) -> FloatArray:
        """Return the joint torques (joints,) N m for an acceleration and a force of the tip: (F.1).

        Args:
            state: last result of ``at``.
            acceleration: acceleration of the tip without contact, m/s^2.
            push: force of the tip on the surface, N.
            posture: joint accelerations (joints,) rad/s^2 that arms with more than two joints stay
                close to.
            added: torque (joints,) N m that is added.
        """
        torque = np.empty_like(state.bias_torque)
        self._tip_torque(*state, posture, *acceleration, *push, added, torque)
        return torque


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


class _SampledRows:
    """Rows of numbers along a reference at the sample times.

    A reference with ``vectorized`` true accepts arrays of times, and is evaluated at many sample
    times at once.
    """

    def __init__(self, sample_time: float) -> None:
        self._sample_time = sample_time
        self.reset()

    def reset(self) -> None:
        """Clear the reference."""
        self._reference: Any = None
        self._sampled: SampledFeedforward | None = None

    def row(self, t: float, reference: Any) -> FloatArray:
        """Return the row (n,) at t (s)."""
        if self._sampled is None or reference is not self._reference:
            self._reference = reference
            self._sampled = SampledFeedforward(_Rows(self.rows, reference), self._sample_time)
        return self._sampled(t)

    def rows(self, reference: Any, t: FloatArray) -> FloatArray:
        """Return rows (T, n) at times (T,)."""
        raise NotImplementedError


class _Rows:
    """Rows along a reference as a function of time, for ``SampledFeedforward``."""

    def __init__(self, rows: Callable[[Any, FloatArray], FloatArray], reference: Any) -> None:
        self._rows, self._reference = rows, reference
        self.vectorized = bool(getattr(reference, "vectorized", False))

    def __call__(self, t: Any) -> FloatArray:
        rows = self._rows(self._reference, np.atleast_1d(np.asarray(t, dtype=np.float64)))
        return rows if np.ndim(t) else rows[0]


class TaskPlan(_SampledRows):
    """Plan of the requested tip motion along a reference: the numbers of ``TaskReference``.

    A reference without ``contact_force``, ``normal`` and ``pressing_torque`` requests no force.
    """

    def __init__(self, arm: Arm, sample_time: float) -> None:
        super().__init__(sample_time)
        self._chain, self._joints = rigid_chain(arm), arm.joints

    def request(self, row: FloatArray) -> TaskReference:
        """Return the request with the numbers of a row."""
        n = self._joints
        a, b, c, d = (NUMBERS + k * n for k in range(4))
        of_tip: Any = row[:NUMBERS].tolist()
        arrays: Any = (row[a:b], row[b:c], row[c:d], row[d : d + n])
        return TaskReference(*of_tip, *arrays)

    def rows(self, reference: Any, t: FloatArray) -> FloatArray:
        """Return rows (T, numbers) at times (T,)."""
        names = "joint_angle", "joint_rate", "joint_acceleration"
        angle, rate, acceleration = (values_of(reference, name, t) for name in names)
        lengths, turned = self._chain.lengths, angle + self._chain.offset
        J, J_rate = tip_jacobian(lengths, turned), tip_jacobian_rate(lengths, turned, rate)
        velocity = np.einsum("tij,tj->ti", J, rate)
        tip_acceleration = np.einsum("tij,tj->ti", J, acceleration)
        tip_acceleration += np.einsum("tij,tj->ti", J_rate, rate)
        # The arrays have the type of the angles, which are symbols in exported controllers.
        force, normal = (np.zeros_like(angle, shape=(len(t), count)) for count in (1, 2))
        pressing = np.zeros_like(angle)
        if hasattr(reference, "contact_force"):
            force[:, 0] = values_of(reference, "contact_force", t)
            normal[:] = values_of(reference, "normal", t)
            pressing[:] = values_of(reference, "pressing_torque", t)
        of_tip = (self._chain.tip(angle), velocity, tip_acceleration, force, normal)
        return np.concatenate([*of_tip, angle, rate, acceleration, pressing], axis=1)


def values_of(reference: Any, name: str, t: FloatArray) -> FloatArray:
    """Evaluate one method of a reference at times (T,)."""
    function = getattr(reference, name)
    if getattr(reference, "vectorized", False):
        return np.asarray(function(t), dtype=np.float64)
    return np.concatenate([numbers(function(now))[None] for now in t.tolist()])


class SurfaceMotion(NamedTuple):
    """Requested motion of the tip along a surface at one instant."""

    x: float  # of the tip of the bent arm, m, world axes
    y: float
    speed: float  # along the tangent (-normal_y, normal_x), m/s
    force_rate: float  # N/s


class SurfacePlan(_SampledRows):
    """Plan of the requested motion along the surface; at rest for a reference without ``tip``."""

    def along(self, t: float, reference: Reference) -> SurfaceMotion:
        """Return the requested motion along the surface at t (s)."""
        row: Any = self.row(t, reference).tolist()
        return SurfaceMotion(*row)

    def rows(self, reference: Any, t: FloatArray) -> FloatArray:
        """Return rows of ``SurfaceMotion`` at times (T,), with central differences as rates."""
        rows = np.zeros((len(t), 4))
        before, after = t - self._sample_time, t + self._sample_time
        over = 2.0 * self._sample_time
        if hasattr(reference, "tip"):
            rows[:, :2] = values_of(reference, "tip", t)[..., :2]
            rates = values_of(reference, "tip", after) - values_of(reference, "tip", before)
            normal = values_of(reference, "normal", t)
            rows[:, 2] = (normal[:, 0] * rates[:, 1] - normal[:, 1] * rates[:, 0]) / over
        force = values_of(reference, "contact_force", after)
        rows[:, 3] = (force - values_of(reference, "contact_force", before)) / over
        return rows
