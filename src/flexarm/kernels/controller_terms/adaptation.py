"""Radial-basis network of a controller; theory page "control under uncertainty", (C.49).

It is compiled because the controller evaluates it at every sample time.
"""

from __future__ import annotations

import numpy as np

from flexarm.kernels.compilation.cache import compiled
from flexarm.kernels.compilation.numbers import exp
from flexarm.kernels.layout import Array


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
