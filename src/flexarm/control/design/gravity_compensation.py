"""Gravity compensation of an arm whose links sag."""

from __future__ import annotations

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.control.hardware.measurement import FloatArray

#: Number of corrections of the sag at the first call. Each one reduces the error by about the ratio
#: of sag to length, for example to a tenth if links sag by a tenth of their length.
_FIRST_CORRECTIONS = 12


class SaggingArm:
    """Static torques of a flexible arm at given joint angles, with sagging links.

    Each call corrects the sag of the previous call once. This is sufficient, because the sag
    changes little between two sample times, and a correction leaves a small fraction of the error.

    Attributes:
        arm: the flexible arm.
    """

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        assembly = arm.assembly
        self._kernels = KernelView(assembly.constants)
        self._state, self._still = self._kernels.zeros(2), self._kernels.zeros()
        self._bodies = assembly.joint_body
        elastic = np.setdiff1d(np.arange(arm.dof), arm.joint_index)
        self._places = np.unravel_index(assembly.coordinates[elastic], self._still.shape)
        weightless = Arm(arm.spec.replace(gravity=(0.0, 0.0)))
        stiffness = weightless.stiffness_matrix(weightless.rest(np.zeros(arm.joints)))
        self._compliance = np.linalg.inv(stiffness[np.ix_(elastic, elastic)])

    def first_sag(self, angle: FloatArray) -> FloatArray:
        """Return the sag, in elastic coordinates, at the first joint angles."""
        sag = np.zeros(len(self._compliance))
        for _ in range(_FIRST_CORRECTIONS):
            _, sag = self.gravity_torque(angle, sag)
        return sag

    def gravity_torque(self, angle: FloatArray, sag: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the torque (joints,) N m at rest, joint springs included, and the next sag."""
        self._state[0, self._bodies, 0] = angle
        self._state[0][self._places] = sag
        force = self._kernels.inverse_dynamics(self._state, self._still)
        torque: FloatArray = force[self._bodies, 0]
        return torque, sag - self._compliance @ force[self._places]
