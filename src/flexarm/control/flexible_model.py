"""The flexible arm as controllers ask it: forces of a motion, and how far links bend under them."""

from __future__ import annotations

import numpy as np

from flexarm.arm import Arm
from flexarm.control.measurement import FloatArray
from flexarm.kernels.cache import Entry
from flexarm.kernels.layout import new_workspace, no_loads, run_time_sizes
from flexarm.kernels.newton_euler import inverse_dynamics
from flexarm.kernels.observables import POSE_COLUMNS, poses


class FlexibleModel:
    """Forces of a flexible arm whose joints move and whose links are bent but do not swing.

    One call of the kernel gives the torques and what is missing to balance the links, (D.3). Joint
    angles, rates and accelerations (joints,) in rad, rad/s, rad/s^2. Nothing is checked.

    Attributes:
        arm: the arm. elastic: (dof - joints,) positions in q of what is not a joint angle.
    """

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        assembly = arm.assembly
        self.elastic = np.setdiff1d(np.arange(arm.dof), arm.joint_index)
        self._constants = assembly.constants
        self._sizes = run_time_sizes(self._constants)
        self._work = new_workspace(self._constants)
        self._loads = no_loads(self._constants)
        width = 1 + self._constants.S.shape[1]
        self._state = np.zeros((2, assembly.bodies, width))
        self._acceleration = np.zeros((assembly.bodies, width))
        # Flat views: one index for a coordinate, wherever it stands in the kernels' arrays.
        self._q, self._qd = self._state.reshape(2, -1)
        self._qdd = self._acceleration.reshape(-1)
        self._force = self._work.force.reshape(-1)
        self._joint_places = assembly.coordinates[arm.joint_index]
        self._elastic_places = assembly.coordinates[self.elastic]
        self._inverse_dynamics, self._find_poses = Entry(inverse_dynamics), Entry(poses)
        self._poses, self._tip = np.zeros((assembly.bodies, POSE_COLUMNS)), np.zeros(6)

    def forces(
        self, angle: FloatArray, rate: FloatArray, acceleration: FloatArray, bend: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return torques (joints,) N m and the elastic forces (dof - joints,) that are missing.

        ``bend`` (dof - joints,): the elastic coordinates; their rates and accelerations are zero.
        """
        joints, elastic = self._joint_places, self._elastic_places
        self._q[joints] = angle
        self._qd[joints] = rate
        self._qdd[joints] = acceleration
        self._q[elastic] = bend
        self._inverse_dynamics(
            self._sizes, self._constants, self._state, self._acceleration, self._loads, self._work
        )
        return self._force[joints], self._force[elastic]

    def tip(self, angle: FloatArray, bend: FloatArray) -> FloatArray:
        """Return x and y (m) of the tip, (2,)."""
        self._q[self._joint_places] = angle
        self._q[self._elastic_places] = bend
        self._find_poses(self._sizes, self._constants, self._state, self._poses, self._tip)
        return self._tip[:2].copy()
