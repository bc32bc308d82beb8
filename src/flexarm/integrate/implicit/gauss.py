"""Gauss collocation of order 6: symmetric, conserves the energy of long undamped motions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flexarm.integrate.base import FloatArray, Integrator
from flexarm.integrate.implicit.collocation import CollocationRecord, advance_collocation
from flexarm.integrate.tableau import demand_order, demand_zero
from flexarm.kernels.compilation.duals import zeros_like
from flexarm.kernels.layout import ArmConstants
from flexarm.kernels.recursion.implicit_step import constants_to_soften


class Coefficients(NamedTuple):
    """Coefficients of Gauss collocation with s stages, for second-order equations."""

    A: FloatArray  # (s, s)
    AA: FloatArray  # (s, s) A A
    b: FloatArray  # (s,)
    bA: FloatArray  # (s,) b A
    c: FloatArray  # (s,)
    guess: FloatArray  # (2, s, 2 s) weights of earlier stages in the initial guess


def gauss_coefficients(stages: int) -> Coefficients:
    """Return the coefficients from Gauss-Legendre quadrature; Hairer and Wanner II, IV.5.

    Raises:
        ValueError: if the coefficients do not have the order or the symmetry of the method.
    """
    x, w = np.polynomial.legendre.leggauss(stages)
    c, b = (1.0 + x) / 2.0, w / 2.0
    powers = np.arange(stages)
    A = (c[:, None] ** (powers + 1) / (powers + 1)) @ np.linalg.inv(c[:, None] ** powers)
    guess = np.zeros((2, stages, 2 * stages))
    guess[0, :, stages:] = _continued(c - 1.0, c)
    guess[1] = _continued(np.concatenate([c - 2.0, c - 1.0]), c)
    demand_order(2 * stages, b, A)
    demand_zero(A + A[::-1, ::-1] - b, "the coefficients must be symmetric")
    return Coefficients(A, A @ A, b, b @ A, c, guess)


def _continued(known: FloatArray, asked: FloatArray) -> FloatArray:
    """Return weights (asked, known) to evaluate the polynomial through values at ``known``."""
    powers = np.arange(known.size)
    return np.asarray(asked[:, None] ** powers @ np.linalg.inv(known[:, None] ** powers))


_COEFFICIENTS = gauss_coefficients(3)
#: Factors of h^2 K and h D on the diagonal of a sweep, chosen to minimise the contraction factor of
#: linear vibrations at the step with the slowest convergence, (I.15).
_PULL, _DRAG = 0.0337, 0.214


@dataclass(frozen=True)
class Gauss6(Integrator):
    """Symmetric method of order 6 with three stages and a fixed step, without energy drift.

    Bending, springs and damping are implicit; the stages are solved to rounding errors. This
    requires a step about as short as that of an explicit method of high order.

    Args:
        step: fixed step (s), shortened to end at every stop; None: ``simulate`` chooses it
            (``flexarm.simulation.run.default_step``).
    """

    name = "gauss_6"
    order = 6
    follows_contacts = False
    reference = ("HairerLubichWanner2006", "HouwenSwart1997")
    stepper = staticmethod(advance_collocation)

    def record(self, constants: ArmConstants, state: FloatArray) -> CollocationRecord:
        """See ``Integrator.record``."""
        count, shape = len(_COEFFICIENTS.c), state.shape[1:]
        return CollocationRecord(
            **_COEFFICIENTS._asdict(),
            pull=_PULL,
            drag=_DRAG,
            inner=zeros_like(state, *state.shape),
            lost=zeros_like(state, *state.shape),
            stages=zeros_like(state, count, *shape),
            earlier=zeros_like(state, 2 * count, *shape),
            ends=zeros_like(state, 2, *state.shape),
            change=zeros_like(state, 1, *state.shape),
            one=np.ones((2, 1)),
            softened=constants_to_soften(constants),
        )
