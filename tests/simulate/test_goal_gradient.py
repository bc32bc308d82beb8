"""The gradient of a goal, against the derivatives of the channels by single inputs."""

import numpy as np
import pytest

import flexarm as fa

pytestmark = pytest.mark.compiled
#: Both add the same derivatives in another order.
SAME = 1e-9


def an_arm():
    rod = {"mass_per_length": 0.5, "elements": 1}
    gauge = fa.Gauge(station=0.1, distance=0.005)
    return fa.Arm(
        links=[
            fa.Link(length=0.8, flexural_rigidity=90.0, gauges=[gauge], **rod),
            fa.Link(length=0.6, flexural_rigidity=40.0, **rod),
        ],
        joints=[fa.Joint(hub_inertia=0.1, damping=0.1), fa.Joint(hub_inertia=0.05)],
        payload=fa.Payload(mass=0.3),
        gravity=(0.0, -9.81),
    )


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


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"weights": {}}, "must not be empty"),
        ({"weights": {"tipp": [0.0]}}, "Did you mean"),
        ({"weights": {"tip": [0.0]}}, "numbers of shape"),
        ({"integrator": "gauss_6", "step": 1e-3}, "explicit Runge-Kutta"),
    ],
)
def test_wrong_arguments(change, text):
    arguments = {"weights": {"tip": np.zeros((3, 2))}, "torque": np.zeros((2, 2)), "rate": 200.0}
    with pytest.raises(fa.InputError, match=text):
        fa.goal_gradient(an_arm(), 0.01, **(arguments | change))


@pytest.mark.parametrize("function", [fa.sensitivities, fa.goal_gradient])
def test_arguments_of_simulate_that_are_not_supported_are_named(function):
    with pytest.raises(fa.InputError) as error:
        function(
            None, 0.1, [], torque=[], changes=[fa.Change("payload.mass", at=0.1, to=0.5)], lods=()
        )
    changes, lods = map(str, error.value.problems)
    assert changes == f"{function.__name__}: changes is not supported with derivatives of runs."
    assert lods.endswith("lods is not an argument. Did you mean 'loads'?")
