"""Functions of CasADi against the methods of the arm, and against CasADi's derivatives."""

import sys

import casadi
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
from flexarm.bridges.symbolic.kernel_calls import ParametricArm
from flexarm.model.paths import number_paths, with_number
from random_options import busy


def values(model, name, given, parameters=()):
    """Evaluate a function with inputs by name, and join its outputs to one vector."""
    function = getattr(model, name)
    inputs = {key: given[key] for key in function.name_in() if key in given}
    by_name = function(**inputs, parameters=np.asarray(parameters))
    found = [np.array(by_name[output]) for output in function.name_out()]
    if len(found) > 1:
        return np.array([one.item() for one in found])
    array = found[0]
    return array.ravel() if array.shape[1] == 1 else array


def assert_all_same(model, arm, given, parameters=()):
    for name, wanted in expected(arm, **given).items():
        found = values(model, name, given, parameters).reshape(wanted.shape)
        assert_same(name, found, wanted, arm, given["q"])


@pytest.mark.sampled("2000", "2002")
@pytest.mark.parametrize("seed", range(2000, 2006))
def test_every_option_on_random_arms(seed):
    b = busy(seed, theory=["linear", "second_order"][seed % 2], reduced=seed % 3 == 0)
    assert_all_same(fa.to_casadi(b.arm), b.arm, of_busy(b))


@pytest.mark.sampled("linear")
@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_parameters_equal_an_arm_with_these_values(theory):
    """21 parameters are changed."""
    arm = parametric(theory)
    model = fa.to_casadi(arm, parameters=list(PARAMETERS))
    assert model.parameters == tuple(PARAMETERS)
    others, other_arm = changed(arm)
    for parameters, same in ((model.nominal, arm), (others, other_arm)):
        assert_all_same(model, same, arguments(arm, 5), parameters)


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_length_as_a_parameter(theory):
    link = {"flexural_rigidity": 20.0, "mass_per_length": 0.5, "elements": 2}
    arms = [
        fa.Arm(
            links=[{"length": length, **link}, {"length": 0.5, **link}],
            gravity=(0.0, -9.8),
            theory=theory,
        )
        for length in (0.8, 0.9)
    ]
    model = fa.to_casadi(arms[0], parameters=["links[0].length"])
    assert_all_same(model, arms[1], arguments(arms[0], 6), [0.9])


def test_every_number_is_an_exact_parameter_or_rejected():
    """An accepted parameter gives the accelerations of an arm with that value."""
    arm = parametric("second_order")
    given, accepted = arguments(arm, 7), []
    acting = [given[name] for name in ("q", "qd", "torque", "tip_force")]
    for path in number_paths(arm.spec):
        try:
            of_values = ParametricArm(arm, [path], [])
        except fa.InputError:
            continue
        accepted.append(path)
        nominal = of_values.nominal[0]
        other = 1.05 * nominal if nominal else 0.05
        numbers = (array.astype(object) for array in acting)
        found = of_values.at([other]).forward_dynamics(*numbers).astype(float)
        changed_arm = fa.Arm(with_number(arm.spec, path, other))
        wanted = changed_arm.forward_dynamics(*acting)
        assert_same("forward_dynamics", found, wanted, changed_arm, given["q"])
    assert set(PARAMETERS) <= set(accepted)
    refused = {"links[0].length", "links[1].length", "links[1].section.height"}
    assert not refused & set(accepted)


def test_prescribed_joint():
    arm = parametric("second_order")
    model = fa.to_casadi(arm, prescribed=[2])
    given = arguments(arm, 8)
    qdd = values(model, "forward_dynamics", given)
    assert qdd[arm.joint_index[1]] == given["torque"][1]
    torque = arm.inverse_dynamics(given["q"], given["qd"], qdd, given["tip_force"])
    # The torque of the prescribed motion gives the same accelerations.
    torque = torque[arm.joint_index]
    # Large forces cancel, so the tolerance is the rounding of accelerations times the condition
    # number of the mass matrix.
    rounding = 1e-10 * (np.abs(arm.mass_matrix(given["q"])) @ np.abs(qdd)).max()
    assert abs(torque[0] - given["torque"][0]) < rounding
    again = arm.forward_dynamics(given["q"], given["qd"], torque, given["tip_force"])
    np.testing.assert_allclose(qdd, again, rtol=0, atol=1e-9 * np.abs(again).max())


