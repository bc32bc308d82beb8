"""Every kind of motion with every timing law obeys the contract of `Motion`."""

import numpy as np
import pytest
from motion_checks import Links, assert_scalars_and_arrays_agree, derivative, smooth_times

from flexarm.base.errors import InputError
from flexarm.motion import (
    TIMING_LAWS,
    circle_motion,
    joint_motion,
    line_motion,
    spline_motion,
    trapezoidal,
    via_point_motion,
)

FOUR_LINKS = (0.9, 0.7, 0.5, 0.6)


def joints_of_three(**timing):
    return joint_motion(Links((1.0, 0.8, 0.6)), [0.3, -2.0, 0.5], [-1.0, 4.0, 0.5], **timing)


def line_of_two(**timing):
    return line_motion(Links(), [2.0, 1.0], [1.0, 2.0], **timing)


def line_of_two_behind(**timing):
    return line_motion(Links(), [-1.5, 0.6], [-1.2, -0.9], elbow="down", **timing)


def line_of_four(**timing):
    return line_motion(Links(FOUR_LINKS), [1.5, 0.8], [-0.9, 1.1], **timing)


def line_of_four_from_posture(**timing):
    posture = [0.2, 1.0, -0.9, 0.8]
    return line_motion(Links(FOUR_LINKS), [1.5, 0.8], [1.6, -0.9], posture=posture, **timing)


def circle_of_two_about_the_base(**timing):
    return circle_motion(Links(), [0.2, -0.1], [1.6, 0.3], -7.0, **timing)


def circle_of_four(**timing):
    return circle_motion(Links(FOUR_LINKS), [1.2, 0.4], [1.6, 0.4], 4.0, **timing)


def spline_of_two(**timing):
    return spline_motion(Links(), [[2.0, 0.5], [1.6, 1.2], [0.5, 1.5], [-0.8, 1.6]], **timing)


def closed_spline_of_four(**timing):
    points = [[1.5, 0.2], [1.2, 0.9], [0.7, 0.6], [1.5, 0.2]]
    return spline_motion(Links(FOUR_LINKS), points, elbow="down", **timing)


def via_points_of_two(**timing):
    points = [[2.0, 0.5], [1.6, 1.2], [0.2, 1.5], [-0.8, 1.6]]
    return via_point_motion(Links(), points, blend=0.4, **timing)


def via_points_of_four(**timing):
    points = [[1.5, 0.2], [1.2, 1.1], [0.3, 0.6]]
    return via_point_motion(Links(FOUR_LINKS), points, blend=0.3, **timing)


MOTIONS = [
    joints_of_three,
    line_of_two,
    line_of_two_behind,
    line_of_four,
    line_of_four_from_posture,
    circle_of_two_about_the_base,
    circle_of_four,
    spline_of_two,
    closed_spline_of_four,
    via_points_of_two,
    via_points_of_four,
]
LAWS = [*TIMING_LAWS.values(), trapezoidal(0.5)]


@pytest.fixture(params=MOTIONS, ids=lambda make: make.__name__, scope="module")
def make(request):
    return request.param


@pytest.fixture(params=LAWS, ids=lambda law: f"{law.name}-{len(law.breaks)}", scope="module")
def motion(make, request):
    return make(duration=2.5, profile=request.param, start_time=0.7)


@pytest.mark.sampled(
    "quintic-2-joints_of_three",
    "trapezoidal-3-line_of_two_behind",
    "trapezoidal-4-line_of_four_from_posture",
    "trapezoidal-4-circle_of_four",
    "quintic-2-closed_spline_of_four",
    "quintic-2-via_points_of_four",
)
def test_breaks_span_the_motion(motion):
    of_the_law = {0.7 + 2.5 * u for u in motion.law.breaks[:-1]} | {motion.end_time}
    assert of_the_law <= set(motion.breaks)
    others = np.array(sorted(set(motion.breaks) - of_the_law))
    s = motion.law((others - 0.7) / 2.5).s
    # A time of 2 s rounds to 4e-16, at up to 0.8 path fractions per second.
    np.testing.assert_allclose(s, motion.path_breaks, rtol=0, atol=1e-15)
    assert list(motion.breaks) == sorted(set(motion.breaks))


@pytest.mark.thorough_cases(
    "line_of_four_from_posture",
    "closed_spline_of_four",
    "circle_of_four",
    "quintic-2-via_points_of_four",
    "trapezoidal-3-via_points_of_four",
    "quintic-2-line_of_four",
    "trapezoidal-3-line_of_four",
)
def test_motion_is_at_rest_before_and_after(motion):
    before = motion.state([-np.inf, -3.0, 0.0, np.nextafter(0.7, 0.0)])
    after = motion.state([motion.end_time, 3.3, 100.0, np.inf])
    for rest, there in [(before, 0.7), (after, np.nextafter(motion.end_time, 0.0))]:
        assert np.all(rest.rate == 0.0)
        assert np.all(rest.acceleration == 0.0)
        assert np.ptp(rest.angle, axis=0).max() == 0.0
        # Rates here are below 10 rad/s, so the next time in floating point moves less than the
        # rounding.
        np.testing.assert_allclose(motion.joint_angle(there), rest.angle[0], rtol=0, atol=1e-13)


