"""Constants of one link for the dynamics of the arm, over its mass-normalised shapes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.beams.assembly import (
    BeamMatrices,
    BeamQuadrature,
    BeamTable,
    FloatArray,
    beam_matrices,
    beam_quadrature,
    interior_shapes,
    interior_values,
    nodal_rotations,
    nodal_shapes,
    over,
    point_shapes,
    product_integral,
    shear_parameters,
)
from flexarm.base.errors import InputError, Problem, check_array, shown
from flexarm.base.late import linalg

#: Legendre coefficients of a cubic on (-1, 1) from the means, over its left and its right half, of
#: the cubic and of its product with the first Legendre polynomial of the half.
_CUBIC = np.array([[2.0, 0, 2, 0], [-3, 3, 3, 3], [0, -8, 0, 8], [4, 12, -4, 12]]) / 4.0
#: Dimensions up to this size, and down to its inverse, have powers within the range of floats.
_LARGEST = 1e50


@dataclass(frozen=True, eq=False)
class LinkConstants:
    """Floating-frame integrals of one link over its m mass-normalised shapes Phi.

    Frame: origin at the root, x normal to the section there, deflection `v(x) = Phi(x)^T eta`,
    rotation of the section `phi(x) = Psi(x)^T eta`; without shear Psi = Phi', and x is along the
    tangent. mu is the mass per length, rho I the rotary inertia per length. Over these shapes the
    mass matrix of the link is the identity and its stiffness diag(w2). Arrays are read-only.

    A rigid link has m = 0 and the same arrays, which are then empty.
    """

    length: float  # L (m)
    mass: float  # integral of mu (kg)
    first_moment: float  # integral of mu x (kg m)
    inertia: float  # integral of mu x^2 + rho I (kg m^2), about the root
    S: FloatArray  # (m,) integral of mu Phi
    a: FloatArray  # (m,) integral of mu x Phi + rho I Psi
    P: FloatArray  # (m,) Phi at the tip
    dP: FloatArray  # (m,) Psi at the tip
    w2: FloatArray  # (m,) stiffness (rad^2/s^2), increasing
    rotary: FloatArray  # (m, m) integral of rho I Psi Psi^T, contained in the identity above
    #: (m, m) integral of mu g(x) with g(x) the integral of Phi' Phi'^T from 0 to x
    D0: FloatArray
    D1: FloatArray  # (m, m) integral of mu x g(x)
    G: FloatArray  # (m, m) g(L): a bent link is shorter by eta^T G eta / 2 along its root tangent
    #: (3,) inertia of the residuals of a rigid translation and rotation about the root, after
    #: subtracting their best approximation by the shapes: translation, coupling, rotation (kg,
    #: kg m, kg m^2); theory page "recursion", (R.6)
    residual_inertia: FloatArray
    #: (2, 2) tip deflection and rotation (rows) of the residuals of a unit translation and rotation
    residual_tip: FloatArray
    #: (2 * elements, m) shapes at the nodes: `basis @ eta` is `[v_2, phi_2, v_3, phi_3, ...]`
    #: (m, rad); the clamped root is omitted
    basis: FloatArray
    projector: FloatArray  # (m, 2 * elements) `basis^T M`, mass-orthogonal, of nodal values
    shear_parameter: FloatArray  # (elements,) 12 EI / (k G A h^2) of each element; 0 without shear
    #: (k, m) interior values of the shapes, k = 3 * elements with shear, else 0
    interior: FloatArray
    table: BeamTable  # from which the constants are computed

    def __post_init__(self) -> None:
        m = self.w2.size
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
                expected: dict[str, tuple[int, ...]] = {
                    "basis": (len(self.basis), m),
                    "projector": (m, len(self.basis)),
                    "residual_inertia": (3,),
                    "residual_tip": (2, 2),
                    "shear_parameter": (self.elements,),
                    "interior": (len(self.interior), m),
                }
                square = field.name in ("rotary", "D0", "D1", "G")
                shape = expected.get(field.name, (m, m) if square else (m,))
                check_array(field.name, value, shape)

    @property
    def elements(self) -> int:
        """Number of finite elements."""
        return len(self.basis) // 2

    def deflection(self, x: object) -> FloatArray:
        """Evaluate Phi at stations x (k,), 0 to length (m): (k, m), m per unit of eta."""
        return self._shapes(x, 0)

    def slope(self, x: object) -> FloatArray:
        """Evaluate Phi' at stations x (k,), 0 to length (m): (k, m), rad per unit of eta.

        With shear it is discontinuous at element ends; the value is that of the outboard element.
        """
        return self._shapes(x, 1)

    def rotation(self, x: object) -> FloatArray:
        """Evaluate the section rotation Psi; as `slope`, to which it is equal without shear."""
        stations = self._stations(x)
        nodal = nodal_rotations(stations, self.length, self.elements, self.shear_parameter)
        return nodal @ self.basis + self._interior(stations, "rotation", 0)

    def curvature(self, x: object) -> FloatArray:
        """Evaluate Psi' at stations x (k,), 0 to length (m): (k, m), 1/m per unit of eta.

        It is discontinuous at element ends; the value is that of the outboard element.
        """
        return self._shapes(x, 2)

    def recovered_curvature(self, x: object) -> FloatArray:
        """Evaluate Psi' at stations x (k,) from the bending moment of two elements: (k, m).

        In statics the integrals of the moment over an element, and over its first Legendre
        polynomial, are exact whatever the rigidity. The cubic polynomial with these integrals in
        the two elements nearest to a station, divided by the rigidity there, therefore has an error
        of fourth order in the length of elements; that of `curvature` is of second order except
        near Gauss points (R.23). Equal to `curvature` with one element.
        """
        stations = self._stations(x)
        if self.elements == 1:
            return self.curvature(stations)
        table = self.table
        quadrature = beam_quadrature(table.x, self.elements)
        h, s, element = quadrature.element_length, quadrature.points, quadrature.element
        legendre = np.polynomial.legendre.legvander
        weights = quadrature.weights * np.interp(s, table.x, table.flexural_rigidity) / h
        tests = weights[:, None] * legendre(2.0 * quadrature.xi - 1.0, 1)
        integrals = np.zeros((self.elements, 2, self.w2.size))
        np.add.at(integrals, element, tests[:, :, None] * self.curvature(s)[:, None, :])
        first = np.clip(np.rint(stations / h).astype(int) - 1, 0, self.elements - 2)
        moments = integrals[first[:, None] + np.arange(2)].reshape(first.size, 4, -1)
        weights = legendre(stations / h - first - 1.0, 3) @ _CUBIC
        rigidity = np.interp(stations, table.x, table.flexural_rigidity)
        return np.asarray(np.einsum("ki,kim->km", weights, moments) / rigidity[:, None])

    def _shapes(self, x: object, derivative: int) -> FloatArray:
        stations = self._stations(x)
        nodal = nodal_shapes(stations, self.length, self.elements, derivative, self.shear_parameter)
        field = ("deflection", derivative) if derivative < 2 else ("rotation", 1)
        return nodal @ self.basis + self._interior(stations, *field)

    def _interior(self, stations: FloatArray, field: str, derivative: int) -> FloatArray:
        """Return the contribution of the interior values: (k, m), zero without shear."""
        if not len(self.interior):
            return np.zeros((stations.size, self.w2.size))
        shapes = interior_shapes(stations, self.length, self.elements, field, derivative)
        return shapes @ self.interior

    def _stations(self, x: object) -> FloatArray:
        """Check stations, and clip those that are outside the link because of rounding."""
        stations = check_array("x", x, (-1,))
        slack = 1e-9 * self.length  # stations computed as sums may differ from the tip by rounding
        outside = (stations < -slack) | (stations > self.length + slack)
        if np.any(outside):
            rule = f"lie between 0 and the length {self.length:g}"
            raise InputError(Problem("x", rule, shown(float(stations[outside][0]))))
        return np.clip(stations, 0.0, self.length)


def link_constants(table: BeamTable, elements: int, modes: int | None = None) -> LinkConstants:
    """Compute the constants of a flexible link; exact for tables linear between stations.

    ``modes`` is the number of reduced shapes, 1 to 2 * elements; None: the finite elements.
    InputError if the mass matrix is not positive definite, or numbers overflow.
    """
    with _in_range(table):
        return _flexible_constants(table, elements, modes)


def _flexible_constants(table: BeamTable, elements: int, modes: int | None) -> LinkConstants:
    quadrature = beam_quadrature(table.x, elements)
    local = point_shapes(table, quadrature)
    matrices = beam_matrices(table, quadrature, local)
    inside = interior_values(table, quadrature, local, matrices.stiffness)
    h = quadrature.element_length
    factor = strain_to_nodal(table, quadrature)
    if len(inside.values):
        matrices = matrices.over(inside.extended)
        factor = inside.stiffened(factor, np.tile([1.0, h], elements))
    shapes = beam_basis(matrices, factor, h, modes)
    basis, interior = shapes.basis, inside.values @ shapes.basis
    all_values = np.vstack([basis, interior]) if len(interior) else basis

    # The slope at s shortens everything outboard of it. Exchanging the order of integration
    # therefore gives single integrals over s, weighted by the outboard mass or first moment.
    s = quadrature.points
    S = basis.T @ matrices.deflection_moment
    a = basis.T @ matrices.rotation_moment
    left = _left_of_rigid_motion(quadrature, all_values @ S, all_values @ a)
    residual = left.T @ matrices.free_mass @ left
    return LinkConstants(
        *_rigid_body(table, quadrature),
        S=S,
        a=a,
        P=basis[-2].copy(),
        dP=basis[-1].copy(),
        w2=shapes.w2,
        rotary=over(matrices.rotary_mass, basis),
        D0=over(product_integral(quadrature, table.outboard_moment(s, 0), local.slope), all_values),
        D1=over(product_integral(quadrature, table.outboard_moment(s, 1), local.slope), all_values),
        G=over(product_integral(quadrature, np.ones_like(s), local.slope), all_values),
        residual_inertia=residual[[0, 0, 1], [0, 1, 1]],
        residual_tip=left[2 * elements : 2 * elements + 2].copy(),
        basis=basis,
        projector=shapes.projector,
        shear_parameter=shear_parameters(table, quadrature),
        interior=interior,
        table=table,
    )


def rigid_constants(table: BeamTable, elements: int = 1) -> LinkConstants:
    """Compute the constants of a rigid link: m = 0, arrays of shape (0,) and (0, 0)."""
    none, square = np.zeros(0), np.zeros((0, 0))
    with _in_range(table):
        length, mass, first_moment, inertia = _rigid_body(table, beam_quadrature(table.x, 1))
    return LinkConstants(
        length,
        mass,
        first_moment,
        inertia,
        S=none,
        a=none,
        P=none,
        dP=none,
        w2=none,
        rotary=square,
        D0=square,
        D1=square,
        G=square,
        residual_inertia=np.array([mass, first_moment, inertia]),
        residual_tip=np.array([[1.0, length], [0.0, 1.0]]),
        basis=np.zeros((2 * elements, 0)),
        projector=np.zeros((0, 2 * elements)),
        shear_parameter=np.zeros(elements),
        interior=none.reshape(0, 0),
        table=table,
    )


@contextmanager
def _in_range(table: BeamTable) -> Iterator[None]:
    """Raise InputError if numbers overflow or underflow, or matrices are indefinite."""
    try:
        with np.errstate(divide="raise", over="raise", invalid="raise"):
            yield
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        if isinstance(error, np.linalg.LinAlgError) and not _is_extreme(table):
            rule = f"is not positive definite: {error}".rstrip(".")
            hint = "Rigidity or mass may vary by too many orders of magnitude along the link."
            raise InputError(Problem("the stiffness", rule, hint=hint)) from None
        length, mass = table.x[-1], table.mass_per_length.max()
        rule = (
            f"of length {length:.3g} m with at most {mass:.3g} kg/m is beyond the range of "
            "floating-point numbers"
        )
        hint = "Check the units; all values are in SI."
        raise InputError(Problem("the link", rule, hint=hint)) from None


def _is_extreme(table: BeamTable) -> bool:
    """Return whether powers and products of the dimensions may exceed the range of floats."""
    shear = [] if table.shear_rigidity is None else [table.shear_rigidity]
    dimensions = np.concatenate(
        [
            table.x[-1:],
            table.flexural_rigidity,
            table.mass_per_length,
            table.rotary_inertia_per_length,
            *shear,
        ]
    )
    sizes = dimensions[dimensions > 0.0]
    return bool(sizes.min() < 1.0 / _LARGEST or sizes.max() > _LARGEST)


def _rigid_body(table: BeamTable, quadrature: BeamQuadrature) -> tuple[float, float, float, float]:
    """Return length, mass, first moment, inertia about the root: first fields of LinkConstants."""
    s, weights = quadrature.points, quadrature.weights
    mass = weights * np.interp(s, table.x, table.mass_per_length)
    rotary = weights * np.interp(s, table.x, table.rotary_inertia_per_length)
    inertia = float(mass @ s**2 + rotary.sum())
    return table.length, float(mass.sum()), float(mass @ s), inertia


def _left_of_rigid_motion(
    quadrature: BeamQuadrature, translation: FloatArray, rotation: FloatArray
) -> FloatArray:
    """Return the residuals (n + 2 + k, 2) of unit rigid motions, with the root's pair first."""
    # The arguments (n + k,) are the values of their best approximation by the shapes. With the full
    # finite element model the residual decays within a few elements of the root. It is so small
    # that differences of integrals (int mu x^2 - a.a) would lose it.
    nodes = np.arange(quadrature.elements + 1) * quadrature.element_length
    left = np.zeros((2 + translation.size, 2))
    rigid = left[: 2 * nodes.size]
    rigid[0::2, 0] = 1.0
    rigid[0::2, 1] = nodes
    rigid[1::2, 1] = 1.0
    left[2:, 0] -= translation
    left[2:, 1] -= rotation
    return left


