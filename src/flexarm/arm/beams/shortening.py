"""Shortening of a bent, inextensible link along its root tangent."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from flexarm.arm.beams.invariants import LinkConstants


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
