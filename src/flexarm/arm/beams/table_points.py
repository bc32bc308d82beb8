"""Effect of the interpolation between the points of a table of section properties."""

from __future__ import annotations

import numpy as np

from flexarm.arm.beams.hermite import FloatArray
from flexarm.arm.beams.properties import BeamTable

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
