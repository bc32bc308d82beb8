"""Matrices and vectors of one link over its nodal coordinates, root clamped.

Nodal coordinates are `[v_2, phi_2, ..., v_{N+1}, phi_{N+1}]`, deflection (m) and rotation of the
section (rad) at the free nodes of N elements; the zero pair of the clamped root is omitted. N(x)
are the shapes of the deflection, N_phi(x) those of the rotation: N' for an Euler-Bernoulli beam.

With shear, the deflection v remains the cubic Hermite polynomial, with end slopes that are the
rotations phi of the end sections plus the angle between the sections and the normals of the axis.
Balance of moments inside the element makes this angle linear in the nodal coordinates; theory page
"beams", section 9. These shapes are exact only under loads at nodes. Three interior shapes of each
element, zero at its ends, represent loads inside it; `interior_values` expresses their values by
the nodal ones.

Reference:
    Z. Friedman and J. B. Kosmatka, "An improved two-node Timoshenko beam finite element",
    Computers & Structures 47(3), 1993, 473-481.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
from numpy.polynomial import polynomial

from flexarm.base.late import interpolate, linalg, scipy

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
    """Return points and weights that integrate polynomials of degree 7 exactly on every piece."""
    # A piece lies between adjacent element ends or breakpoints (p,) m of the tables, so that shape
    # functions and tables are polynomials inside it.
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
    share = np.linspace(0.0, 1.0, _BETWEEN, endpoint=False)
    x = np.append((table.x[:-1, None] + np.diff(table.x)[:, None] * share).ravel(), table.x[-1])
    columns = table.flexural_rigidity, table.mass_per_length
    linear = [np.interp(x, table.x, column) for column in columns]
    smooth = [np.asarray(interpolate.PchipInterpolator(table.x, column)(x)) for column in columns]

    def integral(values: FloatArray) -> FloatArray:
        return np.asarray(scipy.integrate.cumulative_simpson(values, x=x, initial=0))

    # The shape under the inertia of a parabola, one step of an inverse iteration.
    force = integral(linear[1] * x**2)
    force = force[-1] - force
    moment = integral(force)
    curvature = (moment[-1] - moment) / linear[0]
    deflection = integral(integral(curvature))
    changes = [
        scipy.integrate.simpson((after - before) * shape**2, x=x)
        / scipy.integrate.simpson(before * shape**2, x=x)
        for before, after, shape in zip(linear, smooth, (curvature, deflection), strict=True)
    ]
    return float(abs(0.5 * (changes[0] - changes[1])))


@dataclass(frozen=True, eq=False)
class BeamMatrices:
    """Matrices of one link over n = 2 * elements nodal values, plus 3 * elements interior ones.

    The interior values exist only with shear.
    """

    translational_mass: FloatArray  # (n, n) integral of mu N N^T
    rotary_mass: FloatArray  # (n, n) integral of rho I N_phi N_phi^T
    #: (n, n) integral of EI N_phi' N_phi'^T, and with shear of k G A (N' - N_phi) (N' - N_phi)^T
    stiffness: FloatArray
    deflection_moment: FloatArray  # (n,) integral of mu N: momentum of the deflection
    #: (n,) integral of mu x N + rho I N_phi: its angular momentum about the root
    rotation_moment: FloatArray
    #: (n + 2, n + 2) mass without the clamp; the coordinates of the root come first
    free_mass: FloatArray

    @property
    def mass(self) -> FloatArray:
        """(n, n) sum of translational and rotary inertia."""
        return self.translational_mass + self.rotary_mass

    def over(self, shapes: FloatArray) -> BeamMatrices:
        """Return the matrices, except ``free_mass``, over other coordinates: ``shapes`` (n, k)."""
        return BeamMatrices(
            translational_mass=over(self.translational_mass, shapes),
            rotary_mass=over(self.rotary_mass, shapes),
            stiffness=over(self.stiffness, shapes),
            deflection_moment=shapes.T @ self.deflection_moment,
            rotation_moment=shapes.T @ self.rotation_moment,
            free_mass=self.free_mass,
        )


def over(matrix: FloatArray, shapes: FloatArray) -> FloatArray:
    """Return shapes^T matrix shapes, symmetric to the last digit."""
    product: FloatArray = shapes.T @ matrix @ shapes
    return (product + product.T) / 2.0


def beam_matrices(
    table: BeamTable, quadrature: BeamQuadrature, shapes: _PointShapes | None = None
) -> BeamMatrices:
    """Assemble the matrices of a link; exact for tables that are linear between stations."""
    x, shapes = quadrature.points, shapes or point_shapes(table, quadrature)
    mass, rotary, rigidity = (
        np.interp(x, table.x, column)
        for column in (
            table.mass_per_length,
            table.rotary_inertia_per_length,
            table.flexural_rigidity,
        )
    )
    stiffness = product_integral(quadrature, rigidity, shapes.curvature)
    if table.shear_rigidity is not None:
        shear = np.interp(x, table.x, table.shear_rigidity)
        stiffness += product_integral(quadrature, shear, shapes.shear)
    translational = product_integral(quadrature, mass, shapes.deflection, with_root=True)
    turning = product_integral(quadrature, rotary, shapes.rotation, with_root=True)
    return BeamMatrices(
        translational_mass=translational[2:, 2:],
        rotary_mass=turning[2:, 2:],
        stiffness=stiffness,
        deflection_moment=integral(quadrature, mass, shapes.deflection),
        rotation_moment=integral(quadrature, mass * x, shapes.deflection)
        + integral(quadrature, rotary, shapes.rotation),
        free_mass=translational + turning,
    )


def integral(quadrature: BeamQuadrature, density: FloatArray, local: FloatArray) -> FloatArray:
    """Integrate density(x) N(x), (q,) and (q, 4 or 7) at the points, along the link: (n,)."""
    rows, size = _all_rows(quadrature, local)
    total = np.zeros(size)
    np.add.at(total, rows, local * (quadrature.weights * density)[:, None])
    return total[2:]


def product_integral(
    quadrature: BeamQuadrature, density: FloatArray, local: FloatArray, *, with_root: bool = False
) -> FloatArray:
    """Integrate density(x) N(x) N(x)^T as ``integral``: (n, n), or (n + 2, n + 2) ``with_root``."""
    rows, size = _all_rows(quadrature, local)
    total = np.zeros((size, size))
    if not density.any():  # most links have no rotary inertia
        return total if with_root else total[2:, 2:]
    products = local[:, :, None] * local[:, None, :]
    products *= (quadrature.weights * density)[:, None, None]
    np.add.at(total, (rows[:, :, None], rows[:, None, :]), products)
    return total if with_root else total[2:, 2:]


def nodal_shapes(
    stations: FloatArray,
    length: float,
    elements: int,
    derivative: int = 0,
    parameters: FloatArray | None = None,
) -> FloatArray:
    """Evaluate the deflection shapes (k, n) of all nodal coordinates at stations (k,) m.

    The derivative is 0 for the deflection v, 1 for the slope v', 2 for the curvature phi'. At
    element ends the curvature is discontinuous, with shear also the slope: the value is that of the
    outboard element, at the tip that of the last one. ``parameters`` (elements,) are Phi_s of
    `shear_parameters`, None without shear.
    """
    element, xi = _places(stations, length, elements)
    angles = _angles(element, length / elements, elements, parameters)
    return _spread(element, elements, deflection_shapes(xi, length / elements, angles, derivative))


def nodal_rotations(
    stations: FloatArray, length: float, elements: int, parameters: FloatArray
) -> FloatArray:
    """Evaluate the shapes (k, n) of the section rotation phi; arguments as in `nodal_shapes`."""
    element, xi = _places(stations, length, elements)
    angles = _angles(element, length / elements, elements, parameters)
    return _spread(element, elements, rotation_shapes(xi, length / elements, angles))


def interior_shapes(
    stations: FloatArray, length: float, elements: int, field: str, derivative: int
) -> FloatArray:
    """Evaluate interior shapes (k, 3 * elements) of v or phi at stations; see `nodal_shapes`."""
    element, xi = _places(stations, length, elements)
    of = _interior_deflection if field == "deflection" else _interior_rotation
    shapes = np.zeros((element.size, 3 * elements))
    columns = 3 * element[:, None] + np.arange(3)
    np.put_along_axis(shapes, columns, of(xi, length / elements, derivative), axis=1)
    return shapes


def _places(
    stations: FloatArray, length: float, elements: int
) -> tuple[npt.NDArray[np.intp], FloatArray]:
    """Return the element (k,) of each station, and the position in it (k,)."""
    scaled = stations / (length / elements)
    element = np.minimum(scaled.astype(np.intp), elements - 1)
    return element, scaled - element


def _angles(
    element: npt.NDArray[np.intp], length: float, elements: int, parameters: FloatArray | None
) -> FloatArray:
    """Return the rows (k, 4) of the shear angle of each station's element."""
    shear = np.zeros(elements) if parameters is None else parameters
    return shear_angles(shear, length)[element]


