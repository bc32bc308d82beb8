"""Nonlinear steps of an arm over several sample times, and their exact derivatives."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.integrate.transfers import held_torque_transfers
from flexarm.kernels.compilation.cache import Entry
from flexarm.kernels.compilation.duals import DIRECTIONS, Duals
from flexarm.kernels.layout import Workspace
from flexarm.linear.step_derivatives.sampled_step import classical, fastest_rate

#: Largest product of step and fastest rate. The classical Runge-Kutta method changes the frequency
#: of the fastest mode by 0.8 % and its amplitude by 0.7 % in a step. With 2.0, 25 % of its
#: amplitude in a step, control of an arm without damping was unstable.
_REACH = 1.0


class Steps(NamedTuple):
    """States after one to N sample times, and their derivatives."""

    after: FloatArray  # (N, 2 dof) [q, qd]
    state: FloatArray  # (N, 2 dof, 2 dof) by the state one sample time before
    torque: FloatArray  # (N, 2 dof, joints) by the zero-order-hold torque of that time, N m


class SampledSteps:
    """Steps of an arm over several sample times under zero-order-hold torques.

    The steps are those of the method "rk4" and their number follows from the fastest mode of the
    arm, as in `SampledStep`, but they are coarser, for controllers. The derivatives are computed in
    dual numbers.

    Args:
        arm: the arm.
        sample_time: s.
        most: largest number of sample times of a call.

    Attributes:
        steps: number of steps in a sample time.
    """

    def __init__(self, arm: Arm, sample_time: float, most: int) -> None:
        self.steps = max(1, math.ceil(sample_time * fastest_rate(arm) / _REACH))
        self._h, self._A = sample_time / self.steps, classical()
        self._size, self._joints = 2 * arm.dof, arm.joints
        self._view = view = KernelView(arm.assembly.constants)
        self._places, self._bodies = arm.assembly.coordinates, arm.assembly.joint_body
        self._torques = np.zeros((most, view.shape[0]))
        shape = (2, *view.shape)
        self._state, self._torque = Duals.zeros(*shape), Duals.zeros(view.shape[0])
        self._new, self._stages = Duals.zeros(*shape), Duals.zeros(len(self._A) - 1, *shape)
        self._transfers = Duals.zeros(most, *shape)
        arrays = {name: Duals.zeros(*array.shape) for name, array in view.work._asdict().items()}
        self._work = Workspace(**arrays)  # type: ignore[arg-type]
        self._seeds = [self._block(arm, k) for k in range(0, self._size + arm.joints, DIRECTIONS)]
        self._entry = Entry(held_torque_transfers)

    def _block(self, arm: Arm, first: int) -> tuple[Duals, Duals]:
        """Return unit changes of states and torques in eight directions from ``first`` on."""
        units = np.eye(self._size + self._joints)[first : first + DIRECTIONS]
        states = arm.padded(units[:, : self._size].reshape(-1, 2, arm.dof))
        torques = arm.padded_torque(units[:, self._size :])
        nothing = np.zeros(states.shape[1:]), np.zeros(torques.shape[1])
        return Duals.of(nothing[0], states), Duals.of(nothing[1], torques)

    def take(self, x: FloatArray, torques: FloatArray) -> Steps:
        """Advance [q, qd] (2 dof,) under torques (N, joints) N m of N sample times."""
        count, view = len(torques), self._view
        self._torques[:count, self._bodies] = torques
        start = self._state.array.reshape(2, -1, 1 + DIRECTIONS)
        transfers = Duals(self._transfers.array[:count])
        found = []
        for seeds, torque_seeds in self._seeds:
            start[:] = 0.0
            start[:, self._places, 0] = x.reshape(2, -1)
            self._entry(
                view.sizes, view.constants, self._A, self._h, self.steps, self._torques,
                seeds, torque_seeds, self._state, self._torque, view.loads, self._work,
                self._stages, self._new, transfers,
            )  # fmt: skip
            whole = transfers.array.reshape(count, 2, -1, 1 + DIRECTIONS)[:, :, self._places]
            found.append(whole.reshape(count, self._size, 1 + DIRECTIONS))
        slopes = np.concatenate([block[..., 1:] for block in found], axis=2)
        end = self._size + self._joints
        return Steps(found[0][..., 0], slopes[..., : self._size], slopes[..., self._size : end])
