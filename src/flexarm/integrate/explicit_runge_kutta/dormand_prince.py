"""Dormand and Prince's pair of order 8(5,3), with step control and dense output."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import Polynomial

from flexarm.integrate.base import FloatArray
from flexarm.integrate.explicit_runge_kutta import dop853
from flexarm.integrate.explicit_runge_kutta.runge_kutta import ExplicitRungeKutta
from flexarm.integrate.tableau import Tableau


def _order_8_dense(b: FloatArray, D: FloatArray) -> FloatArray:
    """Write DOP853's nested interpolant (Hairer, Norsett and Wanner I, II.6) as polynomials.

    The interpolant is F0 x + F1 x y + F2 x^2 y + F3 x^2 y^2 + ... with y = 1 - x. F0 to F2 come
    from the ends of the step, the others from the rows of D.
    """
    r = D.shape[1]
    total = np.zeros(r)
    total[: b.size] = b
    start, end = np.zeros(r), np.zeros(r)
    start[0], end[b.size] = 1.0, 1.0
    rows = [total, start - total, 2.0 * total - (start + end), *D]
    x, y = Polynomial([0.0, 1.0]), Polynomial([1.0, -1.0])
    dense = np.zeros((r, len(rows)))
    factor = Polynomial([1.0])
    for k, row in enumerate(rows):
        factor = factor * (x if k % 2 == 0 else y)
        powers = np.zeros(len(rows) + 1)
        powers[: factor.coef.size] = factor.coef
        dense += np.outer(row, powers[1:])
    return dense


@cache
def _order_8() -> Tableau:
    rows = [*dop853.A, dop853.B, *dop853.A_EXTRA]  # stages, new point, dense output
    A = np.zeros((len(rows), len(rows)))
    for k, row in enumerate(rows):
        A[k, : len(row)] = row
    b = np.array(dop853.B)
    return Tableau(
        order=8,
        A=A,
        b=b,
        c=np.array([*dop853.C, 1.0, *dop853.C_EXTRA]),
        error=np.array([dop853.E5, dop853.E3]),
        error_orders=(5, 3),
        dense=_order_8_dense(b, np.array(dop853.D)),
    )


@dataclass(frozen=True)
class DormandPrince8(ExplicitRungeKutta):
    """Explicit method of order 8(5,3) with 12 stages, plus three for dense output of order 7."""

    name = "dormand_prince_8"
    order = 8
    adaptive = True
    follows_bristles = True
    reference = ("PrinceDormand1981", "HairerNorsettWanner1993")

    @property
    def tableau(self) -> Tableau:
        """Coefficients of the method."""
        return _order_8()
