"""Line motions have the tip on the line, with consistent joint rates, or are rejected."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from motion_checks import Links

from flexarm.base.errors import InputError
from flexarm.motion import line_motion
from flexarm.motion.geometry.inverse_kinematics import (
    RigidChain,
    tip_jacobian,
    tip_jacobian_rate,
    tip_position,
)
from flexarm.motion.tip.tip_motion import SingularPathError, least_norm_path
from flexarm.motion.tip.tip_paths import line_path

ARMS = [(1.4142, 1.0), (1.0, 1.0), (1.0, 0.8, 0.6), (0.5,) * 4, (0.4, 0.9, 0.2, 0.7, 0.6, 0.3)]


@pytest.fixture(params=ARMS, ids=lambda lengths: f"{len(lengths)}-links-{lengths[1]}")
def arm(request):
    return Links(request.param)


@pytest.fixture(params=["up", "down"])
def motion(arm, request):
    reach = np.sum(arm.lengths)
    start, end = reach * np.array([[0.7, 0.5], [-0.3, 0.6]])
    return line_motion(arm, start, end, 1.6, profile="trapezoidal", elbow=request.param)


T = np.linspace(0.0, 1.6, 201)


@pytest.mark.thorough_cases(
    "up-6-links-0.9", "down-6-links-0.9", "down-3-links-0.8", "up-4-links-0.5"
)
def test_tip_is_on_the_line_at_its_time(motion):
    s = motion.law(T / 1.6).s[:, None]
    line = motion.start + s * (motion.end - motion.start)
    # Rounding of a tip position of at most 4 m.
    np.testing.assert_allclose(motion.tip(T), line, rtol=0, atol=1e-13)


@pytest.mark.thorough_cases(
    "up-6-links-0.9", "down-6-links-0.9", "down-3-links-0.8", "up-4-links-0.5"
)
def test_tip_has_the_velocity_and_acceleration_of_the_line(motion):
    state = motion.state(T)
    _, ds, dds = motion.law(T / 1.6)
    way = motion.end - motion.start
    jacobian = tip_jacobian(motion.chain.lengths, state.angle)
    turning = tip_jacobian_rate(motion.chain.lengths, state.angle, state.rate)
    velocity = np.einsum("tij,tj->ti", jacobian, state.rate)
    acceleration = np.einsum("tij,tj->ti", jacobian, state.acceleration)
    acceleration += np.einsum("tij,tj->ti", turning, state.rate)
    # Rounding of J times rates of at most 20 rad/s.
    np.testing.assert_allclose(velocity, np.outer(ds / 1.6, way), rtol=0, atol=1e-12)
    np.testing.assert_allclose(acceleration, np.outer(dds / 1.6**2, way), rtol=0, atol=1e-11)


@pytest.mark.thorough_cases(
    "up-6-links-0.9", "down-6-links-0.9", "down-3-links-0.8", "up-4-links-0.5"
)
def test_rates_have_the_least_norm(motion):
    state = motion.state(T)
    for angle, rate in zip(state.angle, state.rate, strict=True):
        jacobian = tip_jacobian(motion.chain.lengths, angle)
        idle = np.eye(motion.joints) - np.linalg.pinv(jacobian) @ jacobian
        np.testing.assert_allclose(idle @ rate, 0.0, rtol=0, atol=1e-12)


def test_almost_straight_arms_are_as_accurate():
    # 0.0025 m before full extension rates are ten times those in the middle of the reach.
    motion = line_motion(Links((1.0, 0.8, 0.6)), [1.2, 0.3], [2.39, 0.1], 1.0)
    panels = np.linspace(0.0, 1.0, 101)
    nodes, weights = np.polynomial.legendre.leggauss(16)
    s = panels[:-1, None] + 0.005 * (nodes + 1.0)
    path = motion.path(s.ravel())
    steps = 0.005 * np.einsum("k,pkj->pj", weights, path.rate.reshape(100, 16, 3))
    way = np.diff(motion.path(panels).angle, axis=0)
    # The path is integrated to 1e-12, and a slope of 16 times rounding errors adds a few.
    np.testing.assert_allclose(steps, way, rtol=0, atol=1e-11)
    line = motion.start + s.reshape(-1, 1) * (motion.end - motion.start)
    on_line = tip_position(motion.chain.lengths, path.angle)
    np.testing.assert_allclose(on_line, line, rtol=0, atol=2e-14)  # rounding of 2.4 m


@pytest.mark.thorough_cases("6-links-0.9", "4-links-0.5")
def test_mirrored_lines_have_mirrored_angles(arm):
    mirror = np.array([1.0, -1.0])
    start, end = np.sum(arm.lengths) * np.array([[0.7, 0.3], [0.2, -0.6]])
    up = line_motion(arm, start, end, 1.6, elbow="up").state(T)
    down = line_motion(arm, start * mirror, end * mirror, 1.6, elbow="down").state(T)
    for a, b in zip(up, down, strict=True):
        # the least-norm path has an error of 1e-12
        np.testing.assert_allclose(a, -b, rtol=0, atol=1e-11)


def test_reversed_line_has_the_same_path_for_two_links():
    there = line_motion(Links(), [2.0, 1.0], [1.0, 2.0], 1.0)
    back = line_motion(Links(), [1.0, 2.0], [2.0, 1.0], 1.0)
    t = np.linspace(0.0, 1.0, 33)
    np.testing.assert_allclose(there.joint_angle(t), back.joint_angle(1.0 - t), rtol=0, atol=1e-14)


def test_published_line_is_reproduced():
    motion = line_motion(Links(), [2.0, 1.0], [1.0, 2.0], 2.0)
    angles = motion.joint_angle(0.0)
    assert angles[0] == pytest.approx(0.785388573, abs=5e-10)  # printed to the last digit shown
    assert np.sum(angles) == pytest.approx(0.0000191804, abs=5e-11)
    assert np.all(motion.joint_angle(T)[:, 1] < 0.0)


@pytest.mark.thorough
@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10**6), st.sampled_from(["up", "down"]))
def test_angles_are_continuous(seed, elbow):
    rng = np.random.default_rng(seed)
    start, end = rng.uniform(-1.7, 1.7, (2, 2))
    try:
        motion = line_motion(Links(), start, end, 1.0, elbow=elbow)
    except InputError:
        assume(False)  # out of reach or through the hole
    t = np.linspace(0.0, 1.0, 2001)
    state = motion.state(t)
    step = np.abs(np.diff(state.angle, axis=0))
    assert np.all(step <= 2.0 * np.max(np.abs(state.rate), axis=0) * 5e-4 + 1e-9)
    bend = state.angle[:, 1]
    assert np.all(bend <= 0.0) if elbow == "up" else np.all(bend >= 0.0)


def test_posture_selects_one_of_many_solutions():
    arm = Links((1.0, 1.0, 1.0))
    zigzag = np.array([0.8, -1.9, 1.5])
    motion = line_motion(arm, [1.6, 0.4], [0.5, 1.5], 1.0, posture=zigzag)
    default = line_motion(arm, [1.6, 0.4], [0.5, 1.5], 1.0)
    assert np.max(np.abs(motion.joint_angle(0.0) - zigzag)) < 0.6
    assert np.max(np.abs(motion.joint_angle(0.0) - default.joint_angle(0.0))) > 1.0
    np.testing.assert_allclose(motion.tip(T), default.tip(T), rtol=0, atol=1e-13)


def test_three_links_may_pass_the_base():
    motion = line_motion(Links((1.0, 1.0, 1.0)), [-0.5, 0.0], [0.8, 0.0], 1.0)
    assert np.min(np.hypot(*motion.tip(np.linspace(0, 1, 2001)).T)) < 1e-3


def test_line_may_be_a_point():
    motion = line_motion(Links(), [2.0, 1.0], [2.0, 1.0], 1.0)
    assert np.all(motion.joint_rate(T) == 0.0)


def test_margins_are_as_stated():
    reach = np.sum(Links().lengths)
    for distance in (reach * (1 - 2e-6), 0.4142 + 2e-6 * reach):
        motion = line_motion(Links(), [distance, 0.0], [1.0, 0.2], 1.0)
        assert np.all(np.isfinite(motion.joint_acceleration(T)))


def test_least_norm_path_stops_where_the_arm_is_straight():
    lengths, first = np.ones(3), np.array([0.6, -0.6, -0.6])
    start = np.array([2 * np.cos(0.6) + 1.0, 0.0])
    path = line_path(start, start + np.array([2.0, 0.0]))
    with pytest.raises(SingularPathError) as stop:
        least_norm_path(RigidChain(lengths, np.zeros(3), np.zeros(2)), path, first)
    reached = np.cumsum(stop.value.posture)
    assert np.hypot(np.cos(reached).sum(), np.sin(reached).sum()) == pytest.approx(3.0, abs=1e-5)
    stretch = np.linalg.svd(tip_jacobian(lengths, stop.value.posture), compute_uv=False)[-1]
    assert stretch == pytest.approx(3e-4, rel=1e-3)  # it stops at its limit, 1e-4 of the reach
