"""Settings of runs as one object beside the arguments of the same names."""

import copy
import inspect
import pickle
import warnings
from dataclasses import replace

import numpy as np
import pytest

import flexarm as fa
from flexarm.model.scenarios.scenario import recording_rate
from flexarm.simulation.run.settings import DEFAULTS

CLOSE = fa.RunSettings(rtol=1e-9, rate=200.0)
CALLS = (fa.simulate, fa.sensitivities, fa.goal_gradient, fa.identify, fa.Plant)


def one_link():
    """Return an arm with one link."""
    link = fa.Link(length=1.0, flexural_rigidity=40.0, mass_per_length=0.5, elements=1)
    return fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.05)])


@pytest.mark.parametrize("length", [5e-4, 1.0, 50.0])
def test_a_run_without_a_rate_has_enough_samples_at_any_size(length):
    """Three periods of arms whose period is in proportion to their length."""
    link = fa.Link(
        length=length,
        flexural_rigidity=40.0 * length**4,
        mass_per_length=0.5 * length**2,
        elements=1,
    )
    arm = fa.Arm(links=[link])
    span = 3.0 / float(fa.modes(arm).frequency_hz.max())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = fa.simulate(arm, span, torque=lambda t: [0.0])
        batch = fa.simulate_batch(arm, span, initial=np.zeros((2, arm.dof)))
    assert 100 <= run.sizes["time"] <= 10**6 + 1
    np.testing.assert_array_equal(run.time, batch.time)
    assert batch.attrs["rate"] == 1.0 / run.time.values[1]


@pytest.mark.parametrize(
    ("duration", "rate"),
    [
        (2e-4, 5e5),
        (0.03, 5000.0),
        (0.1, 1000.0),
        (1000.0, 1000.0),
        (1001.0, 500.0),
        (4e6, 0.2),
        (np.nextafter(1e3, 2e3), 500.0),
        (np.nextafter(1e4, 2e4), 50.0),
    ],
)
def test_default_rates_are_round(duration, rate):
    assert recording_rate(None, duration) == pytest.approx(rate, rel=1e-15)
    assert recording_rate(7.0, duration) == 7.0


@pytest.mark.parametrize("how", [{"rate": 0.5}, {"settings": fa.RunSettings(rate=0.5)}])
def test_a_rate_of_less_than_a_sample_is_implausible_in_batches(how):
    arm = one_link()
    with pytest.warns(fa.ImplausibleValueWarning, match="less than one sample"):
        fa.simulate_batch(arm, 1.0, initial=np.zeros((2, arm.dof)), **how)


def test_samples_of_a_torque_have_1000_hertz_in_a_short_run():
    arm = one_link()
    rows = np.full((51, 1), 0.1)
    assert fa.simulate(arm, 0.05, torque=rows).sizes["time"] == 51
    assert fa.simulate_batch(arm, 0.05, torque=[rows, rows]).sizes["time"] == 51


def test_settings_do_what_the_arguments_do():
    arm = one_link()
    wanted = fa.simulate(arm, 0.1, torque=lambda t: [t], rtol=1e-9, rate=200.0)
    found = fa.simulate(arm, 0.1, torque=lambda t: [t], settings=CLOSE)
    assert wanted.attrs["rtol"] == found.attrs["rtol"] == 1e-9
    np.testing.assert_array_equal(wanted.tip, found.tip)
    assert not np.array_equal(
        fa.simulate(arm, 0.1, torque=lambda t: [t], rate=200.0).tip, found.tip
    )


def test_every_call_has_settings():
    arm = one_link()
    torque = np.full((21, 1), 0.1)
    free = ["links[0].flexural_rigidity"]
    for call in (
        lambda **more: fa.sensitivities(arm, 0.1, free, torque=torque, **more).tip,
        lambda **more: (
            fa.goal_gradient(arm, 0.1, {"tip": np.ones((21, 2))}, torque=torque, **more).torque
        ),
        lambda **more: (
            fa.simulate_batch(arm, 0.1, torque=torque, initial=np.zeros((2, arm.dof)), **more).tip
        ),
    ):
        wanted, found = call(rtol=1e-9, rate=200.0), call(settings=CLOSE)
        np.testing.assert_array_equal(wanted, found)
        assert not np.array_equal(call(rate=200.0), found)


def test_plant_has_the_settings_that_it_uses():
    arm = one_link()
    ends = []
    for more in ({"settings": CLOSE}, {"rtol": 1e-9}, {}):
        plant = fa.Plant(arm, 0.01, **more)
        for _ in range(10):
            plant.step([1.0])
        ends.append(plant.q)
    np.testing.assert_array_equal(ends[0], ends[1])
    assert not np.array_equal(ends[0], ends[2])


def test_an_argument_replaces_a_default_and_may_repeat_a_setting():
    result = fa.simulate(one_link(), 0.1, settings=CLOSE, rtol=1e-9, stations=2)
    assert result.sizes["station"] == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"rtol": 1e-6}, "simulate: rtol must be 1e-09 as in settings, got 1e-06"),
        ({"rtol": -1.0}, "simulate: rtol must be greater than 0"),
        ({"settings": 3}, "simulate: settings must be a RunSettings, got 3"),
        ({"rtoll": 3}, "simulate: rtoll is not an argument. Did you mean 'rtol'?"),
    ],
)
def test_contradictions_are_refused(arguments, message):
    with pytest.raises(fa.InputError) as caught:
        fa.simulate(one_link(), 0.1, **{"settings": CLOSE, **arguments})
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"rtol": 0.0}, "rtol must be greater than 0"),
        ({"integrator": "rk5"}, "integrator must be one of 'auto'"),
        ({"stations": 1}, "stations must be 0, or at least 2 (root and tip)"),
        ({"breaks": "no"}, "breaks must be"),
        ({"torque_interpolation": "none"}, "torque_interpolation must be one of"),
        ({"progress": 3}, "progress must be True or False"),
    ],
)
def test_settings_are_checked_when_they_are_created(arguments, message):
    with pytest.raises(fa.InputError) as caught:
        fa.RunSettings(**arguments)
    assert str(caught.value).startswith(f"RunSettings: {message}")


def test_settings_are_declared_once():
    """The names and defaults of the arguments are those of the class."""
    for call in CALLS:
        shown = inspect.signature(call).parameters
        names = {*shown} & {*vars(DEFAULTS)}
        assert names >= {"integrator", "step", "rtol", "atol"}
        for name in names - {"specialized"}:  # of a plant False
            expected = repr(getattr(DEFAULTS, name))
            if name == "rtol" and "accuracy" not in shown:
                expected = "1e-07"
            assert repr(shown[name].default) in (expected, "()")


def test_settings_copy():
    for other in (copy.deepcopy(CLOSE), pickle.loads(pickle.dumps(CLOSE)), replace(CLOSE)):
        assert (other.rtol, other.rate, other.integrator) == (1e-9, 200.0, "auto")
    with pytest.raises(AttributeError):
        CLOSE.rtol = 1.0
