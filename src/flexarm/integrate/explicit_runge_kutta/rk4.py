"""The classical Runge-Kutta method of order 4, with a fixed step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexarm.integrate.explicit_runge_kutta.runge_kutta import ExplicitRungeKutta
from flexarm.integrate.tableau import Tableau, hermite_dense

_B = np.array([1.0, 2.0, 2.0, 1.0]) / 6.0

_TABLEAU = Tableau(
    order=4,
    A=np.array(
        [
            [0.0, 0.0, 0.0, 0.0, 0.0],
            [0.5, 0.0, 0.0, 0.0, 0.0],
            [0.0, 0.5, 0.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 0.0, 0.0],
            [*_B, 0.0],
        ]
    ),
    b=_B,
    c=np.array([0.0, 0.5, 0.5, 1.0, 1.0]),
    error=np.zeros((2, 5)),
    error_orders=(0, 0),
    dense=hermite_dense(_B),
)


@dataclass(frozen=True)
class RungeKutta4(ExplicitRungeKutta):
    """Classical Runge-Kutta method of order 4, fixed step, cubic Hermite dense output.

    It is unstable if the step times the highest frequency exceeds 2.8.
    """

    name = "rk4"
    order = 4
    reference = ("Kutta1901",)

    @property
    def tableau(self) -> Tableau:
        """Coefficients of the method."""
        return _TABLEAU
