"""Points along a link: exact for polynomial integrands, and in the correct element."""

import numpy as np
import pytest
from scipy.interpolate import PPoly

from flexarm.arm.beams.assembly import BeamTable, beam_quadrature

BREAKPOINTS = np.array([0.0, 0.31, 0.5, 1.37, 2.0])


@pytest.mark.parametrize("elements", [1, 3, 4, 7])
@pytest.mark.parametrize("breakpoints", [BREAKPOINTS, BREAKPOINTS[[0, -1]]])
def test_degree_seven_with_kinks_at_breakpoints_and_element_ends_is_exact(elements, breakpoints):
    rng = np.random.default_rng(elements)
    edges = np.union1d(np.linspace(0.0, 2.0, elements + 1), breakpoints)
    piecewise = PPoly(rng.uniform(0.5, 1.5, (8, edges.size - 1)), edges)
    quadrature = beam_quadrature(breakpoints, elements)
    found = quadrature.weights @ piecewise(quadrature.points)
    assert found == pytest.approx(float(piecewise.integrate(0.0, 2.0)), rel=1e-13)  # rounding


def test_points_are_in_their_element():
    quadrature = beam_quadrature(BREAKPOINTS, 3)
    assert np.all(np.diff(quadrature.points) > 0.0)
    assert np.all((quadrature.xi > 0.0) & (quadrature.xi < 1.0))
    position = (quadrature.element + quadrature.xi) * quadrature.element_length
    np.testing.assert_allclose(position, quadrature.points, rtol=1e-14)


def test_breakpoint_within_rounding_of_an_element_end():
    third = 2.0 / 3.0
    beside = np.array([0.0, np.nextafter(third, 0.0), np.nextafter(2 * third, 2.0), 2.0])
    quadrature = beam_quadrature(beside, 3)
    assert quadrature.weights @ quadrature.points**7 == pytest.approx(2.0**8 / 8, rel=1e-13)
    assert set(quadrature.element.tolist()) == {0, 1, 2}
    assert np.all(np.abs(quadrature.xi - 0.5) < 0.5 + 1e-12)


@pytest.mark.parametrize("power", [0, 1])
def test_outboard_moments_are_the_integrals_of_the_table(power):
    mass = np.array([3.0, 1.0, 1.5, 0.2, 0.9])
    table = BeamTable(BREAKPOINTS, np.ones(5), mass, np.zeros(5))
    s = np.concatenate([BREAKPOINTS, np.linspace(0.0, 2.0, 17)])
    slope = np.diff(mass) / np.diff(BREAKPOINTS)
    linear = PPoly(np.stack([slope, mass[:-1]]), BREAKPOINTS)
    found = table.outboard_moment(s, power)
    for station, value in zip(s, found, strict=True):
        # Gauss-Legendre of high order on every interval of the table, divided at the station.
        node, weight = np.polynomial.legendre.leggauss(8)
        edges = np.unique(np.append(BREAKPOINTS[station < BREAKPOINTS], station))
        centre, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
        x = centre[:, None] + half[:, None] * node
        exact = np.sum(half[:, None] * weight * linear(x) * x**power)
        assert value == pytest.approx(exact, rel=1e-13, abs=1e-15)
