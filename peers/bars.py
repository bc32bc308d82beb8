"""A case as rigid bars on springs, for programs that know rigid bodies."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from peers.arms import Case


class Bar(NamedTuple):
    """A uniform thin bar, hinged to the bar before. SI units."""

    offset: float  # of the hinge, along the bar before
    length: float
    mass: float
    spring: float  # of the hinge; 0 at a motor
    link: int | None  # whose motor turns it; None at a spring

    @property
    def inertia(self) -> float:
        """Moment of inertia about the bar's centre, kg m^2."""
        return self.mass * self.length**2 / 12


def bars(case: Case, segments: int) -> list[Bar]:
    """Return the bars from base to tip.

    A spring in the middle of each of ``segments`` equal pieces of a link stands for that piece's
    bending: the error falls with the square of the piece's length.
    """
    found = []
    offset = 0.0
    for link, length in enumerate(case.lengths):
        piece = length / segments
        spring = case.flexural_rigidity / piece
        lengths = [piece / 2, *[piece] * (segments - 1), piece / 2]
        for number, own in enumerate(lengths):
            motor = number == 0
            mass = case.mass_per_length * own
            found.append(Bar(offset, own, mass, *((0.0, link) if motor else (spring, None))))
            offset = own
    return found


def angles(case: Case, segments: int) -> np.ndarray:
    """Return the angles of the hinges at the start, rad, (hinges,)."""
    found = np.zeros(len(case.lengths) * (segments + 1))
    found[:: segments + 1] = case.joint_angles
    return found


def motors(case: Case, segments: int) -> np.ndarray:
    """Return the amplitudes of the motors at the hinges, N m, (hinges,)."""
    found = np.zeros(len(case.lengths) * (segments + 1))
    found[:: segments + 1] = case.amplitude
    return found
