"""Requirements of a controller, declared before a run."""

from typing import NamedTuple

import numpy as np

from flexarm.control.hardware.measurement import FloatArray

#: Readings that nearly every controller uses.
JOINTS = ("joint_angle", "joint_rate")


class ControllerRequirements(NamedTuple):
    """Requirements of a controller; None and empty entries are not checked.

    Attributes:
        joints: number of joints of the controller's arm.
        measured: names that it reads from every measurement.
        gauges: length of the strain reading.
    """

    joints: int | None = None
    measured: tuple[str, ...] = ()
    gauges: int | None = None


def joints_of(expected: int, *numbers: FloatArray) -> int:
    """Return the number of joints of lists: the first length other than ``expected``, if any."""
    lengths = [len(value) for value in numbers if np.ndim(value)]
    return next((length for length in lengths if length != expected), expected)
