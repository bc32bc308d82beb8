"""Mass matrix, velocity forces, potential and power: their relations in Lagrange's equations."""

import numpy as np
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from arm_states import (
    changed,
    complex_energies,
    complex_mass_matrix,
    drawn,
    exact_derivative,
    modal_parts,
)

EPSILON = np.finfo(float).eps
seeds = st.integers(0, 10**6)


@settings(max_examples=60)
@given(seeds, st.booleans())
def test_mass_matrix_is_symmetric_positive_definite(seed, reduced):
    d = drawn(seed, reduced=reduced)
    M = d.arm.mass_matrix(d.q)
    scale = np.sqrt(np.outer(np.diag(M), np.diag(M)))
    # The two halves of a block are computed by different sums.
    np.testing.assert_allclose(M / scale, M.T / scale, rtol=0, atol=1e-14)
    scipy.linalg.cholesky((M + M.T) / scale)  # raises unless positive definite
    elastic = modal_parts(d.arm)
    # A payload never lowers an inertia, and every shape has at least unit mass.
    assert np.all(np.diag(M)[elastic] > 1.0 - 1e-12)


@settings(max_examples=60)
@given(seeds)
def test_kinetic_energy_is_the_quadratic_form_of_the_mass_matrix(seed):
    d = drawn(seed)
    kinetic = d.arm.energy(d.q, d.qd).kinetic
    # Positive definite form of this size: rounding of a few hundred products.
    size = abs(d.qd) @ abs(d.arm.mass_matrix(d.q)) @ abs(d.qd)
    assert abs(d.qd @ d.arm.mass_matrix(d.q) @ d.qd / 2 - kinetic) < 1e-13 * size


def mass_slopes(arm, q):
    """Return dM/dq, (dof, dof, dof), with the coordinate as the last index."""
    directions = np.eye(arm.dof)
    columns = [exact_derivative(lambda p: complex_mass_matrix(arm, p), q, e) for e in directions]
    return np.stack(columns, axis=-1)


@settings(max_examples=25)
@given(seeds)
def test_velocity_forces_follow_from_the_christoffel_symbols(seed):
    """The forces are C qd with C from dM/dq. M_dot - 2 C is skew, so they do no work."""
    d = drawn(seed, gravity=False, damping=False)
    slopes = mass_slopes(d.arm, d.q)
    along = slopes @ d.qd  # M_dot
    across = np.einsum("ikj,k->ij", slopes, d.qd)
    C = (along + across - across.T) / 2
    skew = along - 2 * C
    size = abs(slopes).max() * abs(d.qd).max()
    np.testing.assert_allclose(skew, -skew.T, rtol=0, atol=1e-12 * size)
    zero = np.zeros(d.arm.dof)
    elastic_force = d.arm.bias_force(d.q, zero)
    found = d.arm.bias_force(d.q, d.qd) - elastic_force
    # Elastic forces are subtracted, which leaves their rounding. The rest sums products of inertias
    # and two rates, some of which cancel completely.
    terms = (abs(d.arm.mass_matrix(d.q)) @ abs(d.qd)).max() * abs(d.qd).max()
    terms += (abs(C) @ abs(d.qd)).max()
    rounding = 1e-12 * terms + 8.0 * EPSILON * abs(elastic_force).max()
    np.testing.assert_allclose(found, C @ d.qd, rtol=0, atol=rounding)


@settings(max_examples=40)
@given(seeds)
def test_static_force_is_the_gradient_of_the_potential(seed):
    d = drawn(seed, gravity=True)
    zero = np.zeros(d.arm.dof)

    def potential(q):
        return complex_energies(d.arm, np.stack([q, zero]))[1:].sum()

    slope = [exact_derivative(potential, d.q, e) for e in np.eye(d.arm.dof)]
    found = d.arm.bias_force(d.q, zero)
    # Two sums of the same few dozen products.
    np.testing.assert_allclose(found, slope, rtol=0, atol=1e-12 * abs(found).max())


@settings(max_examples=40)
@given(seeds)
def test_stiffness_is_the_derivative_of_the_static_force(seed):
    d = drawn(seed, gravity=True)
    zero = np.zeros(d.arm.dof)
    K = d.arm.stiffness_matrix(d.q)
    np.testing.assert_allclose(K, K.T, rtol=0, atol=1e-12 * abs(K).max())
    direction = d.qd / np.linalg.norm(d.qd)
    step = 1e-4  # truncation by step^4, and rounding of forces: K times a few millimetres
    near = d.arm.bias_force(d.q + step * direction, zero)
    near = near - d.arm.bias_force(d.q - step * direction, zero)
    far = d.arm.bias_force(d.q + 2 * step * direction, zero)
    far = far - d.arm.bias_force(d.q - 2 * step * direction, zero)
    slope = (8 * near - far) / (12 * step)
    size = abs(K @ direction).max() + EPSILON / step * abs(d.arm.bias_force(d.q, zero)).max()
    np.testing.assert_allclose(K @ direction, slope, rtol=0, atol=1e-9 * size + 1e-7)


@settings(max_examples=60)
@given(seeds)
def test_power_balance(seed):
    """(R.24): motors and dampers act on relative rates, the tip force on the velocity of the
    tip."""
    d = drawn(seed)
    qdd = d.arm.forward_dynamics(d.q, d.qd, d.torque, d.tip_force)
    state, rates = np.stack([d.q, d.qd]), np.stack([d.qd, qdd])
    power = exact_derivative(lambda s: complex_energies(d.arm, s).sum(), state, rates)
    work = d.torque @ d.arm.joint_angles(d.qd) + d.tip_force @ d.arm.tip_velocity(d.q, d.qd)
    work -= d.qd @ d.arm.damping_matrix() @ d.qd
    # Inertia and elastic forces cancel in the balance; each has an error of the condition number of
    # M.
    terms = abs(d.qd) @ (abs(d.arm.mass_matrix(d.q)) @ abs(qdd) + abs(d.arm.bias_force(d.q, d.qd)))
    assert abs(power - work) < 1e-11 * terms


@settings(max_examples=40)
@given(seeds)
def test_damping_force_changes_energy_only_by_its_power(seed):
    d = drawn(seed, damping=True)
    bare = changed(
        d.arm,
        links=tuple(link.model_copy(update={"damping": None}) for link in d.arm.spec.links),
        joints=tuple(joint.model_copy(update={"damping": 0.0}) for joint in d.arm.spec.joints),
    )
    force = d.arm.bias_force(d.q, d.qd)
    drag = force - bare.bias_force(d.q, d.qd)
    D = d.arm.damping_matrix()
    # The forces without damping are subtracted, which leaves their rounding, also of terms that
    # cancel.
    rounding = 1e-13 * (abs(force).max() + (abs(d.arm.mass_matrix(d.q)) @ d.qd**2).max())
    np.testing.assert_allclose(drag, D @ d.qd, rtol=0, atol=rounding)
    assert np.all(np.linalg.eigvalsh(D) >= 0.0)
    assert d.qd @ D @ d.qd > 0.0
