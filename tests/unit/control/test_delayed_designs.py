"""LQG, composite control and loop shaping that are designed for the delay of a drive."""

from functools import partial

import numpy as np
import pytest

import flexarm as fa
from arms import chain

POSTURE, DELAY = [0.3], 3e-3
LATE = fa.Hardware(motors=fa.Motors(delay=DELAY))


@pytest.fixture(scope="module")
def arm():
    rod = {"flexural_rigidity": 20.0, "mass_per_length": 0.5, "elements": 1, "damping": 0.01}
    more = {"gauge": (0.02, 0.004), "payload": 0.1, "gravity": (0.0, -9.81)}
    return chain([0.8], [0.05], **rod, **more)


@pytest.mark.parametrize("kind", [fa.LQG, fa.Composite])
def test_poles_are_those_without_delay(arm, kind):
    """A state that is predicted exactly is fed back as if nothing were late; other poles are zero.

    This is the separation of prediction and feedback: Artstein, IEEE Trans. Automatic Control 27
    (1982) 869-879.
    """
    # Integrals add errors in front of the delay, at which the state is not predicted.
    make = partial(kind, arm, POSTURE, integral=False)
    prompt = fa.loop_margins(make(), arm, [POSTURE])
    late = fa.loop_margins(make(delay=DELAY), arm, [POSTURE], hardware=LATE)
    # Zeros of multiplicity three are computed to the cube root of the rounding error.
    expected, found = prompt.growth.item(), late.growth.item()
    assert found == pytest.approx(expected, rel=1e-6)
    # The design without the delay is unstable, or nearly so.
    careless = fa.loop_margins(make(), arm, [POSTURE], hardware=LATE)
    assert careless.disk_margin.item() < 0.5 * late.disk_margin.item()


def test_errors_along_a_motion_are_those_without_delay(arm):
    motion = fa.quasi_static_reference(arm, fa.joint_motion(arm, [0.0], [0.5], 1.0))
    errors = []
    for delay, hardware in ((0.0, None), (DELAY, LATE)):
        run = fa.simulate(
            arm,
            1.5,
            controller=fa.LQG(arm, POSTURE, delay=delay),
            reference=motion,
            hardware=hardware,
            initial=motion.initial,
            rate=200.0,
        )
        angle = np.array([motion.joint_angle(t) for t in run.time.values])
        errors.append(np.abs(run.joint_angle.values - angle).max())
    prompt, late = errors
    # Late motors let the arm fall for three samples at the start, by 0.1 mrad.
    assert late == pytest.approx(prompt, abs=2e-4)


def test_loop_shaping_keeps_its_margin(arm):
    late = fa.LoopShaping(arm, POSTURE, bandwidth=20.0, delay=DELAY)
    careless = fa.LoopShaping(arm, POSTURE, bandwidth=20.0)
    disk = [
        fa.loop_margins(law, arm, [POSTURE], hardware=LATE).disk_margin.item()
        for law in (late, careless)
    ]
    assert disk[0] > 1.1 * disk[1]
    growth = fa.loop_margins(late, arm, [POSTURE], hardware=LATE).growth.item()
    # The design computes the poles of its own delayed model with exact rates.
    assert late.designs[0].growth == pytest.approx(growth, rel=1e-6)


def test_sample_times_that_are_too_long_are_refused(arm):
    rule = "sample_time must be at most 0.0[0-9]+ s for this arm"
    for kind in (fa.LQG, fa.Composite, fa.LoopShaping):
        with pytest.raises(fa.InputError, match=rule):
            kind(arm, POSTURE, sample_time=0.2)
    with pytest.raises(fa.InputError, match=rule):
        fa.MPC(arm, POSTURE, torque_limit=5.0, sample_time=0.2)
    law = fa.LQG(arm, POSTURE)
    with pytest.raises(fa.InputError, match=rule):
        law.sample_time = 0.2
    inner = fa.JointPD(5.0, 1.0, sample_time=0.2)
    with pytest.raises(fa.InputError, match=rule):
        fa.IntegralResonantControl(arm, inner, posture=POSTURE)
    with pytest.raises(fa.InputError, match=rule):
        fa.SlidingMode(arm, bandwidth=2.0, boundary_layer=0.1, sample_time=0.2)
    with pytest.raises(fa.InputError, match=rule):
        fa.DisturbanceObserver(arm, inner)
    for kind, more in (
        (fa.ComputedTorque, {"frequency_hz": 0.5}),
        (fa.HybridForce, {}),
        (fa.Impedance, {}),
    ):
        with pytest.raises(fa.InputError, match=rule):
            kind(arm, sample_time=0.2, **more)
    fast, sampled = {"bandwidth": 60.0, "sample_time": 0.02}, r"at most 50 rad/s, got 60 rad/s"
    with pytest.raises(fa.InputError, match=sampled):
        fa.LoopShaping(arm, POSTURE, **fast)
    with pytest.raises(fa.InputError, match=sampled):
        fa.Adaptive(arm, damping=1.0, adaptation=1.0, **fast)
