"""The rigid twin as controllers in the task space need it: its tip, and what moves that."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.arm import Arm
from flexarm.hardware.measurement import FloatArray
from flexarm.kernels.cache import Entry
from flexarm.kernels.layout import new_workspace, no_loads, run_time_sizes
from flexarm.kernels.observables import POSE_COLUMNS
from flexarm.kernels.task_dynamics import task_dynamics, tip_torque


class TaskState(NamedTuple):
    """The rigid twin at one moment, until the next is asked for; vectors of the tip, world axes."""

    motion: FloatArray  # (3, 2): position m, velocity m/s, acceleration at none of the joints m/s^2
    jacobian: FloatArray  # (2, joints) m
    mass: FloatArray  # (joints, joints) kg m^2
    bias_torque: FloatArray  # (joints,) N m: what the motion takes where no joint accelerates


class TaskSpace:
    """Kinematics and dynamics of the rigid twin at its tip; the arm's own kernels, unchecked.

    Attributes:
        joints: number of joints.
    """

    def __init__(self, arm: Arm) -> None:
        assembly = arm.rigid().assembly
        constants = assembly.constants
        n, m = constants.S.shape
        self.joints = count = arm.joints
        self._state = TaskState(
            np.zeros((3, 2)), np.zeros((2, count)), np.zeros((count, count)), np.zeros(count)
        )
        self._angle, self._rate = np.zeros(arm.joints), np.zeros(arm.joints)
        self._task_dynamics = Entry(task_dynamics)
        self._arguments = (
            run_time_sizes(constants),
            constants,
            assembly.joint_body,
            self._angle,
            self._rate,
            no_loads(constants),
            np.zeros((2, n, 1 + m)),
            np.zeros((n, 1 + m)),
            new_workspace(constants),
            np.zeros((2, n, 1 + m), dtype=complex),
            np.zeros((n, POSE_COLUMNS), dtype=complex),
            np.zeros(6, dtype=complex),
            np.zeros((2, n)),
            np.zeros((n, 1 + m, n, 1 + m)),
            *self._state,
        )

    def at(self, angle: FloatArray, rate: FloatArray) -> TaskState:
        """Return the twin at joint angles (rad) and rates (rad/s), (joints,) each."""
        self._angle[:], self._rate[:] = angle, rate
        self._task_dynamics(*self._arguments)
        return self._state

    def torque(
        self,
        state: TaskState,
        acceleration: tuple[float, float],
        push: tuple[float, float],
        posture: FloatArray,
        added: FloatArray,
    ) -> FloatArray:
        """Return joint torques (joints,) N m under which the tip accelerates and pushes: (F.1).

        Args:
            state: as ``at`` has just returned it.
            acceleration: of the tip, m/s^2, were there nothing to push.
            push: force of the tip on what it touches, N.
            posture: accelerations (joints,) rad/s^2 that those of more than two joints come near
                to.
            added: torque (joints,) N m that is added.
        """
        torque = np.empty(self.joints)
        tip_torque(*state, posture, *acceleration, *push, added, torque)
        return torque
