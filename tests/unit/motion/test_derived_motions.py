"""Shaped, smoothed and flexible references obey the contract of `Motion`, too."""

import numpy as np
import pytest
from motion_checks import Links, assert_scalars_and_arrays_agree, derivative, smooth_times

import flexarm as fa
from arms import table_one_arm
from flexarm.motion import joint_motion, line_motion


def line(profile="quintic", start_time=0.4):
    return line_motion(Links(), [2.0, 1.0], [1.0, 2.0], 1.2, profile, start_time=start_time)


def way(profile="quintic"):
    return joint_motion(Links((1.0, 0.8)), [0.3, -2.0], [-1.0, 0.5], 0.9, profile, start_time=0.1)


def arm():
    return table_one_arm(joints=[fa.Joint(hub_inertia=0.1), fa.Joint(mass=0.5)])


def changing_frequency(method, **options):
    """Return the frequencies of two masses, which change by a tenth along the motion."""
    return fa.shaped(fa.line_motion(arm(), (2.0, 1.0), (0.5, 0.6), 1.0), arm(), method, **options)


MOTIONS = {
    "zv": lambda: fa.shaped(line(), method="zv", frequency_hz=3.0),
    "zvd, damped": lambda: fa.shaped(way(), frequency_hz=2.0, damping_ratio=0.1),
    "ei, two modes": lambda: fa.shaped(line(), method="ei", frequency_hz=[2.0, 7.0]),
    "zv of trapezoids": lambda: fa.shaped(way("trapezoidal"), method="zv", frequency_hz=1.1),
    "si, damped": lambda: fa.shaped(way(), method="si", frequency_hz=2.0, damping_ratio=0.1),
    "zvd along modes": lambda: changing_frequency("zvd"),
    "zv along two modes": lambda: changing_frequency("zv", modes=[2, 1]),
    "moving average": lambda: fa.smoothed(line(), 0.3, "moving_average"),
    "raised cosine": lambda: fa.smoothed(way("trapezoidal"), 0.25),
    "longer than the motion": lambda: fa.smoothed(way(), 1.7),
    "smoothed and shaped": lambda: fa.shaped(fa.smoothed(way(), 0.2), frequency_hz=2.5),
    "quasi-static": lambda: fa.quasi_static_reference(
        arm(), fa.line_motion(arm(), (2.0, 1.0), (1.0, 2.0), 1.0, start_time=0.3)
    ),
    "quasi-static, trapezoids": lambda: fa.quasi_static_reference(
        arm(),
        fa.joint_motion(arm(), [0.0, 1.0], [0.7, 0.2], 1.5, "trapezoidal", start_time=0.1),
        smoothing=0.15,
    ),
}


@pytest.fixture(params=MOTIONS, scope="module")
def motion(request):
    return MOTIONS[request.param]()


@pytest.mark.sampled(
    "zv", "ei, two modes", "moving average", "smoothed and shaped", "quasi-static, trapezoids"
)
def test_breaks_span_the_motion(motion):
    assert motion.breaks[0] == motion.start_time
    assert motion.breaks[-1] == motion.end_time
    assert np.all(np.diff(motion.breaks) > 0.0)


@pytest.mark.thorough_cases("si, damped", "zv along two modes")
def test_motion_is_at_rest_before_and_after(motion):
    start, end = motion.start_time, motion.end_time
    before = motion.state([-np.inf, start - 3.0, np.nextafter(start, -np.inf)])
    after = motion.state([end, end + 0.1, end + 50.0, np.inf])
    for rest, there in [(before, start), (after, np.nextafter(end, 0.0))]:
        assert np.all(rest.rate == 0.0)
        assert np.all(rest.acceleration == 0.0)
        # Averages of the same angle, to rounding.
        np.testing.assert_allclose(
            rest.angle, rest.angle[:1].repeat(len(rest.angle), 0), atol=3e-15
        )
        np.testing.assert_allclose(motion.joint_angle(there), rest.angle[0], rtol=0, atol=1e-12)


