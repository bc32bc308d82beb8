"""Invariance: mirror, direction of time, direction of world x, and padding."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import flexarm as fa
from arm_states import changed, drawn, parts, state_array
from flexarm.arm.actions import place_loads, tip_load
from flexarm.kernels.layout import ArmConstants, new_workspace, run_time_sizes
from flexarm.kernels.recursion.articulated_body import forward_dynamics
from flexarm.kernels.recursion.composite_body import mass_matrix
from strategies import between

EPSILON = np.finfo(float).eps
seeds = st.integers(0, 10**6)


def assert_same_motion(arm, q, found, wanted):
    """Compare except for the rounding that the mass matrix amplifies, relative to inertia."""
    M = arm.mass_matrix(q)
    scale = np.sqrt(np.diag(M))
    limit = max(1e-12, 4 * EPSILON * np.linalg.cond(M / np.outer(scale, scale)))
    assert np.linalg.norm(scale * (found - wanted)) <= limit * np.linalg.norm(scale * wanted)


@settings(max_examples=50)
@given(seeds)
def test_mirrored_motion_changes_signs_only(seed):
    """Reflection at world x: angles, deflections and moments change their sign."""
    d = drawn(seed)
    payload, (gx, gy) = d.arm.spec.payload, d.arm.spec.gravity
    flipped = payload.model_copy(update={"offset": (payload.offset[0], -payload.offset[1])})
    mirrored = changed(d.arm, payload=flipped, gravity=(gx, -gy))
    force = d.tip_force * [1.0, -1.0, -1.0]
    wanted = -d.arm.forward_dynamics(d.q, d.qd, d.torque, d.tip_force)
    found = mirrored.forward_dynamics(-d.q, -d.qd, -d.torque, force)
    np.testing.assert_array_equal(found, wanted)  # no digit depends on a sign
    np.testing.assert_array_equal(mirrored.tip(-d.q), d.arm.tip(d.q) * [1.0, -1.0, -1.0])
    assert mirrored.energy(-d.q, -d.qd) == d.arm.energy(d.q, d.qd)


@settings(max_examples=50)
@given(seeds)
def test_time_reversal_without_damping(seed):
    """The reversed motion is a motion."""
    d = drawn(seed, damping=False)
    forwards = d.arm.forward_dynamics(d.q, d.qd, d.torque, d.tip_force)
    backwards = d.arm.forward_dynamics(d.q, -d.qd, d.torque, d.tip_force)
    np.testing.assert_array_equal(backwards, forwards)


def test_time_reversal_fails_with_damping():
    d = drawn(3, damping=True)
    forwards = d.arm.forward_dynamics(d.q, d.qd, d.torque)
    assert np.any(abs(d.arm.forward_dynamics(d.q, -d.qd, d.torque) - forwards) > 1e-3)


@settings(max_examples=50)
@given(seeds, between(-10.0, 10.0), st.booleans())
def test_rotation_of_arm_and_loads_changes_nothing(seed, turn, gravity):
    d = drawn(seed, gravity=gravity)
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    turned = changed(d.arm, gravity=tuple(map(float, rotation @ d.arm.spec.gravity)))
    q = d.q.copy()
    q[0] += turn
    force = np.append(rotation @ d.tip_force[:2], d.tip_force[2])
    wanted = d.arm.forward_dynamics(d.q, d.qd, d.torque, d.tip_force)
    assert_same_motion(d.arm, d.q, turned.forward_dynamics(q, d.qd, d.torque, force), wanted)
    # Positions of a few metres; sine and cosine of a sum of angles.
    np.testing.assert_allclose(
        turned.tip(q), np.append(rotation @ d.arm.tip(d.q)[:2], d.arm.tip(d.q)[2] + turn),
        rtol=0, atol=1e-13,
    )  # fmt: skip
    np.testing.assert_allclose(d.arm.mass_matrix(q), d.arm.mass_matrix(d.q), rtol=1e-13, atol=1e-13)
    points = d.arm.shape(d.q, stations=3) @ rotation.T
    np.testing.assert_allclose(turned.shape(q, stations=3), points, rtol=0, atol=1e-13)


@settings(max_examples=50)
@given(seeds, between(-20.0, 20.0), between(-20.0, 20.0))
def test_gravity_equals_an_accelerated_base(seed, gx, gy):
    """Both add one acceleration to every point mass, so the generalised force does not depend on
    the motion."""
    d = drawn(seed, gravity=False)
    heavy = changed(d.arm, gravity=(gx, gy))
    moving = heavy.bias_force(d.q, d.qd) - d.arm.bias_force(d.q, d.qd)
    zero = np.zeros(d.arm.dof)
    resting = heavy.bias_force(d.q, zero) - d.arm.bias_force(d.q, zero)
    size = abs(d.arm.bias_force(d.q, d.qd)).max() + abs(resting).max()
    np.testing.assert_allclose(moving, resting, rtol=0, atol=1e-13 * size)


#: Axes over the modes, for arrays that have one.
MODAL = {"mode": [1], "centrifugal": [1, 2], "shortening": [1, 2], "rows": [1], "slopes": [1]}


def widened(arrays, extra):
    """Return the same arm, or its loads, with ``extra`` more padded modes on every body."""
    wide = []
    for name, array in zip(arrays._fields, arrays, strict=True):
        if isinstance(array, tuple):  # contacts are among the loads
            wide.append(widened(array, extra))
            continue
        growing = [(0, 0)] * array.ndim
        for axis in MODAL.get(name, ()):
            square = name in ("centrifugal", "shortening")
            growing[axis] = (0, 0 if square and array.shape[axis] == 0 else extra)
        wide.append(np.pad(array, growing))
    found = type(arrays)(*wide)
    if isinstance(found, ArmConstants):
        found.mobility[found.mobility == 0.0] = 1.0
    return found


@settings(max_examples=30)
@given(seeds, st.integers(1, 4))
def test_padding_changes_nothing(seed, extra):
    """Bodies with fewer modes than the largest number are padded; more padding gives the same
    motion."""
    d = drawn(seed)
    sizes, constants, work = parts(d.arm)
    state = state_array(d.arm, d.q, d.qd)
    torque = d.arm.padded_torque(d.torque)
    loads = place_loads(d.arm, tip_load(d.arm, d.tip_force))
    forward_dynamics(sizes, constants, state, torque, loads, work)
    wide = widened(constants, extra)
    more = new_workspace(wide)
    wide_state = np.pad(state, [(0, 0), (0, 0), (0, extra)])
    forward_dynamics(run_time_sizes(wide), wide, wide_state, torque, widened(loads, extra), more)
    width = state.shape[2]
    np.testing.assert_array_equal(more.acceleration[:, :width], work.acceleration)
    assert np.all(more.acceleration[:, width:] == 0.0)  # at rest, and it stays at rest
    n = d.arm.assembly.bodies
    M, wide_M = np.zeros((n, width) * 2), np.zeros((n, width + extra) * 2)
    mass_matrix(sizes, constants, state, work, M)
    mass_matrix(run_time_sizes(wide), wide, wide_state, more, wide_M)
    np.testing.assert_array_equal(wide_M[:, :width, :, :width], M)
    padded = wide_M[:, width:].reshape(n * extra, -1)
    assert np.all(np.sort(padded)[:, :-1] == 0.0)
    assert np.all(padded.max(axis=1) == 1.0)


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_rigid_link_between_flexible_links(theory):
    """It moves like a link of a hundred thousand times its neighbours' stiffness."""

    def arm(middle):
        soft = fa.Link(length=0.7, flexural_rigidity=20.0, mass_per_length=0.4, elements=3)
        end = fa.Link(length=0.5, flexural_rigidity=10.0, mass_per_length=0.3, elements=1)
        return fa.Arm(links=[soft, middle, end], gravity=(1.0, -9.0), theory=theory)

    rigid = arm(fa.Link(length=0.6, mass_per_length=0.5, flexible=False, elements=1))
    hard = arm(fa.Link(length=0.6, mass_per_length=0.5, flexural_rigidity=2e6, elements=1))
    rng = np.random.default_rng(8)
    q = rigid.rest([0.4, -1.0, 0.8])
    q[1:7] = 0.02 * rng.normal(size=6) / np.sqrt(rigid.assembly.links[0].w2 / 300.0)
    torque = [1.0, -0.5, 0.2]
    wanted = rigid.forward_dynamics(q, np.zeros(rigid.dof), torque)
    # The stiff link moves like the rigid one if the springs of its modes balance the forces on
    # them.
    elastic = slice(hard.joint_index[1] + 1, hard.joint_index[1] + 3)
    same = hard.from_nodal([0.4, -1.0, 0.8], rigid.nodal(q))
    moving = hard.from_nodal(rigid.joint_angles(wanted), rigid.nodal(wanted))
    carried = hard.inverse_dynamics(same, np.zeros(hard.dof), moving)[elastic]
    same[elastic] = -carried / hard.assembly.links[1].w2
    found = hard.forward_dynamics(same, np.zeros(hard.dof), torque)
    scale = np.sqrt(np.diag(hard.mass_matrix(same)))
    # The bending of a link 1e5 times as stiff moves its neighbours by a part in 1e5.
    assert np.linalg.norm(scale * (found - moving)) < 1e-4 * np.linalg.norm(scale * moving)
