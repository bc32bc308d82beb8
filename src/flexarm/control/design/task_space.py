"""Kinematics and dynamics of the tip of a rigid model, for controllers in task space."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.control.hardware.measurement import FloatArray
from flexarm.kernels.controller_terms.task_dynamics import task_dynamics, tip_torque


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
