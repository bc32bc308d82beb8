"""From a motor's torque to points of its link: zeros against closed forms.

To its own encoder, poles are the hub's frequencies and zeros the clamped ones. They interlace, as
between any force and the displacement on which it does work. Points further out have zeros on the
real axis.
"""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import flexarm as fa
from flexarm.motion.dynamics.dynamics_along import TipConstraint
from flexarm.simulation.inversion.torques import rest_end

DATA = Path(__file__).parents[1] / "data"
BEAM = json.loads((DATA / "beam_reference.json").read_text(encoding="utf-8"))
CLAMPED = np.square(BEAM["clamped"][0]["beta_L"])
HUBS = [case for case in BEAM["pinned"] if case["hub"] > 0.0 and case["tip_mass"] == 0.0]


def lowest(values, count):
    """Return frequencies on the imaginary axis, each once, ascending, without rigid-body poles."""
    assert np.abs(values.real).max() < 1e-4 * np.abs(values).max()
    return np.sort(values.imag[values.imag > 1e-2])[:count]


@pytest.mark.parametrize("case", HUBS, ids=lambda case: f"hub={case['hub']}")
def test_zeros_from_torque_to_encoder(case):
    link = fa.Link(length=1.0, flexural_rigidity=1.0, mass_per_length=1.0, elements=12)
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=case["hub"])])
    model = fa.linearize(arm, outputs="joint_angle")
    zeros = lowest(model.zeros("torque[1]", "joint_angle[1]"), 3)
    poles = lowest(model.poles, 3)
    # Error of the mesh: (beta h)^4 / 1440, 1.3e-4 for the third.
    np.testing.assert_allclose(zeros, CLAMPED[:3], rtol=2e-4)
    np.testing.assert_allclose(poles, np.square(case["beta_L"][:3]), rtol=2e-4)
    together = [value for pair in zip(zeros, poles, strict=True) for value in pair]
    assert all(low < high for low, high in pairwise(together))


# Zeros from the torque to points further out: theory page "small motion", section 6


def uniform(elements):
    """Return a uniform beam of unit length, mass and rigidity, with a torque at its root."""
    link = fa.Link(length=1.0, flexural_rigidity=1.0, mass_per_length=1.0, elements=elements)
    return fa.Arm(links=[link])


def real_zeros(arm, station):
    """Return zeros on the positive real axis from the torque to the deflection of a point,
    ascending."""
    sensor = fa.Sensor("position", 1, station, name="point")
    zeros = fa.linearize(arm, outputs=sensor).zeros("torque[1]", "point[y]")
    return np.sort(zeros.real[(zeros.real > 1e-3) & (np.abs(zeros.imag) < 1e-3 * np.abs(zeros))])


def tip_equation(r):
    """Return (S.8), tan r + tanh r = 0, without its poles."""
    return np.sin(r) * np.cosh(r) + np.cos(r) * np.sinh(r)


def point_equation(r, station):
    """Return (S.9) divided by e^2r, so that no number grows."""
    left = (1.0 - station) * r

    def parts(x):
        fall = np.exp(-2.0 * x)
        s = np.sin(x) * (1.0 + fall) + np.cos(x) * (1.0 - fall)
        return s / 2.0, np.cos(x) * (1.0 + fall)

    (S, C), (s, c) = parts(r), parts(left)
    return S * c - s * C


def roots(equation, count, spacing):
    """Return the first positive roots of a function whose roots are about ``spacing`` apart."""
    grid = np.arange(0.05, (count + 2.0) * spacing, spacing / 40.0)
    values = np.array([equation(r) for r in grid])
    turns = np.flatnonzero(values[:-1] * values[1:] < 0.0)[:count]
    return np.array([brentq(equation, grid[k], grid[k + 1], xtol=1e-14) for k in turns])


def test_equation_of_the_tips_zeros_follows_from_the_beam():
    """s^2 y + y'''' = 0, y = 0 at the root, and y = 0 also at the free tip.

    The determinant of the four conditions on the four exponentials vanishes at s = 2 r^2 and not
    between, and sin b + sinh b does at b = (1 + i) r.
    """
    exponents = np.exp(0.25j * np.pi * np.array([1, 3, 5, 7]))

    def determinant(s):
        k = np.sqrt(s) * exponents  # k^4 = -s^2
        scale = np.exp(-np.maximum(k.real, 0.0))
        rows = [np.ones(4), np.exp(k), (k / abs(k)) ** 2 * np.exp(k), (k / abs(k)) ** 3 * np.exp(k)]
        return abs(np.linalg.det(np.array(rows) * scale))

    found = roots(tip_equation, 4, np.pi)
    for r in found:
        assert determinant(2.0 * r * r) < 1e-9 * determinant(2.0 * (r + 0.3) ** 2)
        b = (1.0 + 1.0j) * r
        assert abs(np.sin(b) + np.sinh(b)) < 1e-12 * abs(np.sinh(b))
    np.testing.assert_allclose(found[:2], [2.36502, 5.49780], rtol=1e-6)