def _spread(element: npt.NDArray[np.intp], elements: int, local: FloatArray) -> FloatArray:
    """Return rows (k, n) over all nodal coordinates, from those of one element (k, 4)."""
    shapes = np.zeros((element.size, 2 * elements + 2))
    np.put_along_axis(shapes, 2 * element[:, None] + np.arange(4), local, axis=1)
    return shapes[:, 2:]


def _all_rows(quadrature: BeamQuadrature, local: FloatArray) -> tuple[npt.NDArray[np.intp], int]:
    """Return the indices (q, 4 or 7) of the coordinates of ``local``, and their total number."""
    size = 2 * quadrature.elements + 2
    if local.shape[1] == 4:
        return quadrature.nodal_rows, size
    return quadrature.all_rows, size + 3 * quadrature.elements


def shear_parameters(table: BeamTable, quadrature: BeamQuadrature) -> FloatArray:
    """Return Phi_s = 12 EI / (k G A h^2) of each element (elements,), from its mean rigidities."""
    # Zero for an Euler-Bernoulli beam. The mean affects the shapes only: energies are integrated
    # over the table itself.
    if table.shear_rigidity is None:
        return np.zeros(quadrature.elements)
    bending, shear = (
        _element_integrals(quadrature, np.interp(quadrature.points, table.x, column))
        for column in (table.flexural_rigidity, table.shear_rigidity)
    )
    return 12.0 * bending / (shear * quadrature.element_length**2)


