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
        for name in ("steps", "evaluations"):
            assert batch[name][k] == single.attrs[name]
    return batch


# Arms that hardly move are repeated with a smaller atol.
@pytest.mark.filterwarnings("ignore::flexarm.AccuracyWarning", "ignore:10 of 10 runs have warn")
@settings(max_examples=6)
@given(seed=st.integers(0, 10**6), how=st.sampled_from(METHODS))
def test_random_arms(seed, how):
    rng = np.random.default_rng(seed)
    arm = fa.Arm(random_spec(rng, links=int(rng.integers(1, 4)), elements=1))
    starts = [arm.rest(rng.uniform(-1.0, 1.0, arm.n_joints)) for _ in range(10)]
    how = {"torque": 0.2 * rng.normal(size=(6, arm.n_joints)), "rate": 300.0, **how}
    try:
        compare(arm, starts, (0, 9), duration=0.02, **how)
    except fa.SimulationError:  # steps that are too long for a stiff arm
        assert "step" in how


@pytest.mark.parametrize("how", METHODS, ids=lambda how: how["integrator"])
def test_joint_laws_and_jumps_of_the_torque(how, executed):
    # Smooth enough for the fixed step of rk4.
    rubbing = fa.Friction(coulomb=0.2, static=0.3, viscous=0.01, smoothing_rate=1.0)
    joints = [fa.Joint(friction=rubbing, damping=0.1), fa.Joint(stiffness=50.0)]
    links = [fa.Link(length=1.4, **ROD), fa.Link(length=1.0, **ROD)]
    arm = fa.Arm(links=links, joints=joints, payload=fa.Payload(mass=0.3), theory="second_order")
    starts = [arm.rest([0.3 * k, 0.2]) for k in range(17)]
    torque = np.random.default_rng(3).normal(size=(9, 2))
    how = {"torque": torque, "torque_interpolation": "hold", "rate": 150.0, **how}
    compare(arm, starts, (0, 8, 16), duration=0.05, **how)
    assert sorted(executed) == list(range(17))


@pytest.mark.thorough_cases("dormand_prince_8")
@pytest.mark.parametrize("how", METHODS, ids=lambda how: how["integrator"])
def test_geared_rotors(how, executed):
    """Products of numbers that all runs share are sums' products in packs, too."""
    joints = [fa.Joint(rotor_inertia=3.3e-5, gear_ratio=ratio) for ratio in (100.0, 37.0)]
    arm = fa.Arm(links=[fa.Link(length=length, **ROD) for length in (1.4, 1.0)], joints=joints)
    starts = [arm.rest([0.3 * k, 0.2]) for k in range(9)]
    torque = np.random.default_rng(3).normal(size=(9, 2))
    compare(arm, starts, (0, 8), torque=torque, rate=150.0, duration=0.05, **how)
    assert sorted(executed) == list(range(9))


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


@pytest.mark.thorough_cases("kennedy_carpenter_5")
@pytest.mark.parametrize("how", METHODS, ids=lambda how: how["integrator"])
def test_each_lane_has_the_constants_of_its_arm(how, executed):
    # Smooth enough for the fixed step of rk4.
    rubbing = fa.Friction(coulomb=0.2, static=0.3, viscous=0.01, smoothing_rate=1.0)
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


def shake(t):
    return [0.5 * np.sin(80.0 * t), -0.3]


DEAD = fa.Load(1, force=(0.3, -0.5), moment=0.2, station=0.9)
STEPPED = fa.Load(2, force=(0.0, 1.0), frame="link", factor=([0.0, 0.02, 0.02], [1.0, 1.0, 3.0]))
SPREAD = fa.Load(2, force=(-0.4, 0.2), spread=(0.2, 0.7), factor=lambda t: np.cos(60.0 * t))
#: What acts on an arm: constant, over time, and with jumps.
ACTING = {
    "constant": {"loads": [DEAD], "base_acceleration": [0.5, -0.2]},
    "over time": {"loads": [SPREAD, DEAD], "base_acceleration": shake},
    "jumps": {
        "loads": [STEPPED],
        "tip_force": [0.1, 0.2, 0.05],
        "base_acceleration": ([0.0, 0.015, 0.03], [[0.0, 0.0], [1.0, 0.0], [0.0, -1.0]]),
    },
    "breaks": {"base_acceleration": lambda t: [float(t > 0.02), 0.0], "breaks": [0.02]},
}


