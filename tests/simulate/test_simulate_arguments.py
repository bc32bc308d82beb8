"""Arguments of ``simulate`` besides the torque: another plant, a tip force; and wrong ones."""

from __future__ import annotations

import importlib

import numpy as np
import pytest

import flexarm as fa
from flexarm.integrate import RungeKutta4


def one_link(**options) -> fa.Arm:
    rod = {"flexural_rigidity": 20.0, "mass_per_length": 0.5}
    return fa.Arm(links=[fa.Link(length=1.0, elements=1, **rod)], **options)


def test_plant_is_simulated_instead_of_the_arm():
    arm, heavy = one_link(), one_link(payload=fa.Payload(mass=1.0))
    found = fa.simulate(arm, 0.2, torque=lambda t: [1.0], plant=heavy)
    wanted = fa.simulate(heavy, 0.2, torque=lambda t: [1.0])
    assert found.identical(wanted.assign_attrs(wall_seconds=found.attrs["wall_seconds"]))
    assert not np.allclose(found.tip, fa.simulate(arm, 0.2, torque=lambda t: [1.0]).tip)


def test_tip_force_equals_the_torque_of_its_lever():
    """On a rigid link at right angles a force F at length L is a torque F L."""
    arm = one_link().rigid()
    pulled = fa.simulate(arm, 1e-3, tip_force=(0.0, 2.0), rate=1e4)
    driven = fa.simulate(arm, 1e-3, torque=[[2.0]] * 11, rate=1e4)
    # The link turns by a few microradians, which shortens the lever to second order.
    np.testing.assert_allclose(pulled.joint_angle, driven.joint_angle, rtol=1e-9, atol=1e-18)
    twisted = fa.simulate(arm, 1e-3, tip_force=(0.0, 0.0, 2.0), rate=1e4)
    np.testing.assert_allclose(twisted.joint_angle, driven.joint_angle, rtol=1e-9, atol=1e-18)


def test_result_contains_its_scenario(tmp_path):
    text = (
        "flexarm: 1\n"
        "arm: {links: [{length: 1.0, flexural_rigidity: 20.0, mass_per_length: 0.5}]}\n"
        "run: {duration: 0.01}\n"
    )
    (tmp_path / "run.yaml").write_text(text)
    result = fa.run_scenario(tmp_path / "run.yaml")
    (tmp_path / "again.yaml").write_text(result.attrs["scenario"])
    again = fa.run_scenario(tmp_path / "again.yaml")
    assert again.attrs["scenario"] == result.attrs["scenario"]
    np.testing.assert_array_equal(again.tip, result.tip)


def test_motion_out_of_reach_is_reported_with_line_and_key(tmp_path):
    text = (
        "flexarm: 1\n"
        "arm: {links: [{length: 1.0, flexural_rigidity: 20.0, mass_per_length: 0.5},"
        " {length: 1.0, flexural_rigidity: 20.0, mass_per_length: 0.5}]}\n"
        "motion: {kind: line, start: [1.0, 0.5], end: [3.0, 0.0], duration: 1.0}\n"
        "drive: {kind: rigid_inverse_dynamics}\n"
        "run: {duration: 0.01}\n"
    )
    path = tmp_path / "far.yaml"
    path.write_text(text)
    with pytest.raises(fa.InputError, match=r"far\.yaml:3: motion\.end must .* reach"):
        fa.run_scenario(path)


class Silent:
    """A controller with all members, from which tests remove one."""

    sample_time = 1e-3

    def reset(self):
        pass

    def update(self, t, measurement, reference):
        return [0.0]


def broken(**attributes):
    return type("Broken", (Silent,), attributes)()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"step": "abc"}, "step must be"),
        ({"step": -1.0}, "step must be greater than 0"),
        (
            {"step": 0.01, "integrator": RungeKutta4(step=1e-3)},
            (
                r"step cannot be combined with an integrator object\. "
                r"Use integrator=RungeKutta4\(step=0\.01\)"
            ),
        ),
        ({"integrator": ["rk4"]}, "integrator must be one of"),
        ({"controller": object()}, "controller must have the method reset"),
        ({"controller": broken(sample_time=float("nan"))}, "controller.sample_time must be"),
        ({"controller": broken(sample_time=0.0)}, "controller.sample_time must be greater than 0"),
        (
            {"rate": 1e12},
            (
                r"rate must be at most 1e\+08 for a duration of 0.1, got 1000000000000\. A "
                r"result has at most"
            ),
        ),
        ({"plant": "arm"}, "plant must be an Arm"),
        ({"torque": np.zeros((5, 3))}, "torque must be numbers of shape"),
        ({"torque": np.zeros((5, 1))}, "torque must have at least"),
        ({"torque": np.zeros((200, 1)), "torque_interpolation": "spline"}, "torque_interpolation"),
        ({"tip_force": [1.0]}, "tip_force must be"),
        ({"breaks": "x"}, "breaks must be numbers"),
        ({"torque_interpolation": "x"}, "torque_interpolation must be one of"),
    ],
)
def test_wrong_arguments_have_one_form_of_message(arguments, message):
    with pytest.raises(fa.InputError, match=message):
        fa.simulate(one_link(), 0.1, **arguments)


def test_controller_that_raises_ends_the_run_with_its_time():
    def update(self, t, measurement, reference):
        if t > 0.0045:
            raise KeyError("gain")
        return [0.0]

    with pytest.raises(fa.SimulationError, match="KeyError: 'gain'") as caught:
        fa.simulate(one_link(), 0.1, controller=broken(update=update))
    assert caught.value.time == pytest.approx(0.005)
    assert caught.value.result.sizes["time"] == 6


def test_open_loop_run_that_fails_has_a_partial_result():
    arm = one_link(gravity=(0.0, -9.81))
    with pytest.raises(fa.SimulationError, match="the step is too long") as caught:
        fa.simulate(arm, 50.0, integrator="rk4", step=0.01, rate=100.0)
    error = caught.value
    assert 0.0 < error.time < 50.0
    assert "Try" in error.hint
    assert np.all(np.isfinite(error.state[0]))
    assert 0 < error.result.sizes["time"] < 5001
    assert error.result.attrs["failure"] == str(error)


def test_noise_as_a_function_of_time_is_rejected(monkeypatch):
    # No number of pieces follows noise; with fewer of them the error is faster.
    history = importlib.import_module("flexarm.simulation.histories.piecewise")
    monkeypatch.setattr(history, "_MOST_PIECES", 1000)
    rng = np.random.default_rng(0)
    with pytest.raises(fa.InputError, match="give noise as samples"):
        fa.simulate(one_link(), 0.1, torque=lambda t: [rng.normal()])
    # The same noise as samples is accepted.
    fa.simulate(one_link(), 0.1, torque=rng.normal(size=(101, 1)), torque_interpolation="hold")
