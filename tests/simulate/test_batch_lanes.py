"""Runs in lanes have the numbers of single runs, to the last bit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import flexarm as fa
from flexarm.model.paths import with_number
from random_arms import random_spec

pytestmark = pytest.mark.compiled

ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732, "elements": 1}
EXPLICIT = ({"integrator": "dormand_prince_8"}, {"integrator": "rk4", "step": 5e-4})
METHODS = (*EXPLICIT, {"integrator": "kennedy_carpenter_5", "rtol": 1e-4, "atol": 1e-6})


def compare(arm, starts, runs, **how):
    """Compare runs of a batch with single results."""
    channels = ["q", "qd", "tip_velocity", "torque", "strain_energy"]
    batch = fa.simulate_batch(arm, initial=starts, channels=channels, **how)
    for k in runs:
        single = fa.simulate(arm, initial=starts[k], **how)
        for name in channels:
            np.testing.assert_array_equal(batch[name][k], single[name], err_msg=name)
        assert batch["steps"][k] == single.attrs["steps"]
        # A single run evaluates the slope again where it resumes.
        count = single.attrs["evaluations"]
        assert abs(batch["evaluations"][k] - count) <= 4 + 0.01 * count
    return batch


@settings(max_examples=6)
@given(seed=st.integers(0, 10**6), how=st.sampled_from(METHODS))
def test_random_arms(seed, how):
    rng = np.random.default_rng(seed)
    arm = fa.Arm(random_spec(rng, links=int(rng.integers(1, 4)), elements=1))
    starts = [arm.rest(rng.uniform(-1.0, 1.0, arm.joints)) for _ in range(10)]
    how = {"torque": 0.2 * rng.normal(size=(6, arm.joints)), "rate": 300.0, **how}
    try:
        compare(arm, starts, (0, 9), duration=0.02, **how)
    except fa.SimulationError:  # steps that are too long for a stiff arm
        assert "step" in how


@pytest.mark.parametrize("how", METHODS, ids=lambda how: how["integrator"])
def test_joint_laws_and_jumps_of_the_torque(how, executed):
    rubbing = fa.Friction(coulomb=0.2, static=0.3, viscous=0.01)
    joints = [fa.Joint(friction=rubbing, damping=0.1), fa.Joint(stiffness=50.0)]
    links = [fa.Link(length=1.4, **ROD), fa.Link(length=1.0, **ROD)]
    arm = fa.Arm(links=links, joints=joints, payload=fa.Payload(mass=0.3), theory="second_order")
    starts = [arm.rest([0.3 * k, 0.2]) for k in range(17)]
    torque = np.random.default_rng(3).normal(size=(9, 2))
    how = {"torque": torque, "torque_interpolation": "hold", "rate": 150.0, **how}
    compare(arm, starts, (0, 8, 16), duration=0.05, **how)
    assert sorted(executed) == list(range(17))


@pytest.mark.parametrize("how", METHODS, ids=lambda how: how["integrator"])
def test_hundreds_of_steps(how, executed):
    """A different rounding of small terms of second order appears after about a hundred steps."""
    rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732, "elements": 16, "modes": 3}
    links = [fa.Link(length=1.4142, **rod), fa.Link(length=1.0, **rod)]
    arm = fa.Arm(links=links, theory="second_order")
    starts = [arm.rest([0.78 + 0.01 * k, -1.57 + 0.02 * k]) for k in range(8)]

    def torque(t):
        return [4.0 * np.sin(2.0 * np.pi * t), 1.5 * np.sin(2.0 * np.pi * t)]

    compare(arm, starts, (0, 3, 7), duration=0.9, rate=100.0, torque=torque, **how)
    assert sorted(executed) == list(range(8))


def test_runs_of_different_length_in_steps(executed):
    """Lanes whose runs end early continue with others."""
    arm = fa.Arm(links=[fa.Link(length=1.0, **ROD)])
    torque = np.random.default_rng(8).normal(size=(21, 20, 1))
    torque[::3] = 0.0  # these need fewer steps
    batch = fa.simulate_batch(arm, 0.2, torque=torque, rate=100.0, channels=["q"], threads=1)
    assert len(set(batch["steps"].values[::3])) == 1
    assert batch["steps"].values[0] < batch["steps"].values[1]
    for k in (0, 7, 20):
        single = fa.simulate(arm, 0.2, torque=torque[k], rate=100.0)
        np.testing.assert_array_equal(batch["q"][k], single["q"])
    assert len(executed) == 21


@pytest.mark.parametrize("how", METHODS, ids=lambda how: how["integrator"])
def test_each_lane_has_the_constants_of_its_arm(how, executed):
    rubbing = fa.Friction(coulomb=0.2, static=0.3, viscous=0.01)
    joints = [fa.Joint(friction=rubbing, damping=0.1, stiffness=20.0)] * 2
    links = [fa.Link(length=1.4, **ROD), fa.Link(length=1.0, **ROD)]
    gravity = (0.0, -9.81)
    arm = fa.Arm(links=links, joints=joints, gravity=gravity, theory="second_order")
    rng = np.random.default_rng(5)
    values = {
        "links[0].flexural_rigidity": rng.uniform(50.0, 200.0, 11),
        "links[1].length": rng.uniform(0.8, 1.2, 11),
        "joints[1].damping": rng.uniform(0.0, 0.5, 11),
        "joints[0].friction.coulomb": rng.uniform(0.1, 0.3, 11),
        "payload.mass": rng.uniform(0.0, 0.5, 11),
    }
    how = {"initial": arm.rest([0.3, 0.2]), "duration": 0.05, "rate": 150.0, **how}
    channels = ["q", "tip", "strain_energy"]
    batch = fa.simulate_batch(arm, parameters=values, channels=channels, **how)
    assert sorted(executed) == list(range(11))
    for k in (0, 8, 10):
        spec = arm.spec
        for path, row in values.items():
            spec = with_number(spec, path, float(row[k]))
        single = fa.simulate(fa.Arm(spec), **how)
        for name in channels:
            np.testing.assert_array_equal(batch[name][k], single[name], err_msg=name)
        assert batch["steps"][k] == single.attrs["steps"]


def test_arms_with_other_arrays_are_in_other_packs(executed):
    rubbing = [fa.Joint(friction=fa.Friction(coulomb=0.1)), fa.Joint()]
    links = [fa.Link(length=1.4, **ROD), fa.Link(length=1.0, **ROD)]
    arms = [fa.Arm(links=links), fa.Arm(links=links, joints=rubbing), fa.Arm(links=links[::-1])]
    torque = np.random.default_rng(3).normal(size=(30, 2))
    how = {"torque": torque, "rate": 500.0}
    batch = fa.simulate_batch(arms, 0.05, threads=1, **how)
    assert executed == [0, 2, 1]
    for k, arm in enumerate(arms):
        single = fa.simulate(arm, 0.05, **how)
        np.testing.assert_array_equal(batch["tip"][k], single["tip"])


@pytest.mark.parametrize("how", EXPLICIT, ids=lambda how: how["integrator"])
def test_samples_inside_steps(how, executed):
    arm = fa.Arm(links=[fa.Link(length=1.0, **ROD)], gravity=(0.0, -9.81))
    compare(arm, [[0.1, 0.0, 0.0], [0.5, 0.01, 0.0]], (0, 1), duration=0.01, rate=1e4, **how)
    assert len(executed) == 2


def test_a_run_that_fails_is_repeated_alone(executed):
    arm = fa.Arm(links=[fa.Link(length=1.0, **ROD)])
    how = {"duration": 0.02, "integrator": "rk4", "step": 1e-3, "rate": 500.0}
    batch = fa.simulate_batch(arm, initial_rate=[[0.0] * 3, [4000.0, 0.0, 0.0]], **how)
    assert executed == [0]
    with pytest.raises(fa.SimulationError) as failed:
        fa.simulate(arm, initial_rate=[4000.0, 0.0, 0.0], **how)
    assert batch["failure"].values[1] == str(failed.value)


@pytest.mark.parametrize(
    "other",
    [
        {"loads": [fa.Load(1, force=(0.0, 1.0))]},
        {"integrator": "gauss_6", "step": 1e-3},
        {"integrator": "auto", "step": 0.01},  # at which rk4 is unstable
        {"channels": ["joint_force"]},
        {"specialized": False, "stations": 2, "channels": ["bending_moment"]},
    ],
    ids=["loads", "method", "step", "forces", "sections"],
)
def test_other_runs_are_executed_one_at_a_time(other, executed):
    arm = fa.Arm(links=[fa.Link(length=1.0, **ROD)])
    own = {"initial": [[0.1, 0.0, 0.0], [0.2, 0.0, 0.0]], "rate": 500.0, **other}
    if other.get("integrator") == "auto":
        with pytest.warns(fa.FlexarmWarning, match="rk4 is unstable"):
            fa.simulate_batch(arm, 0.02, **own)
    else:
        fa.simulate_batch(arm, 0.02, **own)
    assert executed == []
