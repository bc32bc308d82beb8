"""Rigid model of an arm, fast enough for every sample of a controller."""

from __future__ import annotations

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.control.hardware.measurement import FloatArray
from flexarm.kernels.recursion.composite_body import mass_matrix
from flexarm.kernels.recursion.newton_euler import inverse_dynamics_many


class RigidModel:
    """Inverse dynamics and mass matrix of the rigid model of an arm, with the same kernels.

    Joint angles, rates and accelerations (joints,) are relative, in rad, rad/s, rad/s^2. Those of
    several runs have the shape (runs, joints), and so have the torques. Arguments are not checked,
    and non-finite arguments give non-finite results.

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
        if angle.ndim > 1:
            return self._torques(angle, rate, acceleration)
        self._state[0, self._bodies, 0] = angle
        self._state[1, self._bodies, 0] = rate
        self._acceleration[self._bodies, 0] = acceleration
        forces = self._kernels.inverse_dynamics(self._state, self._acceleration)
        torque: FloatArray = forces[self._bodies, 0]
        return torque

    def _torques(self, angle: FloatArray, rate: FloatArray, acceleration: FloatArray) -> FloatArray:
        kernels, count = self._kernels, len(angle)
        states, accelerations = kernels.zeros(count, 2), kernels.zeros(count)
        forces = kernels.zeros(count)
        states[:, 0, self._bodies, 0], states[:, 1, self._bodies, 0] = angle, rate
        accelerations[:, self._bodies, 0] = acceleration
        loads, work = kernels.loads, kernels.work
        kernels.call(inverse_dynamics_many, states, accelerations, loads, work, forces)
        torque: FloatArray = forces[:, self._bodies, 0]
        return torque

    def gravity_torque(self, angle: FloatArray) -> FloatArray:
        """Return the torque (joints,) N m of the arm at rest, joint springs included."""
        return self.torque(angle, self._nothing, self._nothing)

    def mass_matrix(self, angle: FloatArray) -> FloatArray:
        """Return the mass matrix (joints, joints), kg m^2; (runs, joints, joints) of several."""
        if angle.ndim > 1:
            return np.array([self.mass_matrix(one) for one in angle])
        self._state[0, self._bodies, 0] = angle
        self._kernels.call(mass_matrix, self._state, self._kernels.work, self._mass)
        found: FloatArray = self._mass[self._bodies, 0][:, self._bodies, 0]
        return found.copy()  # in the layout of that of several, for the same rounding of products
