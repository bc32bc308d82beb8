"""Integrals from the root to a station: against quadrature, against the whole link, and sums."""

import numpy as np
import pytest

from beam_links import flexible_link, rigid_link
from flexarm.arm.beams.invariants import part_constants, shortening_matrices

LENGTH = 1.3
TABLE = np.array([0.0, 0.31, 0.8, LENGTH])
COLUMNS = {
    "flexural_rigidity": np.array([50.0, 30.0, 25.0, 10.0]),
    "mass_per_length": np.array([1.0, 0.4, 0.5, 0.2]),
    "rotary_inertia_per_length": np.array([0.01, 0.02, 0.005, 0.004]),
}
STATIONS = np.array([0.0, 0.1, LENGTH / 3, 0.8, 1.1, LENGTH])
KINDS = {
    "tapered": {"elements": 3},
    "reduced": {"elements": 4, "modes": 3},
    "shear": {"elements": 3, "shear_rigidity": np.array([400.0, 300.0, 200.0, 100.0])},
}


@pytest.fixture(scope="module", params=KINDS)
def link(request):
    return flexible_link(TABLE, **COLUMNS, **KINDS[request.param])


def fine_points(link, end):
    """Return sixteen Gauss points between neighbours among nodes, breakpoints and the end."""
    nodes = np.linspace(0.0, LENGTH, link.elements + 1)
    cuts = np.unique(np.concatenate([nodes, TABLE, [end]]))
    cuts = cuts[cuts <= end]
    node, weight = np.polynomial.legendre.leggauss(16)
    half = np.diff(cuts)[:, None] / 2
    return (cuts[:-1, None] + half * (1 + node)).ravel(), (half * weight).ravel()


@pytest.mark.parametrize("shortening", [False, True])
def test_integrals_equal_their_definition(link, shortening):
    parts = part_constants(link, STATIONS, shortening=shortening)
    for k, end in enumerate(STATIONS):
        s, w = fine_points(link, end)
        mu = w * np.interp(s, TABLE, COLUMNS["mass_per_length"])
        rho = w * np.interp(s, TABLE, COLUMNS["rotary_inertia_per_length"])
        phi, psi, g = link.deflection(s), link.rotation(s), shortening_matrices(link, s)
        spread = np.einsum("p,pi,pj->ij", mu, phi, phi)
        D0, D1 = 0.0 * spread, 0.0 * spread
        if shortening:
            D1 = np.einsum("p,pij->ij", mu * s, g)
            D0 = np.einsum("p,pij->ij", mu, g)
        exact = {
            "mass": mu.sum(),
            "first_moment": mu @ s,
            "inertia": mu @ s**2 + rho.sum(),
            "S": mu @ phi,
            "a": (mu * s) @ phi + rho @ psi,
            "D0": D0,
            "D1": D1,
            "spread": spread,
        }
        for name, value in exact.items():
            # Rounding of sums over at most a hundred points of numbers up to ten.
            np.testing.assert_allclose(
                getattr(parts, name)[k], value, rtol=0, atol=1e-13, err_msg=name
            )


def test_part_up_to_the_tip_equals_the_link(link):
    parts = part_constants(link, np.array([LENGTH]), shortening=True)
    for name in ("mass", "first_moment", "inertia", "S", "a", "D0", "D1"):
        np.testing.assert_allclose(getattr(parts, name)[0], getattr(link, name), atol=1e-13)
    spread = np.eye(link.w2.size) - link.rotary
    np.testing.assert_allclose(parts.spread[0], spread, atol=1e-12)


def test_part_up_to_the_root_is_zero(link):
    parts = part_constants(link, np.array([0.0]), shortening=True)
    for name in ("mass", "first_moment", "inertia", "S", "a", "D0", "D1", "spread"):
        np.testing.assert_array_equal(getattr(parts, name), 0.0)


def test_rigid_link_has_the_same_mass_and_no_shapes():
    link = rigid_link(TABLE, COLUMNS["mass_per_length"], COLUMNS["rotary_inertia_per_length"])
    parts = part_constants(link, STATIONS, shortening=True)
    assert parts.S.shape == (6, 0)
    assert parts.spread.shape == (6, 0, 0)
    assert parts.mass[-1] == pytest.approx(link.mass, rel=1e-14)
    assert parts.inertia[-1] == pytest.approx(link.inertia, rel=1e-14)
    assert np.all(np.diff(parts.mass) > 0.0)


def test_stations_in_any_order_with_duplicates():
    link = flexible_link(TABLE, **COLUMNS, elements=3)
    mixed = np.array([1.1, 0.1, 1.1, 0.0])
    parts = part_constants(link, mixed, shortening=True)
    for k, end in enumerate(mixed):
        alone = part_constants(link, np.array([end]), shortening=True)
        np.testing.assert_allclose(parts.spread[k], alone.spread[0], atol=1e-14)
        np.testing.assert_allclose(parts.S[k], alone.S[0], atol=1e-14)