def _element_integrals(quadrature: BeamQuadrature, density: FloatArray) -> FloatArray:
    """Integrate a density, (q,) at the points, over each element: (elements,)."""
    totals = np.zeros(quadrature.elements)
    np.add.at(totals, quadrature.element, quadrature.weights * density)
    return totals


def shear_angles(parameters: FloatArray, length: float) -> FloatArray:
    """Return rows (k, 4) that give the shear angle v' - phi from v_1, phi_1, v_2, phi_2; (B.30)."""
    share = parameters / (1.0 + parameters)
    return np.asarray(share[:, None] * np.array([-1.0 / length, -0.5, 1.0 / length, -0.5]))


def deflection_shapes(
    xi: FloatArray, length: float, angles: FloatArray, derivative: int = 0
) -> FloatArray:
    """Evaluate the deflection v, its slope v' or curvature v'' = phi': (k, 4), as (B.31).

    ``xi`` (k,) are positions in their elements, ``angles`` (k, 4) the rows of `shear_angles`.
    """
    local = shape_functions(xi, length, derivative)
    return np.asarray(local + (local[:, 1] + local[:, 3])[:, None] * angles)


def rotation_shapes(xi: FloatArray, length: float, angles: FloatArray) -> FloatArray:
    """Evaluate the shapes (k, 4) of the section rotation phi; as in `deflection_shapes`."""
    return np.asarray(deflection_shapes(xi, length, angles, 1) - angles)


