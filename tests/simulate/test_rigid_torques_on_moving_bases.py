"""Rigid torques of arms whose base moves: runs of the rigid mechanism, momentum, closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import flexarm as fa
from closed_mechanisms import cooperating_arms
from flexarm.motion.dynamics.base_motion import BaseMotion

MASS, LENGTH = 0.4, 0.8
ROD = fa.Link(length=LENGTH, mass_per_length=MASS / LENGTH, flexible=False)
ANGLES = np.array([0.3, 0.5, -0.2])
MOVES = np.array([1.0, -1.2, 0.8])
FREE = ("x", "y", "angle")
WEIGHT = (0.0, -9.81)


def two_arms(gravity: tuple[float, float] = (0.0, 0.0), **base) -> fa.Arm:
    """Return an arm of two rods and an arm of one rod on a base."""
    return fa.Arm(
        base=fa.Base(mass=5.0, inertia=0.8, centre=(0.1, 0.05), **base),
        links=[ROD, ROD, ROD.replace(parent=0)],
        joints=[
            fa.Joint(offset=(0.4, 0.0)),
            fa.Joint(),
            fa.Joint(offset=(-0.4, 0.0), mounting_angle=np.pi),
        ],
        payload=fa.Payload(mass=0.3, inertia=0.01, offset=(0.1, 0.05)),
        gravity=gravity,
    )


BASES = {
    "free": two_arms(free=FREE),
    "free on a rail under gravity": two_arms(WEIGHT, free=("x",)),
    "on springs under gravity": two_arms(
        WEIGHT, free=FREE, stiffness=(300.0, 400.0, 50.0), damping=(3.0, 0.0, 1.0)
    ),
    "on a damper": two_arms(free=("angle",), damping=(0.0, 0.0, 2.0)),
}


@pytest.mark.parametrize("name", BASES)
def test_the_rigid_mechanism_follows_the_motion_under_its_torques(name):
    arm = BASES[name]
    motion = fa.joint_motion(arm, ANGLES, ANGLES + MOVES, 1.2, start_time=0.1)
    torque = fa.rigid_torque(arm, motion)
    start = arm.rest(ANGLES, base=torque.base_position(0.0))
    run = fa.simulate(arm, 2.0, torque=torque, initial=start, accuracy=1e-8)
    times = run.time.values
    # The accuracy of the run is that of its tip; joint errors without feedback accumulate.
    np.testing.assert_allclose(run.joint_angle.values, motion.joint_angle(times), atol=5e-7)
    np.testing.assert_allclose(run.base_position.values, torque.base_position(times), atol=1e-8)
    assert np.ptp(run.base_position.values, axis=0).max() > 0.01


def test_a_base_that_cannot_be_followed_is_an_error(monkeypatch):
    # Otherwise the base would stay at its start beyond the path that the solver found.
    arm = BASES["free"]
    motion = fa.joint_motion(arm, ANGLES, ANGLES + MOVES, 1.2)
    torque = fa.rigid_torque(arm, motion)
    monkeypatch.setattr(BaseMotion, "_slope", lambda self, t, state: np.full(state.size, np.nan))
    with pytest.raises(fa.InputError, match="motion of the base cannot be followed beyond t = 0 s"):
        torque.base_position(0.5)


def test_the_momentum_of_a_free_flyer_is_zero():
    """Of the bodies as points and rods, from differences of their positions."""
    arm = two_arms(free=FREE).spec.replace(payload=fa.Payload())
    arm = fa.Arm(arm)
    motion = fa.joint_motion(arm, ANGLES, ANGLES + MOVES, 1.2)
    torque = fa.rigid_torque(arm, motion)
    step = 1e-4
    for t in (0.2, 0.55, 1.0):
        now = t + step * np.array([-1.0, 1.0])
        masses, inertias = np.array([5.0, MASS, MASS, MASS]), MASS * LENGTH**2 / 12.0
        inertias = np.array([0.8, inertias, inertias, inertias])
        ends = torque.base_position(now), motion.joint_angle(now)
        before, after = np.array([_bodies(*pair) for pair in zip(*ends, strict=True)])
        rates, middle = (after - before) / (2.0 * step), 0.5 * (before + after)
        momentum = masses @ rates[:, :2]
        crossed = middle[:, 0] * rates[:, 1] - middle[:, 1] * rates[:, 0]
        angular = masses @ crossed + inertias @ rates[:, 2]
        moving = masses @ np.abs(rates[:, :2])
        # The error of the differences is of second order in the step.
        assert np.all(np.abs(momentum) < 1e-6 * moving.max())
        assert abs(angular) < 1e-6 * inertias @ np.abs(rates[:, 2])


def _bodies(base: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Return the centres and angles (4, 3) of base and rods."""

    def turned(angle: float, x: float, y: float) -> np.ndarray:
        return np.array(
            [x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)]
        )

    place, angle = base[:2], base[2]
    first, second, third = (
        angle + joints[0],
        angle + joints[0] + joints[1],
        angle + np.pi + joints[2],
    )
    root, other = place + turned(angle, 0.4, 0.0), place + turned(angle, -0.4, 0.0)
    elbow = root + turned(first, LENGTH, 0.0)
    centres = [
        place + turned(angle, 0.1, 0.05),
        root + turned(first, LENGTH / 2, 0.0),
        elbow + turned(second, LENGTH / 2, 0.0),
        other + turned(third, LENGTH / 2, 0.0),
    ]
    return np.column_stack([centres, [angle, first, second, third]])


