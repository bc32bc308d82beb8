"""Newton's laws for the whole arm and for its parts: reactions, momentum and angular momentum."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import flexarm as fa
from arm_states import (
    changed,
    complex_energies,
    complex_mass_matrix,
    drawn,
    exact_derivative,
)

seeds = st.integers(0, 10**6)


def first_moment(arm, q):
    """Return mass times centre of mass (2,), world axes, as minus the energy in a unit gravity."""
    state = np.stack([q, np.zeros_like(q)])
    towards_x, towards_y = changed(arm, gravity=(1.0, 0.0)), changed(arm, gravity=(0.0, 1.0))
    return -np.array([complex_energies(a, state)[2] for a in (towards_x, towards_y)])


def total_mass(arm):
    """Return the mass beyond the first joint (kg); the joint itself does not move."""
    links = sum(link.mass for link in arm.assembly.links)
    return links + sum(joint.mass for joint in arm.spec.joints[1:]) + arm.spec.payload.mass


def turning(arm, rates):
    """Return a bound on the rate of any tangent, from the rates of the coordinates."""
    slopes = [abs(nodal[:, 1]).max() for nodal in arm.nodal(rates)]
    return abs(arm.joint_angles(rates)).sum() + sum(slopes)


def momentum_rate(arm, q, qd, qdd):
    """Return the rate of momentum (2,) on the motion, by differences of an exact first
    derivative."""

    def momentum(t):
        return exact_derivative(
            lambda p: first_moment(arm, p), q + t * qd + t**2 / 2 * qdd, qd + t * qdd
        )

    # Fourth-order differences over a time in which no tangent turns by more than a milliradian.
    step = 1e-3 / max(1.0, turning(arm, qd), np.sqrt(turning(arm, qdd)))
    near, far = momentum(step) - momentum(-step), momentum(2 * step) - momentum(-2 * step)
    return (8 * near - far) / (12 * step)


@settings(max_examples=25)
@given(seeds)
def test_base_reaction_and_loads_equal_the_rate_of_momentum(seed):
    d = drawn(seed)
    reaction = d.arm.joint_reactions(d.q, d.qd, d.qdd, d.tip_force)
    weight = total_mass(d.arm) * np.array(d.arm.spec.gravity)
    found = reaction[0, :2] + weight + d.tip_force[:2]
    wanted = momentum_rate(d.arm, d.q, d.qd, d.qdd)
    # Truncation by the fourth power of the step, 1e-12, and rounding over the step, 1e-12.
    size = abs(reaction).max() + abs(weight).max() + 10.0
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-8 * size)


@settings(max_examples=25)
@given(seeds)
def test_moment_at_the_base_equals_the_rate_of_angular_momentum(seed):
    """Angular momentum about the base is the momentum of joint angle 1, which turns the whole
    arm."""
    d = drawn(seed)
    free = changed(d.arm, gravity=(0.0, 0.0))

    def moment(state):
        return (complex_mass_matrix(free, state[0]) @ state[1])[0]

    state, rates = np.stack([d.q, d.qd]), np.stack([d.qd, d.qdd])
    wanted = exact_derivative(moment, state, rates)
    x, y, _ = d.arm.tip(d.q)
    load = x * d.tip_force[1] - y * d.tip_force[0] + d.tip_force[2]
    cx, cy = first_moment(d.arm, d.q).real
    gx, gy = d.arm.spec.gravity
    reaction = d.arm.joint_reactions(d.q, d.qd, d.qdd, d.tip_force)[0, 2]
    found = reaction + load + cx * gy - cy * gx
    # Sums of a few hundred products of inertias, rates and accelerations.
    size = (abs(d.arm.mass_matrix(d.q)) @ (abs(d.qdd) + d.qd**2)).max() + abs(found) + 10.0
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * size)


@settings(max_examples=40)
@given(seeds)
def test_reaction_moment_is_the_motor_torque_less_friction(seed):
    d = drawn(seed)
    qdd = d.arm.forward_dynamics(d.q, d.qd, d.torque, d.tip_force)
    moment = d.arm.joint_reactions(d.q, d.qd, qdd, d.tip_force)[:, 2]
    friction = np.array([joint.damping for joint in d.arm.spec.joints])
    rates = d.arm.joint_angles(d.qd)
    # The accuracy of torques by the inverse of forward dynamics, see test_forward_and_inverse.
    size = (abs(d.arm.mass_matrix(d.q)) @ abs(qdd)).max() + abs(d.torque).max()
    np.testing.assert_allclose(moment, d.torque - friction * rates, rtol=0, atol=1e-11 * size)


@settings(max_examples=25)
@given(seeds, st.integers(1, 3))
def test_reaction_replaces_the_part_beyond_a_joint(seed, cut):
    """The reaction, as a tip force on the inboard part, gives the same motion of that part."""
    d = drawn(seed, links=4)
    inboard = changed(
        d.arm,
        links=d.arm.spec.links[:cut],
        joints=d.arm.spec.joints[:cut],
        payload=fa.Payload(
            mass=d.arm.spec.joints[cut].mass, inertia=d.arm.spec.joints[cut].housing_inertia
        ),
    )
    reaction = d.arm.joint_reactions(d.q, d.qd, d.qdd, d.tip_force)
    kept = inboard.dof
    # Friction of the joint at the cut also acts on the inboard tip; the moment there is that of the
    # reaction.
    found = inboard.joint_reactions(d.q[:kept], d.qd[:kept], d.qdd[:kept], -reaction[cut])
    size = abs(reaction).max()
    np.testing.assert_allclose(found, reaction[:cut], rtol=0, atol=1e-12 * size)
    force = inboard.inverse_dynamics(d.q[:kept], d.qd[:kept], d.qdd[:kept], -reaction[cut])
    whole = d.arm.inverse_dynamics(d.q, d.qd, d.qdd, d.tip_force)[:kept]
    np.testing.assert_allclose(force, whole, rtol=0, atol=1e-12 * (size + abs(whole).max()))


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_angular_momentum_is_constant_under_torques_between_links(theory):
    """Only the first joint is connected to the ground; torques of the others are internal."""
    link = fa.Link(length=0.8, flexural_rigidity=8.0, mass_per_length=0.5, elements=1)
    arm = fa.Arm(
        links=[link, link],
        joints=[fa.Joint(hub_inertia=0.02), fa.Joint(mass=0.3, housing_inertia=0.01)],
        theory=theory,
    )
    rate = arm.rest([1.0, -0.5])
    result = fa.simulate(
        arm,
        1.0,
        torque=lambda t: [0.0, 0.3 * np.sin(5.0 * t)],
        initial_rate=rate,
        rate=20.0,
        rtol=1e-11,
        atol=1e-13,
    )
    moments = [
        (arm.mass_matrix(q) @ qd)[0]
        for q, qd in zip(result.q.values, result.qd.values, strict=True)
    ]
    assert np.ptp(result.joint_rate.values[:, 1]) > 0.5  # the elbow moves
    # The run's tolerance per step, over a few hundred steps.
    np.testing.assert_allclose(moments, moments[0], rtol=1e-9)
