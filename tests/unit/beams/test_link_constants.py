"""Constants of one link against numerical integrals of their shapes."""

import numpy as np
import pytest
from random_table import INTEGRATION, RandomTable
from scipy.integrate import quad
from scipy.interpolate import CubicHermiteSpline

from beam_links import flexible_link, rigid_link


class Table(RandomTable):
    """A random link and its integrals, one by one with adaptive quadrature."""

    def __init__(self, seed, elements, modes=None):
        super().__init__(seed, least_rotary=0.0)
        self.link = flexible_link(
            self.x, self.stiffness, self.mass, self.rotary, elements=elements, modes=modes
        )
        nodes = np.linspace(0.0, 1.3, elements + 1)
        nodal = self.link.basis.reshape(elements, 2, -1)
        nodal = np.concatenate([np.zeros((1, *nodal.shape[1:])), nodal])
        self.shapes = CubicHermiteSpline(nodes, nodal[:, 0], nodal[:, 1])
        self.slopes = self.shapes.derivative()
        self.kinks = np.union1d(nodes, self.x)


@pytest.fixture(scope="module", params=[(1, 1, None), (2, 3, None), (3, 4, 4)], ids=str)
def table(request):
    return Table(*request.param)


class TestIntegrals:
    def test_rigid_body(self, table):
        link = table.link
        kinks = table.x[1:-1]
        mass, first, second = (
            quad(lambda x, p=p: table.mu(x) * x**p, 0, 1.3, points=kinks)[0] for p in range(3)
        )
        rotary = quad(table.rho_i, 0, 1.3, points=kinks)[0]
        found = (link.length, link.mass, link.first_moment, link.inertia)
        np.testing.assert_allclose(found, (1.3, mass, first, second + rotary), rtol=INTEGRATION)

    def test_momentum(self, table):
        table.assert_momentum(table.slopes)

    def test_tip(self, table):
        np.testing.assert_allclose(table.link.P, table.shapes(1.3), rtol=1e-14)
        np.testing.assert_allclose(table.link.dP, table.slopes(1.3), rtol=1e-11)

    def test_rotary_inertia_is_part_of_a_unit_mass_matrix(self, table):
        m = table.link.w2.size
        rotary = table.integral(lambda x: table.rho_i(x) * table.square(x))
        scale = np.abs(rotary).max()
        np.testing.assert_allclose(table.link.rotary, rotary, atol=INTEGRATION * scale)
        translational = table.integral(
            lambda x: table.mu(x) * np.outer(table.shapes(x), table.shapes(x))
        )
        np.testing.assert_allclose(translational + rotary, np.eye(m), atol=INTEGRATION * m)

    def test_stiffness(self, table):
        curvature = table.slopes.derivative()
        found = table.integral(
            lambda x: np.interp(x, table.x, table.stiffness) * np.outer(curvature(x), curvature(x))
        )
        np.testing.assert_allclose(
            found, np.diag(table.link.w2), atol=INTEGRATION * table.link.w2[-1]
        )

    @pytest.mark.sampled("(1, 1, None)-D0", "(3, 4, 4)-G", "(2, 3, None)-G", "(1, 1, None)-G")
    @pytest.mark.parametrize("name", ["D0", "D1", "G"])
    def test_foreshortening(self, table, name):
        if name == "G":
            exact = table.shortening(1.3)
        else:
            power = int(name[1])
            exact = table.integral(lambda x: table.mu(x) * x**power * table.shortening(x))
        found = getattr(table.link, name)
        np.testing.assert_allclose(found, exact, atol=INTEGRATION * np.abs(exact).max())
        assert np.array_equal(found, found.T)
        assert np.all(np.linalg.eigvalsh(found) > 0.0)  # positive: the link never lengthens


def test_shapes_between_the_nodes_are_cubic_hermite_splines(table):
    x = np.concatenate([np.linspace(0.0, 1.3, 14), [1.3]])
    scale = np.abs(table.slopes.derivative()(x)).max()
    np.testing.assert_allclose(table.link.deflection(x), table.shapes(x), atol=1e-12 * scale)
    np.testing.assert_allclose(table.link.slope(x), table.slopes(x), atol=1e-12 * scale)
    inside = x[:-2] + 0.01  # off the element ends, where the curvature jumps
    curvature = table.slopes.derivative()(inside)
    np.testing.assert_allclose(table.link.curvature(inside), curvature, atol=1e-12 * scale)


def test_curvature_at_the_root_follows_from_the_root_moment():
    """EI v''(0) = P L under a tip force."""
    link = flexible_link([0.0, 2.0], [3.0, 3.0], [1.0, 1.0], [0.0, 0.0], elements=3)
    bent = link.P / link.w2
    assert 3.0 * (link.curvature([0.0]) @ bent)[0] == pytest.approx(2.0, rel=1e-11)
    np.testing.assert_allclose(link.deflection([0.0]), 0.0, atol=1e-15)
    np.testing.assert_allclose(link.slope([0.0]), 0.0, atol=1e-15)


class TestRigidLink:
    def test_rigid_link_has_the_same_mass_and_no_shapes(self):
        table = Table(5, 2)
        rigid = rigid_link(table.x, table.mass, table.rotary, elements=3)
        link = table.link
        for name in ("length", "mass", "first_moment", "inertia"):
            assert getattr(rigid, name) == pytest.approx(getattr(link, name), rel=1e-14)
        assert all(getattr(rigid, name).shape == (0,) for name in ("S", "a", "P", "dP", "w2"))
        assert all(getattr(rigid, name).shape == (0, 0) for name in ("rotary", "D0", "D1", "G"))

    def test_zero_coordinates_are_a_straight_link(self):
        rigid = rigid_link([0.0, 1.0], [1.0, 1.0], [0.0, 0.0], elements=3)
        assert np.array_equal(rigid.basis @ np.zeros(0), np.zeros(6))
        assert rigid.projector.shape == (0, 6)
        assert rigid.deflection([0.0, 0.5]).shape == (2, 0)


def test_arrays_are_read_only():
    link = flexible_link([0.0, 1.0], [1.0, 1.0], [1.0, 1.0], [0.0, 0.0], elements=1)
    with pytest.raises(ValueError, match="read-only"):
        link.D0[0, 0] = 0.0
    with pytest.raises(ValueError, match="read-only"):
        link.basis[0, 0] = 0.0


def test_rigid_link_may_be_massless():
    link = rigid_link([0.0, 2.0], [0.0, 0.0], [0.0, 0.0])
    assert (link.length, link.mass, link.first_moment, link.inertia) == (2.0, 0.0, 0.0, 0.0)
