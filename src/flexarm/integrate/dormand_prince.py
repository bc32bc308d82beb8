"""Dormand and Prince's pairs of order 5(4) and 8(5,3), with step control and dense output.

The coefficients of order 5 are SciPy's public class attributes, which carry them in full precision;
those of order 8 stand in ``dop853``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import Polynomial

from flexarm.integrate import dop853
from flexarm.integrate.runge_kutta import ExplicitRungeKutta
from flexarm.integrate.tableau import FloatArray, Tableau


def _square(A: FloatArray, b: FloatArray, extra: FloatArray | None = None) -> FloatArray:
    """Join the rows of the stages, of the new point and of dense output to one (r, r) array."""
    s = b.size
    r = s + 1 + (0 if extra is None else len(extra))
    joined = np.zeros((r, r))
    joined[:s, : A.shape[1]] = A
    joined[s, :s] = b
    if extra is not None:
        joined[s + 1 :, : extra.shape[1]] = extra
    return joined


@cache
def _order_5() -> Tableau:
    from scipy.integrate import RK45

    return Tableau(
        order=5,
        A=_square(RK45.A, RK45.B),
        b=RK45.B,
        c=np.append(RK45.C, 1.0),
        error=RK45.E,
        error_low=np.zeros(7),
        dense=RK45.P,
    )


def _order_8_dense(b: FloatArray, D: FloatArray) -> FloatArray:
    """Write DOP853's nested interpolant (Hairer, Norsett and Wanner I, II.6) as polynomials.

    The interpolant is F0 x + F1 x y + F2 x^2 y + F3 x^2 y^2 + ... with y = 1 - x, where F0 to F2
    come from the ends of the step and F3 on from the rows of D.
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
    A = np.zeros((len(dop853.C), len(dop853.C)))
    for k, row in enumerate(dop853.A):
        A[k, : len(row)] = row
    b = np.array(dop853.B)
    return Tableau(
        order=8,
        A=_square(A, b, np.array(dop853.A_EXTRA)),
        b=b,
        c=np.array([*dop853.C, 1.0, *dop853.C_EXTRA]),
        error=np.array(dop853.E5),
        error_low=np.array(dop853.E3),
        dense=_order_8_dense(b, np.array(dop853.D)),
    )


@dataclass(frozen=True)
class DormandPrince5(ExplicitRungeKutta):
    """Order 5(4), 7 stages of which the last is the next step's first; order 4 dense output."""

    name = "dormand_prince_5"
    order = 5
    adaptive = True
    reference = ("DormandPrince1980",)

    @property
    def tableau(self) -> Tableau:
        """Coefficients of the method."""
        return _order_5()


@dataclass(frozen=True)
class DormandPrince8(ExplicitRungeKutta):
    """Order 8(5,3), 12 stages, three more for dense output of order 7."""

    name = "dormand_prince_8"
    order = 8
    adaptive = True
    reference = ("PrinceDormand1981", "HairerNorsettWanner1993")

    @property
    def tableau(self) -> Tableau:
        """Coefficients of the method."""
        return _order_8()
