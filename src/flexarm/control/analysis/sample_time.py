"""Sample time that suits the vibration of an arm."""

from __future__ import annotations

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.integrate.base import FloatArray
from flexarm.linear import modes

#: Phase (rad) by which the fastest mode to control turns in a sample: the middle of 0.1 to 0.6, the
#: range of K. J. Astrom and B. Wittenmark, Computer-Controlled Systems, 3rd ed., Prentice Hall
#: 1997, for the poles of a sampled loop.
PHASE = 0.2


def recommended_sample_time(arm: Arm, angles: FloatArray | None = None) -> float | None:
    """Return the longest sample time (s) that suits one mode for each joint; None without modes.

    Args:
        angles: posture (joints,), rad; zero by default.
    """
    found = modes(arm, angles).frequency_hz
    found = found[found > 0.0]
    mode = controlled_modes(arm, found)
    if not mode:
        return None
    longest = PHASE / (2.0 * np.pi * found[mode - 1])
    unit = 10.0 ** (np.floor(np.log10(longest)) - 1.0)
    return float(f"{np.floor(longest / unit + 1e-9) * unit:.2g}")


def controlled_modes(arm: Arm, frequencies: FloatArray) -> int:
    """Return the number of modes that a controller damps: one for each joint, if it exists."""
    return min(arm.joints, frequencies.size)
