"""Constants of links with shear against numerical integrals, and the limit without shear."""

from dataclasses import fields

import numpy as np
import pytest
from random_table import INTEGRATION, L, RandomTable
from scipy.interpolate import PPoly

from beam_links import flexible_link
from flexarm.arm.beams.invariants import shortening_matrices


class Table(RandomTable):
    """A random link, with its deflection and rotation computed from their definition."""

    def __init__(self, seed, elements, modes=None):
        super().__init__(seed, least_rotary=0.01)
        self.shear = self.rng.uniform(5.0, 60.0, 4)
        self.link = flexible_link(
            self.x,
            self.stiffness,
            self.mass,
            self.rotary,
            elements=elements,
            modes=modes,
            shear_rigidity=self.shear,
        )
        nodal = self.link.basis.reshape(elements, 2, -1)
        nodal = np.concatenate([np.zeros((1, *nodal.shape[1:])), nodal])
        nodes = np.linspace(0.0, L, elements + 1)
        inside = self.link.interior.reshape(elements, 3, -1)
        cubics, turns = zip(
            *(self.field(nodes[k : k + 2], nodal[k : k + 2], inside[k]) for k in range(elements)),
            strict=True,
        )
        self.shapes = PPoly(np.stack(cubics, axis=1), nodes)
        self.rotation = PPoly(np.stack(turns, axis=1), nodes)
        self.slopes = self.shapes.derivative()
        self.kinks = np.union1d(nodes, self.x)

    def field(self, ends, nodal, inside):
        """Return cubic v (4, m) and quadratic phi (3, m) of one element, highest power first.

        Of the nodal values: four unknowns of v and one angle from v and v' - angle at both ends,
        and from EI v''' + kGA angle = 0 with the element's mean EI and kGA. The interior values add
        two shapes to v and one to phi.
        """
        h = ends[1] - ends[0]
        dense = np.union1d(ends, self.x[(self.x > ends[0]) & (self.x < ends[1])])
        bending, shear = (
            np.trapezoid(np.interp(dense, self.x, column), dense) / h
            for column in (self.stiffness, self.shear)
        )
        conditions = np.array(
            [
                [0.0, 0.0, 0.0, 1.0, 0.0],
                [0.0, 0.0, 1.0, 0.0, -1.0],
                [h**3, h**2, h, 1.0, 0.0],
                [3 * h**2, 2 * h, 1.0, 0.0, -1.0],
                [6 * bending, 0.0, 0.0, 0.0, shear],
            ]
        )
        wanted = np.vstack([nodal.reshape(4, -1), np.zeros(nodal.shape[-1])])
        solved = np.linalg.solve(conditions, wanted)
        v, turn = solved[:4], np.array([3.0, 2.0, 1.0])[:, None] * solved[:3]
        turn[2] -= solved[4]
        parabola, cubic, turned = inside
        # h xi (1 - xi) and h xi (1 - xi)(1 - 2 xi) in powers of x - x_1
        v += np.stack([0 * parabola, -parabola / h, parabola, 0 * parabola])
        v += np.stack([2 * cubic / h**2, -3 * cubic / h, cubic, 0 * cubic])
        turn += np.stack([-turned / h**2, turned / h, 0 * turned])
        return v, turn


@pytest.fixture(scope="module", params=[(1, 1, None), (2, 3, None), (3, 4, 4)], ids=str)
def table(request):
    return Table(*request.param)


class TestIntegrals:
    def test_momentum(self, table):
        table.assert_momentum(table.rotation)

    def test_tip_rotation_is_that_of_its_section(self, table):
        np.testing.assert_allclose(table.link.P, table.shapes(L), rtol=1e-11)
        scale = np.abs(table.link.dP).max()
        np.testing.assert_allclose(table.link.dP, table.rotation(L), atol=1e-11 * scale)
        assert np.abs(table.link.dP - table.slopes(L)).max() > 1e-3 * scale

    def test_mass_matrix_is_the_unit_matrix(self, table):
        m = table.link.w2.size
        rotary = table.integral(
            lambda x: table.rho_i(x) * np.outer(table.rotation(x), table.rotation(x))
        )
        scale = np.abs(rotary).max()
        np.testing.assert_allclose(table.link.rotary, rotary, atol=INTEGRATION * scale)
        translational = table.integral(
            lambda x: table.mu(x) * np.outer(table.shapes(x), table.shapes(x))
        )
        np.testing.assert_allclose(translational + rotary, np.eye(m), atol=INTEGRATION * m)

    def test_stiffness_is_that_of_bending_and_shear(self, table):
        curvature = table.rotation.derivative()

        def density(x):
            bent, sheared = curvature(x), table.slopes(x) - table.rotation(x)
            return np.interp(x, table.x, table.stiffness) * np.outer(bent, bent) + np.interp(
                x, table.x, table.shear
            ) * np.outer(sheared, sheared)

        found = table.integral(density)
        np.testing.assert_allclose(
            found, np.diag(table.link.w2), atol=INTEGRATION * table.link.w2[-1]
        )

    @pytest.mark.sampled("(1, 1, None)-D0", "(2, 3, None)-G", "(3, 4, 4)-G")
    @pytest.mark.parametrize("name", ["D0", "D1", "G"])
    def test_axial_displacement_follows_from_the_slope_of_the_axis(self, table, name):
        if name == "G":
            exact = table.shortening(L)
        else:
            power = int(name[1])
            exact = table.integral(lambda x: table.mu(x) * x**power * table.shortening(x))
        found = getattr(table.link, name)
        np.testing.assert_allclose(found, exact, atol=INTEGRATION * np.abs(exact).max())

    def test_residual_of_rigid_motions(self, table):
        """1 and x minus their projection on the shapes, with rotations 0 and 1."""
        link = table.link
        followed = np.stack([link.S, link.a], axis=1)

        def motion(x):
            left = np.array([[1.0, x], [0.0, 1.0]])
            left[0] -= table.shapes(x) @ followed
            left[1] -= table.rotation(x) @ followed
            return left

        def density(x):
            moved, turned = motion(x)
            return table.mu(x) * np.outer(moved, moved) + table.rho_i(x) * np.outer(turned, turned)

        inertia = table.integral(density)
        expected = [inertia[0, 0], inertia[0, 1], inertia[1, 1]]
        np.testing.assert_allclose(link.residual_inertia, expected, rtol=1e-7, atol=INTEGRATION)
        np.testing.assert_allclose(link.residual_tip, motion(L), atol=1e-11)


