"""Explicit Runge-Kutta tableaus with error estimate and dense output, checked on construction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexarm.integrate.order_conditions import FloatArray, largest_miss

#: Coefficients are given to at least 16 digits; sums of a dozen of them lose two.
_ROUNDING = 1e-12


def demand(holds: object, rule: str) -> None:
    """Raise an error unless a rule of a tableau holds.

    Raises:
        ValueError: if the rule does not hold.
    """
    if not holds:
        raise ValueError(f"Tableau: {rule}")


def demand_zero(value: object, rule: str) -> None:
    """Raise an error unless a value is zero to rounding errors.

    Raises:
        ValueError: if the value is not zero.
    """
    demand(np.max(np.abs(np.asarray(value))) < _ROUNDING, rule)


def demand_order(order: int, b: FloatArray, *A: FloatArray, exact: float = 1.0) -> None:
    """Raise an error unless all order conditions hold; arguments as in ``largest_miss``.

    Raises:
        ValueError: if a condition does not hold.
    """
    miss, nodes = largest_miss(order, b, *A, exact=exact)
    what = "new point" if exact else "error estimate"
    demand_zero(miss, f"the {what} misses an order condition of a tree of {nodes} nodes")


@dataclass(frozen=True, eq=False)
class Tableau:
    """Coefficients of an explicit Runge-Kutta method with s stages.

    Stage s (counted from 0) is the derivative at the new point, which is also stage 0 of the next
    step. Later stages, if any, are used for dense output only.

    Attributes:
        order: order of the new point.
        A: (r, r) lower triangular; rows of the s stages, of the new point, of dense output.
        b: (s,) weights of the new point.
        c: (r,) abscissae.
        error: (2, s + 1) weights of the error estimate, and of a second, less accurate one,
            combined as in Hairer, Norsett and Wanner, Solving ODEs I (1993), section II.10. Zeros:
            no estimate.
        error_orders: orders up to which the estimates are zero.
        dense: (r, d) polynomials ``b_i(theta) = sum_p dense[i, p] theta^(p + 1)``.

    Raises:
        ValueError: if the coefficients do not satisfy the order conditions or their structure.
    """

    order: int
    A: FloatArray
    b: FloatArray
    c: FloatArray
    error: FloatArray
    error_orders: tuple[int, int]
    dense: FloatArray

    @property
    def stages(self) -> int:
        """Number of stages s of the new point."""
        return int(self.b.size)

    def __post_init__(self) -> None:
        s = self.stages
        demand(np.all(np.triu(self.A) == 0.0), "A must be strictly lower triangular")
        demand_zero(self.A.sum(axis=1) - self.c, "rows of A must sum to c")
        demand_zero(self.A[s, :s] - self.b, "the new point must be stage s")
        demand_order(self.order, self.b, self.A[:s, :s])
        for weights, order in zip(self.error, self.error_orders, strict=True):
            demand_order(order, weights, self.A[: s + 1, : s + 1], exact=0.0)
        ends = np.zeros(len(self.c))
        ends[:s] = self.b
        demand_zero(self.dense.sum(axis=1) - ends, "dense output must end at the new point")
        first, last = np.zeros_like(ends), np.zeros_like(ends)
        first[0], last[s] = 1.0, 1.0
        slope = self.dense @ np.arange(1.0, self.dense.shape[1] + 1.0)
        demand_zero(self.dense[:, 0] - first, "dense output must start with stage 0")
        demand_zero(slope - last, "dense output must end with stage s")


def hermite_dense(b: FloatArray) -> FloatArray:
    """Return dense output of third order from the values and slopes at both ends of a step."""
    s = b.size
    dense = np.zeros((s + 1, 3))
    dense[:s] = np.outer(b, [0.0, 3.0, -2.0])
    dense[0] += [1.0, -2.0, 1.0]
    dense[s] += [0.0, -1.0, 1.0]
    return dense
