"""Nonlinear step of an arm over one sample time, and its exact derivatives."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray, IntArray
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.integrate import INTEGRATORS
from flexarm.integrate.explicit_runge_kutta.runge_kutta import ExplicitRungeKutta
from flexarm.integrate.step_sensitivity import held_torque_jacobian
from flexarm.kernels.layout import ArmConstants
from flexarm.linear.step_derivatives.free_parameters import FreeParameters

#: Largest product of step and fastest rate. The relative error of the frequency of the fastest
#: mode is then 0.2^4 / 120 = 1.3e-5 with the classical Runge-Kutta method. A filter interprets a
#: frequency error as a mass error: at a product of 1.0 its errors were ten times as large as its
#: covariance predicts.
REACH = 0.2


class Step(NamedTuple):
    """A state after one sample time, and its derivatives."""

    after: FloatArray  # (2 dof,) [q, qd]
    state: FloatArray  # (2 dof, 2 dof) by the state before
    torque: FloatArray  # (2 dof, joints) by the zero-order-hold torque, N m
    parameters: FloatArray  # (2 dof, p) by the parameters


class SampledStep:
    """Steps of an arm over a sample time under a zero-order-hold torque, with free parameters.

    The steps are those of ``step_jacobian`` with the method "rk4". Their number follows from the
    fastest mode of the arm. They are compiled as a whole, for filters that step at every sample.

    Args:
        arm: the arm.
        sample_time: s.
        parameters: paths that ``FreeParameters`` accepts, at least one.
        reach: largest product of step and fastest rate.
    """

    def __init__(
        self,
        arm: Arm,
        sample_time: float,
        parameters: Sequence[str] = ("payload.mass",),
        reach: float = REACH,
    ) -> None:
        self.arm = arm
        self.steps = max(1, math.ceil(sample_time * fastest_rate(arm) / reach))
        self._h = sample_time / self.steps
        self.free = FreeParameters(arm, parameters)
        self.places = state_places(arm)
        self._rows = classical()
        self._kernels = kernels = KernelView(arm.assembly.constants, complex)
        self._stages = kernels.zeros(len(self._rows) - 1, 2)
        self._before, self._new = kernels.zeros(2), kernels.zeros(2)
        self._slopes = np.zeros((len(self.places) + arm.joints + 1, 2, *kernels.shape))

    def take(self, x: FloatArray, torque: FloatArray, changes: FloatArray | None = None) -> Step:
        """Advance [q, qd] (2 dof,) by one sample time, with ``changes`` (p,) of the parameters."""
        arm = self.arm
        plain, moved = self.free.at(changes)
        self._carry(x, torque, (plain, moved[0]), self.places, arm.assembly.joint_body)
        slopes = arm.unpadded(self._slopes).reshape(len(self._slopes), -1).T
        size, parameters = 2 * arm.dof, [slopes[:, -1].copy()]
        found = Step(self._after(), slopes[:, :size], slopes[:, size:-1], slopes[:, -1:])
        for one in moved[1:]:
            self._carry(x, torque, (plain, one), self.places[:0], arm.assembly.joint_body[:0])
            parameters.append(arm.unpadded(self._slopes[-1]).ravel())
        return found._replace(parameters=np.stack(parameters, axis=1))

    def advance(
        self, x: FloatArray, torque: FloatArray, changes: FloatArray | None = None
    ) -> FloatArray:
        """Return the state [q, qd] (2 dof,) of ``take``, without its derivatives."""
        plain, _ = self.free.at(changes)
        self._carry(x, torque, (plain, plain), self.places[:0], self.arm.assembly.joint_body[:0])
        return self._after()

    def _after(self) -> FloatArray:
        return self.arm.unpadded(self._new.real).ravel()

    def _carry(
        self,
        x: FloatArray,
        torque: FloatArray,
        constants: tuple[ArmConstants, ArmConstants],
        places: IntArray,
        bodies: IntArray,
    ) -> None:
        """Write the state after the steps to ``_new``, and the last derivatives to ``_slopes``."""
        arm = self.arm
        plain, moved = constants
        held_torque_jacobian(
            self._kernels.sizes,
            plain,
            moved,
            self._rows,
            self._h,
            self.steps,
            places,
            bodies,
            arm.padded(x.reshape(2, -1)).astype(complex),
            arm.padded_torque(torque).astype(complex),
            self._kernels.loads,
            self._kernels.work,
            self._stages,
            self._before,
            self._new,
            self._slopes[-1 - len(places) - len(bodies) :],
        )


def state_places(arm: Arm) -> IntArray:
    """Return level, body and column of each state [q, qd] in the kernels' layout, (2 dof, 3)."""
    body, column = np.divmod(arm.assembly.coordinates, 1 + arm.assembly.modes)
    levels = [np.stack([np.full_like(body, level), body, column], axis=1) for level in range(2)]
    return np.concatenate(levels)


def fastest_rate(arm: Arm) -> float:
    """Return the largest modulus of the poles at rest with zero joint angles, 1/s."""
    zero = np.zeros(arm.dof)
    small = arm.derivatives(zero, zero, np.zeros(arm.joints))
    eye = np.eye(arm.dof)
    A = np.block([[np.zeros_like(eye), eye], [small.q, small.qd]])
    return float(abs(np.linalg.eigvals(A)).max())


def classical() -> FloatArray:
    """Return the classical Runge-Kutta method as the rows of ``held_torque_step``."""
    kind = INTEGRATORS["rk4"]
    assert issubclass(kind, ExplicitRungeKutta)
    tableau = kind().tableau
    s = tableau.stages
    return np.ascontiguousarray(tableau.A[: s + 1, : s + 1])
