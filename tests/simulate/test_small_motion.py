"""Motions from a hundredth of the reach down to a millionth of it, of arms of all sizes."""

import warnings

import numpy as np
import pytest
from scipy.linalg import expm

import flexarm as fa

SIZES = [100.0, 1.0, 1e-2, 1e-4]
PERIODS = 20


def beam(length, rigidity=1.0):
    """Return a clamped aluminium beam with one shape for all lengths."""
    section = fa.Rectangle(width=length / 10, height=length / 50)
    material = fa.Material(density=2700, youngs_modulus=rigidity * 70e9)
    link = fa.Link(length=length, material=material, section=section, elements=4, modes=3)
    return fa.Arm(links=[link], joints=[fa.Joint(fixed=True)])


def bent(arm, share):
    """Return the coordinates of a beam with a tip deflection of a share of its length."""
    length = arm.lengths[0]
    stiffness = 3.0 * arm.spec.links[0].beam().flexural_rigidity[0] / length**3
    return fa.equilibrium(arm, tip_force=[0.0, share * length * stiffness]).q


def released(arm, share, **options):
    """Release a bent beam; return the result and its error relative to the largest coordinate."""
    frequency, q = fa.modes(arm).frequency_hz[0], bent(arm, share)
    rate = 10.0 * frequency
    run = fa.simulate(arm, PERIODS / frequency, initial=q, rate=rate, **options)
    step, state, exact = expm(np.asarray(fa.linearize(arm).A) / rate), np.r_[q, 0.0 * q], []
    for _ in run.time:
        exact.append(state[: len(q)])
        state = step @ state
    return run, np.abs(run.q.values - np.array(exact)).max() / np.abs(q).max()


@pytest.mark.sampled("1e-06")
@pytest.mark.parametrize("share", [1e-2, 1.1e-3, 1e-4, 1e-6])
def test_released_beams_of_all_sizes_have_the_same_small_error(share):
    """Motions just above the limit of the repetition have the largest error, 1.5e-4."""
    errors, steps = [], []
    for length in SIZES:
        run, error = released(beam(length), share)
        errors.append(error)
        steps.append(run.steps)
        assert run.warning == ""
    assert max(errors) < 2e-4
    np.testing.assert_allclose(errors, errors[0], rtol=0.2)  # rounding of unequal numbers
    assert np.ptp(steps) <= 2


@pytest.mark.parametrize("rigidity", [1e-6, 1e6])
def test_steps_in_a_period_do_not_depend_on_the_rigidity(rigidity):
    usual, error = released(beam(1.0), 1e-4)
    run, other = released(beam(1.0, rigidity), 1e-4)
    assert abs(run.steps - usual.steps) <= 2
    assert other == pytest.approx(error, rel=0.2)


def test_motion_near_a_requested_tolerance_warns_and_is_right():
    """Without the repetition the error was 73 % at a tenth of a millimetre."""
    with pytest.warns(fa.AccuracyWarning, match="is near the whole motion of"):
        run, error = released(beam(1e-4), 1e-4, atol=1e-9)
    assert error < 1e-4
    assert run.atol < 1e-14
    assert "Reduce atol, or omit it" in run.warning


def test_requested_tolerances_below_the_motion_do_not_warn():
    run, _ = released(beam(1.0), 1e-2, atol=1e-9)
    assert run.atol == 1e-9
    assert run.warning == ""
    loose, _ = released(beam(1.0), 1e-2, rtol=1e-3, atol=1e-5)  # the relative one is as large
    assert loose.atol == 1e-5
    assert loose.warning == ""


def test_searched_step_that_is_too_long_for_a_small_motion_warns():
    """The search allows 1e-4 of the reach, which is the whole motion here."""
    with pytest.warns(fa.AccuracyWarning, match="give a shorter step"):
        _, error = released(beam(1.0), 1e-4, integrator="generalized_alpha")
    assert error > 0.01
    assert released(beam(1.0), 1e-2, integrator="rk4")[0].warning == ""


def test_smooth_motion_near_a_requested_tolerance_does_not_warn():
    """A rigid arm that falls for 10 ms: the steps are exact whatever the tolerance."""
    arm = fa.Arm(
        links=[fa.Link(length=1.0, mass_per_length=1.0, flexible=False)], gravity=(0.0, -9.81)
    )
    assert fa.simulate(arm, 1e-3, atol=1e-6).warning == ""


@pytest.mark.parametrize("gravity", [(0.0, 0.0), (0.0, -9.81)])
def test_arm_at_rest_does_not_warn(gravity):
    """Steps may add motions as large as the tolerance, which are none of the arm."""
    arm = fa.Arm(beam(1.0).spec.replace(gravity=gravity))
    q = fa.equilibrium(arm).q
    for atol in (None, 1e-6):
        run = fa.simulate(arm, 0.5, initial=q, atol=atol)
        assert run.warning == ""
        np.testing.assert_allclose(
            run.tip[:, :2], np.array([run.tip[0, :2]] * len(run.tip)), atol=1e-10
        )


def test_default_tolerance_follows_the_relative_one_and_the_reach():
    assert released(beam(100.0), 1e-2, rtol=1e-5)[0].atol == pytest.approx(1e-5, rel=1e-12)
    assert released(beam(1e-4), 1e-2)[0].atol == pytest.approx(1e-13, rel=1e-12)


@pytest.mark.thorough
def test_batches_repeat_the_same_runs():
    """Arms of three sizes in lanes, two with a motion that is repeated."""
    arms = [beam(1.0), beam(1e-3), beam(1e-4)]
    q = np.array([bent(arm, share) for arm, share in zip(arms, (1e-2, 1e-4, 1e-4), strict=True)])
    batch = fa.simulate_batch(arms, 1e-3, initial=q, rate=2e4, channels=["q"])
    for row, (arm, start) in enumerate(zip(arms, q, strict=True)):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            alone = fa.simulate(arm, 1e-3, initial=start, rate=2e4)
        np.testing.assert_array_equal(batch.q.values[row], alone.q.values)


def test_events_and_prescribed_joints_of_a_repeated_run():
    links = [fa.Link(length=1.0, flexural_rigidity=50.0, mass_per_length=1.0, elements=2)]
    arm = fa.Arm(links=links)

    turn = fa.PrescribedAngle(
        lambda t: 0.2 + 1e-5 * np.sin(3.0 * t),
        lambda t: 3e-5 * np.cos(3.0 * t),
        lambda t: -9e-5 * np.sin(3.0 * t),
    )
    event = fa.joint_event(arm, 1, 0.2 + 5e-6, direction=1)
    run = fa.simulate(arm, 1.0, prescribed={1: turn}, events=[event], rate=200.0)
    assert run.atol < 1e-11
    assert run.event_name.size == 1
    angle = 0.2 + 1e-5 * np.sin(3.0 * run.time.values)
    np.testing.assert_allclose(run.joint_angle.values[:, 0], angle, rtol=0, atol=1e-11)
