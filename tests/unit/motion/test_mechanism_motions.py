"""Motions of mechanisms whose joints, or whose tip, are given, and the torques of their motors."""

from __future__ import annotations

import numpy as np
import pytest

import flexarm as fa
from closed_mechanisms import CLOSED, FOUR_BAR, Closed, five_bar, four_bar, parallelograms
from oracles.mechanisms import oracle_of
from oracles.rigid_mechanisms import eksergian

#: Joints with a motor, as many as the mechanism has degrees of freedom.
DRIVEN = {
    "four_bar": [1],
    "slider_crank": [1],
    "five_bar": [1, 3],
    "three_rrr": [1, 3, 5],
    "cylinder_boom": [3],
    "parallelograms": [1],
}
TIMES = np.array([0.13, 0.4, 0.77])
#: Accelerations between the postures of the table have an error of 1e-8 of the largest one.
TABLE = 1e-7


def moved(closed: Closed, by: float, driven: list[int], duration: float = 1.0) -> fa.Motion:
    arm = fa.Arm(**closed.fields)
    return fa.joint_motion(arm, closed.joints, closed.joints + by, duration, driven=driven)


def test_a_turn_of_the_crank_is_that_in_closed_form():
    motion = moved(four_bar(), 2.0 * np.pi, [1])
    for angle, rate, acceleration in zip(*motion.state(TIMES), strict=True):
        theta, phi, psi = FOUR_BAR.angles(angle[0])
        expected = [theta.value, phi.value - theta.value, psi.value]
        turns = (angle - expected) / (2.0 * np.pi)
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-12)  # rounding
        rates = [theta.first, phi.first - theta.first, psi.first]
        np.testing.assert_allclose(rate, np.array(rates) * rate[0], rtol=0, atol=TABLE)
        bars = [a.acceleration(rate[0], acceleration[0]) for a in (theta, phi, psi)]
        turning = [bars[0], bars[1] - bars[0], bars[2]]
        np.testing.assert_allclose(acceleration, turning, rtol=0, atol=40.0 * TABLE)


def test_the_torque_of_the_crank_is_that_of_eksergian():
    closed = four_bar()
    motion = moved(closed, 2.0 * np.pi, [1])
    torque = fa.rigid_torque(fa.Arm(**closed.fields), motion)(TIMES)
    assert not np.any(torque[:, 1:])
    state = motion.state(TIMES)
    for k in range(len(TIMES)):
        bodies = FOUR_BAR.bodies(state.angle[k, 0])
        free, unit = (
            eksergian(bodies, state.rate[k, 0], moment, FOUR_BAR.gravity) for moment in (0.0, 1.0)
        )
        expected = (state.acceleration[k, 0] - free) / (unit - free)
        np.testing.assert_allclose(torque[k, 0], expected, rtol=TABLE)


@pytest.mark.parametrize("name", DRIVEN)
def test_torques_of_motors_cause_the_motion(name):
    closed, driven = CLOSED[name](), DRIVEN[name]
    motion = moved(closed, 0.15, driven)
    rigid = fa.Arm(**closed.fields).rigid()
    torque = fa.rigid_torque(rigid, motion)(TIMES)
    passive = np.setdiff1d(np.arange(rigid.n_joints), np.array(driven) - 1)
    assert not np.any(torque[:, passive])
    for k, (q, qd, qdd) in enumerate(zip(*motion.state(TIMES), strict=True)):
        assert np.max(np.abs(rigid.closure_gaps(q))) < 1e-11
        found = rigid.forward_dynamics(q, qd, torque[k])
        np.testing.assert_allclose(found, qdd, rtol=0, atol=TABLE * np.max(np.abs(qdd)) + TABLE)
    if name != "parallelograms":  # its closures depend on each other: the oracle refuses
        oracle = oracle_of(rigid).at(q, qd, torque[-1])
        np.testing.assert_allclose(oracle.acceleration, qdd, rtol=0, atol=10.0 * TABLE)


