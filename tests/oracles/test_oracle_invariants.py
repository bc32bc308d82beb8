"""Laws that hold for every arm, on random arms, and the accuracy of the oracle."""

import numpy as np
import pytest
import scipy.linalg

from random_arms import random_spec, random_state

from .lagrangian import LagrangianOracle


def drawn(seed, **options):
    """Return a random arm's oracle with a state: (oracle, q, qd, torque)."""
    rng = np.random.default_rng(seed)
    spec = random_spec(rng, **options)
    oracle = LagrangianOracle(spec)
    state = random_state(rng, spec)
    q = oracle.coordinates(state.angles, state.nodal)
    qd = oracle.coordinates(state.angle_rates, state.nodal_rates)
    return oracle, q, qd, rng.normal(size=len(spec.links)) * 5


@pytest.mark.thorough_cases("0", "7")
@pytest.mark.parametrize("seed", range(12))
def test_power_balance(seed):
    """dE/dt = torque . joint rate - dissipation + tip load . tip velocity."""
    oracle, q, qd, torque = drawn(seed)
    tip_force = np.random.default_rng(seed).normal(size=3) * [3.0, 3.0, 1.0]
    qdd = oracle.acceleration(q, qd, torque, tip_force)
    step = 1e-5  # central difference of fourth order: truncation and rounding are below 1e-10
    ahead, behind, far, back = (np.array(oracle.tip(q + k * step * qd)) for k in (1, -1, 2, -2))
    tip_velocity = (8 * (ahead - behind) - (far - back)) / (12 * step)
    work = torque @ qd[oracle.joint_index] + tip_force @ tip_velocity - qd @ oracle.damping @ qd
    # The accelerations are rounded to float64; inertia multiplies the error.
    rounding = 1e-15 * abs(qd) @ abs(oracle.mass_matrix(q)) @ abs(qdd)
    np.testing.assert_allclose(oracle.power(q, qd, qdd), work, rtol=0, atol=1e-9 + rounding)


@pytest.mark.thorough_cases("0", "7")
@pytest.mark.parametrize("seed", range(12))
def test_mass_matrix_is_symmetric_positive_definite_and_gives_kinetic_energy(seed):
    oracle, q, qd, _ = drawn(seed)
    mass = oracle.mass_matrix(q)
    np.testing.assert_array_equal(mass, mass.T)
    scipy.linalg.cholesky(mass)  # raises unless positive definite
    kinetic = oracle.energy(q, qd)[0]
    # The kinetic energy is a quadratic form in the rates.
    np.testing.assert_allclose(qd @ mass @ qd / 2, kinetic, rtol=1e-12)


@pytest.mark.thorough_cases("0")
@pytest.mark.parametrize("seed", range(6))
def test_forces_at_rest_are_the_gradient_of_the_potential(seed):
    oracle, q, _, _ = drawn(seed, gravity=True)
    rest = np.zeros(oracle.dof)
    bias = oracle.bias_force(q, rest)

    def potential(point):
        return sum(oracle.energy(point, rest)[1:])

    step = 1e-4  # a polynomial of degree 3 at most, except for slow sines: truncation is step^4
    for k, unit in enumerate(np.eye(oracle.dof) * step):
        near = potential(q + unit) - potential(q - unit)
        far = potential(q + 2 * unit) - potential(q - 2 * unit)
        slope = (8 * near - far) / (12 * step)
        np.testing.assert_allclose(bias[k], slope, atol=1e-12 * abs(potential(q)) / step + 1e-8)


@pytest.mark.thorough_cases("13", "0")
@pytest.mark.parametrize("seed", [0, 1, 2, 13])
def test_rounding_of_float64_arithmetic(seed):
    """The inner arithmetic in float64 differs by its rounding times the condition of M.

    Seeds 0 and 13 draw arms of four links with condition numbers of 1e6.
    """
    oracle, q, qd, torque = drawn(seed)
    shorter = LagrangianOracle(oracle.spec, precision=np.float64)
    exact = oracle.acceleration(q, qd, torque)
    found = shorter.acceleration(q, qd, torque)
    assert abs(found - exact).max() < 1e-9 * abs(exact).max()


@pytest.mark.sampled("linear")
@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_modal_coordinates_give_the_same_dynamics(theory):
    """All clamped modes are the basis; damping is included."""
    oracle, q, qd, torque = drawn(4, links=4, rigid=False, damping=True, theory=theory)
    basis = [scipy.linalg.eigh(p.stiffness_matrix, p.mass_matrix)[1] for p in oracle.points]
    modal = LagrangianOracle(oracle.spec, basis=basis)
    change = np.eye(oracle.dof)
    for where, modes in zip(oracle.shape_slice, basis, strict=True):
        change[where, where] = modes
    eta, eta_rate = np.linalg.solve(change, np.array([q, qd]).T).T
    found = change @ modal.acceleration(eta, eta_rate, torque)
    exact = oracle.acceleration(change @ eta, change @ eta_rate, torque)
    # Rounding of the coordinates, and that of the oracle times the condition number of M (1e5; an
    # extended number has the precision of a double on some platforms).
    tolerance = 1e-13 + 1e5 * np.finfo(np.longdouble).eps
    assert abs(found - exact).max() < tolerance * abs(exact).max()


def test_random_arms_have_every_option_on_and_off():
    rng = np.random.default_rng(5)
    specs = [random_spec(rng) for _ in range(60)]
    links = [link for spec in specs for link in spec.links]
    joints = [joint for spec in specs for joint in spec.joints]
    choices = {
        "theory": {spec.theory for spec in specs} == {"linear", "second_order"},
        "count": {len(spec.links) for spec in specs} == {1, 2, 3, 4},
        "gravity": {spec.gravity == (0.0, 0.0) for spec in specs} == {True, False},
        "flexible": {link.flexible for link in links} == {True, False},
        "damping": {getattr(link.damping, "kind", None) for link in links}
        == {None, "modal", "rayleigh"},
        "beam": {(link.table is None, link.material is None) for link in links}
        == {(True, True), (True, False), (False, True)},
        "payload": {spec.payload.mass > 0 for spec in specs} == {True, False},
        "offset": {spec.payload.offset == (0.0, 0.0) for spec in specs} == {True, False},
    }
    for name in ("hub_inertia", "mass", "housing_inertia", "damping"):
        choices[name] = {getattr(joint, name) > 0 for joint in joints} == {True, False}
    assert [name for name, complete in choices.items() if not complete] == []


def test_random_arms_have_the_requested_options():
    rng = np.random.default_rng(6)
    for _ in range(10):
        spec = random_spec(
            rng, links=3, theory="linear", elements=2, rigid=False, gravity=False, damping=False
        )
        assert len(spec.links) == 3
        assert spec.theory == "linear"
        assert spec.gravity == (0.0, 0.0)
        assert all(j.damping == 0 for j in spec.joints)
        assert all(n.flexible and n.elements == 2 and n.damping is None for n in spec.links)
    reduced = random_spec(rng, rigid=False, reduced=True)
    assert all(1 <= link.modes <= 2 * link.elements for link in reduced.links)
