"""The flexible arm as controllers ask it: forces of a motion, and how far links bend under them."""

from __future__ import annotations

import numpy as np

from flexarm.arm import Arm
from flexarm.hardware.measurement import FloatArray
from flexarm.kernel_view import KernelView
from flexarm.kernels.newton_euler import inverse_dynamics_many
from flexarm.kernels.observables import poses


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
        self._kernels = KernelView(assembly.constants)
        self._state = self._kernels.zeros(2)
        self._joint_places = assembly.coordinates[arm.joint_index]
        self._elastic_places = assembly.coordinates[self.elastic]
        self._poses, self._tip = self._kernels.pose_arrays()

    def forces_many(
        self, angle: FloatArray, rate: FloatArray, acceleration: FloatArray, bend: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return torques (T, joints) N m and the elastic forces (T, dof - joints) that are missing.

        ``bend`` (T, dof - joints): the elastic coordinates; their rates and accelerations are zero.
        """
        joints, elastic = self._joint_places, self._elastic_places
        kernels, count = self._kernels, len(angle)
        states, accelerations = kernels.zeros(count, 2), kernels.zeros(count)
        forces = np.empty_like(accelerations)
        flat = states.reshape(count, 2, -1)
        flat[:, 0, joints], flat[:, 1, joints] = angle, rate
        flat[:, 0, elastic] = bend
        accelerations.reshape(count, -1)[:, joints] = acceleration
        kernels.call(
            inverse_dynamics_many, states, accelerations, kernels.loads, kernels.work, forces
        )
        found = forces.reshape(count, -1)
        return found[:, joints], found[:, elastic]

    def tip(self, angle: FloatArray, bend: FloatArray) -> FloatArray:
        """Return x and y (m) of the tip, (2,)."""
        # A flat view: one index for a coordinate, wherever it stands in the kernels' arrays.
        q = self._state[0].reshape(-1)
        q[self._joint_places], q[self._elastic_places] = angle, bend
        self._kernels.call(poses, self._state, self._poses, self._tip)
        return self._tip[:2].copy()
