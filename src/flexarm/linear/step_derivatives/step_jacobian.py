"""Exact Jacobians of one integrator step, by the kernels of ``simulate``, for optimisers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.base.arguments import check_kind, check_list_of, check_positive
from flexarm.base.errors import InputError, Problem, check_array, public_call, shown
from flexarm.integrate import INTEGRATORS, REMOVED
from flexarm.integrate.base import Drive, System
from flexarm.integrate.explicit_runge_kutta.runge_kutta import ExplicitRungeKutta
from flexarm.integrate.implicit.additive_tableau import Additive, AdditiveTableau, additive_record
from flexarm.integrate.memory import new_memory
from flexarm.integrate.step_sensitivity import held_torque_additive_step, held_torque_step
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.kernels.layout import ArmConstants
from flexarm.linear.statics.gaps import warn_of_bristles
from flexarm.linear.step_derivatives.parameters import constants_by


@dataclass(frozen=True, eq=False)
class StepJacobian:
    """One step from x = [q, qd] to x', and its derivatives, exact to rounding.

    Attributes:
        q, qd: (dof,) after the step.
        state: (2 dof, 2 dof) by [q, qd] before it.
        torque: (2 dof, joints) by the constant torque during the step, N m.
        parameters: for each requested parameter, (2 dof,) by it, at constant initial q and qd.
    """

    q: FloatArray
    qd: FloatArray
    state: FloatArray
    torque: FloatArray
    parameters: dict[str, FloatArray]

    def __repr__(self) -> str:
        by = [f"{self.state.shape[1]} states", f"{self.torque.shape[1]} torques", *self.parameters]
        return f"<flexarm.StepJacobian: {self.state.shape[0]} states by {', '.join(by)}>"


@public_call
def step_jacobian(
    arm: Arm,
    q: ArrayLike,
    qd: ArrayLike,
    torque: ArrayLike,
    step: float,
    *,
    method: str = "rk4",
    parameters: Sequence[str] = (),
) -> StepJacobian:
    """Compute one step of an integrator and its exact derivatives.

    Args:
        arm: the arm.
        q, qd: (dof,) before the step.
        torque: (joints,) N m, constant during the step.
        step: length of the step, s.
        method: a one-step method of ``flexarm.integrate.INTEGRATORS``, explicit or implicit in
            bending. A method with step control takes this step without control.
        parameters: "link_1.length", "link_1.mass", "link_1.rigidity": by a factor on the whole
            link, at one; "payload.mass" by kg, "payload.inertia" by kg m^2.

    Raises:
        InputError: if an argument has the wrong shape or value, the method is not a one-step
            method, or a parameter is not supported.

    Warns:
        AccuracyWarning: friction has bristles, which a step of q and qd does not contain.

    The derivatives by parameters are at constant modal coordinates, not constant nodal ones.
    Chained over steps they give the derivative of a whole run of ``simulate`` from straight links.
    Computed by complex perturbation of the kernels of the integrator; (D.15).
    """
    arm = check_kind("arm", arm, Arm)
    warn_of_bristles(arm, "the step")
    h = check_positive("step", step)
    parameters = check_list_of("parameters", parameters, str)
    state = [check_array(n, v, (arm.dof,)) for n, v in (("q", q), ("qd", qd))]
    held = check_array("torque", torque, (arm.joints,))
    stepper = stepper_of(arm, method, h)
    x, tau = np.concatenate(state), arm.padded_torque(held)
    exact = arm.assembly.constants
    columns = []
    for place in range(2 * arm.dof):
        columns.append(stepper.take(x + _unit(place, x.size), tau, exact).imag / STEP)
    inputs = []
    for joint in range(arm.joints):
        perturbed = arm.padded_torque(held + _unit(joint, arm.joints))
        inputs.append(stepper.take(x, perturbed, exact).imag / STEP)
    named = {}
    for parameter in parameters:
        by = constants_by(arm, parameter)
        moved = ArmConstants(*(c + 1j * STEP * d for c, d in zip(exact, by, strict=True)))
        named[parameter] = stepper.take(x, tau, moved).imag / STEP
    after = stepper.take(x, tau, exact).real
    return StepJacobian(
        after[: arm.dof],
        after[arm.dof :],
        np.stack(columns, axis=1),
        np.stack(inputs, axis=1) if inputs else np.zeros((x.size, 0)),
        named,
    )


def _unit(place: int, size: int) -> FloatArray:
    """Return an imaginary step in one entry of a vector."""
    unit = np.zeros(size, dtype=complex)
    unit[place] = 1j * STEP
    return unit


class _Stepper(Protocol):
    """One integrator with a fixed step length."""

    def take(self, x: FloatArray, torque: FloatArray, constants: ArmConstants) -> FloatArray:
        """Return [q, qd] (2 dof,) after one step, complex; ``torque`` (n,) is given by body."""


def stepper_of(arm: Arm, method: str, h: float) -> _Stepper:
    """Return a stepper of step h (s) for a method whose step depends on the state alone."""
    kind = INTEGRATORS.get(method) if isinstance(method, str) else None
    if kind is not None and issubclass(kind, ExplicitRungeKutta):
        tableau = kind().tableau
        s = tableau.stages
        return _Explicit(arm, np.ascontiguousarray(tableau.A[: s + 1, : s + 1]), h)
    if kind is not None and issubclass(kind, Additive):
        return _Additive(arm, kind.tableau, h)
    known = [
        name for name, k in INTEGRATORS.items() if issubclass(k, (ExplicitRungeKutta, Additive))
    ]
    rule = f"be one of {', '.join(map(repr, known))}"
    hint = ""
    if isinstance(method, str) and method in REMOVED:
        hint = f"It was removed; use {REMOVED[method]!r}."
    elif kind is not None:
        hint = "Multistep and iterative methods are not supported."
    raise InputError(Problem("method", rule, shown(method), hint))


class _Explicit:
    """Steps of an explicit Runge-Kutta method with complex numbers."""

    def __init__(self, arm: Arm, rows: FloatArray, h: float) -> None:
        self.arm, self.rows, self.h = arm, rows, h
        self.kernels = KernelView(arm.assembly.constants, complex)
        self.stages, self.new = self.kernels.zeros(len(rows) - 1, 2), self.kernels.zeros(2)

    def take(self, x: FloatArray, torque: FloatArray, constants: ArmConstants) -> FloatArray:
        """See ``Stepper.take``."""
        held_torque_step(
            self.kernels.sizes,
            _complex(constants),
            self.rows,
            self.h,
            self.arm.padded(x.reshape(2, -1)).astype(complex),
            torque.astype(complex),
            self.kernels.loads,
            self.kernels.work,
            self.stages,
            self.new,
        )
        return self.arm.unpadded(self.new).ravel()


class _Additive:
    """Steps of a method that is implicit in bending, with complex numbers."""

    def __init__(self, arm: Arm, tableau: AdditiveTableau, h: float) -> None:
        self.arm, self.tableau, self.h = arm, tableau, h
        self.kernels = KernelView(arm.assembly.constants, complex)

    def take(self, x: FloatArray, torque: FloatArray, constants: ArmConstants) -> FloatArray:
        """See ``Stepper.take``."""
        own, arm = _complex(constants), self.arm
        coefficients = np.zeros((1, 4, torque.size), dtype=complex)
        coefficients[0, 0] = torque
        span, nothing = np.array([0.0, 1.0]), np.zeros((1, 4, 0))
        amplitude = np.zeros((0, 3))
        kernels = self.kernels
        drive = Drive(span, coefficients, np.zeros(0), kernels.loads, amplitude, span, nothing)
        state = arm.padded(x.reshape(2, -1)).astype(complex)
        memory = new_memory(state, self.h)
        held_torque_additive_step(
            System(kernels.sizes, own, drive, kernels.work),
            additive_record(self.tableau, own, state),
            memory,
            self.h,
        )
        return arm.unpadded(memory.new).ravel()


def _complex(constants: ArmConstants) -> ArmConstants:
    """Convert all constants to complex numbers, so that the kernels compile only once."""
    return ArmConstants(*(array.astype(complex) for array in constants))
