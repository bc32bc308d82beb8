"""Fixed-step methods without a given step: in closed loops, with events, and failures."""

import numpy as np
import pytest

import flexarm as fa
from flexarm.integrate import INTEGRATORS
from flexarm.simulation.run import default_step

FIXED = [name for name, kind in INTEGRATORS.items() if not kind.adaptive]
ROD = {"length": 1.0, "mass_per_length": 1.0}


def pendulum(**options):
    return fa.Arm(links=[fa.Link(flexible=False, **ROD)], gravity=(0.0, -9.81), **options)


@pytest.mark.parametrize("name", FIXED)
def test_result_states_the_step_and_counts_all_evaluations(name):
    result = fa.simulate(pendulum(), 2.0, integrator=name, rate=100.0)
    same = fa.simulate(pendulum(), 2.0, integrator=name, step=2.0 / result.steps, rate=100.0)
    # The same steps give the same motion; the evaluations of the coarser trials are added.
    np.testing.assert_allclose(result.q, same.q, rtol=0, atol=1e-12)
    assert result.evaluations > 1.4 * same.evaluations
    assert result.integrator_reason.startswith(f"named by the user; step {2.0 / result.steps:.3g}")


@pytest.mark.parametrize("name", FIXED)
def test_given_step_is_used_without_trials(name):
    result = fa.simulate(pendulum(), 2.0, integrator=name, step=0.1, rate=100.0)
    assert result.steps == 20
    assert result.integrator_reason == "named by the user"


@pytest.mark.parametrize("name", FIXED)
def test_events_are_those_of_the_accepted_run(name):
    """A rejected trial passes the bottom too, at another time."""
    arm = pendulum()
    bottom = fa.joint_event(arm, 1, -0.5 * np.pi, name="bottom")
    turn = fa.joint_event(arm, 1, -3.0, name="far", terminal=True)
    result = fa.simulate(arm, 50.0, integrator=name, rate=20.0, events=[bottom, turn])
    exact = fa.simulate(arm, 50.0, rtol=1e-12, atol=1e-14, rate=20.0, events=[bottom, turn])
    assert result.event_name.values.tolist() == ["bottom", "far"]
    assert result.ended_by == "far"
    # Accepted trials of the first second differ by up to 1e-4 m; the rod turns at 1 rad/s at least.
    np.testing.assert_allclose(result.event_time, exact.event_time, rtol=0, atol=2e-4)


@pytest.mark.parametrize("name", FIXED)
def test_loop_compares_trials_at_each_sample_time(name):
    arm = pendulum()
    motion = fa.joint_motion(arm, [0.0], [1.0], duration=0.5)

    def controller():
        return fa.JointPD([30.0], [8.0], sample_time=0.02)

    settings = {"reference": motion, "rate": 100.0}
    result = fa.simulate(arm, 0.5, controller=controller(), integrator=name, **settings)
    exact = fa.simulate(arm, 0.5, controller=controller(), rtol=1e-12, atol=1e-14, **settings)
    assert np.linalg.norm((result.tip - exact.tip).values, axis=1).max() < 1e-4
    assert result.steps >= 50  # at least two in each of the 25 sample times


def test_steps_that_the_method_shortens_are_not_compared():
    """With strong damping ``cowell_4`` takes the same steps for all longer requested ones."""
    damped = fa.Joint(hub_inertia=0.01, damping=50.0)
    arm = fa.Arm(links=[fa.Link(flexible=False, **ROD)], joints=[damped], gravity=(0.0, -9.81))
    result = fa.simulate(arm, 1.0, integrator="cowell_4", rate=100.0)
    exact = fa.simulate(arm, 1.0, rtol=1e-12, atol=1e-14, rate=100.0)
    assert np.linalg.norm((result.tip - exact.tip).values, axis=1).max() < 1e-4


def test_trials_truncated_by_stops_of_the_torque_are_not_compared():
    """The torque is constant for 0.1 s, so steps of 0.2 s and of 0.1 s would be the same."""
    arm = pendulum()
    torque = np.array([[3.0], [-2.0]] * 6)[:11]
    settings = {"torque": torque, "torque_interpolation": "hold", "rate": 10.0}
    result = fa.simulate(arm, 1.0, integrator="generalized_alpha", **settings)
    exact = fa.simulate(arm, 1.0, rtol=1e-12, atol=1e-14, **settings)
    assert np.linalg.norm((result.tip - exact.tip).values, axis=1).max() < 1e-4


def test_run_fails_if_no_step_is_short_enough(monkeypatch):
    monkeypatch.setattr(default_step, "ALLOWED", 0.0)
    monkeypatch.setattr(default_step, "_MOST_STEPS", 1e3)
    with pytest.raises(fa.SimulationError, match="no step was given, and at one of") as caught:
        fa.simulate(pendulum(), 1.0, integrator="rk4", rate=100.0)
    assert "integrator='auto'" in caught.value.hint
    assert caught.value.result.sizes["time"] > 0


def test_copy_of_a_plant_finds_its_own_steps():
    import copy

    plant = fa.Plant(pendulum(), 0.05, integrator="generalized_alpha")
    for _ in range(3):
        plant.step([0.0])
    other = copy.deepcopy(plant)
    for one in (plant, other):
        for _ in range(3):
            one.step([1.0])
    np.testing.assert_array_equal(plant.q, other.q)
