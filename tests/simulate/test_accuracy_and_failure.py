"""Accuracy for given tolerances, and runs that fail."""

import sys

import numpy as np
import pytest

import flexarm as fa
from arms import table_one_arm
from flexarm.integrate import RungeKutta4
from flexarm.simulation.run.tolerance import fastest_frequency


def torque(t):
    return [4.0 * np.sin(6.0 * t), 1.5 * np.sin(6.0 * t)]


def run(arm, **options):
    return fa.simulate(
        arm, 1.0, torque=torque, initial=arm.rest([0.8, -1.5]), rate=100.0, **options
    )


def test_run_whose_steps_shrink_is_stopped(monkeypatch):
    """The limits are days of computing; here they are ten steps."""
    module = sys.modules["flexarm.simulation.run.stepping"]
    for name in ("_MOST_STEPS", "_MOST_STEPS_A_TICK"):
        monkeypatch.setattr(module, name, 10.0)
    with pytest.raises(fa.SimulationError, match=r"the step has shrunk to 0\.001 s") as failure:
        run(table_one_arm(), step=1e-3)
    kept = failure.value.result
    assert 0 < kept.sizes["time"] < 101
    assert kept.ended_by == "failure"


@pytest.mark.thorough_cases("second_order")
@pytest.mark.parametrize("integrator", ["dormand_prince_8"])
@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_tip_error_is_proportional_to_the_tolerance(integrator, theory):
    arm = table_one_arm(theory=theory)
    exact = run(arm, rtol=1e-12, atol=1e-14).tip.values
    levels = np.array([1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9])
    errors = np.array(
        [
            abs(run(arm, integrator=integrator, rtol=r, atol=r / 100).tip.values - exact).max()
            for r in levels
        ]
    )
    slope = np.polyfit(np.log(levels), np.log(errors), 1)[0]
    assert 0.75 < slope < 1.25
    # The documented accuracy of the defaults: 1e-6 of the reach at most.
    assert errors[levels == 1e-7][0] < 2.4e-6
    assert np.all(errors < 10.0 * levels)  # metres, for a reach of 2.4 m


def test_fixed_steps_converge_to_the_same_motion():
    arm = table_one_arm()
    exact = run(arm, rtol=1e-12, atol=1e-14).tip.values
    steps = np.array([4e-4, 2e-4, 1e-4])
    errors = [abs(run(arm, step=step).tip.values - exact).max() for step in steps]
    assert run(arm, step=1e-3 / 4).attrs["integrator"] == "rk4"
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(4.0, abs=0.4)


@pytest.mark.parametrize("links", [1, 3])
@pytest.mark.parametrize("elements", [1, 8])
def test_fastest_frequency_is_the_highest_of_the_free_arm(links, elements):
    link = fa.Link(length=0.8, flexural_rigidity=30.0, mass_per_length=0.5, elements=elements)
    arm = fa.Arm(links=[link] * links, payload=fa.Payload(mass=0.5))
    angles = np.linspace(0.3, 1.0, links)
    state = arm.padded(np.stack([arm.rest(angles), np.zeros(arm.dof)]))
    highest = 2 * np.pi * fa.modes(arm, angles, joints="free").frequency_hz[-1]
    found = fastest_frequency(arm, state)
    # Growth of an iterate, which a far from symmetric matrix may slightly overestimate.
    assert 0.9 * highest < found < 1.02 * highest


def test_rigid_arm_has_no_fast_frequency():
    arm = table_one_arm().rigid()
    state = arm.padded(np.stack([arm.rest([0.0, 0.0]), np.zeros(2)]))
    assert fastest_frequency(arm, state) == 0.0


def test_too_long_a_step_is_reported_with_time_reason_hint_and_partial_result():
    """The fastest mode of the arm has 3700 rad/s; 10 ms are far too long for it."""
    arm = table_one_arm()
    with pytest.raises(fa.SimulationError) as caught:
        fa.simulate(arm, 5.0, torque=torque, integrator=RungeKutta4(step=0.01), rate=100.0)
    error = caught.value
    assert 0.0 < error.time < 5.0
    assert "the step is too long" in error.reason
    assert "smaller step" in error.hint
    assert str(error).startswith(f"stopped at t = {error.time:.6g} s: ")
    q, qd = error.state
    assert np.all(np.isfinite(q))
    assert np.all(np.isfinite(qd))
    result = error.result
    assert result.sizes["time"] == int(np.floor(error.time * 100.0 + 1e-9)) + 1
    assert np.all(np.isfinite(result.q.values))
    assert result.attrs["failure"] == str(error)
    np.testing.assert_array_equal(result.q.values[0], np.zeros(arm.dof))


@pytest.mark.thorough
def test_partial_result_can_be_written(tmp_path):
    arm = table_one_arm()
    with pytest.raises(fa.SimulationError) as caught:
        fa.simulate(arm, 5.0, torque=torque, integrator="rk4", step=0.01)
    caught.value.result.to_netcdf(tmp_path / "part.nc", engine="h5netcdf")


def test_run_starts_at_the_start_of_the_motion():
    arm = table_one_arm()
    motion = fa.joint_motion(arm, [0.3, -0.4], [0.8, 0.1], 1.0)
    for options in (
        {"torque": fa.rigid_torque(arm, motion)},
        {"controller": fa.JointPD(5.0, 0.5), "reference": motion},
    ):
        result = fa.simulate(arm, 0.01, **options)
        np.testing.assert_allclose(result.joint_angle.values[0], [0.3, -0.4], rtol=1e-12)
    result = fa.simulate(arm, 0.01)
    np.testing.assert_array_equal(result.joint_angle.values[0], 0.0)