def test_rates_and_accelerations_are_the_derivatives(motion):
    step = 5e-4
    gaps = np.diff(motion.breaks)
    t = np.concatenate(
        [
            smooth_times((a, a + gap), away=3.5 * step, count=21)
            for a, gap in zip(motion.breaks, gaps, strict=False)
            if gap > 10.0 * step
        ]
    )
    rate = derivative(motion.joint_angle, t, step)
    acceleration = derivative(motion.joint_rate, t, step)
    # Sixth order: step^6 = 2e-20 times the seventh derivative, up to 1e10 where frequencies or
    # bending are splines; rounding is 1e-15 / step.
    np.testing.assert_allclose(rate, motion.joint_rate(t), rtol=0, atol=3e-9)
    np.testing.assert_allclose(acceleration, motion.joint_acceleration(t), rtol=0, atol=3e-7)


def test_angles_and_rates_are_continuous_at_breaks(motion):
    for time in motion.breaks:
        left, right = motion.state(np.nextafter(time, -np.inf)), motion.state(time)
        np.testing.assert_allclose(left.angle, right.angle, rtol=0, atol=1e-12)
        np.testing.assert_allclose(left.rate, right.rate, rtol=0, atol=1e-10)


def test_scalars_and_arrays_agree(motion):
    # Sums of a hundred terms in another order, times 1e4 in accelerations.
    assert_scalars_and_arrays_agree(motion, atol=1e-11)
    assert motion.state(np.zeros(0)).angle.shape == (0, motion.joints)
    with pytest.raises(fa.InputError, match="nan"):
        motion.joint_angle(np.nan)


def test_values_on_both_sides_of_a_break():
    """Accelerations of a trapezoid jump in every copy, to the bit."""
    original = way("trapezoidal")
    motion = fa.shaped(original, method="zv", frequency_hz=1.1)
    for time in motion.breaks:
        left = motion.joint_acceleration(np.nextafter(time, -np.inf))
        right = motion.joint_acceleration(time)
        assert np.abs(left - right).max() > 0.1


def test_impulse_is_a_delayed_copy():
    """Constant frequency: the sum by hand."""
    original = line()
    motion = fa.shaped(original, method="zvd", frequency_hz=2.0)
    t = np.linspace(0.0, 3.0, 301)
    for ask in ("joint_angle", "joint_rate", "joint_acceleration"):
        copies = [getattr(original, ask)(t - delay) for delay in (0.0, 0.25, 0.5)]
        wanted = 0.25 * copies[0] + 0.5 * copies[1] + 0.25 * copies[2]
        np.testing.assert_allclose(getattr(motion, ask)(t), wanted, rtol=0, atol=1e-12)
    np.testing.assert_allclose(motion.delays, [[0.0, 0.25, 0.5]] * 2, atol=1e-14)


@pytest.mark.parametrize("window", ["moving_average", "raised_cosine"])
def test_smoothed_motion_is_the_average(window):
    """Against SciPy's adaptive quadrature."""
    from scipy.integrate import quad

    original, span = way(), 0.35
    motion = fa.smoothed(original, span, window)
    weight = {
        "moving_average": lambda a: 1.0 / span,
        "raised_cosine": lambda a: (1.0 - np.cos(2.0 * np.pi * a / span)) / span,
    }[window]
    for t in (0.15, 0.5, 1.05, 1.3):

        def share(age, t=t):
            return weight(age) * original.joint_angle(t - age)[1]

        inside = [t - b for b in original.breaks if 0.0 < t - b < span]
        wanted = quad(share, 0.0, span, points=inside or None, epsabs=1e-13, epsrel=1e-13)[0]
        np.testing.assert_allclose(motion.joint_angle(t)[1], wanted, rtol=0, atol=1e-11)


@pytest.mark.thorough
def test_rigid_torque_along_a_shaped_motion():
    motion = changing_frequency("ei")
    torque = fa.rigid_torque(arm(), motion)
    run = fa.simulate(arm().rigid(), 2.5, torque=torque, rate=100.0)
    wanted = motion.joint_angle(run.time.values)
    # The tolerance of the run.
    np.testing.assert_allclose(run.joint_angle.values, wanted, rtol=0, atol=1e-6)
