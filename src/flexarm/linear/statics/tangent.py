"""Matrices of small deviations, theory "small motion", (S.2), and shapes of steady rotation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.arm.actions import EMPTY, Environment
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.coordinates import coordinate_sizes
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.base.errors import InputError, Problem, shown
from flexarm.kernels.derivatives.tangent import inverse_jacobian
from flexarm.linear.statics.equilibrium import EquilibriumError


class Tangent(NamedTuple):
    """Matrices M, D, K of M qdd + D qd + K q for small deviations, each (dof, dof)."""

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray


def tangent(
    arm: Arm,
    q: FloatArray,
    qd: FloatArray,
    qdd: FloatArray,
    environment: Environment = EMPTY,
) -> Tangent:
    """Linearise the inverse dynamics about a motion q, qd, qdd, each (dof,); exact to rounding.

    If qd is not zero, ``damping`` includes gyroscopic terms and ``stiffness`` centrifugal terms.
    """
    kernels = KernelView(arm.assembly.constants, complex)
    n, width = kernels.shape
    jacobian = np.zeros((n, width, 2, n, width))
    kernels.call(
        inverse_jacobian,
        arm.padded(np.stack([q, qd])).astype(complex),
        arm.padded(qdd),
        environment.placed(arm),
        kernels.work,
        jacobian,
    )
    kept = arm.assembly.coordinates
    by_state = jacobian.reshape(n * width, 2, n * width)[kept]
    return Tangent(arm.mass_matrix(q), by_state[:, 1, kept], by_state[:, 0, kept])


_STEPS = 40


def steady_rates(arm: Arm, spin: float) -> FloatArray:
    """Return the rates (dof,) of an arm that rotates as a whole with ``spin``, rad/s.

    Raises:
        InputError: if the spin is not zero and the arm has gravity, under which no shape is steady,
            or its first joint is fixed.
    """
    rates = np.zeros(arm.dof)
    if spin == 0.0:
        return rates
    if any(arm.spec.gravity):
        raise InputError(Problem("spin", "be zero for an arm with gravity", shown(spin)))
    if arm.joints == 0 or arm.joint_numbers[0] != 1:
        rule = "be zero for an arm whose first joint is fixed"
        raise InputError(Problem("spin", rule, shown(spin)))
    rates[arm.joint_index[0]] = spin
    return rates


def steady_shape(arm: Arm, q: FloatArray, spin: float) -> FloatArray:
    """Compute the steady shape q (dof,) at a constant spin, with joint angles of ``q``; (S.5)."""
    from scipy.linalg import solve

    rates, still = steady_rates(arm, spin), np.zeros(arm.dof)
    bending = np.setdiff1d(np.arange(arm.dof), arm.joint_index)
    if spin == 0.0 or bending.size == 0:
        return q
    found, part, unit = q.copy(), np.ix_(bending, bending), coordinate_sizes(arm)[bending]
    for _ in range(_STEPS):
        missing = arm.inverse_dynamics(found, rates, still)[bending]
        try:
            step = solve(tangent(arm, found, rates, still).stiffness[part], -missing)
        except np.linalg.LinAlgError:
            break
        found[bending] += step
        # Newton's method converges quadratically: after a step this small only rounding remains.
        if np.max(np.abs(step / unit)) <= 1e-9 * (1e-3 + np.max(np.abs(found[bending] / unit))):
            return found
    raise EquilibriumError(0.0, q, f"the links have no steady shape at {spin:g} rad/s.")
