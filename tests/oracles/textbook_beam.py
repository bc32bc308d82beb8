"""Matrices of a uniform cantilever as printed in finite element textbooks.

Source of the element matrices: any text on structural dynamics, for instance L. Meirovitch,
"Fundamentals of Vibrations" (2001), section 10.3. The vectors S and a follow from the same cubic
shape functions by hand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class TextbookBeam:
    """Nodal matrices of a link clamped at its root, m = 2 * elements coordinates.

    mass M (m, m), stiffness K (m, m), first S = int mu N dx (m,), moment a = int mu x N dx (m,).
    """

    mass: np.ndarray
    stiffness: np.ndarray
    first: np.ndarray
    moment: np.ndarray


def textbook_beam(
    length: float, flexural_rigidity: float, mass_per_length: float, elements: int
) -> TextbookBeam:
    """Assemble ``elements`` equal elements of a uniform link."""
    h, mu = length / elements, mass_per_length
    element_mass = (mu * h / 420) * np.array(
        [
            [156, 22 * h, 54, -13 * h],
            [22 * h, 4 * h**2, 13 * h, -3 * h**2],
            [54, 13 * h, 156, -22 * h],
            [-13 * h, -3 * h**2, -22 * h, 4 * h**2],
        ]
    )
    element_stiffness = (flexural_rigidity / h**3) * np.array(
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, 4 * h**2, -6 * h, 2 * h**2],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, 2 * h**2, -6 * h, 4 * h**2],
        ]
    )
    element_first = mu * h * np.array([1 / 2, h / 12, 1 / 2, -h / 12])
    element_moment = mu * h**2 * np.array([3 / 20, h / 30, 7 / 20, -h / 20])

    size = 2 * (elements + 1)
    mass, stiffness = np.zeros((size, size)), np.zeros((size, size))
    first, moment = np.zeros(size), np.zeros(size)
    for k in range(elements):
        part = slice(2 * k, 2 * k + 4)
        mass[part, part] += element_mass
        stiffness[part, part] += element_stiffness
        first[part] += element_first
        moment[part] += element_moment + k * h * element_first
    return TextbookBeam(mass[2:, 2:], stiffness[2:, 2:], first[2:], moment[2:])
