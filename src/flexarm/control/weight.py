"""The torques that hold an arm's weight, links straight or sagging."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from flexarm.arm import Arm
from flexarm.control.measurement import FloatArray
from flexarm.kernels.layout import new_workspace, no_loads, run_time_sizes
from flexarm.kernels.newton_euler import inverse_dynamics

#: Each correction leaves a part of the one before: weight times deflection over stiffness times
#: length, a tenth where links sag by a tenth of their length.
_CORRECTIONS = 4


class SaggingArm:
    """Torques that hold a flexible arm still at given joint angles; links sag under their weight.

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
        flat = assembly.coordinates[elastic]
        self._places = np.unravel_index(flat, self._still.shape)
        weightless = Arm(arm.spec.replace(gravity=(0.0, 0.0)))
        stiffness = weightless.stiffness_matrix(weightless.rest(np.zeros(arm.joints)))
        self._stiffness = cho_factor(stiffness[np.ix_(elastic, elastic)]) if elastic.size else None

    def gravity_torque(self, angle: FloatArray) -> FloatArray:
        """Return the torque (joints,) N m that holds the arm still, joint springs included."""
        self._state[0] = 0.0
        self._state[0, self._bodies, 0] = angle
        if self._stiffness is not None:
            for _ in range(_CORRECTIONS):
                self._state[0][self._places] -= cho_solve(self._stiffness, self._force()[self._places])
        torque: FloatArray = self._force()[self._bodies, 0]
        return torque

    def _force(self) -> FloatArray:
        inverse_dynamics(
            self._sizes, self._constants, self._state, self._still, self._loads, self._work
        )
        force: FloatArray = self._work.force
        return force
