"""Strain at ten places of a link against closed forms: gauges need not lie at Gauss points."""

import numpy as np
import pytest
from scipy.optimize import brentq

import flexarm as fa

LENGTH, EI, MU, DISTANCE = 1.2, 60.0, 0.7, 0.004
PLACES = np.linspace(0.0, 0.9, 10) * LENGTH
GAUGES = [fa.Gauge(station=x, distance=DISTANCE) for x in PLACES]
PAYLOAD, GRAVITY = 0.3, 1e-3  # so small that the bent axis changes no lever


def link_of(elements, **fields):
    rod = {"flexural_rigidity": EI, "mass_per_length": MU, "length": LENGTH}
    return fa.Link(**{**rod, **fields}, elements=elements, gauges=GAUGES)


def held(link):
    """Return a horizontal arm with a payload under gravity, and its coordinates at rest."""
    arm = fa.Arm(links=[link], payload=fa.Payload(mass=PAYLOAD), gravity=(0.0, -GRAVITY))
    return arm, fa.equilibrium(arm, [0.0]).q


def own_strain(arm, q):
    """Return the strain (gauges,) by the curvature of the elements alone."""
    (piece,) = arm.assembly.pieces
    return -DISTANCE * (piece.shapes.curvature(PLACES) @ q[piece.modal])


def error(strain, exact):
    return np.abs(strain - exact).max() / np.abs(exact).max()


@pytest.mark.parametrize("elements", [2, 3, 8])
@pytest.mark.parametrize("kind", ["uniform", "tapered", "stepped", "sheared"])
def test_static_strain_is_exact_between_gauss_points(kind, elements):
    x = np.linspace(0.0, LENGTH, 13)
    rigidity, mass = np.full(13, EI), np.full(13, MU)
    fields = {}
    if kind == "tapered":
        width = 1.0 - 0.6 * x / LENGTH
        rigidity, mass = EI * width**3, MU * width
    elif kind == "stepped":
        rigidity = np.where(x < 0.55 * LENGTH, EI, 0.3 * EI)
    elif kind == "sheared":
        fields = {"element": "timoshenko", "shear_rigidity": 2000.0, "rotary_inertia": False}
    if kind in ("tapered", "stepped"):
        table = fa.SectionTable(x=x, flexural_rigidity=rigidity, mass_per_length=mass)
        fields = {"table": table, "flexural_rigidity": None, "mass_per_length": None}
    arm, q = held(link_of(elements, **fields))
    fine = np.linspace(PLACES, LENGTH, 4001)
    weight = np.trapezoid(np.interp(fine, x, mass) * (fine - PLACES), fine, axis=0)
    moment = -GRAVITY * (weight + PAYLOAD * (LENGTH - PLACES))
    exact = -DISTANCE * moment / np.interp(PLACES, x, rigidity)
    # The trapezoidal rule of 4000 intervals has an error of 1e-8. The moment of a tapered mass is a
    # polynomial of degree 4 between points of the table, so not quite a cubic one.
    tolerance = 1e-6 if mass[-1] == MU else 1e-3
    assert error(arm.strain(q), exact) < tolerance
    assert error(own_strain(arm, q), exact) > 2e-3 / elements


def beam_mode(tip_mass, number):
    """Return the curvature at PLACES per tip deflection of a clamped beam with a mass at its tip.

    cosh(b) cos(b) + 1 = m b (sin(b) cosh(b) - cos(b) sinh(b)), with m relative to the beam.
    """

    def gap(b):
        left = np.cos(b) + 1.0 / np.cosh(b)
        return left - tip_mass * b * (np.sin(b) - np.cos(b) * np.tanh(b))

    grid = np.linspace(0.5, 12.0, 2000)
    starts = [k for k in range(1999) if gap(grid[k]) * gap(grid[k + 1]) < 0.0]
    b = brentq(gap, *grid[starts[number] : starts[number] + 2], xtol=1e-14)
    ratio = (np.cosh(b) + np.cos(b)) / (np.sinh(b) + np.sin(b))
    s = b * PLACES / LENGTH
    curved = np.cosh(s) + np.cos(s) - ratio * (np.sinh(s) + np.sin(s))
    tip = np.cosh(b) - np.cos(b) - ratio * (np.sinh(b) - np.sin(b))
    return (b / LENGTH) ** 2 * curved / tip


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("payload", [0.0, 0.3])
def test_strain_of_vibrations_converges_with_fourth_order(payload, number):
    exact = -DISTANCE * beam_mode(payload / (MU * LENGTH), number)
    errors, own = [], []
    for elements in (4, 8, 16, 32):
        arm = fa.Arm(links=[link_of(elements)], payload=fa.Payload(mass=payload))
        q = fa.modes(arm, [0.0], joints="locked").shapes[number]
        (piece,) = arm.assembly.pieces
        q = q / (piece.shapes.P @ q[piece.modal])
        errors.append(error(arm.strain(q), exact))
        own.append(error(own_strain(arm, q), exact))
    orders, plain = (np.log2(np.array(each[:-1]) / each[1:]) for each in (errors, own))
    assert orders[-1] > 3.5
    assert abs(plain[-1] - 2.0) < 0.5
    assert errors[0] < (1e-3 if number == 0 else 5e-3)
    assert np.all(np.array(errors) < 0.15 * np.array(own))


def test_a_load_inside_a_link_is_smoothed_over_two_elements():
    """The moment has a kink at the load; the error falls with the mesh, not faster than its length.

    The moment of elements of which the load lies at an end is exact.
    """
    place, errors = 0.5 * LENGTH, []
    for elements in (4, 16):
        arm = fa.Arm(links=[link_of(elements)])
        load = fa.Load(link=1, station=place, force=(0.0, -GRAVITY))
        q = fa.equilibrium(arm, [0.0], loads=[load]).q
        moment = -GRAVITY * np.maximum(place - PLACES, 0.0)
        exact = -DISTANCE * moment / EI
        errors.append(error(arm.strain(q), exact))
        assert error(own_strain(arm, q), exact) < 1e-9
    assert 0.01 < errors[0] < 0.1
    assert errors[1] < errors[0] / 3.0
