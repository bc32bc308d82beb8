"""Weights of Cowell's method, theory page "integration", (I.5) to (I.8), checked on import.

Each tuple contains the weights of the accelerations of points k + 1, k, k - 1, ...; those of (I.7)
begin with point k.
"""

from __future__ import annotations

from collections.abc import Sequence

#: (I.5), times h^2: the increment of q from k to k + 1 minus that from k - 1 to k.
RISE = (1.0 / 12.0, 10.0 / 12.0, 1.0 / 12.0)
#: (I.6), times h: the rate at k + 1 minus the increment over h.
RATE = (367.0 / 1440.0, 3.0 / 8.0, -47.0 / 240.0, 29.0 / 360.0, -7.0 / 480.0)
#: (I.7), times h^2 / 12: predicted increment of q minus the previous increment.
PREDICTED_RISE = (14.0, -5.0, 4.0, -1.0)
#: (I.7), times h / 24: predicted change of the rate.
PREDICTED_RATE = (55.0, -59.0, 37.0, -9.0)
#: (I.8): as RISE and RATE, for the trapezoidal rule.
STIFF_RISE = (0.25, 0.5, 0.25)
STIFF_RATE = (0.25, 0.25)

#: Weights of the new acceleration in the new coordinate and in the new rate.
BETA, STIFF_BETA = RISE[0], STIFF_RISE[0]
GAMMA, STIFF_GAMMA = RISE[0] + RATE[0], STIFF_RISE[0] + STIFF_RATE[0]

_ROUNDING = 1e-12


def check_formula(
    name: str, weights: Sequence[float], first: int, to_rate: bool, rise: bool, degree: int
) -> None:
    """Raise unless a formula is exact for q = t^p with p from 2 to ``degree`` and unit steps.

    Args:
        weights: weights of the accelerations at times ``first``, ``first`` - 1, ...; the present
            is time 0.
        to_rate: whether the formula gives the rate at 1; otherwise it gives the coordinate there.
        rise: for a rate, whether the weighted sum is added to the increment to time 1 rather than
            to the present rate; a coordinate adds it to the present one and the last increment.

    Raises:
        ValueError: if the formula is not exact.
    """
    for p in range(2, degree + 1):
        given = sum(
            weight * p * (p - 1) * float(first - k) ** (p - 2) for k, weight in enumerate(weights)
        )
        if to_rate:
            given += 1.0 if rise else 0.0  # the increment from 0 to 1, or the rate at 0
            wanted = float(p)
        else:
            given -= (-1.0) ** p  # the increment from -1 to 0
            wanted = 1.0
        if abs(given - wanted) > _ROUNDING * p * p:
            raise ValueError(f"Cowell: {name} must be exact for polynomials of degree {p}")


check_formula("RISE", RISE, 1, to_rate=False, rise=True, degree=5)
check_formula("RATE", RATE, 1, to_rate=True, rise=True, degree=6)
check_formula(
    "PREDICTED_RISE", [w / 12.0 for w in PREDICTED_RISE], 0, to_rate=False, rise=True, degree=5
)
check_formula(
    "PREDICTED_RATE", [w / 24.0 for w in PREDICTED_RATE], 0, to_rate=True, rise=False, degree=5
)
check_formula("STIFF_RISE", STIFF_RISE, 1, to_rate=False, rise=True, degree=3)
check_formula("STIFF_RATE", STIFF_RATE, 1, to_rate=True, rise=True, degree=2)
