"""Segments, joint laws, loads, moving bases and prescribed joints against Lagrange's equations.

The oracle shares no formula with the package: segments are separate links, springs and stops are
energies, loads are virtual work on material points, the motion of the base has two more
coordinates, and reactions are constraint forces. The base of the oracle also has a velocity, which
must have no effect.
"""

from functools import cache

import numpy as np
import pytest

from arm_states import parts, state_array
from flexarm.arm.actions import Environment
from flexarm.kernels.columns import FREE
from flexarm.kernels.recursion.articulated_body import forward_dynamics
from oracles.joint_laws import passive_torque, stretched
from oracles.lagrangian import LagrangianOracle
from random_options import busy

EPSILON = np.finfo(float).eps
SEEDS = range(1000, 1030)


@cache
def case(seed):
    """Return a random arm, its oracle, and its state in the oracle's coordinates."""
    b = busy(seed, theory=["linear", "second_order"][seed % 2])
    oracle = LagrangianOracle(b.arm.spec)
    return b, oracle, in_oracle(b, oracle, b.q), in_oracle(b, oracle, b.qd)


def in_oracle(b, oracle, vector):
    """Return coordinates of the package, or their rates, as nodal ones of the oracle."""
    values = oracle.coordinates(b.arm.joint_angles(vector), b.arm.nodal(vector))
    for seat in b.arm.assembly.seats:
        if seat.twist is not None:
            values[oracle.spring_of[seat.link]] = vector[seat.twist]
    return values


def surroundings(b):
    return {
        "loads": b.all_loads,
        "base_velocity": b.base_velocity,
        "base_acceleration": b.base_acceleration,
    }


def assert_close(found, exact, mass):
    """Compare accelerations as kinetic energy, so that metres and radians have equal weight."""
    scale = np.sqrt(np.diag(mass))
    # The required accuracy of the recursion is 1e-10. For an ill-conditioned arm no result in
    # double precision is better than the rounding of state and forces times the condition number.
    limit = max(1e-10, 2.0 * EPSILON * np.linalg.cond(mass / np.outer(scale, scale)))
    assert np.linalg.norm(scale * (found - exact)) < limit * np.linalg.norm(scale * exact)


@pytest.mark.sampled("1000", "1007", "1018", "1023", "1029")
@pytest.mark.parametrize("seed", SEEDS)
def test_accelerations(seed):
    b, oracle, q, qd = case(seed)
    exact = oracle.moving(q, qd, b.torque, **surroundings(b)).acceleration
    found = b.arm.forward_dynamics(b.q, b.qd, b.torque, b.tip_force, b.loads, b.base_acceleration)
    found = in_oracle(b, oracle, found)
    assert_close(found, exact, oracle.mass_matrix(q))


@pytest.mark.thorough_cases("1105")
@pytest.mark.parametrize("seed", range(1100, 1106))
def test_accelerations_of_reduced_segments(seed):
    """The oracle takes the reduced shapes of the segments as its basis."""
    b = busy(seed, reduced=True)
    basis = [piece.basis if piece.w2.size else None for piece in b.arm.assembly.links]
    oracle = LagrangianOracle(b.arm.spec, basis=basis)
    exact = oracle.moving(b.q, b.qd, b.torque, **surroundings(b)).acceleration
    found = b.arm.forward_dynamics(b.q, b.qd, b.torque, b.tip_force, b.loads, b.base_acceleration)
    assert_close(found, exact, oracle.mass_matrix(b.q))


def prescribed_accelerations(b):
    """Return accelerations (dof,) in which the joints of ``b.given`` follow their motion."""
    sizes, constants, work = parts(b.arm)
    body, drive = constants.body.copy(), b.torque.copy()
    for joint, acceleration in b.given.items():
        index = b.arm.joint_numbers.tolist().index(joint)
        body[b.arm.assembly.joint_body[index], FREE] = 0.0
        drive[index] = acceleration
    loads = Environment(b.all_loads, b.base_acceleration).placed(b.arm)
    state, torque = state_array(b.arm, b.q, b.qd), b.arm.padded_torque(drive)
    forward_dynamics(sizes, constants._replace(body=body), state, torque, loads, work)
    return b.arm.unpadded(work.acceleration)