@pytest.mark.sampled(
    "over time-dormand_prince_8", "over time-kennedy_carpenter_5", "jumps-rk4", "breaks-rk4"
)
@pytest.mark.parametrize("how", METHODS, ids=lambda how: how["integrator"])
@pytest.mark.parametrize("acting", ACTING.values(), ids=ACTING)
def test_loads_and_base_acceleration(acting, how, executed):
    links = [fa.Link(length=1.4, **ROD), fa.Link(length=1.0, **ROD)]
    gravity = (0.0, -9.81)
    arm = fa.Arm(links=links, gravity=gravity, theory="second_order")
    starts = [arm.rest([0.3 - 0.1 * k, 0.2 * k]) for k in range(10)]
    torque = np.random.default_rng(7).normal(size=(8, 2))
    how = {"torque": torque, "rate": 150.0, **acting, **how}
    batch = compare(arm, starts, (0, 8, 9), duration=0.05, **how)
    assert sorted(executed) == list(range(10))
    free = {name: value for name, value in how.items() if name not in acting}
    other = fa.simulate_batch(arm, initial=starts, channels=["q"], duration=0.05, **free)
    assert np.abs(batch["q"] - other["q"])[:, -1].max() > 1e-5


@pytest.mark.parametrize("acting", ACTING.values(), ids=ACTING)
def test_each_lane_has_the_loads_of_its_arm(acting, executed):
    """A load at the same station of other links acts elsewhere on their modes."""
    links = [fa.Link(length=1.4, **ROD), fa.Link(length=1.0, **{**ROD, "elements": 2})]
    arm = fa.Arm(links=links, theory="second_order")
    lengths = np.linspace(0.8, 1.5, 9)
    how = {"initial": arm.rest([0.3, 0.2]), "duration": 0.05, "rate": 150.0, **acting}
    values = {"links[1].length": lengths, "links[0].length": lengths[::-1] + 0.5}
    batch = fa.simulate_batch(arm, parameters=values, channels=["q"], **how)
    assert sorted(executed) == list(range(9))
    for k in (0, 4, 8):
        spec = arm.spec
        for path, row in values.items():
            spec = with_number(spec, path, float(row[k]))
        single = fa.simulate(fa.Arm(spec), **how)
        np.testing.assert_array_equal(batch["q"][k], single["q"])


@pytest.mark.sampled("over time", "jumps")
@pytest.mark.parametrize("acting", ACTING.values(), ids=ACTING)
def test_loads_on_control_loops(acting, executed):
    links = [fa.Link(length=1.4, **ROD), fa.Link(length=1.0, **ROD)]
    hubs = [fa.Joint(hub_inertia=0.1), fa.Joint(hub_inertia=0.05)]
    arm = fa.Arm(links=links, joints=hubs)
    controller = fa.JointPD([20.0, 8.0], [4.0, 1.0], sample_time=0.003)
    reference = fa.joint_motion(arm, [0.1, 0.2], [0.3, 0.1], 0.05)
    starts = [arm.rest([0.1 - 0.02 * k, 0.2]) for k in range(9)]
    how = {"controller": controller, "reference": reference, "rate": 150.0, **acting}
    compare(arm, starts, (0, 8), duration=0.05, **how)
    assert sorted(executed) == list(range(9))


WALL = {"stiffness": 2e4, "damping": 0.5, "friction": 0.3}
#: Surfaces that the tip of the falling arm below meets within 0.05 s, from some of its starts.
SURFACES = {
    "wall": [fa.Contact(fa.Wall((0.0, 0.0), (0.0, 1.0)), exponent=1.5, **WALL)],
    "post": [fa.Contact(fa.RoundWall((2.35, -0.4), 0.4), **WALL)],
    "two points": [
        fa.Contact(fa.Wall((0.0, 0.0), (0.1, 1.0)), **WALL),
        fa.Contact(fa.Wall((0.0, 0.0), (0.0, 1.0)), link=1, **WALL),
    ],
    "table": [fa.Contact(fa.SurfaceTable([0.0, 1.0, 2.0, 3.0], [0.0, 0.01, 0.0, 0.02]), **WALL)],
}


def falling():
    """An arm close above y = 0, and starts from which its tip falls to it, or does not."""
    links = [fa.Link(length=1.4, **ROD), fa.Link(length=1.0, **ROD)]
    arm = fa.Arm(links=links, gravity=(0.0, -9.81), theory="second_order")
    starts = [arm.rest([0.02 + 0.01 * k, -0.02 - 0.015 * k]) for k in range(10)]
    rates = np.zeros((10, arm.dof))
    rates[:, arm.joint_index] = [[-0.4, -1.0]]
    return arm, starts, rates


