"""The gradient of a goal, against the derivatives of the channels by single inputs."""

import numpy as np
import pytest

import flexarm as fa
from arms import chain
from flexarm.simulation.derivatives.gradient import Repetition
from flexarm.simulation.histories.piecewise import Samples, sampled_torque, spline_edges

pytestmark = pytest.mark.compiled
#: Both add the same derivatives in another order.
SAME = 1e-9


def an_arm():
    rod = {"flexural_rigidity": [90.0, 40.0], "mass_per_length": 0.5, "elements": 1}
    joints = [{"hub_inertia": 0.1, "damping": 0.1}, 0.05]
    more = {"gauge": (0.1, 0.005), "gauged": 1, "payload": 0.3, "gravity": (0.0, -9.81)}
    return chain((0.8, 0.6), joints, **rod, **more)


@pytest.mark.sampled("linear-rk4", "hold-kennedy_carpenter_5", "cubic-dormand_prince_8")
@pytest.mark.parametrize("integrator", ["dormand_prince_8", "kennedy_carpenter_5", "rk4"])
@pytest.mark.parametrize("interpolation", ["hold", "linear", "cubic"])
def test_gradient_is_the_weighted_sum_of_derivatives(integrator, interpolation):
    arm, rng = an_arm(), np.random.default_rng(3)
    given = {
        "torque": np.sin(np.arange(30) / 5.0)[:, None] * [2.0, -1.0],
        "torque_interpolation": interpolation,
        "initial": arm.rest([0.3, -0.4]),
        "tip_force": [0.3, 0.2],
        "integrator": integrator,
        "rate": 200.0,
        "step": 1e-4 if integrator == "rk4" else None,
    }
    run = fa.simulate(arm, 0.15, **given)
    weights = {name: rng.normal(size=run[name].shape) for name in ("tip", "strain", "tip_angle")}
    found = fa.goal_gradient(arm, 0.15, weights, **given)
    paths = ["torque[0][0]", "torque[17][1]", "torque[29][0]", "initial[0]", "initial_rate[3]"]
    by = fa.sensitivities(arm, 0.15, paths, channels=list(weights), **given)
    wanted = [
        sum(float((w * by[name].values[k]).sum()) for name, w in weights.items())
        for k in range(len(paths))
    ]
    own = [*(found["torque"].values[place] for place in [(0, 0), (17, 1), (29, 0)])]
    own += [found["initial"].values[0], found["initial_rate"].values[3]]
    np.testing.assert_allclose(own, wanted, rtol=SAME, atol=SAME * np.abs(wanted).max())


def moved_slowly(arm, samples, rate, **more):
    times = np.arange(samples + 1) / rate
    torque = np.stack([np.sin(3.0 * times), 0.5 * np.cos(3.0 * times)], axis=1)
    return {"torque": torque, "rate": rate, "initial": arm.rest([0.3, -0.4]), **more}


@pytest.mark.thorough_cases("rk4-20.0", "dormand_prince_8-20.0")
@pytest.mark.parametrize("rate", [20.0, 4096.0])
@pytest.mark.parametrize("integrator", ["dormand_prince_8", "kennedy_carpenter_5", "rk4"])
def test_repeated_parts_continue_the_steps_of_the_run(integrator, rate):
    """Many steps in an interval depend on those before it; single ones have one length."""
    arm = an_arm()
    floor = fa.Contact(fa.Wall((0.0, -0.5), (0.0, 1.0)), stiffness=2e3, damping=0.1)
    given = moved_slowly(arm, 20, rate, integrator=integrator, contacts=[floor])
    given["error_estimate"] = False  # the derivatives of one run
    weights = {"tip": np.random.default_rng(4).normal(size=(21, 2))}
    found = fa.goal_gradient(arm, 20 / rate, weights, **given)
    paths = ["torque[2][0]", "torque[11][1]", "torque[18][0]", "initial[1]"]
    by = fa.sensitivities(arm, 20 / rate, paths, channels=["tip"], **given)
    wanted = (weights["tip"] * by["tip"].values).sum(axis=(1, 2))
    own = [*(found["torque"].values[place] for place in [(2, 0), (11, 1), (18, 0)])]
    own.append(found["initial"].values[1])
    np.testing.assert_allclose(own, wanted, rtol=SAME, atol=SAME * np.abs(wanted).max())


