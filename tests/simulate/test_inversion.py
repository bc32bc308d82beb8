"""Torques by inversion, judged by simulating the full model under them."""

import numpy as np
import pytest

import flexarm as fa


def paper_arm(**fields):
    rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
    links = [fa.Link(length=1.4142, elements=2, **rod), fa.Link(length=1.0, elements=1, **rod)]
    return fa.Arm(links=links, **fields)


def paper_line(arm, **fields):
    given = {"duration": 1.0, "start_time": 0.25, **fields}
    return fa.line_motion(arm, start=(2.0, 1.0), end=(1.0, 2.0), **given)


def tip_error(arm, motion, torque, initial, duration):
    run = fa.simulate(arm, duration, torque=torque, initial=initial, rtol=1e-9, atol=1e-11)
    return np.hypot(*(run.tip.values - motion.tip(run.time.values)).T).max()


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_tip_error_on_the_papers_line(theory):
    """Issue 5 asks for a hundredth of the error under rigid torques; it is a five-hundredth."""
    arm = paper_arm(theory=theory)
    line = paper_line(arm)
    found = fa.tip_inversion(arm, line)
    straight = arm.rest(line.joint_angle(0.0))
    np.testing.assert_allclose(found.initial, straight, atol=1e-12)
    rigid = tip_error(arm, line, fa.rigid_torque(arm, line), straight, 1.6)
    own = tip_error(arm, line, found.torque, found.initial, 1.6)
    assert own < rigid / 300.0
    # It judges itself at the same tolerance as any run, and over the same time.
    assert found.tip_error == pytest.approx(own, rel=0.3)
    assert 0.1 < found.pre_actuation < 0.25
    # The zeros that make it non-minimum phase: as many grow as decay.
    assert (
        np.count_nonzero(found.zeros.real > 1.0) == np.count_nonzero(found.zeros.real < -1.0) == 6
    )


@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")  # a soft link, to be seen
def test_single_link_under_gravity():
    """It sags at both ends; the tip of one link is kept in the direction of the rigid one."""
    link = fa.Link(length=1.0, elements=3, flexural_rigidity=10.0, mass_per_length=0.6)
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.1)], gravity=(0.0, -9.81))
    motion = fa.joint_motion(arm, [0.0], [1.0], 0.6, start_time=0.5)
    found = fa.tip_inversion(arm, motion)
    run = fa.simulate(arm, 1.7, torque=found.torque, initial=found.initial)
    seen = np.arctan2(run.tip.values[:, 1], run.tip.values[:, 0])
    wanted = motion.joint_angle(run.time.values)[:, 0]
    assert np.abs(seen - wanted).max() < 5e-4  # 0.1 rad and more under rigid torques
    assert abs(found.initial[0]) > 0.05  # the joint is raised where the link sags


def test_refused():
    arm = paper_arm()
    with pytest.raises(fa.InputError, match=r"start at 0\.19"):
        fa.tip_inversion(arm, paper_line(arm, start_time=0.0))
    with pytest.raises(fa.InputError, match="bends"):
        fa.tip_inversion(arm.rigid(), paper_line(arm))
    straight = fa.joint_motion(arm, [0.2, -0.3], [0.2, 0.3], 1.0, start_time=0.3)
    with pytest.raises(fa.InputError, match="cannot move the tip"):
        fa.tip_inversion(arm, straight)


def test_what_cannot_be_done_says_how_far_it_came():
    arm = paper_arm()
    with pytest.raises(fa.InversionError) as raised:
        fa.tip_inversion(arm, paper_line(arm, duration=0.25))
    assert raised.value.tip_error > 0.0


@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")  # twice as fast as the paper
@pytest.mark.parametrize("profile", ["quintic", "trapezoidal"])
def test_joints_follow_under_flexible_torque(profile):
    arm = paper_arm()
    line = paper_line(arm, profile=profile, start_time=0.013)
    torque = fa.flexible_torque(arm, line, 1.2)
    run = fa.simulate(arm, 1.2, torque=torque, rtol=1e-9, atol=1e-11)
    away = np.abs(run.joint_angle.values - line.joint_angle(run.time.values)).max()
    # The tolerance of the integration, over the run; rigid torques leave 0.05 and 0.24 rad.
    assert away < 1e-7
    assert torque(np.array([0.1, 0.2])).shape == (2, 2)
