"""The torques that hold an arm's weight while its links sag under it."""

from __future__ import annotations

import numpy as np

from flexarm.arm import Arm
from flexarm.hardware.measurement import FloatArray
from flexarm.kernels.cache import Entry
from flexarm.kernels.layout import new_workspace, no_loads, run_time_sizes
from flexarm.kernels.newton_euler import inverse_dynamics

#: Each correction leaves a part of the one before: weight times deflection over stiffness times
#: length, a tenth where links sag by a tenth of their length.
_FIRST_CORRECTIONS = 12


class SaggingArm:
    """Torques that hold a flexible arm still at given joint angles; links sag under their weight.

    The sag is corrected once a call, from that of the call before: between two sample times it
    hardly changes, and each correction leaves a small part of the error.

    Attributes:
        arm: the flexible arm.
    """

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        assembly = arm.assembly
        self._constants = assembly.constants
        self._sizes = run_time_sizes(self._constants)
        self._work = new_workspace(self._constants)
        self._loads = no_loads(self._constants)
        self._state = np.zeros((2, assembly.bodies, 1 + self._constants.S.shape[1]))
        self._still = np.zeros(self._state.shape[1:])
        self._bodies = assembly.joint_body
        elastic = np.setdiff1d(np.arange(arm.dof), arm.joint_index)
        self._places = np.unravel_index(assembly.coordinates[elastic], self._still.shape)
        weightless = Arm(arm.spec.replace(gravity=(0.0, 0.0)))
        stiffness = weightless.stiffness_matrix(weightless.rest(np.zeros(arm.joints)))
        self._compliance = np.linalg.inv(stiffness[np.ix_(elastic, elastic)])
        self._inverse_dynamics = Entry(inverse_dynamics)
        self.reset()

    def reset(self) -> None:
        """Forget the sag."""
        self._state[:] = 0.0
        self._known = False

    def gravity_torque(self, angle: FloatArray) -> FloatArray:
        """Return the torque (joints,) N m that holds the arm still, joint springs included."""
        self._state[0, self._bodies, 0] = angle
        if not self._known:
            for _ in range(_FIRST_CORRECTIONS):
                self._correct()
            self._known = True
        return self._correct()

    def _correct(self) -> FloatArray:
        """Return the torque at the sag as it is, and correct the sag."""
        self._inverse_dynamics(
            self._sizes, self._constants, self._state, self._still, self._loads, self._work
        )
        force = self._work.force
        torque: FloatArray = force[self._bodies, 0]
        self._state[0][self._places] -= self._compliance @ force[self._places]
        return torque
