"""The beam of length, stiffness and mass one that most cases are about."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

import flexarm as fa

FloatArray = NDArray[np.float64]


def unit_beam(
    elements: int,
    *,
    hub: float = 0.0,
    tip_mass: float = 0.0,
    tip_inertia: float = 0.0,
    weight: float = 0.0,
    theory: str = "linear",
    **link: Any,
) -> fa.Arm:
    """Make an arm of one link with L = EI = mu = 1, so that frequencies are lambda = (beta L)^2.

    Args:
        weight: gravity mu g L^3 / EI, down.
        link: further fields of the link.
    """
    return fa.Arm(
        links=[
            fa.Link(length=1, flexural_rigidity=1, mass_per_length=1, elements=elements, **link)
        ],
        joints=[fa.Joint(hub_inertia=hub)],
        payload=fa.Payload(mass=tip_mass, inertia=tip_inertia),
        gravity=(0.0, -weight),
        theory=theory,
    )


def frequencies(arm: fa.Arm, joints: str = "locked") -> FloatArray:
    """Return the frequencies (rad/s) with joints locked or free, rigid-body modes left out."""
    found = 2 * np.pi * fa.modes(arm, joints=joints).frequency_hz
    return np.asarray(found[arm.n_joints * (joints == "free") :])


def mesh_digits(beta: float, elements: int, power: int = 2) -> float:
    """Digits that cubic elements give (beta L)^power: (beta h)^4 / 1440 for power 2.

    The law is that of a uniform Euler-Bernoulli beam without lumped bodies, which hold part of the
    kinetic energy without error; the next power of beta h is left out, hence the small allowance.
    """
    return -math.log10((beta / elements) ** 4 / 1440 * power / 2) - 0.05


def wave_digits(omega: float, mass_over_rigidity: float, element: float) -> float:
    """The same for a frequency (rad/s) of any links: (beta h)^4 is omega^2 (mu / EI) h^4.

    Args:
        mass_over_rigidity: mu / EI (kg/(N m^3)). element: length h of the longest element (m).
    """
    return -math.log10(omega**2 * mass_over_rigidity * element**4 / 1440) - 0.05


def mesh_reason(elements: int) -> str:
    """Why a frequency of a mesh of cubic elements has the error it has."""
    return f"a mesh of {elements} elements gives λ = (βL)² too high by (βh)⁴/1440"
