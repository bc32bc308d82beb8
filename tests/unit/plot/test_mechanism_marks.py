"""Ground points, slides, bases and closures of drawings are where the mechanism has them."""

from __future__ import annotations

import numpy as np
import pytest

import flexarm as fa
from closed_mechanisms import CLOSED
from flexarm.view.plot.drawn_result import shapes_of
from flexarm.view.plot.mechanism import Marks, marks_of

BEAM = {"flexural_rigidity": 20.0, "mass_per_length": 0.5, "elements": 2}
#: Drawn tangents are those of the chords between neighbouring stations of straight links: rounding.
ROUNDING = 1e-12


def marks(arm: fa.Arm, *states: np.ndarray) -> Marks:
    q = np.array(states)
    return marks_of(arm, q, shapes_of(arm, q))


@pytest.mark.parametrize("name", CLOSED)
def test_both_points_of_closed_closures_are_drawn_at_one_place(name):
    closed = CLOSED[name]()
    arm = fa.Arm(**closed.fields)
    q = arm.rest(closed.joints)
    drawn = marks(arm, q)
    assert drawn.pins.shape == (1, len(arm.spec.closures), 2)
    for closure, pin in zip(arm.spec.closures, drawn.pins[0], strict=True):
        ends = drawn.rails[0].reshape(-1, 2)
        assert np.min(np.linalg.norm(ends - pin, axis=1)) < ROUNDING
        if closure.to_link:  # the lines from the axes of both links end in the pin
            assert np.sum(np.linalg.norm(ends - pin, axis=1) < ROUNDING) >= 2


def test_a_fixed_base_has_a_foot_below_each_of_its_joints_and_each_pin_of_the_ground():
    pin = fa.Closure(link=2, to_offset=(1.0, 0.5))
    links = [fa.Link(length=1.0, **BEAM)] * 2
    arm = fa.Arm(links=links, joints=[fa.Joint(offset=(0.2, 0.0)), fa.Joint()], closures=[pin])
    np.testing.assert_array_equal(marks(arm, arm.rest([0.0, 1.0])).feet, [[0.2, 0.0], [1.0, 0.5]])
    serial = fa.Arm(links=links)
    np.testing.assert_array_equal(marks(serial, serial.rest([0.3, 1.0])).feet, [[0.0, 0.0]])


def test_a_moving_base_is_a_body_without_a_foot():
    base = fa.Base(mass=1.0, inertia=1.0, free=("x", "y", "angle"))
    joint = fa.Joint(offset=(0.4, 0.0))
    arm = fa.Arm(links=[fa.Link(length=1.0, **BEAM)], joints=[joint], base=base)
    drawn = marks(arm, arm.rest([0.0], base=[1.0, 2.0, np.pi / 2]))
    assert len(drawn.feet) == 0
    expected = [[1.0, 2.0], [1.0, 2.4], [1.0, 2.0]]
    np.testing.assert_allclose(drawn.body[0], expected, atol=ROUNDING)


def test_a_rail_has_the_length_of_the_travel():
    slide = fa.Joint(kind="prismatic", axis=(0.0, 2.0), offset=(0.5, 0.0))
    arm = fa.Arm(links=[fa.Link(length=1.0, **BEAM)], joints=[slide])
    drawn = marks(arm, arm.rest([0.3]), arm.rest([-0.1]))
    expected = [[0.5, -0.1], [0.5, 0.3]]
    np.testing.assert_allclose(drawn.rails[:, 0], [expected, expected], atol=ROUNDING)


@pytest.mark.parametrize(
    "curve",
    [
        fa.RoundWall((0.1, 0.2), 0.5),
        fa.SurfaceTable([0.1, -0.4, 0.1, 0.6], [0.7, 0.2, -0.3, 0.2], closed=True),
    ],
)
def test_a_curve_is_drawn_where_its_points_are(curve):
    links = [fa.Link(length=1.0, **BEAM)] * 2
    moving = {"to_link": 1, "to_station": 0.0, "angle": 0.3}
    closures = [
        fa.Closure(kind="curve", link=2, shape=curve),
        fa.Closure(kind="curve", link=2, shape=curve, **moving),
    ]
    drawn = []
    for closure in closures:
        arm = fa.Arm(links=links, closures=[closure])
        drawn.append(marks(arm, arm.rest([0.4, 1.0])).rails[0, -1])
    middle = np.array([0.1, 0.2])
    # The spline through four points of the circle is off by some percent.
    np.testing.assert_allclose(np.linalg.norm(drawn[0] - middle, axis=1), 0.5, atol=0.05)
    angle = 0.4 + 0.3  # of the first link, and of the axes of the curve from it
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    back = drawn[1] @ turn - middle
    np.testing.assert_allclose(np.linalg.norm(back, axis=1), 0.5, atol=0.05)
