"""Runs with contacts that are rejected: a start deep in a surface, a motion that presses away from
it."""

import numpy as np
import pytest

import flexarm as fa
from arms import chain, unit_link

#: A rod of 3 kg and 1 m on a joint at its end, in front of a floor.
FLOOR = fa.Wall((0.0, -0.1), (0.0, 1.0))
WEIGHT = 3.0 * 9.81


def start(depth):
    return [np.arcsin(-0.1 - depth)]


def contact(force, depth, exponent=1.0):
    """Return a contact with the given force (N) at a depth (m)."""
    return fa.Contact(FLOOR, force / depth**exponent, exponent=exponent)


@pytest.mark.parametrize(
    ("depth", "weights"),
    [(0.009, 1000.0), (0.05, 9.0)],
    ids=["a blow on a stiff surface", "pressed into a soft one"],
)
def test_start_is_deep_only_with_large_depth_and_large_force(depth, weights):
    touch = contact(weights * WEIGHT, depth)
    result = fa.simulate(unit_link(), 1e-4, initial=start(depth), contacts=[touch], rate=1e4)
    assert float(result.contact_gap[0, 0]) == pytest.approx(-depth, rel=1e-12)


def test_plant_rejects_a_deep_start_at_its_first_step():
    plant = fa.Plant(unit_link(), contacts=[fa.Contact(fa.Wall((0.0, 0.1), (0.0, 1.0)), 1e4)])
    with pytest.raises(fa.InputError, match=r"^Plant\.step: initial must start outside"):
        plant.step([0.0])
    with pytest.raises(fa.InputError, match=r"^Plant\.reset: initial must start outside"):
        plant.reset([0.05])
    plant.reset([0.2])
    plant.step([0.0])


# Motions that press ------------------------------------------------------------------------------

LINK = {"flexural_rigidity": 60.0, "mass_per_length": 0.6, "elements": 1}


@pytest.fixture(scope="module")
def arm():
    return chain((0.8, 0.7), [0.1, 0.1], **LINK)


def table():
    x = np.linspace(0.0, 1.2, 9)
    return fa.SurfaceTable(x, 0.3 + 0.0 * x)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("surface", "normal"),
    [
        (fa.Wall((0.0, 0.3), (0.0, 2.0)), (0.0, 1.0)),
        (fa.RoundWall((0.9, 10.3), 10.0, inside=True), (0.0, 1.0)),
        (table(), (0.0, 1.0)),
        (fa.Wall((0.0, 0.3), (0.0, -1.0)), (0.0, -1.0)),
    ],
    ids=["wall", "room", "table", "ceiling"],
)
def test_motion_that_presses_the_wrong_way_is_rejected(arm, surface, normal):
    """The path lies on the surface; a post beside it is not the pressed surface."""
    line = fa.line_motion(arm, (0.8, 0.3), (1.0, 0.3), 1.0, start_time=0.5)
    post = fa.Contact(fa.RoundWall((0.9, 0.8), 0.05), 1e4)
    touches = [post, fa.Contact(surface, 1e4)]
    hold = {"controller": fa.JointPD(20.0, 2.0), "contacts": touches}
    right = fa.pressed_motion(arm, line, 5.0, normal)
    fa.simulate(arm, 0.01, reference=right, initial=right.initial, **hold)
    wrong = fa.pressed_motion(arm, line, 5.0, -np.array(normal))
    message = (
        r"^simulate: reference\.normal must point away from the surface of contact 2, got "
        r"\(0, -?1\) at t = 0 s, which points into it"
    )
    with pytest.raises(fa.InputError, match=message):
        fa.simulate(arm, 0.01, reference=wrong, initial=wrong.initial, **hold)
