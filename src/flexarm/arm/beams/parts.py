"""Constants of the part of a link between its root and a station.

Theory page "recursion", (R.40): the integrals of `LinkConstants` over the shapes of the whole link,
from the root to the station instead of the tip.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.beams.invariants import LinkConstants
from flexarm.arm.beams.properties import FloatArray, beam_quadrature


@dataclass(frozen=True, eq=False)
class PartConstants:
    """Integrals from the root to each of k stations, over the m shapes of the whole link."""

    mass: FloatArray  # (k,) kg, kg m, kg m^2 about the root
    first_moment: FloatArray  # (k,) kg, kg m, kg m^2 about the root
    inertia: FloatArray  # (k,) kg, kg m, kg m^2 about the root
    S: FloatArray  # (k, m) integrals of mu Phi and of mu x Phi + rho I Psi
    a: FloatArray  # (k, m) integrals of mu Phi and of mu x Phi + rho I Psi
    D0: FloatArray  # (k, m, m) integrals of mu g and of mu x g
    D1: FloatArray  # (k, m, m) integrals of mu g and of mu x g
    spread: FloatArray  # (k, m, m) integral of mu Phi Phi^T, without rotary inertia


def part_constants(link: LinkConstants, x: FloatArray, *, shortening: bool) -> PartConstants:
    """Integrate a link from its root to stations x (k,) m; D0 and D1 only with ``shortening``."""
    table, m = link.table, link.w2.size
    quadrature = beam_quadrature(np.union1d(table.x, x), link.elements)
    s, weights = quadrature.points, quadrature.weights
    mass = weights * np.interp(s, table.x, table.mass_per_length)
    rotary = weights * np.interp(s, table.x, table.rotary_inertia_per_length)
    deflection, slope, rotation = link.deflection(s), link.slope(s), link.rotation(s)
    inside = (s < x[:, None]).astype(np.float64)
    D0, D1, spread = np.zeros((3, x.size, m, m))
    for k, end in enumerate(x):
        n = int(inside[k].sum())  # the points are in ascending order
        spread[k] = _squared(deflection[:n], mass[:n])
        if shortening:
            # As for the whole link: a slope shortens the interval from it to the station.
            beyond = [table.outboard_moment(np.array([end]), power)[0] for power in (0, 1)]
            zeroth, first = (
                weights[:n] * (table.outboard_moment(s[:n], power) - beyond[power])
                for power in (0, 1)
            )
            D0[k] = _squared(slope[:n], zeroth)
            D1[k] = _squared(slope[:n], first)
    return PartConstants(
        mass=inside @ mass,
        first_moment=inside @ (mass * s),
        inertia=inside @ (mass * s**2 + rotary),
        S=inside @ (mass[:, None] * deflection),
        a=inside @ ((mass * s)[:, None] * deflection + rotary[:, None] * rotation),
        D0=D0,
        D1=D1,
        spread=spread,
    )


def inverse_inertia(mass: float, first_moment: float, inertia: float) -> float:
    """Return the inverse inertia about the centre of mass, 1/(kg m^2), or 0 if not positive."""
    central = inertia - first_moment / mass * first_moment if mass else 0.0
    return 1.0 / central if central > 0.0 else 0.0


def _squared(shapes: FloatArray, density: FloatArray) -> FloatArray:
    """Sum density_p shape_pi shape_pj over points p, symmetric to the last digit: (m, m)."""
    product: FloatArray = shapes.T @ (density[:, None] * shapes)
    return (product + product.T) / 2


def shortening_matrices(
    link: LinkConstants, x: NDArray[np.float64]
) -> NDArray[np.float64]:  # fmt: skip
    """Return g(x) = int_0^x Phi' Phi'^T ds (k, m, m) at ascending stations x (k,), m.

    The axial displacement at x is ``-eta^T g(x) eta / 2``. The result is exact: between element
    ends the integrand is a quartic, which three Gauss points integrate. Theory page "link", second
    order.
    """
    ends = np.linspace(0.0, link.length, link.elements + 1)
    cuts = np.unique(np.concatenate([ends, x]))
    points, weights = np.polynomial.legendre.leggauss(3)
    half = np.diff(cuts)[:, None] / 2
    nodes = (cuts[:-1, None] + half) + half * points
    slopes = link.slope(nodes.ravel()).reshape(*nodes.shape, -1)
    pieces = np.einsum("spi,spj,sp->sij", slopes, slopes, half * weights)
    m = slopes.shape[-1]
    total = np.concatenate([np.zeros((1, m, m)), np.cumsum(pieces, axis=0)])
    return np.asarray(total[np.searchsorted(cuts, x)])