def _interior_deflection(xi: FloatArray, length: float, derivative: int = 0) -> FloatArray:
    """Evaluate v of an element's three interior shapes at xi (k,), or its slope v': (k, 3)."""
    # They are the parabola h xi (1 - xi), the cubic h xi (1 - xi)(1 - 2 xi), and zero.
    zero, bump = np.zeros_like(xi), xi * (1.0 - xi)
    if derivative == 0:
        return length * np.stack([bump, bump * (1.0 - 2.0 * xi), zero], axis=1)
    return np.stack([1.0 - 2.0 * xi, 1.0 - 6.0 * bump, zero], axis=1)


def _interior_rotation(xi: FloatArray, length: float, derivative: int = 0) -> FloatArray:
    """Evaluate the rotation phi of the interior shapes, or phi': zero, zero, xi (1 - xi)."""
    zero, bump = np.zeros_like(xi), xi * (1.0 - xi)
    shape = bump if derivative == 0 else (1.0 - 2.0 * xi) / length
    return np.stack([zero, zero, shape], axis=1)


@dataclass(frozen=True, eq=False)
class _PointShapes:
    """Shapes of the element of each quadrature point: (q, 4) for v_1, phi_1, v_2, phi_2.

    With shear (q, 7), where the last three columns are the interior shapes.
    """

    deflection: FloatArray  # v
    slope: FloatArray  # v'
    rotation: FloatArray  # phi of the section
    curvature: FloatArray  # phi'
    shear: FloatArray  # the angle v' - phi


def point_shapes(table: BeamTable, quadrature: BeamQuadrature) -> _PointShapes:
    """Evaluate the shapes of a link's elements at its quadrature points."""
    xi, length = quadrature.xi, quadrature.element_length
    angles = shear_angles(shear_parameters(table, quadrature), length)[quadrature.element]
    nodal = _PointShapes(
        deflection=deflection_shapes(xi, length, angles),
        slope=deflection_shapes(xi, length, angles, 1),
        rotation=rotation_shapes(xi, length, angles),
        curvature=deflection_shapes(xi, length, angles, 2),
        shear=angles,
    )
    if table.shear_rigidity is None:
        return nodal
    slope, rotation = _interior_deflection(xi, length, 1), _interior_rotation(xi, length)
    return _PointShapes(
        deflection=np.hstack([nodal.deflection, _interior_deflection(xi, length)]),
        slope=np.hstack([nodal.slope, slope]),
        rotation=np.hstack([nodal.rotation, rotation]),
        curvature=np.hstack([nodal.curvature, _interior_rotation(xi, length, 1)]),
        shear=np.hstack([nodal.shear, slope - rotation]),
    )


# Rotary inertia is negligible below this fraction of mu h^2. In a beam of one material h then
# exceeds thirty radii of gyration, and shear is negligible too.
_NEGLIGIBLE = 1e-3


@dataclass(frozen=True, eq=False)
class _Interior:
    """Interior values of a link per nodal value; k = 3 * elements with shear, else 0."""

    values: FloatArray  # (k, n) rows that multiply nodal coordinates
    #: (k, n) Y: the stiffness over the nodal coordinates is K + Y^T Y, where K is the stiffness of
    #: the static response
    stiffening: FloatArray

    @property
    def extended(self) -> FloatArray:
        """Nodal and interior values per nodal value, (n + k, n)."""
        return np.vstack([np.eye(self.values.shape[1]), self.values])

    def stiffened(self, strain_to_nodal: FloatArray, units: FloatArray) -> FloatArray:
        """Return F of (K + Y^T Y)^-1 = F F^T from that of K^-1, whose rows have ``units`` (n,)."""
        Y = self.stiffening @ (strain_to_nodal / units[:, None])
        lower = np.linalg.cholesky(np.eye(len(units)) + Y.T @ Y)
        return np.asarray(
            linalg.solve_triangular(lower, strain_to_nodal.T, lower=True).T, np.float64
        )


