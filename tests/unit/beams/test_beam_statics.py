"""Deflections under static loads: exact at the nodes of any mesh."""

import numpy as np
import pytest

from beam_links import flexible_link
from flexarm.arm.beams.assembly import BeamTable, beam_matrices, beam_quadrature, nodal_shapes
from flexarm.arm.beams.invariants import strain_to_nodal

L, EI, MU = 1.4, 105.0, 0.6
# Handbook values, to the rounding of sums over at most 64 coordinates.
EXACT = 1e-12


def uniform(elements, modes=None):
    return flexible_link([0.0, L], [EI, EI], [MU, MU], [0.0, 0.0], elements=elements, modes=modes)


@pytest.mark.parametrize("elements", [1, 2, 5, 32])
class TestUniformCantilever:
    def test_tip_force_and_moment(self, elements):
        link = uniform(elements)
        force, moment = link.P / link.w2, link.dP / link.w2
        assert link.P @ force == pytest.approx(L**3 / (3 * EI), rel=EXACT)
        assert link.dP @ force == pytest.approx(L**2 / (2 * EI), rel=EXACT)
        assert link.P @ moment == pytest.approx(L**2 / (2 * EI), rel=EXACT)
        assert link.dP @ moment == pytest.approx(L / EI, rel=EXACT)

    def test_uniform_load(self, elements):
        link = uniform(elements)
        bent = link.S / MU / link.w2
        assert link.P @ bent == pytest.approx(L**4 / (8 * EI), rel=EXACT)
        assert link.dP @ bent == pytest.approx(L**3 / (6 * EI), rel=EXACT)

    def test_uniform_load_is_exact_at_every_node(self, elements):
        link = uniform(elements)
        x = np.linspace(0.0, L, elements + 1)[1:]
        nodal = (link.basis @ (link.S / MU / link.w2)).reshape(elements, 2)
        deflection = x**2 * (6 * L**2 - 4 * L * x + x**2) / (24 * EI)
        slope = x * (3 * L**2 - 3 * L * x + x**2) / (6 * EI)
        np.testing.assert_allclose(nodal, np.stack([deflection, slope], axis=1), rtol=1e-11)

    def test_linearly_growing_load(self, elements):
        """A root with growing rate loads the link like a triangle: w = -mu x."""
        link = uniform(elements)
        bent = link.a / MU / link.w2
        assert link.P @ bent == pytest.approx(11 * L**5 / (120 * EI), rel=EXACT)
        assert link.dP @ bent == pytest.approx(L**4 / (8 * EI), rel=EXACT)

    def test_curvature_of_a_uniform_load_is_exact_at_the_gauss_points(self, elements):
        """Elsewhere in an element it lacks a parabola (Barlow, 1976)."""
        link, h = uniform(elements), L / elements
        gauss = 0.5 * h * (1.0 + np.array([-1.0, 1.0]) / np.sqrt(3.0))
        inside = np.concatenate([gauss, h * np.array([0.1, 0.3, 0.5])])
        x = np.add.outer(np.arange(elements) * h, inside)
        nodal = link.basis @ (link.S / MU / link.w2)
        found = (nodal_shapes(x.ravel(), L, elements, 2) @ nodal).reshape(x.shape)
        lacking = (h**2 - 6.0 * h * inside + 6.0 * inside**2) / (12.0 * EI)
        exact = (L - x) ** 2 / (2.0 * EI)
        # Rounding of nodal values divided by h^2.
        np.testing.assert_allclose(found[:, :2], exact[:, :2], rtol=0.0, atol=1e-9 * L**2 / EI)
        np.testing.assert_allclose(found + lacking, exact, rtol=0.0, atol=1e-9 * L**2 / EI)


@pytest.mark.parametrize("modes", [2, 3, 6])
def test_reduced_shapes_carry_tip_loads_exactly(modes):
    link = uniform(8, modes)
    assert link.P @ (link.P / link.w2) == pytest.approx(L**3 / (3 * EI), rel=EXACT)
    assert link.dP @ (link.P / link.w2) == pytest.approx(L**2 / (2 * EI), rel=EXACT)
    assert link.dP @ (link.dP / link.w2) == pytest.approx(L / EI, rel=EXACT)


def test_one_shape_represents_the_tip_force_alone():
    link = uniform(8, 1)
    assert link.P @ (link.P / link.w2) == pytest.approx(L**3 / (3 * EI), rel=EXACT)
    assert link.dP @ (link.dP / link.w2) < 0.8 * L / EI  # a moment needs the second shape


@pytest.mark.parametrize("kink", [False, True])
def test_tapered_tip_compliance_converges_with_fourth_order(kink):
    """Against Castigliano's integral of M(x)^2/EI(x), in closed form per segment.

    Fourth order needs element ends at the kinks of the table.
    """
    x = np.array([0.0, 0.5, 1.0]) if kink else np.array([0.0, 1.0])
    stiffness = np.array([3.0, 2.0, 0.5]) if kink else np.array([3.0, 0.5])
    node, weight = np.polynomial.legendre.leggauss(40)
    centre, half = (x[1:] + x[:-1]) / 2, np.diff(x) / 2
    s = centre[:, None] + half[:, None] * node
    bending = half[:, None] * weight / np.interp(s, x, stiffness)
    exact = np.array([np.sum(bending * (1 - s) ** p) for p in (2, 1, 0)])
    errors = []
    for elements in (32, 64):
        link = flexible_link(x, stiffness, np.ones_like(x), 0 * x, elements=elements)
        found = [link.P @ (link.P / link.w2), link.P @ (link.dP / link.w2)]
        errors.append(np.abs(np.array([*found, link.dP @ (link.dP / link.w2)]) - exact) / exact)
    # Strong tapers approach the order slowly: the lowest value here is 3.976.
    np.testing.assert_allclose(np.log2(errors[0] / errors[1]), 4.0, atol=0.05)
    assert np.max(errors[1]) < 1e-7


def test_strain_coordinates_store_unit_energy():
    rng = np.random.default_rng(7)
    x = np.array([0.0, 0.4, 0.55, 1.3, 2.0])
    table = BeamTable(x, rng.uniform(1, 9, 5), rng.uniform(1, 2, 5), np.zeros(5))
    quadrature = beam_quadrature(table.x, 6)
    units = np.tile([1.0, 2.0 / 6], 6)
    stiffness = beam_matrices(table, quadrature).stiffness / np.outer(units, units)
    factor = strain_to_nodal(table, quadrature)
    # Condition number 1e5 of the stiffness matrix times rounding.
    np.testing.assert_allclose(factor.T @ stiffness @ factor, np.eye(12), atol=1e-10)
