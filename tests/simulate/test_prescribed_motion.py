"""Joints with a prescribed motion: their torque, and the motion of the others."""

import numpy as np
import pytest

import flexarm as fa
from arms import ROD, table_one_arm


def swing(amplitude, omega, phase=0.0):
    """A sine about zero."""
    return fa.PrescribedAngle(
        lambda t: amplitude * np.sin(omega * t + phase),
        lambda t: amplitude * omega * np.cos(omega * t + phase),
        lambda t: -amplitude * omega**2 * np.sin(omega * t + phase),
    )


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_joint_follows_its_motion(theory):
    given = swing(0.15, 5.0, 0.3)
    arm = table_one_arm(theory=theory, gravity=(0.0, -2.0))
    result = fa.simulate(arm, 1.0, prescribed={1: given}, rate=200)
    exact = [(given.angle(t), given.rate(t)) for t in result.time.values]
    # The acceleration is interpolated a hundred times closer than the tolerance of 1e-7, and
    # integrated twice.
    np.testing.assert_allclose(result.joint_angle.values[:, 0], [a for a, _ in exact], atol=2e-8)
    np.testing.assert_allclose(result.joint_rate.values[:, 0], [r for _, r in exact], atol=1e-7)
    assert np.ptp(result.joint_angle.values[:, 1]) > 0.1  # the other joint is free
    np.testing.assert_array_equal(result.torque.values[:, 1], 0.0)


@pytest.mark.sampled("linear")
@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_torque_of_a_prescribed_joint_gives_the_same_motion(theory):
    # A prescribed joint has the smoothed law, whose torque a spline can follow.
    rubbing = fa.Joint(friction=fa.Friction(coulomb=0.2, smoothing_rate=0.01))
    joints = [fa.Joint(damping=0.3, stiffness=2.0), rubbing]
    arm = table_one_arm(theory=theory, gravity=(0.0, -9.81), joints=joints)
    motion = {1: swing(0.4, 5.0), 2: swing(-0.7, 4.0, 0.5)}
    moved = fa.simulate(arm, 0.5, prescribed=motion, rate=20000, rtol=1e-9, atol=1e-11)
    start = {"initial": moved.q.values[0], "initial_rate": moved.qd.values[0]}
    driven = fa.simulate(arm, 0.5, torque=moved.torque.values, rate=20000, rtol=1e-9, **start)
    # A spline through 20 kHz samples of torques that vibrate with the links' highest modes.
    np.testing.assert_allclose(driven.q.values, moved.q.values, rtol=0, atol=1e-6)


# The balance holds for any bending.
@pytest.mark.sampled("moved1")
@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")
@pytest.mark.parametrize("moved", [(1,), (2,), (1, 2)])
def test_power_balance(moved):
    """Work of all torques on the joints is the change of energy."""
    arm = table_one_arm(theory="second_order", gravity=(0.0, -9.81))
    motion = {joint: swing(0.3 * joint, 6.0) for joint in moved}
    torque = [1.0 if joint in moved else 0.5 for joint in (1, 2)]
    result = fa.simulate(
        arm, 0.5, prescribed=motion, torque=lambda t: torque, rate=10000, rtol=1e-9, atol=1e-11
    )
    for joint in (1, 2):
        own = result.torque.sel(joint=joint).values
        if joint in moved:
            assert np.ptp(own) > 1.0  # not the requested torque, which such a joint ignores
        else:
            np.testing.assert_array_equal(own, 0.5)
    energy = (result.kinetic_energy + result.strain_energy + result.gravity_energy).values
    power = np.sum(result.torque.values * result.joint_rate.values, axis=1)
    work = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * 1e-4)])
    # The trapezoidal rule at 10 kHz on a torque that vibrates at up to 500 Hz.
    scale = abs(energy - energy[0]).max()
    np.testing.assert_allclose(energy - energy[0], work, rtol=0, atol=2e-3 * scale)


def test_motion_of_all_joints_is_divided_among_them():
    arm = table_one_arm()
    motion = fa.line_motion(arm, start=(2.0, 1.0), end=(1.0, 2.0), duration=1.5)
    both = fa.simulate(arm, 1.7, prescribed={1: motion, 2: motion}, rate=100)
    requested = np.array([motion.joint_angle(t) for t in both.time.values])
    np.testing.assert_allclose(both.joint_angle.values, requested, atol=1e-7)
    rigid = fa.simulate(arm.rigid(), 1.5, prescribed={1: motion, 2: motion}, rate=100)
    torque = fa.rigid_torque(arm, motion)
    wanted = np.array([torque(t) for t in rigid.time.values])
    # Accelerations are interpolated to 1e-9 of the largest.
    np.testing.assert_allclose(rigid.torque.values, wanted, rtol=0, atol=1e-6 * abs(wanted).max())


def test_steps_end_at_breaks():
    """After a jump of the acceleration the angle is exactly its integral."""
    arm = table_one_arm().rigid()
    given = fa.PrescribedAngle(
        lambda t: 4.0 * np.clip(t - 0.2, 0.0, 0.5) ** 2 + 4.0 * max(t - 0.7, 0.0),
        lambda t: 8.0 * np.clip(t - 0.2, 0.0, 0.5),
        lambda t: 8.0 if 0.2 <= t < 0.7 else 0.0,
        breaks=(0.2, 0.7),
    )
    result = fa.simulate(arm, 1.0, prescribed={1: given}, rate=10)
    assert result.joint_rate.values[-1, 0] == pytest.approx(4.0, rel=1e-9)
    assert result.joint_angle.values[-1, 0] == pytest.approx(8 * 0.125 + 4 * 0.3, rel=1e-9)


def test_prescribed_joint_of_an_arm_with_segments():
    link = fa.Link(length=1.0, elements=4, segments=4, **ROD)
    arm = fa.Arm(links=[link, link], theory="second_order")
    result = fa.simulate(arm, 0.5, prescribed={2: swing(0.5, 6.0)}, rate=100)
    exact = 0.5 * np.sin(6.0 * result.time.values)
    np.testing.assert_allclose(result.joint_angle.values[:, 1], exact, atol=2e-8)
