"""Runs with a requested accuracy: true errors, estimates, and what cannot be combined with it."""

import warnings
from functools import partial
from unittest.mock import Mock

import numpy as np
import pytest
import xarray as xr

import flexarm as fa
import page_scripts
from accuracy_runs import QUIET, random_arm, tip_error
from flexarm.simulation.calls.run import with_error


@pytest.mark.thorough
@pytest.mark.parametrize("part", [1e-4, 1e-6])
def test_errors_are_below_the_request_and_its_estimate(part):
    over, estimates = [], []
    for seed in range(9):
        arm, torque = random_arm(seed, friction=seed > 6)
        accuracy = part * float(arm.lengths.sum())
        result = fa.simulate(arm, 0.6, torque=torque, accuracy=accuracy, **QUIET)
        error = tip_error(arm, result, torque=torque)
        over.append(error / accuracy)
        estimates.append(error / result.attrs["integration_error"])
        assert result.attrs["integration_error"] <= accuracy
    assert max(over) < 1.5  # the request is an estimate: above three times it must warn
    assert np.median(over) < 1.0
    assert np.mean(np.array(estimates) < 1.0) > 0.7


def test_full_mesh_takes_far_fewer_evaluations_than_an_explicit_method():
    links = [fa.Link(length=1.0, flexural_rigidity=100.0, mass_per_length=0.5, elements=4)] * 2
    arm = fa.Arm(links=links)
    run = {"torque": lambda t: np.array([1.0, 0.3]) * np.sin(3.0 * t) ** 2, **QUIET}
    explicit = fa.simulate(arm, 0.6, rtol=1e-7, integrator="dormand_prince_8", **run)
    result = fa.simulate(arm, 0.6, accuracy=2e-5, **run)
    assert result.attrs["integrator"] == "kennedy_carpenter_5"
    assert result.attrs["evaluations"] < 0.2 * explicit.attrs["evaluations"]
    assert np.abs(result.tip - explicit.tip).max() < 2e-5


def test_growing_errors_warn():
    # A chain of three links that falls for 8 s: the motion is chaotic.
    links = [fa.Link(length=0.3, flexible=False, mass_per_length=1.0)] * 3
    arm = fa.Arm(links=links, gravity=(0.0, -9.81))
    start = arm.rest([2.0, 1.0, 0.5])
    with pytest.warns(fa.AccuracyWarning, match="errors grow in this motion"):
        result = fa.simulate(arm, 20.0, initial=start, accuracy=1e-9, **QUIET)
    assert result.attrs["integration_error"] > 1e-9
    assert "errors grow" in result.attrs["warning"]


def test_controller_keeps_the_state_of_the_returned_run():
    arm, _ = random_arm(1)
    motion = fa.joint_motion(arm, [0.0, 0.0], [0.3, -0.2], 0.5)
    integral = fa.JointPID(proportional=1.0, derivative=0.1, integral=0.2, sample_time=5e-4)
    result = fa.simulate(arm, 0.6, controller=integral, reference=motion, accuracy=1e-5, **QUIET)
    again = fa.JointPID(proportional=1.0, derivative=0.1, integral=0.2, sample_time=5e-4)
    method = {"integrator": result.attrs["integrator"], "rtol": result.attrs["rtol"]}
    alone = fa.simulate(arm, 0.6, controller=again, reference=motion, **method, **QUIET)
    assert np.array_equal(result.torque, alone.torque)
    assert result.attrs["integration_error"] <= 1e-5


def test_steps_between_samples_are_verified_by_another_method():
    """Equal steps of one method have a difference of zero, whatever their error is."""
    arm, _ = random_arm(1)
    motion = fa.joint_motion(arm, [0.0, 0.0], [0.3, -0.2], 0.5)
    law = fa.JointPD(proportional=1.0, derivative=0.1, sample_time=5e-4)
    follow = {"controller": law, "reference": motion, **QUIET}
    run = fa.simulate(arm, 0.6, accuracy=1e-4, **follow)
    exact = fa.simulate(arm, 0.6, rtol=1e-12, integrator="dormand_prince_8", **follow)
    error = np.abs(run.tip - exact.tip).max().item()
    assert error < run.attrs["integration_error"] < 1e-4


