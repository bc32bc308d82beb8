"""Plausible numbers: ratios with their usual ranges, and the units that explain a wrong one.

A number is compared with other numbers of the same arm wherever possible. Only physical facts have
absolute ranges; they are in `FACTS`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from flexarm.base.errors import ImplausibleValueWarning, warn_caller

#: Earth's standard gravity, m/s^2.
STANDARD_GRAVITY = 9.80665

#: Factors to SI units of the units in which users give numbers by mistake, the likeliest first.
MISTAKES: dict[str, tuple[tuple[str, float], ...]] = {
    "m": (("mm", 1e-3), ("um", 1e-6), ("cm", 1e-2), ("km", 1e3)),
    "Pa": (("GPa", 1e9), ("MPa", 1e6), ("kPa", 1e3), ("mPa", 1e-3)),
    "kg/m^3": (("g/cm^3", 1e3), ("t/mm^3", 1e12), ("g/m^3", 1e-3)),
    "kg": (("g", 1e-3), ("t", 1e3), ("mg", 1e-6)),
    "kg/m": (("g/m", 1e-3), ("kg/mm", 1e3), ("t/mm", 1e6)),
    "N m^2": (("N mm^2", 1e-6), ("kN m^2", 1e3), ("N cm^2", 1e-4), ("mN m^2", 1e-3)),
    "kg m^2": (("g cm^2", 1e-7), ("kg mm^2", 1e-6), ("kg cm^2", 1e-4), ("g m^2", 1e-3)),
    "m/s^2": (("mm/s^2", 1e-3), ("cm/s^2", 1e-2)),
    "rad": (("deg", math.pi / 180.0),),
    "N m/rad": (("kN m/rad", 1e3), ("N mm/rad", 1e-3), ("MN m/rad", 1e6)),
    "N m/A": (("mN m/A", 1e-3), ("N mm/A", 1e-3)),
    "N m s/rad": (("mN m s/rad", 1e-3),),
    "N m": (("N mm", 1e-3), ("kN m", 1e3)),
    "ohm": (("mohm", 1e-3), ("kohm", 1e3)),
    "s": (("ms", 1e-3), ("us", 1e-6)),
}
_MOST_FINDINGS = 5


class Number(NamedTuple):
    """A number that may be wrong.

    Attributes:
        path: its path. value: in SI units. unit: its SI unit.
        power: exponent with which a ratio depends on it.
    """

    path: str
    value: float
    unit: str
    power: float = 1.0


class Range(NamedTuple):
    """Range of plausible ratios, and a usual one."""

    low: float
    usual: float
    high: float


#: Physical facts: ranges by unit, and the sentence about a number outside.
FACTS = {
    # From aerogels (Pekala 1989) to osmium, 22,590 kg/m^3 (CRC Handbook of Chemistry and Physics).
    "kg/m^3": (Range(1.0, 2e3, 23e3), "but solids have 1 (aerogel) to 23,000 (osmium)"),
    # From hydrogels and the softest silicones to diamond, 1.2e12 Pa (Ashby, Materials Selection in
    # Mechanical Design, chart of modulus and density; also for the others).
    "Pa": (Range(1e4, 1e10, 1.25e12), "but solids have 1e4 (gels) to 1.2e12 (diamond)"),
    # Speed of sound in a bar: 18 km/s in diamond, 3 m/s in gels.
    "m/s": (
        Range(2.0, 4e3, 2e4),
        "so that sound in it has {ratio} m/s, but solids have 2 (gels) to 2e4 (diamond)",
    ),
    # Jupiter has 24.8 m/s^2 (NASA Planetary Fact Sheet), the most of the planets.
    "m/s^2": (Range(0.0, 9.8, 30.0), "but the planets have at most 25"),
}
#: No solid that is denser than this (kg/m^3) has a modulus in this range (Pa): metals and ceramics
#: are stiffer, elastomers filled with iron softer.
DENSE, BETWEEN = 2300.0, (2e7, 3e8)
#: The same for solids that are denser than every filled elastomer.
DENSEST, SOFTEST = 4000.0, 1e9


def judge(
    findings: list[str], ratio: float, within: Range, statement: str, *numbers: Number
) -> None:
    """Add a finding if a ratio is outside its range.

    It names the number and the unit that bring the ratio nearest to the usual one, with preference
    for the first; if none brings it into the range, it names the first number.

    Args:
        statement: continues *NAME is VALUE,* and has ``{ratio}`` in it.
        numbers: those on which the ratio depends, the likeliest to be wrong first.
    """
    if within.low <= ratio <= within.high or math.isnan(ratio):
        return
    meant, end, nearest = numbers[0], ".", math.inf
    for k, number in enumerate(numbers):
        for rank, (unit, factor) in enumerate(MISTAKES.get(number.unit, ())):
            corrected = ratio * factor**number.power
            possible = FACTS[number.unit][0] if number.unit in FACTS else None
            if possible and not possible.low <= abs(number.value) * factor <= possible.high:
                continue
            if not (within.low <= corrected <= within.high and corrected > 0.0):
                continue
            unlikely = abs(math.log(corrected / within.usual)) + k + 1.5 * rank
            if unlikely < nearest:
                meant, nearest = number, unlikely
                end = f": did you mean {number.value * factor:.4g} {number.unit} ({unit})?"
    value = f"{meant.path} is {meant.value:.4g} {meant.unit}"
    findings.append(f"{value}, {statement.format(ratio=_short(ratio))}{end}")


def judge_fact(findings: list[str], path: str, value: float, unit: str) -> None:
    """Add a finding if a number is outside the range of `FACTS` for its unit."""
    within, statement = FACTS[unit]
    judge(findings, value, within, statement, Number(path, value, unit))


def _short(ratio: float) -> str:
    return f"{ratio:.0f}" if 100.0 <= ratio < 1e6 else f"{ratio:.2g}"


def warn_of(findings: Sequence[str]) -> None:
    """Warn once of all implausible numbers of a call.

    Warns:
        ImplausibleValueWarning: if there are any.
    """
    if not findings:
        return
    shown = " ".join(findings[:_MOST_FINDINGS])
    more = len(findings) - _MOST_FINDINGS
    end = f" ({more} more implausible numbers.)" if more > 0 else ""
    warn_caller(f"{shown}{end}", ImplausibleValueWarning)
