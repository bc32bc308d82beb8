"""Exact Jacobians of one integrator step, for optimisers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.arguments import check_kind, check_list_of, check_positive
from flexarm.base.errors import check_array, public_call
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.kernels.layout import ArmConstants
from flexarm.linear.statics.gaps import warn_of_bristles
from flexarm.linear.step_derivatives.complex_step import stepper_of
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