def test_methods_that_disagree_are_not_called_accurate():
    """Also if finer tolerances change nothing: the steps are those of the samples.

    A method that agrees is asked once.
    """

    def run(tip, method):
        values = xr.DataArray(np.full((5, 2), tip), dims=("time", "axis"))
        attributes = {"integrator": method, "steps": 100, "controller_calls": 100, "rtol": 1e-6}
        work = {"evaluations": 1000, "wall_seconds": 1.0, "unstable_loop": ""}
        return xr.Dataset({"tip": values}, attrs=attributes | work), []

    def executed(tip, accuracy, integrator="dormand_prince_8"):
        return run(tip if integrator == "kennedy_carpenter_5" else 1.0, integrator)

    first = run(1.0, "dormand_prince_8")
    asked = Mock(side_effect=partial(executed, 1.0 + 1e-5))
    (result, _), doubt = with_error(first, 1e-4, asked)
    assert (asked.call_count, doubt) == (1, "")
    assert result.attrs["evaluations"] == 2000
    (result, _), doubt = with_error(first, 1e-4, partial(executed, 1.003))
    assert result.attrs["integration_error"] == pytest.approx(3e-3 * 2**0.5, rel=0.5)
    assert result.attrs["evaluations"] == 3000
    assert "Do not rely on an accuracy" in doubt


def test_batch_equals_single_runs_bit_for_bit():
    arm, torque = random_arm(2)
    starts = np.array([arm.rest([0.1 * k, 0.2, -0.1]) for k in range(3)])
    accuracy = 1e-4 * float(arm.lengths.sum())
    batch = fa.simulate_batch(arm, 0.6, initial=starts, torque=torque, accuracy=accuracy, **QUIET)
    assert batch.attrs["accuracy"] == pytest.approx(accuracy)
    for k, start in enumerate(starts):
        how = {"initial": start, "torque": torque, "accuracy": accuracy}
        alone = fa.simulate(arm, 0.6, **how, **QUIET)
        assert np.array_equal(batch.tip.values[k], alone.tip.values)
        assert int(batch.evaluations[k]) == alone.attrs["evaluations"]
        assert alone.attrs["integration_error"] <= accuracy


@pytest.mark.parametrize("accuracy", [None, 1e-3])
def test_lanes_decide_as_single_runs_do(accuracy):
    """Of runs that turn ever faster, errors of the last ones grow, and they begin again."""
    arm, torque = random_arm(2)
    fast = 12.0 if accuracy else 24.0  # rad/s
    rates = np.array([arm.rest([k * fast, -0.75 * k * fast, 0.4 * k * fast]) for k in range(6)])
    how = {"torque": torque, "accuracy": accuracy, **QUIET}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.FlexarmWarning)  # they bend far
        batch = fa.simulate_batch(arm, 0.5, initial_rate=rates, **how)
        alone = [fa.simulate(arm, 0.5, initial_rate=rate, **how) for rate in rates]
    request = (accuracy or alone[0].attrs["accuracy"]) / float(arm.lengths.sum())
    large = [result.attrs["rtol"] > 0.05 * request for result in alone]
    assert True in large
    assert False in large
    for k, result in enumerate(alone):
        if accuracy is None or large[k]:  # `simulate` goes on until the request is reached
            assert np.array_equal(batch.tip.values[k], result.tip.values)
            assert int(batch.evaluations[k]) == result.attrs["evaluations"]


def test_steps_that_samples_limit_are_not_verified_by_each_other():
    """Steps of 1 ms at both tolerances differ by little, and err by 2.4 times the accuracy."""
    accuracy, duration = 1e-4, 5.0
    rigidity = (200.0 / 3.516) ** 2  # of a link of 1 m and 1 kg: 200 rad/s, clamped, first mode
    link = fa.Link(length=1.0, flexural_rigidity=rigidity, mass_per_length=1.0, elements=4, modes=3)
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.05)])
    times = np.arange(round(1000.0 * duration) + 1) / 1000.0
    start = arm.rest([0.0])
    start[1] = 0.005
    run = {"torque": 3.3 * np.sin(6.0 * np.pi * times)[:, None], "torque_interpolation": "hold"}
    run |= {"initial": start, "rate": 1000.0, "progress": False}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.LargeDeflectionWarning)
        exact = fa.simulate(arm, duration, rtol=1e-10, **run)
        result = fa.simulate(arm, duration, accuracy=accuracy, **run)
    assert np.hypot(*(result.tip - exact.tip).values.T).max() <= accuracy