def test_more_motors_than_needed_have_the_torques_of_least_norm():
    closed = five_bar(gravity=(0.0, -9.81))
    arm = fa.Arm(**closed.fields).rigid()
    motion = moved(closed, 0.3, [1, 3])
    few, many = fa.rigid_torque(arm, motion), fa.rigid_torque(arm, motion, actuated=[1, 2, 3, 4])
    q, qd, qdd = motion.state(0.4)
    assert np.linalg.norm(many(0.4)) < 0.9 * np.linalg.norm(few(0.4))
    found = arm.forward_dynamics(q, qd, many(0.4))
    np.testing.assert_allclose(found, qdd, rtol=0, atol=1e-6)
    # Torques of least norm do no work against torques that move nothing: those of closures.
    idle = arm.closure_jacobian(q)
    np.testing.assert_allclose(idle @ many(0.4), 0.0, atol=1e-9)


def test_a_mechanism_at_rest_is_held_against_gravity():
    closed = four_bar(flexible=False)
    arm = fa.Arm(**closed.fields)
    torque = fa.rigid_torque(arm, moved(closed, 1.0, [1]))
    for t, posture in ((-1.0, closed.joints), (2.0, moved(closed, 1.0, [1]).joint_angle(2.0))):
        rest = fa.equilibrium(arm, posture, held=[1])
        np.testing.assert_allclose(torque(t), rest.torque, rtol=1e-9, atol=1e-12)


def test_parallelograms_stay_parallelograms():
    closed = parallelograms(2)
    turned = moved(closed, 0.5, [1]).joint_angle(1.0) - closed.joints
    np.testing.assert_allclose(turned, [0.5, -0.5, 0.5, -0.5, 0.5], atol=1e-12)


def test_the_tip_of_a_five_bar_follows_a_path():
    closed = five_bar()
    arm = fa.Arm(**closed.fields)
    start = arm.rigid().tip(closed.joints)[:2]
    points = [start, [-0.1, 0.6], [0.1, 0.6]]
    motion = fa.via_point_motion(arm, points, 1.0, posture=closed.joints)
    path = fa.line_motion(arm, start, [-0.1, 0.6], 1.0, posture=closed.joints)
    np.testing.assert_allclose(motion.tip([0.0, 1.0]), [start, points[2]], atol=1e-12)
    assert len(motion.breaks) == 4  # both ends of the corner
    middle = path.state(0.5)
    np.testing.assert_allclose(path.tip(0.5), 0.5 * (start + points[1]), atol=1e-10)
    torque = fa.rigid_torque(arm, path, actuated=[1, 3])(0.5)
    found = arm.rigid().forward_dynamics(middle.angle, middle.rate, torque)
    np.testing.assert_allclose(found, middle.acceleration, rtol=0, atol=1e-6)
    end = fa.inverse_kinematics(arm, points[1], posture=closed.joints)
    np.testing.assert_allclose(path.joint_angle(1.0), end, atol=1e-9)


def test_the_tip_of_a_gantry_follows_a_circle():
    beam = {"mass_per_length": 1.0, "flexible": False}
    arm = fa.Arm(
        links=[fa.Link(length=0.1, **beam), fa.Link(length=0.3, **beam)],
        joints=[fa.Joint(kind="prismatic"), fa.Joint(kind="prismatic", axis=(0.0, 1.0))],
    )
    motion = fa.circle_motion(arm, [0.0, 0.5], [0.4, 0.5], np.pi, 1.0, posture=[0.0, 0.5])
    tip = arm.tip(arm.rest(motion.joint_angle(0.3)))[:2]
    np.testing.assert_allclose(np.hypot(tip[0], tip[1] - 0.5), 0.4, rtol=1e-10)
    np.testing.assert_allclose(motion.joint_angle(1.0), [-0.8, 0.5], atol=1e-12)


@pytest.mark.thorough
def test_torques_of_flexible_links_keep_the_crank_on_its_motion():
    closed = four_bar()
    arm = fa.Arm(**closed.fields)
    motion = moved(closed, 1.0, [1])
    torque = fa.flexible_torque(arm, motion)
    run = fa.simulate(arm, 1.0, torque=torque, initial=torque.initial, rate=100)
    error = run.joint_angle.values[:, 0] - motion.joint_angle(run.time.values)[:, 0]
    assert np.max(np.abs(error)) < 1e-7  # ten times the tolerance of both runs
    assert not np.any(run.torque.values[:, 1:])
