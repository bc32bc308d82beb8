"""Rigid torques with a spline correction for the flexibility of the links."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from flexarm.motion.dynamics.dynamics_along import RigidTorque

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from flexarm.motion.motion import Motion

    Floats = NDArray[np.float64]

DEGREE = 3
#: Coefficients at each end that stay fixed, so that value and slope are continuous there.
_HELD = 2


@dataclass(frozen=True, eq=False)
class CorrectedTorque:
    """Rigid torque of a motion plus a cubic spline, as a function of time.

    Attributes:
        rigid: torque of the rigid model.
        knots: (N + 7,) s; each end has three additional knots.
        coefficients: (N + 3, joints) N m; before and after the knots the spline is constant.
    """

    #: Whether the torque accepts an array of times, for ``simulate``.
    vectorized: ClassVar[bool] = True

    rigid: RigidTorque
    knots: Floats
    coefficients: Floats

    def __repr__(self) -> str:
        return (
            f"<flexarm.CorrectedTorque: {self.joints} joints, rigid torque and a spline of "
            f"{len(self.coefficients)} coefficients each>"
        )

    @property
    def motion(self) -> Motion:
        """The reference motion."""
        return self.rigid.motion

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return self.rigid.joints

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times (s) at which the torque or its slope may jump, and the ends of the spline."""
        return tuple(sorted({*self.rigid.breaks, float(self.knots[0]), float(self.knots[-1])}))

    def __call__(self, t: ArrayLike) -> Floats:
        """Return the joint torques (n,) at a time (s), or (T, n) at times (T,); N m."""
        from scipy.interpolate import BSpline

        inside = np.clip(np.asarray(t, dtype=np.float64), self.knots[0], self.knots[-1])
        added: Floats = BSpline(self.knots, self.coefficients, DEGREE)(inside)
        return self.rigid(t) + added


def spline_knots(start: float, end: float, spacing: float) -> Floats:
    """Return evenly spaced knots, with three additional ones at each end."""
    count = max(int(np.ceil((end - start) / spacing)), 2 * _HELD)
    inner = np.linspace(start, end, count + 1)
    return np.concatenate([[start] * DEGREE, inner, [end] * DEGREE])


def spline_values(knots: Floats, t: Floats) -> Floats:
    """Return the values (T, N + 3) of all B-splines at times (T,)."""
    from scipy.interpolate import BSpline

    inside = np.clip(t, knots[0], knots[-1])
    values: Floats = BSpline.design_matrix(inside, knots, DEGREE).toarray()
    return values


def free_coefficients(knots: Floats) -> slice:
    """Return the coefficients that can change without changing value and slope at the ends."""
    return slice(_HELD, len(knots) - DEGREE - 1 - _HELD)
