"""Units of length, time and force of an arm, which default parameters are relative to."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.control.design.default_requirements import RIGID, typical_torque
from flexarm.linear.vibration.lowest import lowest_frequency
from flexarm.model.checks import Record
from flexarm.model.drives.base import parameters_of
from flexarm.model.paths import unit_at
from flexarm.model.units import unit_of

#: Exponents of rate, length and force in each unit. Electrical units have no scale in an arm.
_UNITS = {
    "s": (-1.0, 0.0, 0.0),
    "Hz": (1.0, 0.0, 0.0),
    "m": (0.0, 1.0, 0.0),
    "N": (0.0, 0.0, 1.0),
    "kg": (-2.0, -1.0, 1.0),
    "Pa": (0.0, -2.0, 1.0),
    "J": (0.0, 1.0, 1.0),
}
#: A division, or a unit and its exponent.
_WORD = re.compile(r"/|per\b|[A-Za-z]+(?:\^-?\d+(?:\.\d+)?)?")
#: Scale of a number that is zero, relative to its typical size on the arm.
_OF_ZERO = 0.1
#: Largest default cutoff, relative to the sampling frequency.
_CUTOFF = 0.005


class ArmScales(NamedTuple):
    """Angular frequency (rad/s), length (m) and force (N) of an arm."""

    rate: float
    length: float
    force: float

    def size(self, unit: str) -> float:
        """Return the typical size of a number with a unit such as ``N s/m``; 1 for angles."""
        size, sign, over = 1.0, 1.0, 1.0
        for word in _WORD.findall(unit):
            if word in ("/", "per"):  # "rad/s per 1/m": all after "per" is divided
                over = -1.0 if word == "per" else over
                sign = -1.0 if word == "/" else 1.0
                continue
            name, _, power = word.partition("^")
            exponent = over * sign * float(power or 1.0)
            scales = zip(self, _UNITS.get(name, (0.0, 0.0, 0.0)), strict=True)
            size *= math.prod(scale ** (exponent * each) for scale, each in scales)
            if name == "Hz":
                size /= (2.0 * math.pi) ** exponent
        return size


def slow_rate(arm: Arm, sample_time: float) -> float:
    """Return the lowest angular frequency (rad/s) of the straight arm with locked joints.

    At most 0.0064 rad in a ``sample_time`` (s), because a stiff arm may press on a stiff surface.
    """
    return min(lowest_frequency(arm), RIGID / sample_time)


def arm_scales(arm: Arm, rate: float) -> ArmScales:
    """Return the units of an arm with an angular frequency (rad/s).

    The force at the reach accelerates the rigid arm by a quarter of the square of the frequency.
    """
    length = float(np.sum(arm.lengths))
    torques = typical_torque(arm, None, rate)
    if not torques.size:  # no joint is free
        c = arm.assembly.constants
        torques = np.array([np.sum(c.mass + c.tip_mass) * (0.5 * length * rate) ** 2])
    return ArmScales(rate, length, float(np.max(torques)) / length)


def size_of_zero(arm: Arm, record: Record, path: str, rate: float | None = None) -> float:
    """Return a change of a number of a record that is large on an arm, from the number's unit.

    ``rate`` is the scale of frequencies; by default the lowest one with locked joints. A rigid arm
    has none, but is linear in numbers with a time, such as damping.
    """
    lowest = lowest_frequency(arm) if rate is None else rate
    scales = arm_scales(arm, lowest if np.isfinite(lowest) else 1.0)
    return _OF_ZERO * scales.size(unit_at(record, path))


def set_defaults(controller: Any, shares: Mapping[str, float], scales: ArmScales) -> None:
    """Replace parameters that are None by shares of their typical sizes on an arm."""
    declared = parameters_of(type(controller))
    for name, share in shares.items():
        if getattr(controller, name) is None:
            unit = unit_of(declared[name].description)
            setattr(controller, name, share * scales.size(unit))


def default_cutoff(arm: Arm, sample_time: float) -> float:
    """Return half of the lowest frequency with locked joints (Hz), with a limit by the loop."""
    return min(lowest_frequency(arm) / (4.0 * math.pi), _CUTOFF / sample_time)
