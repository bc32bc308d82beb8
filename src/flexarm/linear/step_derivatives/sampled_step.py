"""Nonlinear step of an arm over one sample time, and its exact derivatives."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexarm.arm import Arm
from flexarm.assembly.assemble import FloatArray, IntArray
from flexarm.assembly.kernel_view import KernelView
from flexarm.integrate import INTEGRATORS
from flexarm.integrate.explicit_runge_kutta.runge_kutta import ExplicitRungeKutta
from flexarm.integrate.step_sensitivity import held_torque_jacobian
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.kernels.layout import ArmConstants
from flexarm.linear.step_derivatives.parameters import constants_by

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
    parameter: FloatArray  # (2 dof,) by the parameter


class SampledStep:
    """Steps of an arm over a sample time under a zero-order-hold torque, with one free parameter.

    The steps are those of ``step_jacobian`` with the method "rk4". Their number follows from the
    fastest mode of the arm. They are compiled as a whole, for filters that step at every sample.

    Args:
        arm: the arm.
        sample_time: s.
        parameter: one in which the constants are linear, such as "payload.mass".
        reach: largest product of step and fastest rate.
    """

    def __init__(
        self,
        arm: Arm,
        sample_time: float,
        parameter: str = "payload.mass",
        reach: float = REACH,
    ) -> None:
        self.arm = arm
        self.steps = max(1, math.ceil(sample_time * fastest_rate(arm) / reach))
        self._h = sample_time / self.steps
        exact = arm.assembly.constants
        self._exact = ArmConstants(*(array.astype(complex) for array in exact))
        by = constants_by(arm, parameter)
        self._by = [(k, d) for k, d in enumerate(by) if np.any(d)]
        self.places = state_places(arm)
        self._rows = classical()
        self._kernels = kernels = KernelView(exact, complex)
        self._stages = kernels.zeros(len(self._rows) - 1, 2)
        self._before, self._new = kernels.zeros(2), kernels.zeros(2)
        self._slopes = np.zeros((len(self.places) + arm.joints + 1, 2, *kernels.shape))

    def constants(self, change: float) -> tuple[ArmConstants, ArmConstants]:
        """Return the complex constants with the changed parameter, unperturbed and perturbed."""
        plain, moved = list(self._exact), list(self._exact)
        for k, by in self._by:
            plain[k] = self._exact[k] + change * by
            moved[k] = plain[k] + 1j * STEP * by
        return ArmConstants(*plain), ArmConstants(*moved)

    def take(self, x: FloatArray, torque: FloatArray, change: float = 0.0) -> Step:
        """Advance [q, qd] (2 dof,) by one sample time, with a ``change`` of the parameter."""
        arm = self.arm
        self._carry(x, torque, change, self.places, arm.assembly.joint_body, self._slopes)
        slopes = arm.unpadded(self._slopes).reshape(len(self._slopes), -1).T
        size = 2 * arm.dof
        return Step(self._after(), slopes[:, :size], slopes[:, size:-1], slopes[:, -1])

    def advance(self, x: FloatArray, torque: FloatArray, change: float = 0.0) -> FloatArray:
        """Return the state [q, qd] (2 dof,) of ``take``, without its derivatives."""
        none = self.arm.assembly.joint_body[:0]
        self._carry(x, torque, change, self.places[:0], none, self._slopes[-1:])
        return self._after()

    def _after(self) -> FloatArray:
        return self.arm.unpadded(self._new.real).ravel()

    def _carry(
        self,
        x: FloatArray,
        torque: FloatArray,
        change: float,
        places: IntArray,
        bodies: IntArray,
        slopes: FloatArray,
    ) -> None:
        """Write the state after the steps to ``_new``, and the derivatives to ``slopes``."""
        arm = self.arm
        plain, moved = self.constants(change)
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
            slopes,
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