@pytest.mark.parametrize("held", [0.0, 0.5])
@pytest.mark.parametrize("kinks", [(), (5, 6), (5, 8, 26)])
def test_samples_are_collected_by_the_transpose_of_the_spline(kinks, held):
    rate, rng = 50.0, np.random.default_rng(2)
    samples = np.sin(np.arange(30) / 4.0)[:, None]
    history = sampled_torque(samples, rate, 29 / rate, 1, "cubic", np.array(kinks) / rate)
    history = history.held_to(29 / rate + held)
    assert history.stops.size == len(kinks) + (held > 0.0)
    edges = spline_edges(samples, rate, np.array(kinks) / rate)
    added = Samples(history, (30, 2), rate, "cubic", edges).added(np.eye(30))
    pieces = rng.normal(size=(len(history.coefficients), 4, 2)) / rate ** np.arange(4)[:, None]
    found = Samples(history, (30, 2), rate, "cubic", edges).collected(pieces)
    wanted = np.tensordot(added, pieces, axes=([0, 1], [0, 1]))
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=1e-13 * np.abs(wanted).max())


def test_gradient_by_the_samples_of_a_pulse():
    """Steps also end inside a pulse, where its spline has no edges."""
    rod = {"flexural_rigidity": 50.0, "mass_per_length": 0.5, "elements": 1}
    arm, rate, times = chain((1.0,), [0.1], **rod), 200.0, np.arange(201) / 200.0
    pulse = np.maximum(np.cos(np.pi * np.clip((times - 0.5) / 0.04, -0.5, 0.5)), 0.0) ** 2
    weights = {"tip": np.zeros((201, 2))}
    weights["tip"][-1, 1] = 1.0
    given = {"rate": rate, "rtol": 1e-10, "progress": False}
    gradient = fa.goal_gradient(arm, 1.0, weights, torque=2.0 * pulse[:, None], **given).torque

    def goal(place, change):
        torque = 2.0 * pulse
        torque[place] += change
        result = fa.simulate(arm, 1.0, torque=torque[:, None], **given)
        return float(result.tip[-1, 1])

    for place in (95, 98, 100, 103):  # with the stops for edges, 98 and 100 erred by a third
        by_difference = (goal(place, 0.01) - goal(place, -0.01)) / 0.02
        assert gradient.values[place, 0] == pytest.approx(by_difference, rel=2e-3)


def test_derivatives_in_memory_grow_with_the_square_root(monkeypatch):
    arm = an_arm()
    calls = []

    def repeated(self, part):
        calls.append(len(part.ends))
        return transfers(self, part)

    transfers = Repetition.transfers
    monkeypatch.setattr(Repetition, "transfers", repeated)
    for samples in (100, 400):
        calls.clear()
        given = moved_slowly(arm, samples, 1e4, torque_interpolation="hold")
        fa.goal_gradient(arm, samples / 1e4, {"tip": np.ones((samples + 1, 2))}, **given)
        assert sum(calls) == samples
        assert max(calls) <= np.sqrt(samples) < len(calls) + 1


@pytest.mark.parametrize("function", [fa.sensitivities, fa.goal_gradient])
def test_arguments_of_simulate_that_are_not_supported_are_named(function):
    with pytest.raises(fa.InputError) as error:
        function(
            an_arm(),
            0.1,
            [],
            torque=[],
            changes=[fa.Change("payload.mass", at=0.1, to=0.5)],
            lods=(),
        )
    changes, lods = map(str, error.value.problems)
    assert changes == f"{function.__name__}: changes is not supported with derivatives of runs."
    assert lods.endswith("lods is not an argument. Did you mean 'loads'?")
