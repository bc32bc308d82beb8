"""A link as a set of material points: their places, masses and shapes.

The quadrature is exact for all integrals of the model: sections vary linearly between breakpoints
and shapes are cubic inside an element, so on an interval without breakpoint or node no integrand
exceeds degree 7 (mass times deflection squared), which four Gauss points integrate exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

# Abscissas on [-1, 1] and weights in closed form, to the last bit of an extended number.
ROOT = np.sqrt(np.longdouble(6) / 5) * 2 / 7
OUTER, INNER = np.sqrt(np.longdouble(3) / 7 + ROOT), np.sqrt(np.longdouble(3) / 7 - ROOT)
SHIFT = np.sqrt(np.longdouble(30)) / 36
FAR = np.sqrt(np.longdouble(3) / 5)
GAUSS = {
    3: (np.array([-FAR, 0, FAR]), np.array([5, 8, 5]) / np.longdouble(9)),
    4: (
        np.array([-OUTER, -INNER, INNER, OUTER]),
        np.array([0.5 - SHIFT, 0.5 + SHIFT, 0.5 + SHIFT, 0.5 - SHIFT]),
    ),
}


def hermite(x: np.ndarray, length: float, elements: int, derivative: int) -> np.ndarray:
    """The cubic Hermite functions of a link with a clamped root, or a derivative of them.

    x: stations in m, shape (k,); returns (k, 2 * elements): columns are the nodal coordinates
    [v_2, phi_2, v_3, phi_3, ...] (m and rad) of the free nodes of ``elements`` equal elements.
    """
    h = length / elements
    cubics = [  # in s = (x - start of the element) / h, lowest power first
        np.polynomial.Polynomial([1, 0, -3, 2]),
        np.polynomial.Polynomial([0, 1, -2, 1]) * h,
        np.polynomial.Polynomial([0, 0, 3, -2]),
        np.polynomial.Polynomial([0, 0, -1, 1]) * h,
    ]
    matrix = np.zeros((len(x), 2 * (elements + 1)), dtype=x.dtype)
    element = np.minimum((x / h).astype(int), elements - 1)
    s = x / h - element
    for k, cubic in enumerate(cubics):
        values = cubic.deriv(derivative)(s) / h**derivative
        matrix[np.arange(len(x)), 2 * element + k] = values
    return matrix[:, 2:]


def gauss_points(edges: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return stations and weights of ``count`` Gauss points on every interval between ``edges``."""
    node, weight = GAUSS[count]
    start, size = edges[:-1, None], np.diff(edges)[:, None]
    return (start + size * (node + 1) / 2).ravel(), (size * weight / 2).ravel()


@dataclass(frozen=True)
class MaterialPoints:
    """One link cut into points; matrices act on its coordinates (nodal, or those of a basis).

    x (k,): stations, m. mass (k,): kg. rotary (k,): section inertia, kg m^2. rigidity (k,): N m^3,
    the flexural rigidity times the length a point stands for.
    deflection, slope, curvature (k, m): v, v', v'' at the points; tip_deflection, tip_slope (m,).
    inner_slope (j, m): v' at the points of the integral of v'^2; running (k, j) and whole (j,)
    their weights for an integral from the root to each station and to the tip.
    """

    x: np.ndarray
    mass: np.ndarray
    rotary: np.ndarray
    rigidity: np.ndarray
    deflection: np.ndarray
    slope: np.ndarray
    curvature: np.ndarray
    tip_deflection: np.ndarray
    tip_slope: np.ndarray
    inner_slope: np.ndarray
    running: np.ndarray
    whole: np.ndarray

    @property
    def stiffness_matrix(self) -> np.ndarray:
        """Return the link's own stiffness, clamped at its root, shape (m, m)."""
        return (self.curvature.T @ (self.rigidity[:, None] * self.curvature)).astype(float)

    @property
    def mass_matrix(self) -> np.ndarray:
        """Return the link's own mass with rotary inertia, clamped at its root, shape (m, m)."""
        moving = self.deflection.T @ (self.mass[:, None] * self.deflection)
        return (moving + self.slope.T @ (self.rotary[:, None] * self.slope)).astype(float)


def between(stations: np.ndarray, x: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Return values of a table at stations, linear between its points (in the stations'
    precision)."""
    left = np.clip(np.searchsorted(x, stations, side="right") - 1, 0, len(x) - 2)
    share = (stations - x[left]) / (x[left + 1] - x[left])
    return (1 - share) * column[left] + share * column[left + 1]


def material_points(
    link: Any,
    basis: np.ndarray | None = None,
    precision: type[np.floating] = np.longdouble,
    cuts: tuple[float, ...] = (),
) -> MaterialPoints:
    """Cut ``link`` (a link of the arm's specification) into material points.

    basis: shape (2 * elements, m), nodal displacements per coordinate; None for the nodal
    coordinates themselves. A rigid link has no coordinates: its matrices have zero columns.
    precision: number type of everything returned. cuts: stations that no point may straddle.
    """
    beam, length, elements = link.beam(), precision(link.length), int(link.elements)
    table_x = np.asarray(beam.x, dtype=precision)
    nodes = np.arange(elements + 1) * length / elements
    edges = np.unique(np.concatenate([nodes, table_x, np.array(cuts, dtype=precision)]))
    x, weight = gauss_points(edges, 4)

    def per_point(column: Any) -> np.ndarray:
        if column is None:
            return np.zeros_like(x)
        return weight * between(x, table_x, np.asarray(column, dtype=precision))

    if not link.flexible:
        basis = np.zeros((2 * elements, 0))
    elif basis is None:
        basis = np.eye(2 * elements)

    def shapes(stations: np.ndarray, derivative: int) -> np.ndarray:
        return hermite(stations, length, elements, derivative) @ basis

    # v'^2 has degree 4 inside an element: three points on each interval between stations.
    inner_x, inner_weight = gauss_points(np.unique(np.concatenate([edges, x])), 3)
    tip = np.array([length])
    columns = {
        "x": x,
        "mass": per_point(beam.mass_per_length),
        "rotary": per_point(beam.rotary_inertia_per_length),
        "rigidity": per_point(beam.flexural_rigidity if link.flexible else None),
        "deflection": shapes(x, 0),
        "slope": shapes(x, 1),
        "curvature": shapes(x, 2),
        "tip_deflection": shapes(tip, 0)[0],
        "tip_slope": shapes(tip, 1)[0],
        "inner_slope": shapes(inner_x, 1),
        "running": np.where(inner_x < x[:, None], inner_weight, 0.0),
        "whole": inner_weight,
    }
    return MaterialPoints(**{name: column.astype(precision) for name, column in columns.items()})
