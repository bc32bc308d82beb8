"""Every key of a scenario has an effect on the result, and is kept when the file is written.

The keys are those of the scenario itself, of `initial` and of `run`. A key that is read and then
forgotten is worse than one that does not exist.
"""

import numpy as np
import pytest

import flexarm as fa
from flexarm.model import Scenario, file_text, load_scenario
from flexarm.model.scenarios.scenario import InitialState, RunSpec

LINK = {"length": 0.8, "flexural_rigidity": 90.0, "mass_per_length": 0.5, "elements": 1}
ARM = {
    "gravity": [0.0, -9.81],
    "links": [LINK, LINK],
    "joints": [{"hub_inertia": 0.1}, {"hub_inertia": 0.05}],
}
RUN = {"duration": 0.02, "rate": 500.0}
CART = {"arm": {**ARM, "base": {"mass": 1.0, "free": ["x"]}}}
SCENARIO = {"arm": ARM, "run": RUN}
MOTION = {"kind": "joint", "start": [0.3, 0.2], "end": [0.5, 0.4], "duration": 0.1}
PD = {"kind": "joint_pd", "proportional": 8.0, "derivative": 0.8, "sample_time": 0.002}
FLOOR = {"surface": {"kind": "wall", "point": [0.0, 0.0], "normal": [0.0, 1.0]}, "stiffness": 1e4}
FIXED_STEP = {**RUN, "integrator": "rk4", "step": 1e-4}

#: The value of a key, and the other keys that the scenario then has in both runs.
CASES = {
    "arm": ({**ARM, "theory": "second_order"}, {"initial": {"joint_rate": [1.0, 2.0]}}),
    "motion": (MOTION, {}),
    "drive": ({"kind": "torque", "values": [[1.0, 0.2]] * 11, "rate": 500.0}, {}),
    "hardware": ({"motors": {"torque_limit": 0.01}}, {"motion": MOTION, "drive": PD}),
    "prescribed": ([{"kind": "hold", "joint": 1}], {}),
    "loads": ([{"link": 2, "force": [0.0, 1.0]}], {}),
    "base_acceleration": ([0.0, 1.0], {}),
    "events": ([{"name": "down", "kind": "joint_angle", "joint": 1, "angle": -1e-4}], {}),
    "contacts": ([FLOOR], {}),
    "changes": ([{"path": "payload.mass", "at": 0.01, "to": 0.5}], {}),
    "initial": ({"joint_angle": [0.1, 0.2]}, {}),
    "run": ({**RUN, "duration": 0.03}, {}),
    "initial.joint_angle": ([0.1, 0.2], {}),
    "initial.joint_rate": ([1.0, 0.2], {}),
    "initial.base_position": ([0.1, 0.0, 0.0], CART),
    "initial.base_velocity": ([0.1, 0.0, 0.0], CART),
    "initial.equilibrium": (True, {}),
    "initial.balance": (True, {"initial": {"equilibrium": True}}),
    "run.duration": (0.03, {}),
    "run.rate": (1000.0, {}),
    "run.stations": (3, {}),
    "run.integrator": ("kennedy_carpenter_5", {}),
    "run.accuracy": (1e-3, {}),
    "run.rtol": (1e-3, {}),
    "run.atol": (1e-3, {}),
    "run.step": (5e-5, {"run": FIXED_STEP}),
}


def keys():
    """Return the names of all keys."""
    inside = {"initial": InitialState, "run": RunSpec}
    nested = {f"{name}.{key}" for name, record in inside.items() for key in record.model_fields}
    return set(Scenario.model_fields) | nested


def without(key):
    """Return a scenario without a special value of the key."""
    return Scenario(**{**SCENARIO, **CASES[key][1]})


def with_key(key):
    """Return the same scenario with the value of the key."""
    value, others = CASES[key]
    scenario = {**SCENARIO, **others}
    name, _, inner = key.partition(".")
    return Scenario(
        **{**scenario, name: {**scenario.get(name, {}), inner: value} if inner else value}
    )


def outcome(scenario):
    """Return channels, coordinates and attributes of a run, except for its text and its times."""
    result = fa.run_scenario(scenario)
    kept = {name: values.values for name, values in result.variables.items()}
    left_out = {"scenario", "arm", "controller_seconds", "wall_seconds"}
    return kept | {name: v for name, v in result.attrs.items() if name not in left_out}


def equal(one, other):
    return one.keys() == other.keys() and all(np.array_equal(one[k], other[k]) for k in one)


@pytest.mark.filterwarnings("ignore::flexarm.LimitWarning")  # intended
def test_two_runs_of_one_scenario_are_equal():
    """Otherwise every key would seem to have an effect."""
    scenario = with_key("hardware")
    assert equal(outcome(scenario), outcome(scenario))


def test_every_key_has_a_case():
    assert set(CASES) == keys(), "add it to CASES"


@pytest.mark.filterwarnings("ignore::flexarm.FlexarmWarning")
@pytest.mark.parametrize("key", CASES)
def test_key_has_an_effect(key):
    assert not equal(outcome(with_key(key)), outcome(without(key))), f"{key} has no effect"


@pytest.mark.parametrize("key", CASES)
def test_key_is_kept_in_a_file(key, tmp_path):
    scenario = with_key(key)
    (tmp_path / "run.yaml").write_text(file_text(scenario), encoding="utf-8")
    assert load_scenario(tmp_path / "run.yaml") == scenario
    assert scenario != without(key)
