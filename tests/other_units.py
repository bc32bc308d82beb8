"""The same arm and the same results in other units of length, mass and time.

Records name the unit of each number in its description, channels in their attributes, so a change
of units needs no table of fields. Factors that are powers of two keep every digit.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexarm.arm import Arm
from flexarm.model.checks import Record
from flexarm.studio.values.ranges import unit_of

#: Exponents of length, mass and time in each unit. Electric units stay.
_BASE = {
    "m": (1, 0, 0),
    "kg": (0, 1, 0),
    "s": (0, 0, 1),
    "rad": (0, 0, 0),
    "1": (0, 0, 0),
    "Hz": (0, 0, -1),
    "N": (1, 1, -2),
    "Pa": (-1, 1, -2),
    "J": (2, 1, -2),
}
#: Fields whose description has no unit, or another one for the numbers of its records.
_UNITS = {"friction_speed": "m/s", "angle": "rad", "to": "1"}


@dataclass(frozen=True)
class Units:
    """Factors of the numbers of lengths, masses and times."""

    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    def factor(self, unit: str, exponent: float = 1.0) -> float:
        """Return the factor of a number with a unit such as ``N m s/rad``."""
        powers = np.zeros(3)
        text = unit.replace("N/m^exponent", f"N/m^{exponent}")
        sign = 1.0
        for word in re.findall(r"/|[A-Za-z1]+(?:\^-?\d+(?:\.\d+)?)?", text):
            if word == "/":
                sign = -1.0
                continue
            name, _, power = word.partition("^")
            powers += sign * float(power or 1.0) * np.array(_BASE[name])
        return float(self.length ** powers[0] * self.mass ** powers[1] * self.time ** powers[2])

    def record(self, record: Any) -> Any:
        """Return a record, or a list of records, in these units."""
        if isinstance(record, Record):
            changed = {}
            for name, field in type(record).model_fields.items():
                value = getattr(record, name)
                unit = _UNITS.get(name, unit_of(field.description or ""))
                factor = 1.0
                if name == "stiffness" and hasattr(record, "exponent"):
                    factor = self.factor("N/m^exponent", record.exponent)
                elif name == "force" and getattr(record, "spread", None) is not None:
                    factor = self.factor("N/m")
                elif unit:
                    factor = self.factor(unit)
                changed[name] = self._scaled(value, factor)
            return (
                type(record).model_construct(**changed)
                if not changed
                else type(record)(
                    **{k: v for k, v in changed.items() if v is not None and k != "kind"}
                )
            )
        return self._scaled(record, 1.0)

    def _scaled(self, value: Any, factor: float) -> Any:
        if isinstance(value, Record):
            return self.record(value)
        if isinstance(value, bool) or value is None or isinstance(value, (str, int)):
            return value
        if isinstance(value, float):
            return value * factor
        if isinstance(value, (tuple, list)):
            return tuple(self._scaled(each, factor) for each in value)
        if isinstance(value, np.ndarray):
            return value * factor
        return value

    def arm(self, arm: Arm) -> Arm:
        """Return an arm in these units."""
        return Arm(self.record(arm.spec))

    def sizes(self, arm: Arm) -> np.ndarray:
        """Return the factors (dof,) of the coordinates: angles stay, modes are in m kg^0.5."""
        factors = np.full(arm.dof, self.factor("m kg^0.5"))
        factors[arm.joint_index] = 1.0
        for seat in arm.assembly.seats:
            if seat.twist is not None:
                factors[seat.twist] = 1.0
        return factors