def test_arms_with_a_common_object_follow_their_motor_on_a_free_base():
    closed = cooperating_arms()
    arm = fa.Arm(**closed.fields).rigid()
    motion = fa.joint_motion(arm, closed.joints, closed.joints + 0.15, 1.0, driven=[1])
    torque = fa.rigid_torque(arm, motion)
    run = fa.simulate(arm, 1.3, torque=torque, initial=arm.rest(closed.joints), accuracy=1e-8)
    times = run.time.values
    np.testing.assert_allclose(run.joint_angle.values, motion.joint_angle(times), atol=1e-8)
    np.testing.assert_allclose(run.base_position.values, torque.base_position(times), atol=1e-8)
    assert not np.any(run.torque.values[:, 1:])


FREQUENCY = 2.0


@pytest.mark.parametrize("name", ["free", "free on a rail under gravity", "with a common object"])
def test_errors_of_a_free_flyer_decay_as_in_closed_form_under_computed_torque(name):
    """From rest, so that the momentum is zero as in the model of the controller."""
    driven, by = None, 0.02
    if name == "with a common object":
        closed = cooperating_arms()
        arm, posture, driven = fa.Arm(**closed.fields).rigid(), closed.joints, [1]
        motion = fa.joint_motion(arm, posture, posture + 0.15, 1.0, driven=driven)
        start = fa.assembled(arm, arm.rest(posture + np.array([by, 0.0, 0.0, 0.0])), held=driven).q
    else:
        arm, posture = BASES[name], ANGLES
        motion = fa.joint_motion(arm, posture, posture + MOVES, 1.0)
        start = arm.rest(posture + by)
    law = fa.ComputedTorque(arm, FREQUENCY, actuated=driven)
    run = fa.simulate(arm, 0.6, controller=law, reference=motion, initial=start)
    t, omega = run.time.values, 2.0 * np.pi * FREQUENCY
    expected = by * (1.0 + omega * t) * np.exp(-omega * t)  # critically damped
    errors = run.joint_angle.values - motion.joint_angle(t)
    errors = errors[:, :1] if driven else errors
    # The zero-order hold delays by half a sample, 0.6 % of 1 / omega.
    np.testing.assert_allclose(errors, np.tile(expected[:, None], errors.shape[1]), atol=0.02 * by)


def test_small_deviations_from_a_motion_include_the_base():
    """Of a run of the flexible arm from the linear system, whose error is of second order."""
    link = {"mass_per_length": 0.5, "flexural_rigidity": 2000.0, "modes": 1}
    hub = fa.Joint(hub_inertia=0.05)
    arm = fa.Arm(
        base=fa.Base(mass=5.0, inertia=0.8, free=("x", "angle"), stiffness=(400.0, 0.0, 0.0)),
        links=[fa.Link(length=0.8, **link), fa.Link(length=0.6, **link)],
        joints=[hub.replace(offset=(0.4, 0.0)), hub],
        payload=fa.Payload(mass=0.3),
    )
    motion = fa.joint_motion(arm, [0.3, 0.5], [0.9, 0.0], 1.2)
    model = fa.linearize_along(arm, motion, rate=1000.0)
    A, f = CubicSpline(model.time, model.A), CubicSpline(model.time, model.f)
    run = fa.simulate(
        arm, 1.2, torque=fa.rigid_torque(arm, motion), accuracy=1e-8, rate=10.0,
        initial=arm.rest([0.3, 0.5]),
    )  # fmt: skip
    times = run.time.values
    path = solve_ivp(
        lambda t, x: A(t) @ x + f(t), (0.0, 1.2), np.zeros(2 * arm.dof), method="DOP853",
        rtol=1e-8, atol=1e-12, t_eval=times,
    )  # fmt: skip
    deviations = run.q.values - model.at(times).reference.q
    found = path.y[: arm.dof].T
    np.testing.assert_allclose(found, deviations, rtol=0, atol=2e-3 * np.abs(deviations).max())
    assert np.all(np.abs(deviations).max(axis=0) > 1e-7)


def test_bases_without_an_equilibrium_or_with_the_ground_in_a_loop_are_refused():
    falling = two_arms(WEIGHT, free=("y",))
    with pytest.raises(fa.InputError, match=r"arm\.base has no equilibrium at the start"):
        fa.rigid_torque(falling, fa.joint_motion(falling, ANGLES, ANGLES + MOVES, 1.0))
    with pytest.raises(fa.InputError, match="not supported for a base with springs"):
        fa.ComputedTorque(BASES["on springs under gravity"], 1.0)
    pinned = fa.Closure(link=3, to_offset=(-1.2, 0.0))
    tied = fa.Arm(two_arms(free=FREE).spec.replace(closures=[pinned]))
    with pytest.raises(fa.InputError, match="connect links or the base, because the base moves"):
        fa.joint_motion(tied, np.zeros(3), np.zeros(3), 1.0, driven=[1])
