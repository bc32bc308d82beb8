"""The flexible arm as controllers ask it: forces of a motion, and how far links bend under them."""

from __future__ import annotations

import numpy as np

from flexarm.arm import Arm
from flexarm.hardware.measurement import FloatArray
from flexarm.kernels.cache import Entry
from flexarm.kernels.layout import new_workspace, no_loads, run_time_sizes
from flexarm.kernels.newton_euler import inverse_dynamics_many
from flexarm.kernels.observables import POSE_COLUMNS, poses


class FlexibleModel:
    """Forces of a flexible arm whose joints move and whose links are bent but do not swing.

    Torques and what is missing to balance the links: (D.3). Joint angles, rates and accelerations
    in rad, rad/s, rad/s^2. Nothing is checked.

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
        self._joint_places = assembly.coordinates[arm.joint_index]
        self._elastic_places = assembly.coordinates[self.elastic]
        self._inverse_dynamics, self._find_poses = Entry(inverse_dynamics_many), Entry(poses)
        self._poses, self._tip = np.zeros((assembly.bodies, POSE_COLUMNS)), np.zeros(6)

    def forces_many(
        self, angle: FloatArray, rate: FloatArray, acceleration: FloatArray, bend: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return torques (T, joints) N m and the elastic forces (T, dof - joints) that are missing.

        ``bend`` (T, dof - joints): the elastic coordinates; their rates and accelerations are zero.
        """
        joints, elastic = self._joint_places, self._elastic_places
        _, bodies, width = self._state.shape
        states = np.zeros((len(angle), 2, bodies, width))
        accelerations = np.zeros((len(angle), bodies, width))
        forces = np.empty_like(accelerations)
        flat = states.reshape(len(angle), 2, -1)
        flat[:, 0, joints], flat[:, 1, joints] = angle, rate
        flat[:, 0, elastic] = bend
        accelerations.reshape(len(angle), -1)[:, joints] = acceleration
        self._inverse_dynamics(
            self._sizes, self._constants, states, accelerations, self._loads, self._work, forces
        )
        found = forces.reshape(len(angle), -1)
        return found[:, joints], found[:, elastic]

    def tip(self, angle: FloatArray, bend: FloatArray) -> FloatArray:
        """Return x and y (m) of the tip, (2,)."""
        # A flat view: one index for a coordinate, wherever it stands in the kernels' arrays.
        q = self._state[0].reshape(-1)
        q[self._joint_places], q[self._elastic_places] = angle, bend
        self._find_poses(self._sizes, self._constants, self._state, self._poses, self._tip)
        return self._tip[:2].copy()
