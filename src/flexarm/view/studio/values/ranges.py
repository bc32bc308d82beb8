"""Units of values, and ranges of their sliders, from the descriptions and bounds of records."""

from __future__ import annotations

import math
from dataclasses import dataclass

from flexarm.model.units import unit_of
from flexarm.view.studio.values.forms import Form

#: Nonnegative numbers that are zero in special cases only.
_POSITIVE = ("mass_per_length",)
#: Largest slider value for a number that is zero, by unit; 1 for others.
_USUAL = {
    "rad": math.pi,
    "m/s^2": 10.0,
    "kg": 2.0,
    "kg m^2": 0.1,
    "N m/rad": 100.0,
    "Hz": 10.0,
    "N": 10.0,
}
_ROUND = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)


@dataclass(frozen=True)
class Range:
    """Range and step of a slider."""

    low: float
    high: float
    step: float


@dataclass(frozen=True)
class Sizes:
    """Sizes of an arm that limit sliders.

    Attributes:
        links: number of links. reach: m. longest: length of the longest link (m).
    """

    links: int
    reach: float
    longest: float


def range_of(name: str, value: float, description: str, form: Form, sizes: Sizes) -> Range:
    """Return the range of the slider of a number.

    Args:
        name: of its field. form: with its bounds. description: with its unit.
    """
    bounds = list(form.bounds())
    lowest = max((bound for bound, below, _ in bounds if below), default=-math.inf)
    highest = min((bound for bound, below, _ in bounds if not below), default=math.inf)
    if form.type is int:
        most = {"link": sizes.links, "joint": sizes.links}.get(name, max(8.0, 2.0 * value))
        least = -most if lowest < 0.0 else lowest
        return Range(least, max(min(most, highest), least + 1.0, value), 1.0)
    if "world frame (m)" in description:
        return Range(-sizes.reach, sizes.reach, nice(sizes.reach / 300.0))
    scale = abs(value) or _USUAL.get(unit_of(description), 1.0) / 2.0
    high = sizes.longest if name == "station" else nice(2.0 * scale)
    step = nice(high / 300.0)
    low = 0.0 if lowest >= 0.0 else -high
    open_below = any(below and strict for _, below, strict in bounds)
    open_above = any(not below and strict for _, below, strict in bounds)
    if open_below or name in _POSITIVE:
        lowest = max(lowest, 0.0) + step if lowest >= 0.0 or name in _POSITIVE else lowest + step
    return Range(max(low, lowest), min(high, highest - step if open_above else highest), step)


def nice(value: float) -> float:
    """Return a round number that is not smaller."""
    power = 10.0 ** math.floor(math.log10(value))
    factor = next(k for k in _ROUND if k * power >= value * (1.0 - 1e-9))
    return float(f"{factor * power:.6g}")
