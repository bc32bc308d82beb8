"""Adaptation laws of controllers; theory page "control under uncertainty", (C.44), (C.49).

The functions are compiled because controllers evaluate them at every sample time.
"""

from __future__ import annotations

import numpy as np

from flexarm.kernels.compilation.cache import compiled
from flexarm.kernels.compilation.numbers import exp
from flexarm.kernels.layout import Array


@compiled
def adaptive_torque(
    columns: Array,
    known: int,
    error: Array,
    damping: Array,
    gain: Array,
    leakage: float,
    dead_zone: float,
    start: Array,
    lower: Array,
    upper: Array,
    step: float,
    estimate: Array,
    torque: Array,
) -> None:
    """Write the adaptive torque into ``torque`` (joints,) and update the estimate, (C.44).

    ``columns`` (known + p, joints): columns of the regressor; the first ``known`` belong to
    parameters that are not adapted. ``error`` (joints,) is s = qd - qd_r. ``estimate``, ``gain``,
    ``start``, ``lower``, ``upper`` have shape (p,).
    """
    size = 0.0
    for j in range(error.shape[0]):
        size += error[j] * error[j]
        torque[j] = -damping[j] * error[j]
        for k in range(known):
            torque[j] += columns[k, j]
        for k in range(estimate.shape[0]):
            torque[j] += columns[known + k, j] * estimate[k]
    size = np.sqrt(size)
    # The error is counted from the edge of the dead zone, so that adaptation starts smoothly.
    counted = max(size - dead_zone, 0.0) / max(size, 1e-300)
    for k in range(estimate.shape[0]):
        drive = 0.0
        for j in range(error.shape[0]):
            drive += columns[known + k, j] * error[j]
        rate = -gain[k] * counted * drive - leakage * (estimate[k] - start[k])
        estimate[k] = min(max(estimate[k] + step * rate, lower[k]), upper[k])


@compiled
def network_torque(
    angle: Array,
    signals: Array,
    error: Array,
    centres: Array,
    sharpness: Array,
    damping: Array,
    gain: float,
    leakage: float,
    e_modification: float,
    step: float,
    weights: Array,
    torque: Array,
) -> None:
    """Write the torque of a radial-basis network into ``torque`` and update its weights, (C.49).

    ``torque`` (joints,). ``centres`` (c, joints) in rad and ``sharpness`` (joints,) in 1/rad define
    the Gaussians; ``signals`` (z,) multiply every Gaussian; ``weights`` (joints, c, z); ``error``
    (joints,) is s = qd - qd_r.
    """
    size = 0.0
    for j in range(error.shape[0]):
        size += error[j] * error[j]
        torque[j] = -damping[j] * error[j]
    keep = 1.0 - step * (leakage + e_modification * np.sqrt(size))
    for c in range(centres.shape[0]):
        distance = 0.0
        for j in range(centres.shape[1]):
            away = sharpness[j] * (angle[j] - centres[c, j])
            distance += away * away
        bump = exp(-0.5 * distance)
        for z in range(signals.shape[0]):
            feature = bump * signals[z]
            for j in range(error.shape[0]):
                torque[j] += weights[j, c, z] * feature
                weights[j, c, z] = keep * weights[j, c, z] - step * gain * feature * error[j]