def test_shapes_between_the_nodes(table):
    inside = np.linspace(0.0, L, 14)[:-1] + 0.01  # away from element ends, where slopes jump
    curvature = table.rotation.derivative()(inside)
    close = {"atol": 1e-11 * np.abs(curvature).max()}
    np.testing.assert_allclose(table.link.deflection(inside), table.shapes(inside), **close)
    np.testing.assert_allclose(table.link.slope(inside), table.slopes(inside), **close)
    np.testing.assert_allclose(table.link.rotation(inside), table.rotation(inside), **close)
    np.testing.assert_allclose(table.link.curvature(inside), curvature, **close)


def test_shortening_up_to_a_station(table):
    stations = np.array([0.0, 0.31, 0.9, L])
    exact = np.array([table.shortening(x) if x else 0.0 * table.link.G for x in stations])
    found = shortening_matrices(table.link, stations)
    np.testing.assert_allclose(found, exact, atol=INTEGRATION * np.abs(exact).max())


def test_without_shear_rotation_equals_the_slope():
    two = np.ones(2)
    link = flexible_link([0.0, L], two, two, 0 * two, elements=3)
    x = np.linspace(0.0, L, 7)
    np.testing.assert_array_equal(link.rotation(x), link.slope(x))
    np.testing.assert_array_equal(link.shear_parameter, np.zeros(3))


X = np.array([0.0, 0.4, 0.55, 1.3])
COLUMNS = (np.array([5.0, 4.0, 8.0, 2.0]), np.array([3.0, 1.0, 1.5, 0.2]), np.full(4, 0.02))


@pytest.mark.parametrize("modes", [None, 3])
@pytest.mark.parametrize("elements", [2, 16])
def test_very_stiff_shear_gives_an_euler_bernoulli_beam(elements, modes):
    plain = flexible_link(X, *COLUMNS, elements=elements, modes=modes)
    # Shear parameters of 1e-18 and less vanish beside one.
    stiff = flexible_link(
        X, *COLUMNS, elements=elements, modes=modes, shear_rigidity=np.full(4, 1e24)
    )
    assert 0.0 < stiff.shear_parameter.max() < 1e-17
    for field in fields(plain):
        if field.name not in ("shear_parameter", "interior", "table"):
            exact, found = getattr(plain, field.name), getattr(stiff, field.name)
            # The residual of a unit motion is a difference of numbers of order one.
            scale = 1.0 if field.name == "residual_tip" else np.abs(exact).max()
            np.testing.assert_allclose(found, exact, rtol=0, atol=1e-11 * scale, err_msg=field.name)


def test_difference_to_an_euler_bernoulli_beam_falls_with_the_stiffness():
    plain = flexible_link(X, *COLUMNS, elements=4).w2[:3]
    drops = [
        1 - flexible_link(X, *COLUMNS, elements=4, shear_rigidity=np.full(4, k)).w2[:3] / plain
        for k in (1e6, 1e7)
    ]
    np.testing.assert_allclose(drops[0] / drops[1], 10.0, rtol=1e-2)


def test_rigid_body_constants_do_not_depend_on_shear():
    plain = flexible_link(X, *COLUMNS, elements=4)
    soft = flexible_link(X, *COLUMNS, elements=4, shear_rigidity=[30.0, 5.0, 8.0, 20.0])
    for name in ("length", "mass", "first_moment", "inertia"):
        assert getattr(soft, name) == getattr(plain, name)


@pytest.mark.thorough
@pytest.mark.parametrize("slenderness", [1.0, 3.0, 30.0])
@pytest.mark.parametrize("rotary", [0.0, 1.0])
def test_finest_mesh_of_a_stocky_link_passes_the_internal_checks(slenderness, rotary):
    """Shear parameters up to two million, with and without inertia of the rotations."""
    two = np.ones(2)
    link = flexible_link(
        [0.0, 1.0],
        two,
        two,
        rotary * two / slenderness**2,
        elements=256,
        shear_rigidity=two * slenderness**2 / 3.12,
    )
    assert np.all(np.isfinite(link.w2))
