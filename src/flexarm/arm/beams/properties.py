"""Section properties along a link: tables of stiffness and inertia, and their interpolation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexarm.arm.beams.hermite import FloatArray

# Two-point Gauss-Legendre rule on (-1, 1); both weights are one.
_NODES = np.array([-1.0, 1.0]) / np.sqrt(3.0)


@dataclass(frozen=True, eq=False)
class BeamTable:
    """Section properties at stations from the root (0) to the tip, linear in between.

    The conditions are those of `model.arm.links.Link`, which checks them.

    Attributes:
        x: (p,) stations (m), p >= 2, from 0, strictly increasing; the last one is the length.
        flexural_rigidity: (p,) EI (N m^2), positive.
        mass_per_length: (p,) mu (kg/m), not negative; positive somewhere unless it may be massless.
        rotary_inertia_per_length: (p,) rho I (kg m), not negative; without shear, zero is
            an Euler-Bernoulli beam, otherwise a Rayleigh beam.
        shear_rigidity: (p,) k G A (N), positive: Timoshenko beam; None: sections stay normal to
            the axis.
    """

    x: FloatArray
    flexural_rigidity: FloatArray
    mass_per_length: FloatArray
    rotary_inertia_per_length: FloatArray
    shear_rigidity: FloatArray | None = None

    @property
    def length(self) -> float:
        """Length of the link (m)."""
        return float(self.x[-1])

    def outboard_moment(self, s: FloatArray, power: int) -> FloatArray:
        """Integrate mu x^power from each station s (k,) m to the tip; exact: (k,) kg or kg m."""
        between = self._moment(self.x[:-1], self.x[1:], power)
        beyond = np.append(np.cumsum(between[::-1])[::-1], 0.0)[1:]
        interval = np.clip(np.searchsorted(self.x, s, side="right") - 1, 0, self.x.size - 2)
        return np.asarray(self._moment(s, self.x[interval + 1], power) + beyond[interval])

    def _moment(self, start: FloatArray, end: FloatArray, power: int) -> FloatArray:
        """Integrate mu x^power over intervals without stations; exact up to mu x^2."""
        half = (end - start) / 2
        points = (start + end) / 2 + _NODES[:, None] * half
        mass = np.interp(points, self.x, self.mass_per_length)
        return np.asarray(half * np.sum(mass * points**power, axis=0))


#: Fewest points of a table that counts as a sampled taper; fewer are drawn as straight pieces.
_SAMPLED = 5
#: Points of the quadrature between two points of the table.
_BETWEEN = 16


def interpolation_error(table: BeamTable) -> float:
    """Estimate the relative error of the first frequency by linear interpolation of a smooth taper.

    The linear interpolation is compared with a monotone cubic one (Fritsch and Carlson, SIAM
    Journal on Numerical Analysis 17 (1980) 238-246), which follows smooth tapers and jumps alike.
    Rayleigh's quotient gives the effect on the frequency of the link, clamped at its root. Zero
    for tables that are no samples of a taper: with fewer than five points, without mass, or with a
    rigidity that both rises and falls.
    """
    steps = np.diff(table.flexural_rigidity)
    if table.x.size < _SAMPLED or (np.any(steps > 0.0) and np.any(steps < 0.0)):
        return 0.0
    if not np.any(table.mass_per_length):
        return 0.0
    from scipy.integrate import cumulative_simpson, simpson
    from scipy.interpolate import PchipInterpolator

    share = np.linspace(0.0, 1.0, _BETWEEN, endpoint=False)
    x = np.append((table.x[:-1, None] + np.diff(table.x)[:, None] * share).ravel(), table.x[-1])
    columns = table.flexural_rigidity, table.mass_per_length
    linear = [np.interp(x, table.x, column) for column in columns]
    smooth = [np.asarray(PchipInterpolator(table.x, column)(x)) for column in columns]

    def integral(values: FloatArray) -> FloatArray:
        return np.asarray(cumulative_simpson(values, x=x, initial=0))

    # The shape under the inertia of a parabola, one step of an inverse iteration.
    force = integral(linear[1] * x**2)
    force = force[-1] - force
    moment = integral(force)
    curvature = (moment[-1] - moment) / linear[0]
    deflection = integral(integral(curvature))
    changes = [
        simpson((after - before) * shape**2, x=x) / simpson(before * shape**2, x=x)
        for before, after, shape in zip(linear, smooth, (curvature, deflection), strict=True)
    ]
    return float(abs(0.5 * (changes[0] - changes[1])))