@pytest.mark.parametrize("part", [1e-3, 1e-5])
@pytest.mark.parametrize("kind", ["damping ratio 2 %", "no damping"])
def test_a_smooth_arm_takes_the_large_tolerances_that_a_second_run_verifies(part, kind):
    """The page has 30 arms; the cost of each of these is at most half."""
    script = page_scripts.script("measure_accuracy")
    for arm, arguments in script.arms(kind, 2):
        (cost, error, estimated), *_ = script.measure(arm, (part,), **arguments)
        assert cost < 0.5
        assert error < 0.5
        assert estimated < 1.5  # of the error, of which the largest is 2.1 times the estimate
        result = fa.simulate(arm, accuracy=part * arm.lengths.sum(), **arguments, **QUIET)
        assert result.attrs["accuracy"] == pytest.approx(part * arm.lengths.sum())
        assert "a second run verifies" in result.attrs["integrator_reason"]


def test_an_expensive_or_sudden_arm_keeps_small_tolerances():
    accuracy = 1e-4
    turning = fa.Arm(links=[fa.Link(length=0.5, flexural_rigidity=2.0, mass_per_length=0.2)] * 2)
    start = turning.rest([0.0, 0.0])
    fast = {"initial": start, "initial_rate": turning.rest([400.0, 200.0])}
    rubbing, torque = random_arm(0, friction=True)
    for arm, run in ((turning, fast), (rubbing, {"torque": torque})):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fa.FlexarmWarning)  # it bends far
            result = fa.simulate(arm, 0.1, accuracy=accuracy, **run, **QUIET)
        assert result.attrs["rtol"] <= 0.0101 * accuracy / float(arm.lengths.sum())
        assert result.attrs["integration_error"] <= accuracy


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"rtol": 1e-5}, "accuracy cannot be combined with rtol"),
        ({"atol": 1e-5}, "accuracy cannot be combined with atol"),
        ({"step": 1e-3}, "accuracy cannot be combined with step"),
        ({"integrator": "rk4"}, "accuracy is not supported with the integrator 'rk4'"),
        ({"accuracy": 0.0}, "accuracy must be greater than 0"),
    ],
)
def test_accuracy_excludes(given, message):
    arm, _ = random_arm(0)
    with pytest.raises(fa.InputError, match=message):
        fa.simulate(arm, 0.1, **{"accuracy": 1e-5, **given})


def test_tolerance_of_one_or_more_is_refused():
    arm, _ = random_arm(0)
    with pytest.raises(fa.InputError, match="rtol must be less than 1, got 5"):
        fa.simulate(arm, 0.1, rtol=5.0)


def test_the_error_is_not_zero_where_the_tolerance_is_limited():
    """Both tolerances were the largest possible one, and the error was called 0."""
    arm = fa.Arm(links=[fa.Link(length=0.5, flexural_rigidity=50.0, mass_per_length=0.5)] * 2)
    result = fa.simulate(arm, 0.5, torque=lambda t: [0.1, 0.0], accuracy=1.0, progress=False)
    assert 0.0 < result.attrs["integration_error"] < 1.0


def test_an_accuracy_beyond_rounding_warns():
    arm = fa.Arm(links=[fa.Link(length=0.5, flexible=False, mass_per_length=0.5)])
    with pytest.warns(fa.AccuracyWarning, match="integration error is unknown"):
        result = fa.simulate(arm, 0.2, torque=lambda t: [0.1], accuracy=1e-15, progress=False)
    assert np.isnan(result.attrs["integration_error"])


def _pulse(t):
    return np.exp(-(((t - 0.5) / 0.003) ** 2))


@pytest.mark.parametrize(
    "acting",
    [
        {"torque": lambda t: np.array([20.0 * _pulse(t), 0.0])},
        {"loads": [fa.Load(2, (0.0, 50.0), factor=_pulse)]},
        {"base_acceleration": lambda t: (0.0, 300.0 * _pulse(t))},
    ],
)
def test_a_pulse_is_not_stepped_over(acting):
    """Two runs of order 5 of an arm at rest both stepped over it, and agreed."""
    link = fa.Link(length=1.0, flexural_rigidity=20.0, mass_per_length=0.5, elements=2)
    arm = fa.Arm(links=[link, link], joints=[fa.Joint(hub_inertia=0.05)] * 2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.LargeDeflectionWarning)
        exact = fa.simulate(
            arm, 1.0, rtol=1e-11, breaks=[0.48, 0.5, 0.52], progress=False, **acting
        )
        result = fa.simulate(arm, 1.0, accuracy=1e-3, progress=False, **acting)
    assert np.ptp(exact.tip.values, axis=0).max() > 0.02
    assert np.abs(result.tip - exact.tip).max() < 1e-3
