"""Inverse kinematics inverts the forward one on both branches, or reports why it cannot."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motion_checks import Links

from flexarm.motion import inverse_kinematics as of_an_arm
from flexarm.motion.geometry.inverse_kinematics import (
    damped_least_squares,
    reach_limits,
    tip_jacobian,
    tip_position,
)
from strategies import between

# Rounding of a tip position, of its angles and of their sum, per metre of reach.
ROUNDING = 1e-13

length = between(0.05, 3.0)
direction = between(-np.pi, np.pi)
share = between(0.0, 1.0)


def inverse_kinematics(lengths, *args, **options):
    return of_an_arm(Links(tuple(lengths)), *args, **options)


def chains(smallest: int, largest: int):
    return st.lists(length, min_size=smallest, max_size=largest).map(np.array)


def point_within(lengths, ratio, angle):
    inner, outer = reach_limits(lengths)
    return (inner + ratio * (outer - inner)) * np.array([np.cos(angle), np.sin(angle)])


def miss(lengths, angles, point):
    return np.hypot(*(tip_position(lengths, angles) - point)) / np.sum(lengths)


@settings(deadline=None)
@given(chains(2, 2), share, direction, st.sampled_from(["up", "down"]))
def test_two_links_reach_every_point_on_both_branches(lengths, ratio, angle, elbow):
    point = point_within(lengths, ratio, angle)
    angles = inverse_kinematics(lengths, point, elbow)
    assert miss(lengths, angles, point) < ROUNDING
    assert angles[1] <= 0.0 if elbow == "up" else angles[1] >= 0.0


@settings(deadline=None)
@given(chains(2, 6), share, direction)
def test_branches_are_mirror_images(lengths, ratio, angle):
    point = point_within(lengths, ratio, angle)
    up = inverse_kinematics(lengths, point, "up")
    down = inverse_kinematics(lengths, point * [1.0, -1.0], "down")
    difference = np.angle(np.exp(1j * (up + down)))  # pi and -pi are the same angle
    np.testing.assert_allclose(difference, 0.0, rtol=0, atol=1e-12)


@settings(deadline=None)
@given(chains(3, 6), share, direction, st.sampled_from(["up", "down"]))
def test_longer_arms_reach_every_point_without_a_given_posture(lengths, ratio, angle, elbow):
    point = point_within(lengths, ratio, angle)
    angles = inverse_kinematics(lengths, point, elbow)
    assert miss(lengths, angles, point) < ROUNDING
    assert np.all(np.abs(angles) <= np.pi)


@settings(deadline=None)
@given(chains(3, 6), between(0.05, 0.95), direction)
def test_constructed_posture_is_not_singular(lengths, ratio, angle):
    angles = inverse_kinematics(lengths, point_within(lengths, ratio, angle))
    inner, outer = reach_limits(lengths)
    stretch = np.linalg.svd(tip_jacobian(lengths, angles), compute_uv=False)[-1]
    # Links in one line would give zero. The lowest value is that of the shortest link across.
    assert stretch > 1e-3 * min(outer, 20.0 * (outer - inner))


def test_constructed_posture_is_inside_the_limits_of_its_triangles():
    angles = inverse_kinematics([1.0, 1.0, 1.0, 1.0], [0.01, 0.0])
    assert abs(angles[0]) > 0.5  # at the limit the first link would have the direction of the point


@settings(deadline=None, max_examples=50)
@given(chains(3, 6), between(0.3, 0.9), direction, st.integers(0, 10**6))
def test_damped_least_squares_converges_from_a_posture(lengths, ratio, angle, seed):
    # Without a hole: near its edge are folded postures at which the search stops.
    lengths = np.minimum(lengths, 0.99 * (np.sum(lengths) - np.max(lengths)))
    point = point_within(lengths, ratio, angle)
    posture = np.random.default_rng(seed).uniform(-2.0, 2.0, len(lengths))
    angles = inverse_kinematics(lengths, point, posture=posture)
    assert miss(lengths, angles, point) < 2e-13  # the tolerance of the search and rounding


def test_damped_least_squares_converges_quadratically(monkeypatch):
    lengths = np.array([1.0, 0.8, 0.6, 0.4])
    posture = np.array([0.4, 0.5, -0.7, 0.9])
    monkeypatch.setattr("flexarm.motion.geometry.inverse_kinematics.MAX_ITERATIONS", 10)
    angles, missed = damped_least_squares(lengths, np.array([-1.0, 0.9]), posture)
    # Constant damping would gain about one digit per step.
    assert missed < 1e-12
    np.testing.assert_allclose(tip_position(lengths, angles), [-1.0, 0.9], rtol=0, atol=1e-12)


def test_damped_least_squares_changes_its_posture_little():
    lengths = np.array([1.0, 0.8, 0.6, 0.4])
    posture = np.array([0.4 + 2 * np.pi, 0.5, -0.7, 0.9])
    near = tip_position(lengths, posture) + np.array([1e-3, -2e-3])
    angles = inverse_kinematics(lengths, near, posture=posture)
    # The least-norm change is |miss| over the smallest singular value, here above 0.5 m.
    assert np.linalg.norm(angles - posture) < 2.0 * np.hypot(1e-3, 2e-3)


def distance(angles, posture):
    return float(np.sum((angles - posture) ** 2))


@pytest.mark.thorough
@settings(deadline=None, max_examples=40)
@given(chains(3, 6), between(0.3, 0.9), direction, st.integers(0, 10**6))
def test_no_small_change_is_nearer_to_the_posture(lengths, ratio, angle, seed):
    lengths = np.minimum(lengths, 0.99 * (np.sum(lengths) - np.max(lengths)))
    point = point_within(lengths, ratio, angle)
    rng = np.random.default_rng(seed)
    posture = rng.uniform(-2.0, 2.0, len(lengths))
    nearest = inverse_kinematics(lengths, point, posture=posture)
    least = distance(nearest, posture)
    for elbow in ("up", "down"):
        built = inverse_kinematics(lengths, point, elbow)
        turned = built + 2.0 * np.pi * np.round((posture - built) / (2.0 * np.pi))
        assert least <= distance(turned, posture) + 1e-9
    for _ in range(5):
        change = 1e-3 * rng.normal(size=len(lengths))
        near, missed = damped_least_squares(lengths, point, nearest + change)
        assert missed < 1e-12 * np.sum(lengths)
        # The gradient vanishes to 1e-9, so changes of 1e-3 gain less than that.
        assert distance(near, posture) > least - 1e-9


def test_nearest_posture_to_a_straight_arm():
    """Damped least squares cannot start from a straight arm, because joint rates cannot shorten
    it."""
    nearest = inverse_kinematics([1.0, 1.0, 1.0], [2.0, 0.0], posture=[0.0, 0.0, 0.0])
    turned = np.cumsum(nearest)
    np.testing.assert_allclose(np.cos(turned).sum(), 2.0, rtol=0, atol=1e-12)
    # Least squares of (a, b, c) with the tip at (2, 0), by a search on a fine grid of the first.
    first = np.linspace(-1.5, 1.5, 200_001)
    x, y = 2.0 - np.cos(first), -np.sin(first)
    inner = np.hypot(x, y)
    inside = inner <= 2.0
    bend = 2.0 * np.arccos(np.minimum(inner / 2.0, 1.0))
    squares = [
        first**2 + (np.arctan2(y, x) - sign * bend / 2.0 - first) ** 2 + bend**2
        for sign in (1.0, -1.0)
    ]
    best = min(float(np.min(row[inside])) for row in squares)
    assert distance(nearest, np.zeros(3)) == pytest.approx(best, abs=1e-8)


def test_posture_keeps_its_full_turns_on_the_boundary():
    posture = np.array([0.1 + 4.0 * np.pi, 0.4, 0.2 - 2.0 * np.pi])
    straight = inverse_kinematics([2.0, 0.5, 0.25], [0.0, 2.75], posture=posture)
    expected = [4.5 * np.pi, 0.0, -2.0 * np.pi]
    np.testing.assert_allclose(straight, expected, rtol=0, atol=1e-7)


def test_each_boundary_has_one_posture():
    lengths = [2.0, 0.5, 0.25]
    straight = inverse_kinematics(lengths, [0.0, 2.75], posture=[0.1, 0.4, 0.2])
    folded = inverse_kinematics(lengths, [1.25, 0.0], posture=[0.1, 0.4, 0.2])
    np.testing.assert_allclose(straight, [np.pi / 2, 0.0, 0.0], rtol=0, atol=1e-7)
    np.testing.assert_allclose(np.abs(folded), [0.0, np.pi, 0.0], rtol=0, atol=1e-7)


def test_one_link_reaches_points_on_its_circle():
    np.testing.assert_allclose(inverse_kinematics([2.0], [0.0, -2.0]), [-np.pi / 2])


def test_published_posture_is_reproduced():
    angles = inverse_kinematics([1.4142, 1.0], [2.0, 1.0])
    # Accurate to the last printed digit.
    assert angles[0] == pytest.approx(0.785388573, abs=5e-10)
    assert np.sum(angles) == pytest.approx(0.0000191804, abs=5e-11)
