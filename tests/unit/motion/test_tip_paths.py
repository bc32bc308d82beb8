"""Paths of the tip: circles, splines and via points against closed forms, and wrong input."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motion_checks import Links

from flexarm.base.errors import InputError
from flexarm.motion import (
    TIMING_LAWS,
    circle_motion,
    line_motion,
    spline_motion,
    trapezoidal,
    via_point_motion,
)
from flexarm.motion.geometry.inverse_kinematics import tip_jacobian, tip_jacobian_rate
from flexarm.motion.tip.tip_paths import arc_path, polygon_path, spline_path

ARMS = [Links(), Links((0.9, 0.7, 0.5, 0.6))]
POINTS = np.array([[1.9, 0.4], [1.4, 1.2], [0.4, 1.4], [-0.6, 1.7], [-1.2, 1.1]])


@pytest.fixture(params=ARMS, ids=lambda arm: f"{arm.n_links}-links")
def arm(request):
    return request.param


def tip_state(motion, t):
    """Return velocity and acceleration of the tip from the joints, (T, 2) each."""
    state = motion.state(t)
    angles = state.angle + motion.chain.offset
    jacobian = tip_jacobian(motion.chain.lengths, angles)
    turning = tip_jacobian_rate(motion.chain.lengths, angles, state.rate)
    velocity = np.einsum("tij,tj->ti", jacobian, state.rate)
    acceleration = np.einsum("tij,tj->ti", jacobian, state.acceleration)
    return velocity, acceleration + np.einsum("tij,tj->ti", turning, state.rate)


def test_circle_at_constant_speed_has_centripetal_acceleration(arm):
    center, radius, turn, ramp = np.array([1.0, 0.9]), 0.4, 2.0 * np.pi, 0.2
    motion = circle_motion(
        arm, center, center + radius * np.array([0.0, 1.0]), turn, 2.0, profile=trapezoidal(ramp)
    )
    t = np.linspace(2.0 * ramp, 2.0 * (1.0 - ramp), 101)[:-1]
    rate = turn / (1.0 - ramp) / 2.0  # rad/s of the tip about the centre
    out = (motion.tip(t) - center) / radius
    velocity, acceleration = tip_state(motion, t)
    # Rounding of rates of 4 rad/s times the Jacobian, and of their squares.
    np.testing.assert_allclose(np.hypot(*out.T), 1.0, rtol=0, atol=1e-13)
    np.testing.assert_allclose(np.hypot(*velocity.T), rate * radius, rtol=0, atol=1e-12)
    np.testing.assert_allclose(acceleration, -(rate**2) * radius * out, rtol=0, atol=1e-10)


def test_full_circle_returns_the_two_link_arm_to_its_posture():
    motion = circle_motion(Links(), [1.0, 0.9], [1.4, 0.9], 2.0 * np.pi, 1.0)
    np.testing.assert_allclose(motion.joint_angle(1.0), motion.joint_angle(0.0), rtol=0, atol=1e-14)


@pytest.mark.parametrize("turns", [1.0, -1.0, 2.25])
def test_circle_about_the_base_turns_the_first_joint_only(turns):
    motion = circle_motion(Links(), [0.0, 0.0], [1.5, 0.5], 2.0 * np.pi * turns, 1.0)
    way = motion.joint_angle([0.2, 0.5, 1.0]) - motion.joint_angle(0.0)
    s = motion.law(np.array([0.2, 0.5, 1.0])).s
    np.testing.assert_allclose(way[:, 0], 2.0 * np.pi * turns * s, rtol=0, atol=1e-13)
    np.testing.assert_allclose(way[:, 1], 0.0, rtol=0, atol=1e-13)


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10**6))
def test_angles_of_circles_are_continuous(seed):
    rng = np.random.default_rng(seed)
    center, out = rng.uniform(-1.2, 1.2, (2, 2))
    try:
        motion = circle_motion(Links(), center, center + out, rng.uniform(-9.0, 9.0), 1.0)
    except InputError:
        return  # out of reach, or through the hole
    t = np.linspace(0.0, 1.0, 4001)
    state = motion.state(t)
    step = np.abs(np.diff(state.angle, axis=0))
    assert np.all(step <= 2.0 * np.max(np.abs(state.rate), axis=0) * 2.5e-4 + 1e-9)


@pytest.mark.parametrize("law", TIMING_LAWS)
def test_spline_passes_its_points_exactly(arm, law):
    motion = spline_motion(arm, POINTS, 2.0, profile=law)
    inner = [t for t in motion.breaks if not _of_the_law(motion, t)]
    times = [0.0, *inner, 2.0]
    # A break in time is rounded to 4e-16 s, at a speed of a few m/s; positions to 1e-15 m.
    np.testing.assert_allclose(motion.tip(times), POINTS, rtol=0, atol=1e-14)


def _of_the_law(motion, t):
    return min(abs(t - motion.start_time - motion.duration * u) for u in motion.law.breaks) < 1e-9


def test_spline_reproduces_a_cubic():
    """Not-a-knot ends reproduce a curve that is a cubic in the chord length."""
    x = np.array([0.0, 0.3, 0.7, 1.2, 1.5])
    path = spline_path(np.column_stack([x, np.zeros(5)]))
    place = path.at(np.linspace(0.0, 1.0, 11))
    np.testing.assert_allclose(place.point[:, 0], np.linspace(0.0, 1.5, 11), rtol=0, atol=1e-14)
    np.testing.assert_allclose(place.curve, 0.0, rtol=0, atol=1e-12)


def test_spline_through_a_circle_converges_to_its_curvature():
    def error(count):
        angle = np.linspace(0.0, 2.0 * np.pi, count + 1)
        points = np.column_stack([np.cos(angle), np.sin(angle)])
        points[-1] = points[0]
        place = spline_path(points).at(np.linspace(0.0, 1.0, 97))
        across = place.slope[:, 0] * place.curve[:, 1] - place.slope[:, 1] * place.curve[:, 0]
        return np.abs(across / np.hypot(*place.slope.T) ** 3 - 1.0).max()

    # The second derivative of a cubic spline has order 2.
    assert error(16) / error(32) == pytest.approx(4.0, rel=0.1)
    assert error(32) < 0.01


def test_closed_spline_has_no_corner():
    points = [[1.5, 0.2], [1.2, 0.9], [0.7, 0.6], [1.5, 0.2]]
    first, last = (spline_path(points).at(np.array([s])) for s in (0.0, 1.0))
    np.testing.assert_allclose(first.slope, last.slope, rtol=0, atol=1e-12)
    np.testing.assert_allclose(first.curve, last.curve, rtol=0, atol=1e-11)


def test_via_points_are_lines_with_rounded_corners(arm):
    motion = via_point_motion(arm, POINTS, 2.0, blend=0.2)
    path, corners = motion.tip_path, POINTS[1:-1]
    s = np.linspace(0.0, 1.0, 2001)
    place = path.at(s)
    from_lines = np.min([_from_line(place.point, a, b) for a, b in pairwise(POINTS)], axis=0)
    from_corners = np.min([np.hypot(*(place.point - c).T) for c in corners], axis=0)
    on_lines = from_corners > 0.2 + 1e-9
    assert np.max(from_lines[on_lines]) < 1e-14
    total = np.sum(np.hypot(*np.diff(POINTS, axis=0).T))
    np.testing.assert_allclose(np.hypot(*place.slope[on_lines].T), total, rtol=1e-13)
    # The documented distance from the corner: 3/8 of the blend times the sine of half of the turn.
    middle = np.array(path.breaks).reshape(-1, 2).mean(axis=1)
    ways = np.diff(POINTS, axis=0)
    headings = np.unwrap(np.arctan2(ways[:, 1], ways[:, 0]))
    expected = 0.375 * 0.2 * np.sin(np.abs(np.diff(headings)) / 2.0)
    gap = np.hypot(*(path.at(middle).point - corners).T)
    np.testing.assert_allclose(gap, expected, rtol=1e-12)


def _from_line(points, a, b):
    way = (b - a) / np.hypot(*(b - a))
    off = points - a
    along = np.clip(off @ way, 0.0, np.hypot(*(b - a)))
    return np.hypot(*(off - np.outer(along, way)).T)


def test_default_corners_start_at_a_quarter_of_the_shorter_line():
    path = polygon_path([[0.0, 0.0], [1.0, 0.0], [1.0, 3.0]], None)
    np.testing.assert_allclose(path.at(np.array(path.breaks)).point, [[0.75, 0.0], [1.0, 0.25]])


def test_corners_may_meet_in_the_middle_of_a_line():
    path = polygon_path([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [2.0, 1.0]], 0.5)
    np.testing.assert_allclose(path.breaks, [0.5 / 3.0, 0.5, 2.5 / 3.0], rtol=1e-15)
    sides = [path.at(np.array([np.nextafter(0.5, s)])) for s in (0.0, 1.0)]
    for before, after in zip(*sides, strict=True):
        np.testing.assert_allclose(before, after, rtol=0, atol=1e-13)


@pytest.mark.sampled("2-links")
def test_two_via_points_are_a_line(arm):
    line = line_motion(arm, POINTS[0], POINTS[1], 1.0)
    t = np.linspace(0.0, 1.0, 21)
    for other in (via_point_motion, spline_motion):
        state = other(arm, POINTS[:2], 1.0).state(t)
        for part, want in zip(state, line.state(t), strict=True):
            np.testing.assert_allclose(part, want, rtol=0, atol=1e-10)


def test_coinciding_breaks_of_path_and_law_are_one_break():
    triangular = trapezoidal(0.5)
    points = [[1.8, 0.3], [1.4, 0.9], [1.8, 1.5]]  # the second is halfway
    motion = spline_motion(Links(), points, 1.0, profile=triangular)
    assert motion.breaks == (0.0, 0.5, 1.0)


@pytest.mark.parametrize("seed", range(5))
def test_extremes_bound_the_distance(seed):
    rng = np.random.default_rng(seed)
    center, points = rng.uniform(-1.0, 1.0, 2), rng.uniform(-2.0, 2.0, (6, 2))
    for path in (
        spline_path(points),
        polygon_path(points, None),
        arc_path(points[0], points[1], 3.0 * rng.normal()),
    ):
        along = np.hypot(*(path.at(np.linspace(0.0, 1.0, 20_001)).point - center).T)
        found = np.hypot(*(path.at(path.extremes(center)).point - center).T)
        # The grid misses an extreme by the square of its step.
        assert along.min() - 1e-5 < found.min() <= along.min() + 1e-12
        assert along.max() + 1e-5 > found.max() >= along.max() - 1e-12
        speed = np.hypot(*path.at(np.linspace(0.0, 1.0, 20_001)).slope.T)
        assert speed.max() <= path.fastest * (1.0 + 1e-12)
