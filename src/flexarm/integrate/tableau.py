"""Explicit Runge-Kutta tableaus with error estimate and dense output, checked on construction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Coefficients are printed to at least 16 digits; sums of a dozen of them lose two.
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class Tableau:
    """Coefficients of an explicit Runge-Kutta method with s stages.

    Stage s (counted from 0) is the derivative at the new point, which is also stage 0 of the next
    step; later ones, if any, serve dense output alone.

    Attributes:
        order: order of the solution that is carried on.
        A: (r, r) lower triangular; rows of the s stages, of the new point, of dense output.
        b: (s,) weights of the new point.
        c: (r,) abscissae.
        error: (s + 1,) weights of the error estimate (zeros: none).
        error_low: (s + 1,) weights of a second, cruder estimate (zeros: none), combined as in
            Hairer, Norsett and Wanner, Solving ODEs I (1993), section II.10.
        dense: (r, d) polynomials ``b_i(theta) = sum_p dense[i, p] theta^(p + 1)``.

    Raises:
        ValueError: the coefficients contradict each other; a typing error cannot be constructed.
    """

    order: int
    A: FloatArray
    b: FloatArray
    c: FloatArray
    error: FloatArray
    error_low: FloatArray
    dense: FloatArray

    @property
    def stages(self) -> int:
        """Number of stages s that make the new point."""
        return int(self.b.size)

    def __post_init__(self) -> None:
        s = self.stages
        self._demand(np.all(np.triu(self.A) == 0.0), "A must be strictly lower triangular")
        self._demand_zero(self.A.sum(axis=1) - self.c, "rows of A must sum to c")
        self._demand_zero(self.A[s, :s] - self.b, "the new point must be stage s")
        self._demand_zero(self.error.sum(), "error weights must sum to zero")
        self._demand_zero(self.error_low.sum(), "error weights must sum to zero")
        for k in range(1, self.order + 1):
            moment = self.b @ self.c[:s] ** (k - 1) - 1.0 / k
            self._demand_zero(moment, f"quadrature of order {k} must be exact")
        ends = np.zeros(len(self.c))
        ends[:s] = self.b
        self._demand_zero(self.dense.sum(axis=1) - ends, "dense output must end at the new point")
        first, last = np.zeros_like(ends), np.zeros_like(ends)
        first[0], last[s] = 1.0, 1.0
        slope = self.dense @ np.arange(1.0, self.dense.shape[1] + 1.0)
        self._demand_zero(self.dense[:, 0] - first, "dense output must start with stage 0")
        self._demand_zero(slope - last, "dense output must end with stage s")

    @staticmethod
    def _demand(holds: object, rule: str) -> None:
        if not holds:
            raise ValueError(f"Tableau: {rule}")

    def _demand_zero(self, value: object, rule: str) -> None:
        self._demand(np.max(np.abs(np.asarray(value))) < _ROUNDING, rule)


def hermite_dense(b: FloatArray) -> FloatArray:
    """Dense output of third order from the values and slopes at both ends of a step."""
    s = b.size
    dense = np.zeros((s + 1, 3))
    dense[:s] = np.outer(b, [0.0, 3.0, -2.0])
    dense[0] += [1.0, -2.0, 1.0]
    dense[s] += [0.0, -1.0, 1.0]
    return dense
