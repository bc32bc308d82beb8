"""The rigid twin of an arm, quick enough for a controller to ask at every sample time."""

from __future__ import annotations

import numpy as np

from flexarm.arm import Arm
from flexarm.hardware.measurement import FloatArray
from flexarm.kernels.cache import Entry
from flexarm.kernels.composite_body import mass_matrix
from flexarm.kernels.layout import new_workspace, no_loads, run_time_sizes
from flexarm.kernels.newton_euler import inverse_dynamics


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
        assembly = self.arm.assembly
        self._constants = assembly.constants
        self._sizes = run_time_sizes(self._constants)
        self._work = new_workspace(self._constants)
        self._loads = no_loads(self._constants)
        self._bodies = assembly.joint_body
        modes = self._constants.S.shape[1]
        self._state = np.zeros((2, assembly.bodies, 1 + modes))
        self._acceleration = np.zeros((assembly.bodies, 1 + modes))
        self._mass = np.zeros((*self._acceleration.shape, *self._acceleration.shape))
        self._nothing = np.zeros(self.joints)
        self._inverse_dynamics, self._mass_matrix = Entry(inverse_dynamics), Entry(mass_matrix)

    def torque(self, angle: FloatArray, rate: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Return the torque (joints,) N m that a motion takes: M qdd + bias, gravity included."""
        self._state[0, self._bodies, 0] = angle
        self._state[1, self._bodies, 0] = rate
        self._acceleration[self._bodies, 0] = acceleration
        return self._force()

    def gravity_torque(self, angle: FloatArray) -> FloatArray:
        """Return the torque (joints,) N m that holds the arm still, joint springs included."""
        return self.torque(angle, self._nothing, self._nothing)

    def mass_matrix(self, angle: FloatArray) -> FloatArray:
        """Return the mass matrix (joints, joints), kg m^2."""
        self._state[0, self._bodies, 0] = angle
        self._mass_matrix(self._sizes, self._constants, self._state, self._work, self._mass)
        found: FloatArray = self._mass[self._bodies, 0][:, self._bodies, 0]
        return found

    def _force(self) -> FloatArray:
        self._inverse_dynamics(
            self._sizes,
            self._constants,
            self._state,
            self._acceleration,
            self._loads,
            self._work,
        )
        force: FloatArray = self._work.force[self._bodies, 0]
        return force
