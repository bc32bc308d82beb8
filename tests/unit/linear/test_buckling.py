"""Axial loads: their effect on stiffness, buckling of a link, and dead against follower loads."""

import numpy as np
import pytest
import scipy.linalg

import flexarm as fa
from arms import chain

GREENHILL = 7.83734743894  # rho A g L^3 / EI of a standing column: zero of a Bessel function
EULER = np.pi**2 / 4


def column(segments=1, elements=8, theory="second_order", gravity=(0.0, 0.0)):
    """Return a link of unit length, stiffness and mass."""
    rod = {"flexural_rigidity": 1.0, "mass_per_length": 1.0, "elements": elements}
    return chain([1.0], segments=segments, theory=theory, gravity=gravity, **rod)


def buckling_load(stiffness):
    """Return the least factor p > 0 at which K(p), linear in p, is singular; K(0) is positive
    definite."""
    plain = stiffness(0.0)[1:, 1:]
    change = plain - stiffness(1.0)[1:, 1:]
    return 1.0 / scipy.linalg.eigh(change, plain, eigvals_only=True)[-1]


def standing_weight(**fields):
    """Return the buckling weight rho A g L^3 / EI of a clamped standing column."""
    up = [np.pi / 2]

    def stiffness(g):
        arm = column(gravity=(0.0, -g), **fields)
        return arm.stiffness_matrix(arm.rest(up))

    return buckling_load(stiffness)


def pushed(frame, **fields):
    """Return the buckling force P L^2 / EI along a link from its tip towards its root."""
    arm = column(**fields)
    straight = arm.rest([0.0])

    def stiffness(p):
        return arm.stiffness_matrix(straight, loads=[fa.Load(1, (-p, 0.0), frame=frame)])

    return buckling_load(stiffness)


@pytest.mark.parametrize("segments", [1, 2, 4])
def test_greenhills_buckling_weight(segments):
    # Eight elements; the error falls with the fourth power of their length (test below).
    assert standing_weight(segments=segments) == pytest.approx(GREENHILL, rel=1.5e-5)


@pytest.mark.parametrize("segments", [1, 4])
def test_eulers_buckling_load(segments):
    assert pushed("world", segments=segments) == pytest.approx(EULER, rel=3e-6)


@pytest.mark.parametrize(("load", "exact"), [(standing_weight, GREENHILL), (None, EULER)])
def test_buckling_loads_converge_with_fourth_order(load, exact):
    of = load or (lambda **fields: pushed("world", **fields))
    errors = [of(elements=n) / exact - 1.0 for n in (4, 8, 16)]
    assert all(error > 0.0 for error in errors)  # a mesh is stiffer than the beam
    np.testing.assert_allclose(np.diff(np.log2(errors)), -4.0, atol=0.1)


def test_linear_segments_buckle_as_a_chain_of_springs():
    """For axial loads segments are rigid: the load converges from above with second order."""
    errors = [pushed("world", theory="linear", elements=n, segments=n) - EULER for n in (8, 16, 32)]
    assert all(error > 0.0 for error in errors)
    np.testing.assert_allclose(np.diff(np.log2(errors)), -2.0, atol=0.1)


def test_one_linear_link_cannot_buckle():
    arm = column(theory="linear")
    straight = arm.rest([0.0])
    pushed_hard = arm.stiffness_matrix(straight, (-100.0, 0.0))
    assert pushed_hard[0, 0] == pytest.approx(-100.0)  # a free joint would fold
    bending = arm.stiffness_matrix(straight)[1:, 1:]
    np.testing.assert_allclose(pushed_hard[1:, 1:], bending, rtol=1e-14, atol=1e-9)


def test_stability_changes_at_the_buckling_load():
    arm = column(segments=4)
    below = fa.equilibrium(arm, tip_force=(-0.99 * EULER, 0.0))
    above = fa.equilibrium(arm, tip_force=(-1.01 * EULER, 0.0))
    assert below.stable
    assert not above.stable
    np.testing.assert_allclose(above.q, 0.0, atol=1e-12)  # straight, but unstable


def test_tension_stiffens_a_link():
    """The lowest squared frequency grows by the tension times the mode's int Phi'^2, 4.6478."""
    arm = column()
    slack = fa.equilibrium(arm).lowest_eigenvalue
    assert slack == pytest.approx(3.5160152685**2, rel=1e-5)
    tension = 0.01
    pulled = fa.equilibrium(arm, tip_force=(tension, 0.0)).lowest_eigenvalue
    # To first order in the tension; the next term is smaller by the tension over EI / L^2.
    assert (pulled - slack) / tension == pytest.approx(4.6478, rel=1e-3)


def test_dead_and_follower_loads():
    """Beck's column does not buckle as Euler's does, because a follower load has no potential."""
    arm = column(segments=8)
    beyond = 1.05 * EULER
    dead = fa.equilibrium(arm, tip_force=(-beyond, 0.0))
    follower = [fa.Load(1, (-beyond, 0.0), frame="link")]
    assert not dead.stable
    assert fa.equilibrium(arm, loads=follower).stable
    K = arm.stiffness_matrix(arm.rest([0.0]), loads=follower)
    assert abs(K - K.T).max() > 0.1
    conservative = arm.stiffness_matrix(arm.rest([0.0]), (-beyond, 0.0))
    np.testing.assert_allclose(conservative, conservative.T, atol=1e-12 * abs(K).max())


def test_follower_load_bends_a_link_further():
    """It turns with the end of the link, so its lever does not vanish."""
    arm = column(segments=8)
    dead = fa.equilibrium(arm, loads=[fa.Load(1, (0.0, 2.0))])
    follower = fa.equilibrium(arm, loads=[fa.Load(1, (0.0, 2.0), frame="link")])
    assert arm.tip(follower.q)[2] > arm.tip(dead.q)[2] + 0.05


def test_stiffness_under_loads_is_the_derivative_of_the_force():
    arm = fa.Arm(
        links=[
            fa.Link(length=1.0, flexural_rigidity=3.0, mass_per_length=1.0, segments=2),
            fa.Link(length=0.7, flexural_rigidity=2.0, mass_per_length=1.0, elements=1),
        ],
        joints=[
            fa.Joint(stiffness=2.0),
            fa.Joint(limits={"lower": -1, "upper": 0.1, "stiffness": 9}),
        ],
        gravity=(1.0, -3.0),
        theory="second_order",
    )
    loads = [
        fa.Load(1, (1.0, -2.0), 0.3, station=0.6, frame="link"),
        fa.Load(2, (0.5, 1.0), spread=(0.1, 0.6)),
    ]
    rng = np.random.default_rng(4)
    q, zero = arm.rest([0.4, 0.3]), np.zeros(arm.dof)
    for piece in arm.assembly.pieces:
        q[piece.modal] = 0.2 * rng.normal(size=piece.shapes.w2.size) / np.sqrt(piece.shapes.w2)
    K = arm.stiffness_matrix(q, (0.5, -0.5, 0.2), loads)
    step = 1e-5  # truncation by its square, rounding of forces of 1e4 over it: 1e-7
    for column_of, unit in zip(K.T, np.eye(arm.dof) * step, strict=True):
        ahead, behind = (
            arm.inverse_dynamics(q + sign * unit, zero, zero, (0.5, -0.5, 0.2), loads)
            for sign in (1, -1)
        )
        np.testing.assert_allclose(column_of, (ahead - behind) / (2 * step), rtol=1e-6, atol=1e-5)
