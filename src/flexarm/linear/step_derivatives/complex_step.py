"""Integrator steps in complex arithmetic, computed by the kernels that ``simulate`` uses."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.base.errors import InputError, Problem, shown
from flexarm.integrate import INTEGRATORS, REMOVED
from flexarm.integrate.base import Drive, System
from flexarm.integrate.explicit_runge_kutta.runge_kutta import ExplicitRungeKutta
from flexarm.integrate.implicit.additive_tableau import Additive, AdditiveTableau, additive_record
from flexarm.integrate.memory import new_memory
from flexarm.integrate.step_sensitivity import held_torque_additive_step, held_torque_step
from flexarm.kernels.layout import ArmConstants


class Stepper(Protocol):
    """One integrator with a fixed step length."""

    def take(self, x: FloatArray, torque: FloatArray, constants: ArmConstants) -> FloatArray:
        """Return [q, qd] (2 dof,) after one step, complex; ``torque`` (n,) is given by body."""


def stepper_of(arm: Arm, method: str, h: float) -> Stepper:
    """Return a stepper of step h (s) for a method of ``INTEGRATORS``.

    Raises:
        InputError: if the method is unknown, or its step does not depend on the state alone.
    """
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
