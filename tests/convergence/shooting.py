"""Frequencies of clamped beams by shooting, independent of finite elements."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq


def shooting_root(slope, x, guess):
    """Return the frequency near `guess` of a clamped-free beam, by integration from root to tip.

    slope: function of station, two solutions (8,) of deflection, rotation, moment and force, and
    squared frequency. x: stations between which the properties are smooth.
    """

    def mismatch(frequency):
        # unit moment, then unit force, at the root
        y = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        for start, end in pairwise(x):
            run = solve_ivp(
                slope, (start, end), y, "DOP853", args=(frequency**2,), rtol=1e-12, atol=1e-13
            )
            y = run.y[:, -1]
        return y[2] * y[7] - y[3] * y[6]

    return brentq(mismatch, 0.98 * guess, 1.01 * guess, xtol=1e-13, rtol=1e-12)
