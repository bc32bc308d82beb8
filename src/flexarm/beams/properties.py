"""Section properties along a link: checked tables of stiffness and inertia."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexarm.beams.hermite import FloatArray
from flexarm.errors import InputError, Problem, check_array

# Two-point Gauss-Legendre rule on (-1, 1); both weights are one.
_NODES = np.array([-1.0, 1.0]) / np.sqrt(3.0)


@dataclass(frozen=True, eq=False)
class BeamTable:
    """Section properties at stations from the root (0) to the tip, linear in between.

    Attributes:
        x: (p,) stations (m), p >= 2, from 0, strictly increasing; the last one is the length.
        flexural_rigidity: (p,) EI (N m^2), positive.
        mass_per_length: (p,) mu (kg/m), not negative; positive somewhere unless it may be massless.
        rotary_inertia_per_length: (p,) rho I (kg m), not negative; without shear, zero is
            an Euler-Bernoulli beam, otherwise a Rayleigh beam.
        shear_rigidity: (p,) k G A (N), positive: Timoshenko beam; None: sections stay normal to
            the axis.

    Use `beam_table` to create one; it checks these conditions.
    """

    x: FloatArray
    flexural_rigidity: FloatArray
    mass_per_length: FloatArray
    rotary_inertia_per_length: FloatArray
    shear_rigidity: FloatArray | None = None

    @property
    def length(self) -> float:
        """Length of the link (m)."""
        return float(self.x[-1])

    def outboard_moment(self, s: FloatArray, power: int) -> FloatArray:
        """Integrate mu x^power from each station `s` to the tip; exact.

        Args:
            s: (k,) stations (m).
            power: 0 gives the mass (kg), 1 the first moment about the root (kg m).

        Returns:
            (k,) integrals.
        """
        between = self._moment(self.x[:-1], self.x[1:], power)
        beyond = np.append(np.cumsum(between[::-1])[::-1], 0.0)[1:]
        interval = np.clip(np.searchsorted(self.x, s, side="right") - 1, 0, self.x.size - 2)
        outboard: FloatArray = self._moment(s, self.x[interval + 1], power) + beyond[interval]
        return outboard

    def _moment(self, start: FloatArray, end: FloatArray, power: int) -> FloatArray:
        """Integrate mu x^power over intervals without stations; exact up to mu x^2."""
        half = (end - start) / 2
        points = (start + end) / 2 + _NODES[:, None] * half
        mass = np.interp(points, self.x, self.mass_per_length)
        moment: FloatArray = half * np.sum(mass * points**power, axis=0)
        return moment


def beam_table(
    where: str,
    x: object,
    flexural_rigidity: object,
    mass_per_length: object,
    rotary_inertia_per_length: object,
    shear_rigidity: object = None,
    *,
    may_be_massless: bool = False,
) -> BeamTable:
    """Check a table of section properties and convert it to arrays.

    Args:
        where: name of the link, for messages.
        x, flexural_rigidity, mass_per_length, rotary_inertia_per_length, shear_rigidity:
            array-likes of equal length, see `BeamTable`.
        may_be_massless: whether mass may be zero everywhere, as for a rigid link.

    Raises:
        InputError: if a column has another length than `x`, is not finite or does not meet its
            condition; all problems are reported together.
    """
    stations = check_array(where, "x", x, (-1,))
    size = (stations.size,)
    stiffness = check_array(where, "flexural_rigidity", flexural_rigidity, size)
    mass = check_array(where, "mass_per_length", mass_per_length, size)
    rotary = check_array(where, "rotary_inertia_per_length", rotary_inertia_per_length, size)
    shears = shear_rigidity is not None
    shear = check_array(where, "shear_rigidity", shear_rigidity, size) if shears else np.ones(size)
    problems = [
        Problem(where, name, rule, _listed(column))
        for name, column, rule, kept in (
            ("x", stations, "have at least two stations", stations.size >= 2),
            ("x", stations, "start at 0", stations.size > 0 and stations[0] == 0.0),
            ("x", stations, "increase strictly", bool(np.all(np.diff(stations) > 0.0))),
            ("flexural_rigidity", stiffness, "be positive", bool(np.all(stiffness > 0.0))),
            (
                "mass_per_length",
                mass,
                f"be {'' if may_be_massless else 'positive somewhere and '}negative nowhere",
                bool(np.all(mass >= 0.0) and (may_be_massless or np.any(mass > 0.0))),
            ),
            ("rotary_inertia_per_length", rotary, "not be negative", bool(np.all(rotary >= 0.0))),
            ("shear_rigidity", shear, "be positive", bool(np.all(shear > 0.0))),
        )
        if not kept
    ]
    if problems:
        raise InputError(*problems)
    return BeamTable(stations, stiffness, mass, rotary, shear if shears else None)


def _listed(column: FloatArray) -> str:
    """Format the first few numbers of a column."""
    more = ", ..." if column.size > 6 else ""
    return f"[{', '.join(f'{number:.6g}' for number in column[:6])}{more}]"