def interior_values(
    table: BeamTable, quadrature: BeamQuadrature, shapes: _PointShapes, stiffness: FloatArray
) -> _Interior:
    """Compute the interior values of a link from K (n + k, n + k), also over interior values.

    The two-node element is exact under loads at its nodes, but inertia also loads the link between
    them. Without the shear strain of these loads, frequencies converge as h^2 if shear dominates.
    Three interior values of each element, v cubic and phi quadratic with zero ends, represent it.
    They are not coordinates, because they would add frequencies near the cut-off sqrt(kGA/rho I),
    which limits the step of every integrator. They are functions of the nodal values d,
    b = S d + T p(d) with S = -K_bb^-1 K_bn and T = K_bb^-1 F: the static response to the nodal
    values, and to the inertia F p of the mean acceleration p of each element. p follows from the
    forces K d at the inner nodes, which are inertia forces in a vibration. Loads at the tip cause
    no forces there, so the static response to them stays exact. Theory page "beams", section 9.
    """
    n = 2 * quadrature.elements
    if table.shear_rigidity is None:
        return _Interior(np.zeros((0, n)), np.zeros((0, n)))
    K, K_bb = stiffness, stiffness[n:, n:]
    S = -np.linalg.solve(K_bb, K[n:, :n])
    static = K[:n, :n] + K[:n, n:] @ S
    # The mean acceleration of v, phi in each element, per nodal value, is the force ``static @ d``
    # at inner nodes divided by the inertia of these nodes. Root and tip elements take the value of
    # their inner node, because other forces act at root and tip; the error is of first order in two
    # elements and changes frequencies in fifth order. The moment at a node also contains mu h^3/15
    # v'' of a smooth field around it.
    h, elements, xi = quadrature.element_length, quadrature.elements, quadrature.xi
    mass, rotary = (
        quadrature.weights * np.interp(quadrature.points, table.x, column)
        for column in (table.mass_per_length, table.rotary_inertia_per_length)
    )
    both = np.stack([mass, rotary + h**2 / 15.0 * mass], axis=1)
    inertia = np.zeros((elements + 1, 2))
    np.add.at(inertia, quadrature.element, (1.0 - xi)[:, None] * both)
    np.add.at(inertia, quadrature.element + 1, xi[:, None] * both)
    nodal = static.reshape(elements, 2, -1)[:-1] / inertia[1:-1, :, None]
    mean = np.zeros((elements, 2, static.shape[1]))
    mean[:-1] += nodal
    mean[1:] += nodal
    mean[1:-1] /= 2.0
    forces = _inertia_forces(table, quadrature, shapes) @ mean.reshape(2 * elements, -1)
    response = np.linalg.solve(K_bb, forces)
    energy = np.linalg.cholesky(K_bb).T @ response
    return _Interior(np.asarray(S + response, np.float64), np.asarray(energy, np.float64))


def _inertia_forces(
    table: BeamTable, quadrature: BeamQuadrature, local: _PointShapes
) -> FloatArray:
    """Return F (3 * elements, 2 * elements): inertia of each element's mean acceleration."""
    # If rotary inertia is negligible, F vanishes. Otherwise the response would cancel the
    # deflection that node rotations cause in soft elements, and then these rotations would have no
    # inertia.
    elements = quadrature.elements
    mass, rotary = (
        np.interp(quadrature.points, table.x, column)
        for column in (table.mass_per_length, table.rotary_inertia_per_length)
    )
    of_element = np.zeros((elements, 3, 2))
    for k, field in ((0, mass[:, None] * local.deflection), (1, rotary[:, None] * local.rotation)):
        inertia = quadrature.weights[:, None] * field[:, 4:]
        np.add.at(of_element[:, :, k], quadrature.element, inertia)
    turning = _element_integrals(quadrature, rotary)
    scale = _NEGLIGIBLE * quadrature.element_length**2 * _element_integrals(quadrature, mass)
    of_element *= (turning / np.maximum(turning + scale, np.finfo(float).tiny))[:, None, None]
    forces = np.zeros((elements, 3, elements, 2))
    each = np.arange(elements)
    forces[each, :, each] = of_element
    return forces.reshape(3 * elements, -1)
