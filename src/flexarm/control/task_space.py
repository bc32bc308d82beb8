"""The tip of the rigid twin as controllers in the task space need it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.arm import Arm
from flexarm.control.measurement import FloatArray
from flexarm.kernels.layout import run_time_sizes
from flexarm.kernels.observables import POSE_COLUMNS
from flexarm.kernels.tip_motion import tip_motion


class TipState(NamedTuple):
    """Where the tip is and how joints move it, world axes."""

    position: FloatArray  # (2,) m
    velocity: FloatArray  # (2,) m/s
    jacobian: FloatArray  # (2, joints) m
    bias: FloatArray  # (2,) m/s^2: acceleration where no joint accelerates


class TaskSpace:
    """Rigid kinematics of the tip; the arm's own kernels, without checks."""

    def __init__(self, arm: Arm) -> None:
        assembly = arm.rigid().assembly
        self._constants = assembly.constants
        self._sizes = run_time_sizes(self._constants)
        self._bodies = assembly.joint_body
        n, m = self._constants.S.shape
        self._state = np.zeros((2, n, 1 + m))
        self._scratch = np.zeros((2, n, 1 + m), dtype=complex)
        self._poses = np.zeros((n, POSE_COLUMNS), dtype=complex)
        self._tip = np.zeros(6, dtype=complex)

    def at(self, angle: FloatArray, rate: FloatArray) -> TipState:
        """Return the tip at joint angles (rad) and rates (rad/s), (joints,) each."""
        self._state[0, self._bodies, 0] = angle
        self._state[1, self._bodies, 0] = rate
        found = np.zeros((3, 2))
        jacobian = np.zeros((2, self._state.shape[1]))
        tip_motion(
            self._sizes,
            self._constants,
            self._state,
            self._scratch,
            self._poses,
            self._tip,
            found[0],
            found[1],
            jacobian,
            found[2],
        )
        return TipState(found[0], found[1], jacobian[:, self._bodies], found[2])


def accelerations_for(tip: TipState, wanted: FloatArray) -> FloatArray:
    """Return joint accelerations (joints,) that give the tip an acceleration (2,), m/s^2.

    The smallest ones of an arm with more than two joints; damped where the arm is nearly straight
    or folded, so that nothing grows beyond bounds there.
    """
    J = tip.jacobian
    square = J @ J.T
    trace = square[0, 0] + square[1, 1]
    damping = 1e-6 * trace
    a, b, c = square[0, 0] + damping, square[0, 1], square[1, 1] + damping
    x, y = wanted - tip.bias
    scale = 1.0 / (a * c - b * b)
    solved: FloatArray = J.T @ np.array([scale * (c * x - b * y), scale * (a * y - b * x)])
    return solved
