"""Shapes of a link: orthonormal, diagonal, with a sign; and properties of reduced sets."""

import numpy as np
import pytest
from scipy.linalg import eigh

from beam_links import flexible_link
from flexarm.arm.beams.assembly import BeamTable, beam_matrices, beam_quadrature
from flexarm.arm.beams.invariants import beam_basis, strain_to_nodal
from flexarm.base.errors import InputError

X = np.array([0.0, 0.4, 0.55, 1.3, 2.0])
STIFFNESS = np.array([5.0, 4.0, 8.0, 2.0, 1.0])
MASS = np.array([3.0, 1.0, 1.5, 0.2, 0.9])
ROTARY = np.array([0.03, 0.0, 0.01, 0.02, 0.005])
ELEMENTS = 6


def ragged(modes=None, elements=ELEMENTS):
    return flexible_link(X, STIFFNESS, MASS, ROTARY, elements=elements, modes=modes)


def uniform(elements, modes=None):
    one, zero = np.ones(2), np.zeros(2)
    return flexible_link([0.0, 1.0], one, one, zero, elements=elements, modes=modes)


@pytest.fixture(scope="module")
def matrices():
    table = BeamTable(X, STIFFNESS, MASS, ROTARY)
    return beam_matrices(table, beam_quadrature(table.x, ELEMENTS))


@pytest.mark.parametrize("modes", [None, 1, 2, 3, 5, 12])
def test_shapes_diagonalise_mass_and_stiffness(matrices, modes):
    link = ragged(modes)
    mass = link.basis.T @ matrices.mass @ link.basis
    stiffness = link.basis.T @ matrices.stiffness @ link.basis
    frequency = np.sqrt(link.w2)
    np.testing.assert_allclose(mass, np.eye(link.w2.size), atol=1e-12)
    # Relative to w_i w_j; rounding grows with the ratio of the frequencies, here 2e3.
    scaled = stiffness / np.outer(frequency, frequency)
    np.testing.assert_allclose(scaled, np.eye(link.w2.size), atol=1e-9)
    assert np.all(np.diff(link.w2) > 0.0)


def test_full_basis_is_the_finite_element_model(matrices):
    link = ragged()
    np.testing.assert_allclose(link.w2, eigh(matrices.stiffness, matrices.mass)[0], rtol=1e-8)
    np.testing.assert_allclose(link.projector @ link.basis, np.eye(12), atol=1e-12)
    # The shapes of the stiffest modes are small at the nodes, so their inverse is large.
    np.testing.assert_allclose(link.basis @ link.projector, np.eye(12), atol=1e-10)


@pytest.mark.thorough
def test_lowest_frequencies_are_accurate_on_the_finest_mesh():
    """Directly from K and M the lowest frequency of 256 elements is accurate to 1e-6 only."""
    link = uniform(256)
    beta = np.array([1.875104068712, 4.6940911329742, 7.8547574382376])
    mesh_error = (beta / 256) ** 4 / 1440
    np.testing.assert_allclose(np.sqrt(link.w2[:3]) / beta**2 - 1, mesh_error, atol=2e-12)


@pytest.mark.parametrize("modes", [None, 4])
def test_tips_have_positive_deflection(modes):
    assert np.all(ragged(modes).P > 0.0)


def test_sign_follows_the_largest_entry_if_the_tip_hardly_moves():
    """A tip a million times heavier than the link is at rest in all modes except the lowest."""
    x = np.array([0.0, 0.999, 0.9991, 1.0])
    mass = np.array([1.0, 1.0, 1e10, 1e10])
    one = np.ones(4)
    link = flexible_link(x, one, mass, 1e-3 * mass, elements=4)
    signs = link.P > 0.0
    units = np.tile([1.0, 0.25], 4)[:, None]
    scaled = link.basis * units
    still = np.abs(link.P) <= 1e-6 * np.abs(scaled).max(axis=0)
    assert 0 < still.sum() < 8
    assert np.all(signs[~still])
    peaks = scaled[np.abs(scaled).argmax(axis=0), np.arange(8)]
    assert np.all(peaks[still] > 0.0)