@pytest.mark.sampled("wall-kennedy_carpenter_5", "post-rk4", "table-dormand_prince_8")
@pytest.mark.parametrize("how", METHODS, ids=lambda how: how["integrator"])
@pytest.mark.parametrize("contacts", SURFACES.values(), ids=SURFACES)
def test_contacts(contacts, how, executed):
    """Impacts in some lanes do not change the steps of the others."""
    arm, starts, rates = falling()
    if "step" in how:  # fixed steps do not resolve hard impacts and dry friction
        contacts = [one.replace(stiffness=500.0, friction=0.0) for one in contacts]
        how = {**how, "step": 1e-4}
    how = {"contacts": contacts, "duration": 0.06, "rate": 300.0, **how}
    channels = ["q", "contact_force", "contact_gap"]
    batch = fa.simulate_batch(arm, initial=starts, initial_rate=rates, channels=channels, **how)
    assert sorted(executed) == list(range(10))
    for k in (0, 4, 9):
        single = fa.simulate(arm, initial=starts[k], initial_rate=rates[k], **how)
        for name in channels:
            np.testing.assert_array_equal(batch[name][k], single[name], err_msg=name)
        for name in ("steps", "evaluations"):
            assert batch[name][k] == single.attrs[name]
    touched = (batch["contact_gap"] < 0.0).any(dim=("time", "contact")).values
    assert touched.any()


def test_each_lane_has_the_contacts_of_its_arm(executed):
    arm, starts, rates = falling()
    how = {"initial": starts[2], "initial_rate": rates[2], "duration": 0.06, "rate": 300.0}
    how["contacts"] = SURFACES["wall"]
    values = {"links[1].length": np.linspace(0.9, 1.1, 9), "payload.mass": np.linspace(0.1, 0.5, 9)}
    batch = fa.simulate_batch(arm, parameters=values, channels=["q", "contact_force"], **how)
    assert sorted(executed) == list(range(9))
    for k in (0, 4, 8):
        spec = arm.spec
        for path, row in values.items():
            spec = with_number(spec, path, float(row[k]))
        single = fa.simulate(fa.Arm(spec), **how)
        for name in ("q", "contact_force"):
            np.testing.assert_array_equal(batch[name][k], single[name], err_msg=name)
        assert batch["evaluations"][k] == single.attrs["evaluations"]
    assert (batch["contact_force"] != 0.0).any(dim=("time", "axis", "contact")).all()


@pytest.mark.filterwarnings("ignore::flexarm.FlexarmWarning")
def test_runs_that_return_to_a_surface_are_repeated_alone(executed):
    """Their errors are estimated by a second run; the others stay in lanes."""
    link = fa.Link(length=1.0, flexural_rigidity=100.0, mass_per_length=0.05, elements=1, modes=1)
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.1)])
    starts = [arm.rest([angle]) for angle in (0.0, 0.05, -3.0, 0.1)]
    wall = fa.Contact(fa.Wall((0.0, 0.4), (0.0, -1.0)), stiffness=1e4, damping=0.1)
    how = {"contacts": [wall], "torque": np.ones((100, 1)), "rate": 100.0, "duration": 1.0}
    how["integrator"] = "kennedy_carpenter_5"
    batch = compare(arm, starts, range(4), **how)
    assert executed == [2]
    assert batch["evaluations"].values[0] > 5 * batch["evaluations"].values[2]


def test_runs_that_contacts_end_are_repeated_alone(executed):
    """A start deep inside a surface, and a fixed step that is too long for an impact."""
    arm, starts, rates = falling()
    deep = fa.Contact(fa.Wall((0.0, 0.0), (0.0, 1.0)), 1e6)
    starts = [starts[3], arm.rest([-0.3, 0.0]), starts[4]]
    rates[1] *= 0.0
    how = {"contacts": [deep], "duration": 0.06, "rate": 300.0, "integrator": "rk4", "step": 1e-3}
    batch = fa.simulate_batch(arm, initial=starts, initial_rate=rates[:3], **how)
    assert batch["failure"].values[1].startswith("initial must start outside the surface")
    for k in (0, 2):
        assert "too long to resolve a contact" in batch["failure"].values[k]
        with pytest.raises(fa.SimulationError) as failed:
            fa.simulate(arm, initial=starts[k], initial_rate=rates[k], **how)
        assert batch["failure"].values[k] == str(failed.value)
    assert executed == []


