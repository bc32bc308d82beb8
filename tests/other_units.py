"""The same arm and the same results in other units of length, mass and time.

Records name the unit of each number in its description, channels in their attributes, so a change
of units needs no table of fields. Factors that are powers of two keep every digit.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import turning_joints
from flexarm.model.arm.joints import Joint, unit_of_sliding
from flexarm.model.checks import Record, descriptions_of
from flexarm.view.studio.values.fields import unit_of

#: Exponents of length, mass and time in each unit.
_BASE = {
    "m": (1.0, 0.0, 0.0),
    "kg": (0.0, 1.0, 0.0),
    "s": (0.0, 0.0, 1.0),
    "rad": (0.0, 0.0, 0.0),
    "1": (0.0, 0.0, 0.0),
    "Hz": (0.0, 0.0, -1.0),
    "N": (1.0, 1.0, -2.0),
    "Pa": (-1.0, 1.0, -2.0),
    "J": (2.0, 1.0, -2.0),
}


@dataclass(frozen=True)
class Units:
    """Factors of the numbers of lengths, masses and times, in other units than SI."""

    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    def factor(self, unit: str) -> float:
        """Return the factor of a number with a unit such as ``N m s/rad``."""
        powers, sign = np.zeros(3), 1.0
        for word in re.findall(r"/|[A-Za-z1]+(?:\^-?\d+(?:\.\d+)?)?", unit):
            if word == "/":
                sign = -1.0
                continue
            name, _, power = word.partition("^")
            powers += sign * float(power or 1.0) * np.array(_BASE[name])
        length, mass, time = powers
        return float(self.length**length * self.mass**mass * self.time**time)

    def record(self, record: Any, slides: bool = False) -> Any:
        """Return a record in these units; that of a part of a joint that ``slides``."""
        changed = {}
        if isinstance(record, Joint) and record.kind == "prismatic":
            changed["kind"], slides = record.kind, True
        texts = descriptions_of(type(record))
        for name in type(record).model_fields:
            value = getattr(record, name)
            if value is not None and name != "kind":
                unit = unit_of_sliding(type(record), name)[0] if slides else ""
                if name == "gear_ratio" and not record.rotor_inertia:  # the default has no unit
                    unit = ""
                factor = self.factor(unit) if unit else self._factor(record, name, texts.get(name))
                changed[name] = _scaled(self, value, factor, slides)
        return type(record)(**changed)

    def _factor(self, record: Any, name: str, description: str | None) -> float:
        unit = unit_of(description or "")
        if hasattr(record, "exponent") and name == "stiffness":  # N per depth to this power
            return self.factor(f"N/m^{record.exponent}")
        if name == "force" and getattr(record, "spread", None) is not None:
            unit = "N/m"
        return self.factor(unit) if unit else 1.0

    def arm(self, arm: Arm) -> Arm:
        """Return an arm in these units."""
        return Arm(self.record(arm.spec))

    def coordinates(self, arm: Arm) -> np.ndarray:
        """Return the factors (dof,) of the coordinates: angles stay, modes are in m kg^0.5."""
        factors = np.ones(arm.dof)
        factors[arm.joint_index] = np.where(turning_joints(arm), 1.0, self.length)
        for piece in arm.assembly.pieces:
            factors[piece.modal] = self.factor("m kg^0.5")
        return factors

    def channel(self, arm: Arm, unit: str) -> Any:
        """Return the factor of a channel with a unit, for q and qd one for each coordinate."""
        if unit == "rad or m kg^0.5":
            return self.coordinates(arm)
        if unit == "rad/s or m kg^0.5/s":
            return self.coordinates(arm) / self.time
        return self.factor(unit)


def _scaled(units: Units, value: Any, factor: float, slides: bool) -> Any:
    if isinstance(value, Record):
        return units.record(value, slides)
    if isinstance(value, tuple | list):
        return tuple(_scaled(units, each, factor, slides) for each in value)
    return value * factor if isinstance(value, float) else value