@pytest.mark.sampled("1000", "1007", "1014", "1029")
@pytest.mark.parametrize("seed", SEEDS)
def test_prescribed_joints_and_reactions(seed):
    """Accelerations of the other joints, required torques, and the reactions of all joints."""
    b, oracle, q, qd = case(seed)
    exact = oracle.moving(q, qd, b.torque, given=b.given, **surroundings(b))
    qdd = prescribed_accelerations(b)
    found = in_oracle(b, oracle, qdd)
    numbers = b.arm.joint_numbers.tolist()
    for joint, acceleration in b.given.items():
        assert b.arm.joint_angles(qdd)[numbers.index(joint)] == acceleration
    mass = oracle.mass_matrix(q)
    assert_close(found, exact.acceleration, mass)
    acting = (b.q, b.qd, qdd, b.tip_force, b.loads, b.base_acceleration)
    motor = b.arm.inverse_dynamics(*acting)[b.arm.joint_index]
    # Far below the effect of a wrong term, far above rounding of the forces in balance.
    weight = 1e-10 * np.linalg.norm(np.sqrt(np.diag(mass)) * exact.acceleration)
    reach = np.sqrt(np.diag(mass)[oracle.joint_index].max(initial=1.0))
    np.testing.assert_allclose(motor, exact.torque, rtol=1e-10, atol=weight * reach)
    reactions = b.arm.joint_reactions(*acting)
    heaviness = np.sqrt(b.arm.assembly.constants.mass.sum() + 10.0)
    np.testing.assert_allclose(
        reactions[:, :2], exact.joint_force, rtol=1e-10, atol=weight * heaviness
    )
    carried = joint_moments(b, exact)
    np.testing.assert_allclose(
        reactions[list(carried), 2], list(carried.values()), rtol=1e-10, atol=weight * reach
    )


def joint_moments(b, exact):
    """Return moments on links (by index from 0) that only their joint determines.

    Fixed joints are omitted, and rotors except those on the base, whose own rate is their absolute
    one.
    """
    moments = {}
    for k, seat in enumerate(b.arm.assembly.seats):
        joint = b.arm.spec.joints[seat.link]
        if joint.elastic:
            twist, rate = b.q[seat.twist], b.qd[seat.twist]
            spring = joint.stiffness * stretched(joint, twist)
            moments[seat.link] = -spring - joint.damping * rate
        elif not joint.rotor_inertia or seat.link == 0:
            angle, rate = b.state.angles[k], b.state.angle_rates[k]
            inertia = joint.rotor_inertia * joint.gear_ratio**2
            moments[seat.link] = exact.torque[k] + passive_torque(joint, angle, rate)
            moments[seat.link] -= inertia * exact.acceleration[seat.angle]
    return moments


@pytest.mark.parametrize("seed", SEEDS)
def test_energy_with_springs_and_stops(seed):
    b, oracle, q, qd = case(seed)
    exact = oracle.energy(q, qd)
    # Rounding of the modal basis; energies are single numbers.
    np.testing.assert_allclose(
        b.arm.energy(b.q, b.qd)[:3], exact, rtol=1e-12, atol=1e-12 * max(map(abs, exact))
    )
    np.testing.assert_allclose(b.arm.tip(b.q), oracle.tip(q), rtol=0, atol=1e-13)


@pytest.mark.thorough
def test_every_option_is_drawn():
    arms = [case(seed)[0] for seed in SEEDS]
    joints = [joint for b in arms for joint in b.arm.spec.joints]
    assert {joint.fixed for joint in joints} == {True, False}
    assert {(joint.elastic, joint.rotor_inertia > 0) for joint in joints} == {
        (False, False), (False, True), (True, True)
    }  # fmt: skip
    assert {joint.gear_ratio for joint in joints} == {0.5, 1.0, 50.0}
    assert {bool(j.stiffness) for j in joints} == {True, False}
    assert {j.friction is None for j in joints} == {True, False}
    assert {j.friction.viscous > 0 for j in joints if j.friction} == {True, False}
    assert {j.friction.static is None for j in joints if j.friction} == {True, False}
    assert {j.friction.coulomb_negative is None for j in joints if j.friction} == {True, False}
    assert {j.winding is None for j in joints} == {True, False}
    assert {j.backlash > 0 for j in joints if j.elastic} == {True, False}
    twists = [
        abs(b.q[seat.twist]) > b.arm.spec.joints[seat.link].backlash / 2
        for b in arms
        for seat in b.arm.assembly.seats
        if seat.backlash
    ]
    assert set(twists) == {True, False}
    assert {link.hub_radius > 0 for b in arms for link in b.arm.spec.links} == {True, False}
    reached = set()
    for b in arms:
        turning = [b.arm.spec.joints[seat.link] for seat in b.arm.assembly.seats]
        for joint, angle, rate in zip(turning, b.state.angles, b.state.angle_rates, strict=True):
            if joint.limits is not None:
                side = int(angle > joint.limits.upper) - int(angle < joint.limits.lower)
                reached.add((side, joint.limits.damping * side * rate < -1.0))
    assert {side for side, _ in reached} == {-1, 0, 1}
    # leaves faster than the spring returns
    assert {lets_go for _, lets_go in reached} == {True, False}
    assert {link.segments for b in arms for link in b.arm.spec.links} == {1, 2, 3, 4}
    loads = [load for b in arms for load in b.loads]
    assert {(load.frame, load.spread is None) for load in loads} == {
        (frame, point) for frame in ("world", "link") for point in (True, False)
    }
    assert {any(b.base_acceleration) for b in arms} == {True, False}
    assert {len(b.given) for b in arms} >= {0, 1, 2}