@pytest.mark.parametrize(("elements", "close"), [(6, 0.015), (12, 1e-3), (24, 7e-5)])
def test_zeros_from_torque_to_tip(elements, close):
    """Real pairs (S.8), for a torque on the hub, whose inertia has no effect. Error (b h)^4 / 720.

    ``close``: of the third zero, 0.0137, 7.8e-4, 4.5e-5 measured; the error of the first is 200
    times smaller.
    """
    wanted = 2.0 * roots(tip_equation, 3, np.pi) ** 2
    arm = uniform(elements)
    found = real_zeros(arm, None)
    np.testing.assert_allclose(found[:3], wanted, rtol=close)
    np.testing.assert_allclose(found[0], wanted[0], rtol=close / 100.0)
    hub = fa.Arm(links=arm.spec.links, joints=[fa.Joint(hub_inertia=0.5)])
    # Zeros of state space beside poles at 1e5 lose digits: 3e-8 on the finest mesh.
    np.testing.assert_allclose(real_zeros(hub, None)[:3], found[:3], rtol=1e-6)
    motion = fa.joint_motion(arm, [0.0], [0.1], 20.0, start_time=100.0)
    inverted = rest_end(TipConstraint(arm, motion), 0.0).zeros
    growing = np.sort(inverted.real[inverted.real > 1e-3])
    np.testing.assert_allclose(growing[:3], found[:3], rtol=1e-6)


@pytest.mark.parametrize("station", [0.4, 0.5, 0.7])
def test_zeros_from_torque_to_a_point(station):
    """The slowest right half-plane zero of a point (S.9); about 2 (pi / x)^2 near the root."""
    exact = 2.0 * roots(lambda r: point_equation(r, station), 1, np.pi / station)[0] ** 2
    assert exact == pytest.approx(2.0 * (np.pi / station) ** 2, rel=0.1)
    np.testing.assert_allclose(real_zeros(uniform(24), station)[0], exact, rtol=2e-4)


def direct(arm, station):
    """Return the direct acceleration of a point per N m."""
    return fa.linearize(arm, outputs=fa.Sensor("acceleration", 1, station)).D[1, 0]


def first_sign_change(function, stations):
    values = np.array([function(x) for x in stations])
    k = int(np.argmax(values < 0.0))
    return brentq(function, stations[k - 1], stations[k])


@pytest.mark.thorough
def test_turning_station_of_a_mesh_is_within_its_first_element():
    """All points of a beam except its root are non-minimum phase; a mesh agrees beyond that
    station."""
    parts = []
    for elements in (6, 12, 24):
        arm = uniform(elements)
        stations = np.linspace(0.01, 3.0, 60) / elements
        turn = first_sign_change(lambda x, arm=arm: direct(arm, x), stations)
        parts.append(turn * elements)
        # On one side no zero is in the right half-plane, on the other there is one.
        assert real_zeros(arm, 0.9 * turn).size == 0
        assert real_zeros(arm, 1.1 * turn).size > 0
    np.testing.assert_allclose(parts, parts[-1], rtol=1e-5)
    assert parts[-1] < 1.0


@pytest.mark.thorough
@pytest.mark.parametrize("count", [4, 8, 16])
def test_turning_station_of_a_number_of_modes(count):
    """(S.10): the sum of the first modes has its first root at tan z = z over the last wave
    number."""
    arm = uniform(48)
    found = fa.modes(arm, joints="free")
    shapes = found.shapes[: count + 1]  # the rigid mode too
    at_root = shapes[:, arm.joint_index[0]]

    def kept(x):
        row = fa.linearize(arm, outputs=fa.Sensor("position", 1, x)).C[1, : arm.dof]
        return (shapes @ row) @ at_root

    limit = (count + 0.75) * np.pi  # half-way to the omitted mode, at (k + 1/4) pi
    turn = first_sign_change(kept, np.linspace(0.5, 6.0, 23) / limit)
    z = brentq(lambda z: np.sin(z) - z * np.cos(z), 4.0, 4.6)
    # The sum replaces an integral: 0.4 % with four modes, less with more; the mesh, 0.03 %.
    assert turn * limit == pytest.approx(z, rel=5e-3)
