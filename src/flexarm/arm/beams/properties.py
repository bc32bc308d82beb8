"""Section properties along a link, shape functions of its elements, and quadrature along it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from numpy.polynomial import polynomial

FloatArray = npt.NDArray[np.float64]

# Rows: powers 0 to 3 of xi; columns: the shape functions for an element of unit length.
_SHAPES = np.array(
    [
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0],
        [-3.0, -2.0, 3.0, -1.0],
        [2.0, 1.0, -2.0, 1.0],
    ]
)
_DERIVATIVES = tuple(polynomial.polyder(_SHAPES, order) for order in range(4))


def shape_functions(xi: FloatArray, length: float, derivative: int = 0) -> FloatArray:
    """Evaluate the four shape functions, or one of their derivatives by x, at xi (k,): (k, 4).

    The deflection inside the element is `shape_functions(xi, length) @ [v_1, phi_1, v_2, phi_2]`
    with the deflections v (m) and slopes phi (rad) of its two ends, at xi = 0 and 1.
    """
    powers = xi[:, None] ** np.arange(4 - derivative)
    unit = np.array([1.0, length, 1.0, length]) / length**derivative
    return np.asarray(powers @ _DERIVATIVES[derivative] * unit, np.float64)


# The integrands have at most degree 7: cubic times cubic shape functions times a linear mass per
# length, and quadratic times quadratic slopes times a cubic outboard moment. Four points suffice.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True, eq=False)
class BeamQuadrature:
    """Points and weights along one link divided into elements of equal length."""

    elements: int  # number of elements
    element_length: float  # length of each element (m)
    points: FloatArray  # (k,) distances from the root (m), increasing
    weights: FloatArray  # (k,) quadrature weights (m)
    element: npt.NDArray[np.intp]  # (k,) index of the element of each point
    xi: FloatArray  # (k,) position in that element, 0 to 1

    @cached_property
    def nodal_rows(self) -> npt.NDArray[np.intp]:
        """Indices (k, 4) of the nodal coordinates of each point's element, from the root's on."""
        return 2 * self.element[:, None] + np.arange(4)

    @cached_property
    def all_rows(self) -> npt.NDArray[np.intp]:
        """Indices (k, 7) of the nodal coordinates, then of three interior values per element."""
        interior = 2 * self.elements + 2 + 3 * self.element[:, None] + np.arange(3)
        return np.hstack([self.nodal_rows, interior])


def beam_quadrature(breakpoints: FloatArray, elements: int) -> BeamQuadrature:
    """Return points and weights that integrate polynomials of degree 7 exactly on every piece.

    A piece lies between adjacent element ends or breakpoints (p,) m of the tables, so that shape
    functions and tables are polynomials inside it.
    """
    ends = np.linspace(0.0, breakpoints[-1], elements + 1)
    edges = np.union1d(ends, breakpoints)
    middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    points = (middle[:, None] + half[:, None] * _NODES).ravel()
    # A piece may be as short as rounding errors (a breakpoint at an element end), so its middle and
    # not its rounded points determine its element.
    owner = np.searchsorted(ends[1:-1], middle, side="right")
    element = np.repeat(owner, _NODES.size)
    element_length = float(breakpoints[-1]) / elements
    return BeamQuadrature(
        elements=elements,
        element_length=element_length,
        points=points,
        weights=(half[:, None] * _WEIGHTS).ravel(),
        element=element,
        xi=(points - ends[element]) / element_length,
    )


# Two-point Gauss-Legendre rule on (-1, 1); both weights are one.
_TWO_NODES = np.array([-1.0, 1.0]) / np.sqrt(3.0)


@dataclass(frozen=True, eq=False)
class BeamTable:
    """Section properties at stations from the root (0) to the tip, linear in between.

    The conditions are those of `model.arm.links.Link`, which checks them.
    """

    x: FloatArray  # (p,) stations (m), p >= 2, from 0, strictly increasing to the length
    flexural_rigidity: FloatArray  # (p,) EI (N m^2), positive
    mass_per_length: FloatArray  # (p,) mu (kg/m), not negative; only a massless link has none
    #: (p,) rho I (kg m), not negative; without shear, zero is an Euler-Bernoulli beam, otherwise a
    #: Rayleigh beam
    rotary_inertia_per_length: FloatArray
    #: (p,) k G A (N), positive: Timoshenko beam; None: sections stay normal to the axis
    shear_rigidity: FloatArray | None = None

    @property
    def length(self) -> float:
        """Length of the link (m)."""
        return float(self.x[-1])

    def outboard_moment(self, s: FloatArray, power: int) -> FloatArray:
        """Integrate mu x^power from each station s (k,) m to the tip; exact: (k,) kg or kg m."""
        between = self._moment(self.x[:-1], self.x[1:], power)
        beyond = np.append(np.cumsum(between[::-1])[::-1], 0.0)[1:]
        interval = np.clip(np.searchsorted(self.x, s, side="right") - 1, 0, self.x.size - 2)
        return np.asarray(self._moment(s, self.x[interval + 1], power) + beyond[interval])

    def _moment(self, start: FloatArray, end: FloatArray, power: int) -> FloatArray:
        """Integrate mu x^power over intervals without stations; exact up to mu x^2."""
        half = (end - start) / 2
        points = (start + end) / 2 + _TWO_NODES[:, None] * half
        mass = np.interp(points, self.x, self.mass_per_length)
        return np.asarray(half * np.sum(mass * points**power, axis=0))


#: Fewest points of a table that counts as a sampled taper; fewer are drawn as straight pieces.
_SAMPLED = 5
#: Points of the quadrature between two points of the table.
_BETWEEN = 16


def interpolation_error(table: BeamTable) -> float:
    """Estimate the relative error of the first frequency by linear interpolation of a smooth taper.

    The linear interpolation is compared with a monotone cubic one (Fritsch and Carlson, SIAM
    Journal on Numerical Analysis 17 (1980) 238-246), which follows smooth tapers and jumps alike.
    Rayleigh's quotient gives the effect on the frequency of the link, clamped at its root. Zero
    for tables that are no samples of a taper: with fewer than five points, without mass, or with a
    rigidity that both rises and falls.
    """
    steps = np.diff(table.flexural_rigidity)
    if table.x.size < _SAMPLED or (np.any(steps > 0.0) and np.any(steps < 0.0)):
        return 0.0
    if not np.any(table.mass_per_length):
        return 0.0
    from scipy.integrate import cumulative_simpson, simpson
    from scipy.interpolate import PchipInterpolator

    share = np.linspace(0.0, 1.0, _BETWEEN, endpoint=False)
    x = np.append((table.x[:-1, None] + np.diff(table.x)[:, None] * share).ravel(), table.x[-1])
    columns = table.flexural_rigidity, table.mass_per_length
    linear = [np.interp(x, table.x, column) for column in columns]
    smooth = [np.asarray(PchipInterpolator(table.x, column)(x)) for column in columns]

    def integral(values: FloatArray) -> FloatArray:
        return np.asarray(cumulative_simpson(values, x=x, initial=0))

    # The shape under the inertia of a parabola, one step of an inverse iteration.
    force = integral(linear[1] * x**2)
    force = force[-1] - force
    moment = integral(force)
    curvature = (moment[-1] - moment) / linear[0]
    deflection = integral(integral(curvature))
    changes = [
        simpson((after - before) * shape**2, x=x) / simpson(before * shape**2, x=x)
        for before, after, shape in zip(linear, smooth, (curvature, deflection), strict=True)
    ]
    return float(abs(0.5 * (changes[0] - changes[1])))