class TestReducedBasis:
    def test_one_shape_is_the_tip_force_deflection(self):
        """Rayleigh's quotient of 3 x^2 - x^3: 3 EI/L^3 over 33/140 of the mass."""
        link = uniform(5, 1)
        assert link.w2[0] == pytest.approx(3 * 140 / 33, rel=1e-12)

    def test_two_shapes_equal_one_element(self):
        """The two static shapes of a uniform link are cubics: the space of a single element."""
        reduced, single = uniform(7, 2), uniform(1)
        np.testing.assert_allclose(reduced.w2, single.w2, rtol=1e-11)
        x = np.linspace(0.0, 1.0, 9)
        np.testing.assert_allclose(reduced.deflection(x), single.deflection(x), atol=1e-10)

    @pytest.mark.parametrize("modes", [1, 2, 3, 5, 8, 11])
    def test_frequencies_are_never_below_the_full_model(self, modes):
        full, reduced = ragged().w2, ragged(modes).w2
        assert np.all(reduced >= full[:modes] * (1 - 1e-11))  # equal up to rounding
        more = ragged(modes + 1).w2
        assert np.all(reduced >= more[:modes] * (1 - 1e-11))

    def test_all_modes_equal_the_full_model(self):
        np.testing.assert_allclose(ragged(12).w2, ragged().w2, rtol=1e-9)

    @pytest.mark.parametrize("modes", [3, 5])
    def test_span_contains_static_shapes_and_clamped_clamped_modes(self, matrices, modes):
        link = ragged(modes)
        inner = slice(None, -2)
        _, clamped = eigh(matrices.stiffness[inner, inner], matrices.mass[inner, inner])
        fixed_tip = np.vstack([clamped[:, : modes - 2], np.zeros((2, modes - 2))])
        static = np.linalg.solve(matrices.stiffness, np.eye(12)[:, -2:])
        wanted = np.hstack([static, fixed_tip])
        kept = link.basis @ (link.projector @ wanted)
        np.testing.assert_allclose(kept, wanted, atol=1e-10 * np.abs(wanted).max())

    def test_omitted_modes_are_outside_the_span(self, matrices):
        link = ragged(3)
        inner = slice(None, -2)
        _, clamped = eigh(matrices.stiffness[inner, inner], matrices.mass[inner, inner])
        second = np.append(clamped[:, 1], [0.0, 0.0])
        kept = link.projector @ second
        assert kept @ kept < 0.9  # of the unit modal mass that it would have inside the span

    def test_loaded_tip_converges_faster_than_with_clamped_free_modes(self):
        """The static shapes serve links with another link at their tip."""
        full = uniform(16)

        def loaded(w2, tip):
            return np.sqrt(eigh(np.diag(w2), np.eye(w2.size) + 2.0 * np.outer(tip, tip))[0])

        exact = loaded(full.w2, full.P)[:3]
        reduced = uniform(16, 5)
        error = loaded(reduced.w2, reduced.P)[:3] / exact - 1
        truncated = loaded(full.w2[:5], full.P[:5])[:3] / exact - 1
        assert np.all(error < 0.1 * truncated)
        assert np.all(error > -1e-12)  # Rayleigh's principle, up to rounding


def test_projection_of_a_shape_outside_the_span_is_the_nearest_one(matrices):
    link = ragged(4)
    nodal = np.random.default_rng(1).normal(size=12)
    left_over = nodal - link.basis @ (link.projector @ nodal)
    np.testing.assert_allclose(link.basis.T @ matrices.mass @ left_over, 0.0, atol=1e-11)


def test_stiffness_that_disagrees_with_the_shapes_is_rejected(matrices):
    """Shapes of a slightly stiffer tip against the stiffness matrix of the link itself."""
    table = BeamTable(X, STIFFNESS + np.array([0, 0, 0, 0, 1e-3]), MASS, ROTARY)
    factor = strain_to_nodal(table, beam_quadrature(table.x, ELEMENTS))
    with pytest.raises(InputError, match="the stiffness over the shapes must be diagonal"):
        beam_basis(matrices, factor, 2.0 / ELEMENTS, None)


@pytest.mark.parametrize("seed", range(6))
def test_extreme_tables_pass_the_internal_checks(seed):
    """Properties that vary over twelve orders of magnitude must not cause a false error."""
    rng = np.random.default_rng(seed)
    x = np.concatenate([[0.0], np.sort(rng.uniform(0.0, 2.0, 9)), [2.0]])
    stiffness, mass = 10.0 ** rng.uniform(-6, 6, (2, 11))
    elements = [1, 3, 10, 24, 40, 64][seed]
    link = flexible_link(x, stiffness, mass, 0.1 * mass, elements=elements)
    assert link.w2.size == 2 * elements
