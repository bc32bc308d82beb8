"""Impulses of shapers against published amplitudes and insensitivities, and closed forms."""

import numpy as np
import pytest
from scipy.optimize import brentq

import flexarm as fa
from flexarm.motion.shaping import impulses, residual, specified_insensitivity

V = 0.05
#: Width of the range with less than 5 % residual for the order n of a Chebyshev polynomial. ZVn
#: leaves |cos(pi r / 2)|^n; a shaper with n - 1 humps leaves V |T_n(cos(pi r / 2) / c)|.
CLOSED = {
    "zv": 4.0 / np.pi * np.arcsin(V),
    "zvd": 4.0 / np.pi * np.arcsin(V ** (1 / 2)),
    "zvdd": 4.0 / np.pi * np.arcsin(V ** (1 / 3)),
}


def humps(order):
    """Return the width of the range in which a shaper with ``order - 1`` humps leaves at most V."""
    return 4.0 / np.pi * np.arcsin(1.0 / np.cosh(np.arccosh(1.0 / V) / order))


def width(method, **options):
    """Return the width of the range with less than 5 % residual around the design frequency."""

    def excess(r):
        return fa.shaper_sensitivity(r, method, **options)[0] - V * (1.0 + 1e-9)

    # All ranges here are narrower than 0.9, and the residual exceeds 5 % within another 0.3.
    edges = []
    for sign in (-1.0, 1.0):
        ratios = 1.0 + sign * np.arange(0.02, 0.6, 0.005)
        beyond = next(r for r in ratios if excess(r) > 0.0)
        edges.append(brentq(excess, beyond - sign * 0.005, beyond, xtol=1e-12))
    return edges[1] - edges[0]


@pytest.mark.parametrize(("method", "printed"), [("zv", 0.06), ("zvd", 0.29), ("ei", 0.40)])
def test_insensitivity_is_the_published_one(method, printed):
    """Singhose, Seering and Singer (1994): widths of 5 %, printed with two digits."""
    assert width(method) == pytest.approx(printed, abs=0.005)


@pytest.mark.parametrize(("method", "wanted"), [*CLOSED.items(), ("ei", humps(2))])
def test_insensitivity_is_the_closed_form(method, wanted):
    # A root found to 1e-12, of a residual whose slope is 0.1 or more, after a factor 1 + 1e-9.
    assert width(method) == pytest.approx(wanted, abs=2e-9)


def test_specified_insensitivity_of_ei_is_ei():
    """EI is the shortest shaper for its range (Singhose, Seering and Singer 1996)."""
    made = specified_insensitivity(0.0, V, humps(2))
    # A grid of 161 frequencies misses the edges of the range by rounding only; the middle is on it.
    np.testing.assert_allclose(made.amplitudes, [(1 + V) / 4, (1 - V) / 2, (1 + V) / 4], atol=1e-5)
    np.testing.assert_allclose(made.phases, [0.0, np.pi, 2.0 * np.pi], atol=1e-4)


def test_specified_insensitivity_of_two_humps_is_the_published_shaper():
    """Two-hump EI: Singhose, Porter, Tuttle and Singer, J. Dyn. Sys. Meas. Control 119 (1997)."""
    X = np.cbrt(V**2 * (np.sqrt(1 - V**2) + 1))
    first = (3 * X**2 + 2 * X + 3 * V**2) / (16 * X)
    made = specified_insensitivity(0.0, V, humps(3))
    # The two humps lie between frequencies of the grid, so the residual is 1e-4 of V higher there.
    wanted = [first, 0.5 - first, 0.5 - first, first]
    np.testing.assert_allclose(made.amplitudes, wanted, atol=1e-4)
    np.testing.assert_allclose(made.phases, np.pi * np.arange(4), atol=1e-3)


@pytest.mark.sampled("1.0-0.2", "0.05-0.2")
@pytest.mark.parametrize("ratio", [0.0, 0.05, 0.2])
@pytest.mark.parametrize("insensitivity", [0.05, 0.3, 0.6, 1.0])
def test_specified_insensitivity_touches_its_limit_at_the_edges(ratio, insensitivity):
    made = specified_insensitivity(ratio, V, insensitivity)
    ratios = np.linspace(1.0 - 0.5 * insensitivity, 1.0 + 0.5 * insensitivity, 2001)
    left = residual(made, ratio, ratios)
    assert left.max() < V * (1.0 + 5e-4)  # between the frequencies of the grid
    assert max(left[0], left[-1]) == pytest.approx(V, rel=1e-3)
    assert np.all(made.amplitudes > 0.0)
    assert made.amplitudes.sum() == pytest.approx(1.0, abs=1e-14)
    assert made.phases[0] == 0.0
    assert np.all(np.diff(made.phases) >= 0.0)


@pytest.mark.thorough
def test_shorter_than_any_published_shaper_for_its_range():
    """A wider range takes longer, and less than the next shaper with equal distances."""
    ranges = (0.1, humps(2), 0.5, 0.6, humps(3))
    lengths = [specified_insensitivity(0.0, V, each).phases[-1] / np.pi for each in ranges]
    assert np.all(np.diff(lengths) > 0.0)
    assert lengths[0] < 2.0  # ZVD and EI take two half periods
    assert lengths[2] < lengths[3] < 3.0


def test_damped_residual_is_that_of_an_oscillator():
    """(C.3) from a sum of free vibrations, each from its impulse to the last one."""
    ratio = 0.15
    made = impulses("zvd", ratio, V, 0.5)
    for detuned in (0.8, 1.0, 1.3):
        pole = detuned * (-ratio + 1j * np.sqrt(1 - ratio**2))
        times = made.phases / np.sqrt(1 - ratio**2)
        wanted = abs(np.sum(made.amplitudes * np.exp(pole * (times[-1] - times))))
        found = residual(made, ratio, np.array([detuned]))[0]
        assert found == pytest.approx(wanted, rel=1e-12)