# Rounding errors are 1e-13 on meshes of 256 elements; if the matrix is not positive definite, the
# error is far larger than this limit.
_ORTHONORMALITY = 1e-10
# The shapes must diagonalise the stiffness up to the rounding error of the product itself plus this
# relative tolerance. The check detects wrong algebra, not lost digits.
_DIAGONALITY = 1e-7


@dataclass(frozen=True, eq=False)
class BeamBasis:
    """Mass-normalised shapes Phi of one link: nodal coordinates are `basis @ eta`."""

    #: (n, m) with n = 2 * elements: column j contains shape j at the nodes (m and rad per unit of
    #: eta_j, which is in sqrt(kg) m)
    basis: FloatArray
    #: (m, n) `basis^T M`: eta of a nodal deflection; for one outside the span of the shapes, eta of
    #: its mass-orthogonal projection
    projector: FloatArray
    #: (m,) stiffness over the shapes (rad^2/s^2), increasing: squared frequencies of the clamped
    #: link
    w2: FloatArray

    def __post_init__(self) -> None:
        shapes = self.basis.shape[1]
        error = np.abs(self.projector @ self.basis - np.eye(shapes)).max(initial=0.0)
        if not error < _ORTHONORMALITY:
            raise InputError(
                Problem(
                    "projector @ basis",
                    f"be the identity to {_ORTHONORMALITY:g}",
                    f"an error of {error:.2g}",
                    "The mass matrix may not be positive definite.",
                )
            )