def test_functions_of_time_are_evaluated_once(executed):
    """Runs with arms of their own have the factors of the loads in common."""
    arm = fa.Arm(links=[fa.Link(length=1.0, **ROD)])
    calls = []

    def factor(t):
        calls.append(t)
        return 1.0 + t

    how = {"loads": [fa.Load(1, force=(0.0, 1.0), factor=factor)], "rate": 100.0, "threads": 1}
    counts = []
    for runs in (1, 9):
        masses = {"payload.mass": np.linspace(0.1, 0.4, runs)}
        fa.simulate_batch(arm, 0.02, parameters=masses, **how)
        counts.append(len(calls))
    assert counts[1] == 2 * counts[0]
    assert len(executed) == 10


def test_a_load_that_does_not_fit_a_later_arm(executed):
    arm = fa.Arm(links=[fa.Link(length=1.0, **ROD)])
    push = fa.Load(1, force=(0.0, 1.0), station=0.9)
    how = {"loads": [push], "rate": 100.0}
    batch = fa.simulate_batch(arm, 0.02, parameters={"links[0].length": [1.0, 0.8, 1.2]}, **how)
    assert sorted(executed) == [0, 2]
    with pytest.raises(fa.InputError) as refused:
        fa.simulate(fa.Arm(with_number(arm.spec, "links[0].length", 0.8)), 0.02, **how)
    assert batch["failure"].values[1] in str(refused.value)
    with pytest.raises(fa.InputError, match=r"^simulate_batch: Load.station"):
        fa.simulate_batch(arm, 0.02, loads=[fa.Load(1, force=(0.0, 1.0), station=1.1)])


def test_arms_with_other_arrays_are_in_other_packs(executed):
    rubbing = [fa.Joint(friction=fa.Friction(coulomb=0.1, smoothing_rate=0.01)), fa.Joint()]
    links = [fa.Link(length=1.4, **ROD), fa.Link(length=1.0, **ROD)]
    arms = [fa.Arm(links=links), fa.Arm(links=links, joints=rubbing), fa.Arm(links=links[::-1])]
    torque = np.random.default_rng(3).normal(size=(30, 2))
    how = {"torque": torque, "rate": 500.0}
    batch = fa.simulate_batch(arms, 0.05, threads=1, **how)
    assert executed == [0, 2, 1]
    for k, arm in enumerate(arms):
        single = fa.simulate(arm, 0.05, **how)
        np.testing.assert_array_equal(batch["tip"][k], single["tip"])


def test_arms_whose_friction_holds_are_executed_singly(executed):
    joints = [fa.Joint(hub_inertia=0.1, friction=fa.Friction(coulomb=0.1))]
    arm = fa.Arm(links=[fa.Link(length=1.0, **ROD)], joints=joints)
    how = {"torque": np.random.default_rng(3).normal(size=(30, 1)), "rate": 500.0}
    batch = fa.simulate_batch([arm, arm], 0.05, threads=1, **how)
    assert executed == []
    np.testing.assert_array_equal(batch["tip"][1], fa.simulate(arm, 0.05, **how)["tip"])


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
        {"prescribed": {1: fa.PrescribedAngle.hold(0.1)}},
        {"integrator": "gauss_6", "step": 1e-3},
        {"integrator": "auto", "step": 0.01},  # at which rk4 is unstable
        {"channels": ["joint_force"]},
        {"specialized": False, "stations": 2, "channels": ["bending_moment"]},
    ],
    ids=["prescribed", "method", "step", "forces", "sections"],
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


def test_estimated_errors_of_runs_in_lanes(executed):
    """They are those of single runs, and absent in runs that no second one verifies."""
    rod = {
        "flexural_rigidity": 40.0,
        "mass_per_length": 0.5,
        "damping": fa.ModalDamping(ratio=0.02),
    }
    arm = fa.Arm(
        links=[fa.Link(length=1.0, elements=2, modes=2, **rod)], joints=[fa.Joint(hub_inertia=0.1)]
    )
    torques = [lambda t, size=size: [size * np.sin(6.0 * t)] for size in (0.05, 3.0, 5.0)]
    batch = fa.simulate_batch(arm, 1.0, torque=torques, progress=False)
    singles = [fa.simulate(arm, 1.0, torque=torque, progress=False) for torque in torques]
    assert set(executed) == {0, 1, 2}
    errors = [single.attrs.get("integration_error", np.nan) for single in singles]
    assert np.isfinite(errors).tolist() == [False, True, True]
    np.testing.assert_allclose(batch["integration_error"], errors, rtol=1e-12)