@pytest.mark.thorough_cases(
    "line_of_four_from_posture",
    "closed_spline_of_four",
    "quintic-2-via_points_of_four",
    "trapezoidal-3-via_points_of_four",
    "quintic-2-line_of_four",
    "quintic-2-circle_of_four",
)
def test_rates_and_accelerations_are_the_derivatives(motion):
    step = 2.5e-3
    t = smooth_times(motion.breaks, away=3.5 * step)
    rate = derivative(motion.joint_angle, t, step)
    acceleration = derivative(motion.joint_rate, t, step)
    # Sixth order: (step / 2.5)^6 = 1e-18 times the seventh derivative, 1e6 and more where the line
    # passes near a singular posture; rounding is 1e-16 / step = 4e-14 times the angles.
    np.testing.assert_allclose(rate, motion.joint_rate(t), rtol=0, atol=2e-10)
    np.testing.assert_allclose(acceleration, motion.joint_acceleration(t), rtol=0, atol=1e-9)


@pytest.mark.sampled(
    "quintic-2-joints_of_three",
    "trapezoidal-3-line_of_two_behind",
    "trapezoidal-4-line_of_four_from_posture",
    "trapezoidal-4-circle_of_four",
    "quintic-2-closed_spline_of_four",
    "quintic-2-via_points_of_four",
)
def test_integral_of_the_rate_is_the_change_of_angle(motion):
    nodes, weights = np.polynomial.legendre.leggauss(200)
    way = np.zeros(motion.joints)
    for a, b in zip(motion.breaks[:-1], motion.breaks[1:], strict=True):
        t = 0.5 * (a + b) + 0.5 * (b - a) * nodes
        way += 0.5 * (b - a) * weights @ motion.joint_rate(t)
    total = motion.joint_angle(motion.end_time) - motion.joint_angle(motion.start_time)
    # So many points are exact to rounding; the least-norm path has an error of 1e-12.
    np.testing.assert_allclose(way, total, rtol=0, atol=1e-11)


@pytest.mark.thorough_cases(
    "line_of_four", "line_of_four_from_posture", "circle_of_four", "closed_spline_of_four"
)
def test_values_on_both_sides_of_a_break(make):
    motion = make(duration=1.3, profile="trapezoidal", start_time=0.1)
    for k, time in enumerate(motion.breaks):
        left = motion.state(np.nextafter(time, -np.inf))
        right = motion.state(time)
        np.testing.assert_allclose(left.angle, right.angle, rtol=0, atol=1e-12)
        np.testing.assert_allclose(left.rate, right.rate, rtol=0, atol=1e-12)
        jump = np.max(np.abs(left.acceleration - right.acceleration))
        if any(abs(time - 0.1 - 1.3 * u) < 1e-9 for u in motion.law.breaks):
            assert jump > 0.1, f"the acceleration should jump at break {k}"
        else:  # of the path
            assert jump < 1e-9 * np.max(np.abs(right.acceleration))


def test_scalars_and_arrays_agree(motion):
    assert_scalars_and_arrays_agree(motion, atol=1e-13)


@pytest.mark.thorough_cases(
    "line_of_four_from_posture", "circle_of_four", "closed_spline_of_four", "via_points_of_four"
)
def test_start_time_shifts_the_motion(make):
    early, late = make(duration=1.0), make(duration=1.0, start_time=2.0)
    t = np.linspace(0.0, 1.0, 17)  # sixteenths: t + 2 is exact
    for a, b in zip(early.state(t), late.state(t + 2.0), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.thorough_cases(
    "line_of_four_from_posture", "circle_of_four", "closed_spline_of_four", "line_of_four"
)
def test_slower_motion_has_the_same_path(make):
    fast, slow = make(duration=1.0), make(duration=4.0)
    t = np.linspace(0.0, 1.0, 17)
    a, b = fast.state(t), slow.state(4.0 * t)
    np.testing.assert_array_equal(a.angle, b.angle)
    np.testing.assert_allclose(a.rate, 4.0 * b.rate, rtol=1e-14)
    np.testing.assert_allclose(a.acceleration, 16.0 * b.acceleration, rtol=1e-13, atol=1e-12)


def test_motions_are_frozen(motion):
    with pytest.raises(AttributeError):
        motion.duration = 3.0


def test_nan_times_are_rejected(motion):
    with pytest.raises(InputError, match="t must be a time or an array of times, got"):
        motion.joint_rate([0.0, np.nan])


#: Wrong arguments of all motions, and the beginning of the message.
WRONG_TIMING = [
    ({"duration": 0.0}, r"_motion: duration must be greater than 0 s, got 0"),
    ({"duration": -1.0}, "duration must be greater than 0 s, got -1"),
    ({"duration": np.nan}, "duration must be finite"),
    ({"duration": [1.0, 2.0]}, "duration must be a number"),
    ({"duration": "long"}, "duration must be a number"),
    ({"duration": 1.0, "start_time": np.inf}, "start_time must be finite"),
    ({"duration": 1.0, "start_time": 1e12}, "start_time must be small enough to resolve"),
    ({"duration": 1.0, "profile": "sudden"}, "profile must be a TimingLaw or one of"),
]


def test_wrong_timing_is_rejected(make):
    for timing, message in WRONG_TIMING:
        with pytest.raises(InputError, match=message):
            make(**timing)
