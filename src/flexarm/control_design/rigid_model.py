"""Rigid model of an arm, fast enough for every sample of a controller."""

from __future__ import annotations

import numpy as np

from flexarm.arm import Arm
from flexarm.assembly.kernel_view import KernelView
from flexarm.hardware.measurement import FloatArray
from flexarm.kernels.recursion.composite_body import mass_matrix


class RigidModel:
    """Inverse dynamics and mass matrix of the rigid model of an arm, with the same kernels.

    Joint angles, rates and accelerations (joints,) are relative, in rad, rad/s, rad/s^2. Arguments
    are not checked, and non-finite arguments give non-finite results.

    Attributes:
        arm: the rigid model. joints: number of joints.
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
        """Return the torque (joints,) N m of a motion: M qdd + bias, gravity included."""
        self._state[0, self._bodies, 0] = angle
        self._state[1, self._bodies, 0] = rate
        self._acceleration[self._bodies, 0] = acceleration
        forces = self._kernels.inverse_dynamics(self._state, self._acceleration)
        torque: FloatArray = forces[self._bodies, 0]
        return torque

    def gravity_torque(self, angle: FloatArray) -> FloatArray:
        """Return the torque (joints,) N m of the arm at rest, joint springs included."""
        return self.torque(angle, self._nothing, self._nothing)

    def mass_matrix(self, angle: FloatArray) -> FloatArray:
        """Return the mass matrix (joints, joints), kg m^2."""
        self._state[0, self._bodies, 0] = angle
        self._kernels.call(mass_matrix, self._state, self._kernels.work, self._mass)
        found: FloatArray = self._mass[self._bodies, 0][:, self._bodies, 0]
        return found
