"""The rigid twin of an arm, quick enough for a controller to ask at every sample time."""

from __future__ import annotations

import numpy as np

from flexarm.arm import Arm
from flexarm.hardware.measurement import FloatArray
from flexarm.kernel_view import KernelView
from flexarm.kernels.composite_body import mass_matrix


class RigidModel:
    """Torques and inertias of the rigid twin; the same kernels as the arm's, without checks.

    Joint angles, rates and accelerations (joints,) in rad, rad/s, rad/s^2, relative. Nothing is
    checked: numbers that are not finite give numbers that are not finite.

    Attributes:
        arm: the rigid twin. joints: number of joints.
    """

    def __init__(self, arm: Arm) -> None:
        self.arm = arm.rigid()
        self.joints = arm.joints
        self._kernels = kernels = KernelView(self.arm.assembly.constants)
        self._bodies = self.arm.assembly.joint_body
        self._state, self._acceleration = kernels.zeros(2), kernels.zeros()
        self._mass = np.zeros(kernels.shape * 2)
        self._nothing = np.zeros(self.joints)

    def torque(self, angle: FloatArray, rate: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Return the torque (joints,) N m that a motion takes: M qdd + bias, gravity included."""
        self._state[0, self._bodies, 0] = angle
        self._state[1, self._bodies, 0] = rate
        self._acceleration[self._bodies, 0] = acceleration
        forces = self._kernels.inverse_dynamics(self._state, self._acceleration)
        torque: FloatArray = forces[self._bodies, 0]
        return torque

    def gravity_torque(self, angle: FloatArray) -> FloatArray:
        """Return the torque (joints,) N m that holds the arm still, joint springs included."""
        return self.torque(angle, self._nothing, self._nothing)

    def mass_matrix(self, angle: FloatArray) -> FloatArray:
        """Return the mass matrix (joints, joints), kg m^2."""
        self._state[0, self._bodies, 0] = angle
        self._kernels.call(mass_matrix, self._state, self._kernels.work, self._mass)
        found: FloatArray = self._mass[self._bodies, 0][:, self._bodies, 0]
        return found