def test_lagrange_equations_by_symbolic_differentiation():
    """The inverse dynamics equals d/dt dT/dqd - dT/dq + dU/dq from the expressions of the
    energies."""
    arm = fa.Arm(links=parametric("second_order").spec.links, theory="second_order")
    model = fa.to_casadi(arm)
    q, qd, qdd = (casadi.SX.sym(name, arm.dof) for name in ("q", "qd", "qdd"))
    kinetic, strain, gravity = model.energy(q, qd, [])
    momentum = casadi.gradient(kinetic, qd)
    rate = casadi.jtimes(momentum, q, qd) + casadi.jtimes(momentum, qd, qdd)
    force = rate - casadi.gradient(kinetic - strain - gravity, q)
    function = casadi.Function("force", [q, qd, qdd], [force])
    given = arguments(arm, 9)
    found = np.array(function(given["q"], given["qd"], given["qdd"])).ravel()
    wanted = arm.inverse_dynamics(given["q"], given["qd"], given["qdd"])
    wanted -= arm.damping_matrix() @ given["qd"]
    # Energies are sums of a few hundred products, each with its rounding.
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-11 * abs(wanted).max())


def test_jacobian_of_friction_at_rest():
    """The slope of friction is largest at rest, and CasADi's rules must keep it."""
    arm = parametric("second_order")
    given = {**arguments(arm, 10), "qd": np.zeros(arm.dof)}
    function = fa.to_casadi(arm).forward_dynamics
    jacobian = function.jacobian()
    inputs = [given["q"], given["qd"], given["torque"], np.zeros(3), []]
    found = np.array(jacobian(*inputs, function(*inputs))[1])
    wanted = arm.derivatives(given["q"], given["qd"], given["torque"]).qd
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-10 * np.abs(wanted).max())


def test_omitted_inputs_give_nan():
    """A call without the state or the parameters must not compute with zeros."""
    arm = parametric("linear")
    model = fa.to_casadi(arm, parameters=["payload.mass"])
    given = arguments(arm, 11)
    motion = {name: given[name] for name in ("q", "qd", "torque")}
    function = model.forward_dynamics
    assert np.isnan(np.array(function(**motion)["qdd"])).any()
    found = function(**motion, parameters=model.nominal)["qdd"]
    unloaded = arm.forward_dynamics(*motion.values())
    np.testing.assert_allclose(np.array(found).ravel(), unloaded, rtol=1e-9, atol=1e-9)


REFUSED = {
    "links[0].lenght": "links[0] has no lenght; did you mean length?",
    "links[7].length": "links has no 7",
    "links[0].elements": "It is 2 there.",
    "joints[1].friction.coulomb": "joints[1].friction has no coulomb",
    "payload": "It is Payload",
    "payload mass": "did you mean payload?",
    "links[1].section.height": "Possible for links[1]: ",
    "joints[1].rest_angle": "It is 0 in this arm",
    "links[0].length": "form of the modes",
}


@pytest.mark.parametrize("path", REFUSED)
def test_numbers_that_cannot_be_parameters_are_rejected(path):
    with pytest.raises(fa.InputError) as error:
        fa.to_casadi(parametric("linear"), parameters=["payload.mass", path])
    assert "parameters[1]" in str(error.value)
    assert REFUSED[path] in str(error.value)


def test_shear_parameters_that_change_the_modes_are_rejected():
    link = {"length": 0.5, "material": "steel", "section": fa.Rectangle(width=0.02, height=0.02)}
    arm = fa.Arm(links=[{**link, "element": "timoshenko", "elements": 2}])
    fa.to_casadi(arm, parameters=["links[0].material.youngs_modulus"])
    with pytest.raises(fa.InputError, match=r"links.0..material.poissons_ratio"):
        fa.to_casadi(arm, parameters=["links[0].material.poissons_ratio"])


def test_wrong_arguments_are_rejected():
    arm = parametric("linear")
    with pytest.raises(fa.InputError, match=r"repeats payload.mass"):
        fa.to_casadi(arm, parameters=["payload.mass", "payload.mass"])
    with pytest.raises(fa.InputError, match=r"prescribed\[0\]"):
        fa.to_casadi(arm, prescribed=[3])
    with pytest.raises(fa.InputError, match="arm must be an Arm"):
        fa.to_casadi(arm.spec)


def test_without_casadi_the_error_names_the_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(fa.InputError, match=r"pip install 'flexarm\[casadi\]'"):
        fa.to_casadi(parametric("linear"))
