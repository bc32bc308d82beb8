"""What a controller relies on, told before a run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.hardware.measurement import FloatArray

#: What nearly every controller reads.
JOINTS = ("joint_angle", "joint_rate")


class Needs(NamedTuple):
    """What a controller relies on; None and nothing for what it takes as it comes."""

    joints: int | None = None  # that it was made for
    measured: tuple[str, ...] = ()  # names that it looks up in every measurement
    gauges: int | None = None  # length of the strain that it reads


def joints_of(expected: int, *numbers: FloatArray) -> int:
    """Return how many joints lists are for: the first length that is not ``expected``, or that."""
    lengths = [len(value) for value in numbers if np.ndim(value)]
    return next((length for length in lengths if length != expected), expected)