def beam_basis(
    matrices: BeamMatrices, strain_to_nodal: FloatArray, element_length: float, modes: int | None
) -> BeamBasis:
    """Compute the shapes of a link.

    The complete set consists of the eigenvectors of stiffness and mass of the clamped link: the
    finite element model itself in other coordinates. The reduced set is that of Craig and Bampton:
    the static shapes of a unit force and a unit moment at the tip, where the rest of the arm acts,
    then the lowest modes with the tip also clamped, all diagonalised again within their span.
    R. R. Craig and M. C. C. Bampton, "Coupling of substructures for dynamic analyses", AIAA Journal
    6(7), 1968, 1313-1319.

    ``strain_to_nodal`` (n, n) is F of that function, whose rotation rows have the unit of
    ``element_length`` h (m). ``modes`` is m, or None for all n: 1 keeps the shape of the tip force,
    2 also that of the tip moment. InputError if the mass matrix is not positive definite.
    """
    # Rotations times the element length keep the mass matrix well conditioned on any mesh.
    units = np.tile([1.0, element_length], len(strain_to_nodal) // 2)
    root_mass = _mass_factor(matrices.mass / np.outer(units, units))
    # With M = G G^T and K^-1 = F F^T the modes are the left singular vectors of G^T F, and the
    # singular values 1/w. No squares are formed, so low frequencies have full precision.
    motion = root_mass.T @ strain_to_nodal
    if modes is not None:
        motion = motion @ _craig_bampton(motion, strain_to_nodal, modes)
    vectors, periods, _ = np.linalg.svd(motion, full_matrices=False)
    basis = linalg.solve_triangular(root_mass, vectors, lower=True, trans="T") / units[:, None]
    # Make the tip deflection positive, or else the largest entry.
    shapes = basis * units[:, None]
    tip, largest = shapes[-2], np.abs(shapes).max(axis=0)
    peak = shapes[np.abs(shapes).argmax(axis=0), np.arange(shapes.shape[1])]
    # Below this limit, rounding errors could determine the sign of the tip deflection.
    basis = basis * np.where(np.where(np.abs(tip) > 1e-6 * largest, tip, peak) < 0.0, -1.0, 1.0)
    beam = BeamBasis(basis=basis, projector=basis.T @ matrices.mass, w2=1.0 / periods**2)
    error = np.abs(beam.basis.T @ matrices.stiffness @ beam.basis - np.diag(beam.w2))
    rounding = np.abs(beam.basis).T @ np.abs(matrices.stiffness) @ np.abs(beam.basis)
    frequency = np.sqrt(beam.w2)
    allowed = _DIAGONALITY * np.outer(frequency, frequency)
    allowed += 10 * len(matrices.stiffness) * np.finfo(float).eps * rounding
    if not np.all(error <= allowed):
        worst = float((error / allowed).max())
        problem = Problem(
            "the stiffness over the shapes",
            "be diagonal",
            f"errors of {worst:.2g} times the tolerance",
            "Flexural rigidity or mass may vary by too many orders of magnitude along the link.",
        )
        raise InputError(problem)
    return beam


def _mass_factor(mass: FloatArray) -> FloatArray:
    """Return the lower triangular G with M = G G^T."""
    try:
        return np.asarray(np.linalg.cholesky(mass), np.float64)
    except np.linalg.LinAlgError:
        lowest = float(np.linalg.eigvalsh(mass)[0])
        problem = Problem(
            "the mass matrix",
            "be positive definite",
            f"one with lowest eigenvalue {lowest:.3g}",
            "Give every element of the link some mass.",
        )
        raise InputError(problem) from None


def _craig_bampton(motion: FloatArray, strain_to_nodal: FloatArray, modes: int) -> FloatArray:
    """Return orthonormal strain coordinates z (n, m) of the reduced shapes."""
    # The strain of a tip force is the transposed tip row of F, and shapes with a clamped tip are
    # orthogonal to it, so that one orthogonal matrix contains both.
    split, _ = np.linalg.qr(strain_to_nodal[-2:].T, mode="complete")
    static, clamped = split[:, : min(modes, 2)], split[:, 2:]
    if modes <= 2:
        return static
    _, _, shapes = np.linalg.svd(motion @ clamped, full_matrices=False)
    return np.hstack([static, clamped @ shapes[: modes - 2].T])


def strain_to_nodal(table: BeamTable, quadrature: BeamQuadrature) -> FloatArray:
    """Compute the matrix F (n, n) that transforms strain coordinates z to nodal coordinates.

    On a fine mesh the stiffness matrix is ill conditioned (as the fourth power of the number of
    elements): with 256 elements the lowest frequency keeps five digits. Because the root is
    clamped, the curvature can be integrated twice from the root instead. These sums lose no digits.

    In element e (length h, xi from 0 to 1) the curvature is `c_0 + c_1 sqrt(3) (2 xi - 1)`, and
    `z_e = sqrt(h) R c` with `R^T R` the integral of EI over the products of the two functions, so
    the strain energy is |z|^2 / 2. Hence `F^T K F = 1` and `F F^T` is the flexibility matrix.
    With shear the angle, quadratic in each element, adds its flexibility; (B.32). These are the
    static shapes, including the interior shapes: the response to loads at nodes. Rows are
    `[v_2, phi_2 h, v_3, phi_3 h, ...]`, so that all have the unit of length. LinAlgError if the
    bending stiffness of an element is not positive.
    """
    h, elements = quadrature.element_length, quadrature.elements
    linear = np.sqrt(3.0) * (2.0 * quadrature.xi - 1.0)
    basis = np.stack([np.ones_like(linear), linear], axis=1)
    stiffness = np.interp(quadrature.points, table.x, table.flexural_rigidity)
    gram = np.zeros((elements, 2, 2))
    np.add.at(
        gram,
        quadrature.element,
        (quadrature.weights * stiffness)[:, None, None] * basis[:, :, None] * basis[:, None, :],
    )
    # z = R c sqrt(h) with gram = h R^T R = lower lower^T, so c = lower^-T z.
    curvature = np.linalg.inv(np.linalg.cholesky(gram)).transpose(0, 2, 1)
    # Increments of (v, phi h) over an element by its curvature: rotation h^2 c_0, deflection
    # h^2 integral of (1 - xi) kappa = h^2 (c_0 / 2 - c_1 sqrt(3) / 6), besides h phi.
    from_curvature = np.zeros((elements, 2, 2))
    from_curvature[:, 0, 0], from_curvature[:, 1, 0] = 0.5, 1.0
    from_curvature[:, 0, 1] = -np.sqrt(3.0) / 6.0
    gains = h**2 * from_curvature @ curvature
    if table.shear_rigidity is not None:
        flexibility = gains @ gains.transpose(0, 2, 1)
        # The mean shear angle under unit shear force, a parabola, rad/(N m), adds to the
        # deflection.
        basis = np.polynomial.legendre.legvander(2.0 * quadrature.xi - 1.0, 2)
        weights = quadrature.weights * np.interp(quadrature.points, table.x, table.shear_rigidity)
        gram = np.zeros((quadrature.elements, 3, 3))
        products = weights[:, None, None] * basis[:, :, None] * basis[:, None, :]
        np.add.at(gram, quadrature.element, products)
        flexibility[:, 0, 0] += h**2 * np.asarray(np.linalg.inv(gram)[:, 0, 0], np.float64)
        gains = np.asarray(np.linalg.cholesky(flexibility), np.float64)
    spread = np.zeros((elements, 2, elements, 2))
    each = np.arange(elements)
    spread[each, :, each, :] = gains
    rotation = np.cumsum(spread[:, 1], axis=0)
    deflection = np.cumsum(spread[:, 0] + rotation - spread[:, 1], axis=0)
    return np.stack([deflection, rotation], axis=1).reshape(2 * elements, 2 * elements)


class PartConstants(NamedTuple):
    """Integrals from the root to each of k stations, over the m shapes of the link; (R.40)."""

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
