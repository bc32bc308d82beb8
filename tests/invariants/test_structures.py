"""Statics and vibration of structures after cutting, joining and locking."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import flexarm as fa
from arm_states import changed, drawn, modal_parts, squared_frequencies
from arms import chain

seeds = st.integers(0, 10**6)


def straight(pieces, theory="linear", **options):
    """Return one straight bar in parts of (length, elements), all of the same section."""
    lengths, elements = map(list, zip(*pieces, strict=True))
    bar = {"flexural_rigidity": 3.0, "mass_per_length": 0.7, "elements": elements}
    return chain(lengths, theory=theory, **bar, **options)


@settings(max_examples=40)
@given(seeds)
def test_locking_a_joint_raises_every_frequency(seed):
    """Rayleigh: a constraint raises each frequency, at most to the next one."""
    d = drawn(seed, links=3, gravity=False, rigid=False)
    order = np.random.default_rng(seed).permutation(3).tolist()
    states = [squared_frequencies(d.arm, d.state.angles, order[:locked]) for locked in range(4)]
    for loose, held in pairwise(states):
        lower, upper = loose[: held.size], loose[1:]
        # They are computed as 1 / (1 + lambda), to rounding.
        slack = 1e-14 * (1.0 + upper) ** 2
        assert np.all(held >= lower - slack)
        assert np.all(held <= upper + slack)
        assert np.any(held[:7] > 1.0001 * lower[:7] + 1e-6)


@settings(max_examples=30)
@given(seeds)
def test_modes_are_the_eigenvalues_of_mass_and_stiffness(seed):
    d = drawn(seed, gravity=False, damping=False)
    every = list(range(d.arm.n_joints))
    for joints, locked in (("locked", every), ("free", [])):
        modes = fa.modes(d.arm, d.state.angles, joints=joints)
        wanted = squared_frequencies(d.arm, d.state.angles, locked)
        assert modes.shapes.shape == (wanted.size, d.arm.dof)
        if wanted.size:
            few = slice(0, 3 + d.arm.n_joints)
            np.testing.assert_allclose(
                modes.squared_frequency[few],
                wanted[few],
                rtol=1e-8,
                atol=1e-8 * wanted[few].max() + 1e-12,
            )
            M = d.arm.mass_matrix(d.arm.rest(d.state.angles))
            shapes = modes.shapes[few]
            # The stiffest ones are omitted, because their eigenvalues are inaccurate here.
            np.testing.assert_allclose(shapes @ M @ shapes.T, np.eye(len(shapes)), atol=1e-8)


@pytest.mark.parametrize("theory", ["linear", "second_order"])
@pytest.mark.parametrize(
    "pieces",
    [
        [(0.5, 2), (0.5, 2)],
        [(0.25, 1), (0.75, 3)],
        [(0.75, 3), (0.25, 1)],
        [(0.25, 1)] * 4,
        [(0.25, 1), (0.5, 2), (0.25, 1)],
    ],
    ids=["halves", "first node", "last node", "every node", "three"],
)
def test_locked_straight_links_of_one_section_are_one_beam(pieces, theory):
    """Cuts at nodes change neither frequencies nor shapes nor static sag."""
    whole = straight([(1.0, 4)], theory)
    cut = straight(pieces, theory)
    one = fa.modes(whole)
    many = fa.modes(cut)
    # All eight; the highest is 1e3 times the lowest, which loses as many digits.
    np.testing.assert_allclose(many.frequency_hz, one.frequency_hz, rtol=1e-11)
    along = np.cumsum([length for length, _ in pieces])
    for shape, reference in zip(many.shapes[:3], one.shapes[:3], strict=True):
        # The deflection is so small that rotations between the parts are linear: squares are 1e-12.
        line = whole.shape(1e-6 * reference, stations=101)[0]
        bent = cut.shape(1e-6 * shape, stations=2)[:, 1]
        reached = line[(100 * along).round().astype(int)]
        np.testing.assert_allclose(abs(bent[:, 1]), abs(reached[:, 1]), rtol=1e-6, atol=1e-12)


def test_static_sag_does_not_depend_on_the_cuts():
    whole = straight([(1.0, 4)], gravity=(0.0, -1.0))
    cut = straight([(0.25, 1), (0.75, 3)], gravity=(0.0, -1.0))
    deflections = []
    for arm in (whole, cut):
        elastic = modal_parts(arm)
        q = arm.rest(np.zeros(arm.n_joints))
        # The straight arm is horizontal; linear statics about it.
        weight = arm.bias_force(q, np.zeros(arm.dof))[elastic]
        level = changed(arm, gravity=(0.0, 0.0))
        K = level.stiffness_matrix(q)[np.ix_(elastic, elastic)]
        q[elastic] = np.linalg.solve(K, -weight)
        # First-order displacement of the tip: velocity of a straight arm.
        deflections.append(arm.tip_velocity(arm.rest(np.zeros(arm.n_joints)), q)[1:])
    w, EI = 0.7, 3.0
    np.testing.assert_allclose(deflections[0], [-w / (8 * EI), -w / (6 * EI)], rtol=1e-12)
    np.testing.assert_allclose(deflections[1], deflections[0], rtol=1e-12)


@settings(max_examples=40)
@given(seeds)
def test_reciprocity_across_links(seed):
    """Betti and Maxwell: a load at A moves B as the same load at B moves A.

    Loads are every motor, and force and moment at the tip; responses are accelerations at rest.
    """
    d = drawn(seed)
    zero = np.zeros(d.arm.dof)
    level = changed(d.arm, gravity=(0.0, 0.0))
    q = d.arm.rest(d.state.angles)
    jacobian = np.array([level.tip_velocity(q, unit) for unit in np.eye(d.arm.dof)]).T
    points = np.concatenate([np.eye(d.arm.dof)[d.arm.joint_index], jacobian])
    answers = [
        level.forward_dynamics(q, zero, load[: d.arm.n_joints], load[d.arm.n_joints :])
        for load in np.eye(d.arm.n_joints + 3)
    ]
    flexibility = points @ np.array(answers).T
    scale = np.sqrt(np.outer(np.diag(flexibility), np.diag(flexibility)))
    # Rounding multiplied by the condition number of M; 1e-12 at most for some hundred arms.
    np.testing.assert_allclose(flexibility / scale, flexibility.T / scale, rtol=0, atol=1e-10)
    # Motors only, also at the bent arm in motion.
    answers = d.arm.derivatives(d.q, d.qd, d.torque).torque[d.arm.joint_index]
    scale = np.sqrt(np.outer(np.diag(answers), np.diag(answers)))
    np.testing.assert_allclose(answers / scale, answers.T / scale, rtol=0, atol=1e-10)


def test_static_reciprocity_of_elbow_and_tip():
    """Joints are locked: the tip moves under an elbow couple as the elbow turns under a tip
    force."""
    arm = straight([(0.6, 3), (0.4, 2)])
    q = arm.rest([0.0, 0.0])
    zero = np.zeros(arm.dof)
    elastic = modal_parts(arm)
    flexibility = np.linalg.inv(arm.stiffness_matrix(q)[np.ix_(elastic, elastic)])

    def bent_by(tip_force, elbow_couple):
        load = -arm.inverse_dynamics(q, zero, zero, tip_force)
        load[elastic] += elbow_couple * np.concatenate(
            [arm.assembly.links[0].dP, 0.0 * arm.assembly.links[1].dP]
        )
        answer = zero.copy()
        answer[elastic] = flexibility @ load[elastic]
        return answer

    by_force, by_couple = bent_by([0.0, 1.0], 0.0), bent_by([0.0, 0.0], 1.0)
    drop = arm.tip_velocity(q, by_couple)[1]
    turn = arm.nodal(by_force)[0][-1, 1]
    assert drop == pytest.approx(turn, rel=1e-12)
    # By hand: the force bends the first part with 0.4 F at its end and F: (0.4 L1 + L1^2/2) / EI.
    assert turn == pytest.approx((0.4 * 0.6 + 0.6**2 / 2) / 3.0, rel=1e-12)
    whole = arm.tip_velocity(q, by_force)[1]
    assert whole == pytest.approx(1.0 / (3 * 3.0), rel=1e-12)  # P L^3 / 3 EI


@settings(max_examples=40)
@given(seeds)
def test_reduced_shapes_are_a_projection_of_the_full_model(seed):
    """Galerkin: reduced links have the matrices and forces of full ones, projected to fewer
    shapes."""
    d = drawn(seed, reduced=True, rigid=False)
    full = fa.Arm(
        d.arm.spec.model_copy(
            update={
                "links": tuple(
                    link.model_copy(update={"modes": None, "damping": None})
                    for link in d.arm.spec.links
                )
            }
        )
    )
    reduced = changed(
        d.arm,
        links=tuple(link.model_copy(update={"damping": None}) for link in d.arm.spec.links),
    )
    basis = np.zeros((full.dof, reduced.dof))
    basis[full.joint_index, reduced.joint_index] = 1.0
    for i, (many, few) in enumerate(zip(full.assembly.links, reduced.assembly.links, strict=True)):
        rows = slice(full.joint_index[i] + 1, full.joint_index[i] + 1 + many.w2.size)
        columns = slice(reduced.joint_index[i] + 1, reduced.joint_index[i] + 1 + few.w2.size)
        basis[rows, columns] = many.projector @ few.basis
    q, qd = basis @ d.q, basis @ d.qd
    # Shapes of one mesh in two bases: their conversion has rounding of the mesh's condition number,
    # 1e4.
    scale = np.sqrt(np.diag(reduced.mass_matrix(d.q)))
    M = basis.T @ full.mass_matrix(q) @ basis
    np.testing.assert_allclose(
        reduced.mass_matrix(d.q) / np.outer(scale, scale), M / np.outer(scale, scale), atol=1e-10
    )
    found, wanted = reduced.bias_force(d.q, d.qd), basis.T @ full.bias_force(q, qd)
    terms = abs(basis).T @ abs(full.bias_force(q, qd))
    assert np.all(abs(found - wanted) < 1e-10 * terms.max())
    np.testing.assert_allclose(reduced.tip(d.q), full.tip(q), rtol=0, atol=1e-11)
    pair = np.array([reduced.energy(d.q, d.qd)[:3], full.energy(q, qd)[:3]])
    np.testing.assert_allclose(pair[0], pair[1], rtol=1e-10, atol=1e-10 * abs(pair).max())
