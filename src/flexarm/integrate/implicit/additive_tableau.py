"""Additive Runge-Kutta integrators: pairs of tableaus, checked on construction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexarm.integrate.base import FloatArray, Integrator
from flexarm.integrate.implicit.additive import AdditiveRecord, advance_additive
from flexarm.integrate.tableau import demand, demand_order, demand_zero
from flexarm.kernels.compilation.duals import zeros_like
from flexarm.kernels.layout import ArmConstants
from flexarm.kernels.recursion.implicit_step import constants_to_soften


@dataclass(frozen=True, eq=False)
class AdditiveTableau:
    """Coefficients of an explicit and a diagonally implicit method of s stages.

    Both have the same abscissae and the same weights of the new point.

    Attributes:
        order: order of the new point for every split of the equations; that of the embedded
            solution is one less.
        explicit, implicit: (s + 1, s) rows of the stages and of the new point.
        c: (s + 1,) abscissae.
        error: (2, s + 1) weights of the error estimate; the second row and column are zero.

    Raises:
        ValueError: if the coefficients do not satisfy the order conditions or their structure.
    """

    order: int
    explicit: FloatArray
    implicit: FloatArray
    c: FloatArray
    error: FloatArray

    def __post_init__(self) -> None:
        s = self.explicit.shape[1]
        AE, AI, b = self.explicit[:s], self.implicit[:s], self.implicit[s]
        demand(np.all(np.triu(AE) == 0.0), "the explicit rows must be strictly lower triangular")
        demand(np.all(np.triu(AI, 1) == 0.0), "the implicit rows must be lower triangular")
        diagonal = np.diag(AI)
        same = diagonal[0] == 0.0 and np.all(diagonal[1:] == diagonal[1])
        demand(same, "the implicit stages must have one number on the diagonal")
        demand_zero(AI[-1] - b, "the new point must be the last implicit stage")
        demand_zero(self.explicit[s] - b, "both methods must have the same weights")
        for rows in (self.explicit, self.implicit):
            demand_zero(rows.sum(axis=1) - self.c, "rows must sum to c")
        demand_order(self.order, b, AE, AI)
        demand_order(self.order - 1, self.error[0, :s], AE, AI, exact=0.0)


def additive_tableau(
    order: int,
    explicit: Sequence[Sequence[float]],
    implicit: Sequence[Sequence[float]],
    embedded: Sequence[float],
) -> AdditiveTableau:
    """Create a tableau from the rows of its stages; the last implicit row is the new point.

    ``embedded`` (s,): weights of the embedded solution for the error estimate.
    """
    s = len(embedded)
    pair = np.zeros((2, s + 1, s))
    for half, rows in zip(pair, (explicit, implicit), strict=True):
        for k, row in enumerate([*rows, implicit[-1]]):
            half[k, : len(row)] = row
    error = np.zeros((2, s + 1))
    error[0, :s] = pair[1, s] - embedded
    return AdditiveTableau(order, pair[0], pair[1], np.append(pair[0, :s].sum(axis=1), 1.0), error)


def additive_record(
    tableau: AdditiveTableau, constants: ArmConstants, state: FloatArray
) -> AdditiveRecord:
    """Allocate the record of a run from ``state`` (2, n, 1 + m), with its number type."""
    return AdditiveRecord(
        explicit=tableau.explicit,
        implicit=tableau.implicit,
        c=tableau.c,
        error=tableau.error,
        order=tableau.order,
        known=zeros_like(state, *state.shape),
        stages=zeros_like(state, len(tableau.c), *state.shape),
        softened=constants_to_soften(constants),
    )


@dataclass(frozen=True)
class Additive(Integrator):
    """Base class of the additive methods."""

    adaptive: ClassVar[bool] = True
    follows_bristles: ClassVar[bool] = True
    follows_sticking: ClassVar[bool] = True
    follows_closures: ClassVar[bool] = True
    reference: ClassVar[tuple[str, ...]] = ("KennedyCarpenter2003", "BoscarinoFilbetRusso2016")
    tableau: ClassVar[AdditiveTableau]
    stepper = staticmethod(advance_additive)

    def record(self, constants: ArmConstants, state: FloatArray) -> AdditiveRecord:
        """See ``Integrator.record``."""
        return additive_record(self.tableau, constants, state)
