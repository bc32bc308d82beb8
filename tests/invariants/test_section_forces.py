"""Forces inside links, at their ends and between segments, of random arms in motion."""

import numpy as np
import pytest

import flexarm as fa
from arm_states import changed, drawn, state_array
from flexarm.arm.observe import channels_of
from random_options import busy

# Sums of a few dozen terms of the size of the largest one.
ROUNDING = 1e-11


def in_world(forces, angle):
    """Return force and moment (..., 3) in world axes from axial force, shear force and moment."""
    c, s = np.cos(angle), np.sin(angle)
    axial, shear, moment = np.moveaxis(forces, -1, 0)
    return np.stack([c * axial - s * shear, s * axial + c * shear, moment], axis=-1)


def root_and_tip_angles(arm, q):
    """Return world angles of the links' root and tip sections, (links,) each, rad; or their
    rates."""
    state = state_array(arm, q, 0 * q)
    root = channels_of(arm, state[None])["link_angle"][0]
    joints = arm.joint_angles(q)
    tip = np.append(root[1:] - joints[1:], 0.0)
    last = arm.assembly.pieces_of(arm.n_joints - 1)
    tip[-1] = root[-1] + sum(piece.shapes.dP @ q[piece.modal] for piece in last)
    return root, tip


@pytest.mark.parametrize("seed", range(20))
def test_forces_at_the_ends_equal_the_joint_reactions(seed):
    """At the root without the hub, and at the tip that of the next joint."""
    d = drawn(seed)
    bare = [joint.replace(mass=0.0, housing_inertia=0.0) for joint in d.arm.spec.joints]
    arm = changed(d.arm, joints=tuple(bare), payload=fa.Payload())
    base = np.array([1.0, -2.0])
    forces = arm.section_forces(d.q, d.qd, d.qdd, 5, d.tip_force, base_acceleration=base)
    reactions = arm.joint_reactions(d.q, d.qd, d.qdd, d.tip_force, base_acceleration=base)
    root, tip = root_and_tip_angles(arm, d.q)
    turning = root_and_tip_angles(arm, d.qdd)[0]  # angles are sums of coordinates
    hubs = np.array([joint.hub_inertia for joint in bare]) * turning
    limit = ROUNDING * abs(reactions).max()
    entering = reactions - np.stack([0 * hubs, 0 * hubs, hubs], axis=1)
    np.testing.assert_allclose(in_world(forces[:, 0], root), -entering, rtol=0, atol=limit)
    leaving = np.concatenate([-reactions[1:], d.tip_force[None]])
    np.testing.assert_allclose(in_world(forces[:, -1], tip), leaving, rtol=0, atol=limit)


@pytest.mark.parametrize("seed", range(2000, 2020))
def test_forces_are_finite_and_independent_of_other_stations(seed):
    b = busy(seed)
    qdd = b.arm.forward_dynamics(b.q, b.qd, b.torque, b.tip_force, b.loads, b.base_acceleration)
    surroundings = (b.tip_force, b.loads, b.base_acceleration)
    few = b.arm.section_forces(b.q, b.qd, qdd, 4, *surroundings)
    many = b.arm.section_forces(b.q, b.qd, qdd, 10, *surroundings)
    assert np.all(np.isfinite(many))
    np.testing.assert_allclose(many[:, ::3], few, rtol=0, atol=ROUNDING * abs(few).max())


@pytest.mark.parametrize("theory", ["linear", "second_order"])
@pytest.mark.parametrize("seed", range(4))
def test_mirrored_arms_have_mirrored_forces(theory, seed):
    """The axial force stays, shear force and moment change their signs."""
    d = drawn(seed, theory=theory)
    spec = d.arm.spec
    gx, gy = spec.gravity
    along, aside = spec.payload.offset
    payload = spec.payload.replace(offset=(along, -aside))
    mirrored = fa.Arm(spec.replace(gravity=(gx, -gy), payload=payload))
    force = d.tip_force * [1.0, -1.0, -1.0]
    found = mirrored.section_forces(-d.q, -d.qd, -d.qdd, 6, force)
    exact = d.arm.section_forces(d.q, d.qd, d.qdd, 6, d.tip_force) * [1.0, -1.0, -1.0]
    np.testing.assert_allclose(found, exact, rtol=0, atol=ROUNDING * abs(exact).max())


@pytest.mark.parametrize("segments", [2, 4, 5])
def test_segments_equal_the_whole_link_under_small_loads(segments):
    """At rest; slopes of 1e-7 are so small that their effect is below the tolerance."""
    link = fa.Link(length=1.2, flexural_rigidity=30.0, mass_per_length=0.5, elements=20)
    push = fa.Load(1, (0.0, -3e-6), 1e-6, station=0.43)
    spread = fa.Load(1, (1e-6, 2e-6), spread=(0.1, 1.1))
    surroundings = {"tip_force": (2e-6, 1e-6, 1e-6), "loads": [push, spread]}
    found = []
    for count in (1, segments):
        arm = fa.Arm(links=[link.replace(segments=count)])
        q = fa.equilibrium(arm, [0.3], **surroundings).q
        found.append(arm.section_forces(q, 0 * q, 0 * q, 21, **surroundings))
    # Forces of 3e-6 turned by slopes of 1e-7.
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-12)
    assert abs(found[0][..., 2]).max() > 1e-6
