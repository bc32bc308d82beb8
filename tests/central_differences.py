"""Derivatives of results by central differences of order 8, with an estimate of their error."""

import numpy as np

from flexarm.simulation.derivatives.differences import ORDER_6, ORDER_8


def differences(results_of, value, step):
    """Return (derivative, largest error) of each array of a list that depends on a number."""
    runs = {k: results_of(value + k * step) for k in range(-4, 5) if k}

    def slope(place, weights):
        rises = [runs[k][place] - runs[-k][place] for k in range(1, 5)]
        return sum(w * rise for w, rise in zip(weights, rises, strict=True)) / step

    both = [(slope(k, ORDER_8), slope(k, ORDER_6)) for k in range(len(runs[1]))]
    return [(one, np.abs(one - other).max(initial=0.0)) for one, other in both]
