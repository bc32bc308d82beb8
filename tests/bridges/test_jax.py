"""Functions of JAX against the methods of the arm, and transformations of these functions."""

import sys

import numpy as np
import pytest

import flexarm as fa
from bridges.symbolic_cases import (
    PARAMETERS,
    arguments,
    assert_same,
    changed,
    expected,
    of_busy,
    parametric,
)
from random_options import busy

jax = pytest.importorskip("jax", reason="JAX is not installed: fa.to_jax was not tried")
jnp = jax.numpy

ARGUMENTS = {
    "forward_dynamics": ("q", "qd", "torque", "tip_force"),
    "residual": ("q", "qd", "qdd", "torque", "tip_force"),
    "inverse_dynamics": ("q", "qd", "qdd", "tip_force"),
    "bias_force": ("q", "qd"),
    "mass_matrix": ("q",),
    "energy": ("q", "qd"),
    "tip": ("q",),
    "tip_velocity": ("q", "qd"),
    "strain": ("q",),
    "joint_reactions": ("q", "qd", "qdd", "tip_force"),
}


@pytest.fixture(autouse=True)
def _double_precision():
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", before)


@pytest.fixture(scope="module")
def small():
    """Return a model of one flexible link with friction, with two parameters."""
    arm = fa.Arm(
        links=[{"length": 0.7, "flexural_rigidity": 12.0, "mass_per_length": 0.4, "modes": 2}],
        joints=[{"hub_inertia": 0.02, "friction": {"coulomb": 0.2, "smoothing_rate": 0.3}}],
        payload={"mass": 0.1},
        gravity=(0.0, -9.81),
        theory="second_order",
    )
    return arm, fa.to_jax(arm, parameters=["payload.mass", "links[0].flexural_rigidity"])


def values(model, name, given, parameters=None):
    chosen = {key: given[key] for key in ARGUMENTS[name]}
    return np.array(getattr(model, name)(**chosen, parameters=parameters))


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [2000, 2003])
def test_every_option_on_random_arms(seed):
    b = busy(seed, theory=["linear", "second_order"][seed % 2], reduced=True)
    given, model = of_busy(b), fa.to_jax(b.arm)
    # Without compilation, which would take most of the time.
    with jax.disable_jit():
        for name, wanted in expected(b.arm, **given).items():
            assert_same(name, values(model, name, given), wanted, b.arm, given["q"])


@pytest.mark.thorough
def test_parameters_equal_an_arm_with_these_values():
    arm = parametric("second_order")
    model = fa.to_jax(arm, parameters=list(PARAMETERS))
    others, other_arm = changed(arm)
    given = arguments(arm, 5)
    with jax.disable_jit():
        for name, wanted in expected(other_arm, **given).items():
            found = values(model, name, given, others)
            assert_same(name, found, wanted, other_arm, given["q"])


@pytest.mark.thorough
def test_jit_vmap_and_derivatives_agree(small):
    arm, model = small
    given = arguments(arm, 1)
    q, qd, torque = given["q"], given["qd"], given["torque"]
    wanted = arm.forward_dynamics(q, qd, torque)
    np.testing.assert_allclose(
        jax.jit(model.forward_dynamics)(q, qd, torque),
        wanted,
        rtol=0,
        atol=1e-11 * max(abs(wanted)),
    )
    many = jax.vmap(model.forward_dynamics, in_axes=(0, 0, None))
    found = many(np.stack([q, 0.5 * q]), np.stack([qd, qd]), torque)
    other = arm.forward_dynamics(0.5 * q, qd, torque)
    np.testing.assert_allclose(found, [wanted, other], rtol=0, atol=1e-11 * max(abs(wanted)))
    exact = arm.derivatives(q, qd, torque)
    by_q, by_qd, by_torque = jax.jacrev(model.forward_dynamics, argnums=(0, 1, 2))(q, qd, torque)
    for one, other in ((by_q, exact.q), (by_qd, exact.qd), (by_torque, exact.torque)):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-11 * np.abs(other).max())
    along = np.ones(arm.dof)
    _, slope = jax.jvp(lambda q: model.forward_dynamics(q, qd, torque), (jnp.array(q),), (along,))
    np.testing.assert_allclose(slope, exact.q @ along, rtol=0, atol=1e-11 * np.abs(exact.q).max())


@pytest.mark.thorough
def test_gradient_of_friction_at_rest(small):
    """The slope of friction is largest at rest, and JAX's rules must keep it."""
    arm, model = small
    q, rest, torque = arguments(arm, 2)["q"], np.zeros(arm.dof), np.zeros(1)
    found = jax.jacfwd(model.forward_dynamics, argnums=1)(q, rest, torque)
    wanted = arm.derivatives(q, rest, torque).qd
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-11 * np.abs(wanted).max())


@pytest.mark.thorough
def test_derivative_by_a_parameter(small):
    arm, model = small
    q = arguments(arm, 3)["q"]

    def energy(parameters):
        return model.energy(q, jnp.zeros(arm.dof), parameters=parameters).total

    found = jax.grad(energy)(model.nominal)
    # Strain energy is proportional to the rigidity, gravity energy linear in the payload.
    exact = arm.energy(q, np.zeros(arm.dof))
    assert found[1] * model.nominal[1] == pytest.approx(exact.strain, rel=1e-12)
    assert found[0] == pytest.approx(9.81 * arm.tip(q)[1], rel=1e-12)


@pytest.mark.thorough
def test_single_precision_is_kept(small):
    """Results of float32 inputs are float32, also at rest, where squares of small numbers
    underflow."""
    arm, model = small
    given = {key: np.float32(value) for key, value in arguments(arm, 4).items()}
    q, qd, torque = given["q"], 0.0 * given["qd"], given["torque"]
    found = model.forward_dynamics(q, qd, torque)
    assert found.dtype == jnp.float32
    wanted = arm.forward_dynamics(q, qd, torque)
    # 1e-7 for each of a few operations, with some cancellation.
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-4 * max(abs(wanted)))
    slope = jax.jacfwd(model.forward_dynamics, argnums=1)(q, qd, torque)
    exact = arm.derivatives(q, qd, torque).qd
    np.testing.assert_allclose(slope, exact, rtol=0, atol=1e-3 * np.abs(exact).max())


@pytest.mark.parametrize("wrong", [[0.0, 1.0], "text", [[0.0]], None, [1j]])
def test_wrong_shapes_are_rejected(small, wrong):
    _, model = small
    with pytest.raises(fa.InputError, match=r"JaxModel.tip: q must be numbers of shape \(3,\)"):
        model.tip(wrong)
    with pytest.raises(fa.InputError, match="parameters must be numbers of shape"):
        model.tip(np.zeros(3), parameters=[1.0])


def test_without_jax_the_error_names_the_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "jax", None)
    with pytest.raises(fa.InputError, match=r"pip install 'flexarm\[jax\]'"):
        fa.to_jax(parametric("linear"))
