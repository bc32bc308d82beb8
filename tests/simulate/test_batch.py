"""Batches of runs: equal to single runs, independent of each other, failures kept per run."""

import tracemalloc
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import flexarm as fa
from closed_mechanisms import four_bar
from flexarm.model.paths import with_number

pytestmark = pytest.mark.compiled

ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732, "elements": 1}
HUBS = [fa.Joint(hub_inertia=0.1), fa.Joint(hub_inertia=0.05)]
ARM = fa.Arm(
    links=[fa.Link(length=1.4, **ROD), fa.Link(length=1.0, **ROD)],
    joints=HUBS,
    gravity=(0.0, -9.81),
    theory="second_order",
)
MOTION = fa.joint_motion(ARM, [0.1, 0.2], [0.3, 0.1], 0.5)
DURATION, RATE = 0.03, 500.0
STARTS = np.array([ARM.rest([0.1 * k, 0.4 - 0.05 * k]) for k in range(9)])
TORQUES = np.random.default_rng(4).normal(size=(9, 15, 2))
SHORT = {"duration": DURATION, "rate": RATE}


def same(left, right):
    """Whether two datasets are equal to the last bit, apart from computing times."""
    left, right = (d.drop_attrs(deep=False) for d in (left, right))
    return left.identical(right)


def assert_run(batch, k, single, channels=("joint_angle", "tip")):
    """Run k of a batch is a single result, to the last bit."""
    for name in channels:
        np.testing.assert_array_equal(batch[name].values[k], single[name].values)
    own = batch.isel(run=k)
    for name in ("ended_by", "failure", "warning", "integrator", "steps", "evaluations"):
        assert own[name].item() == single.attrs[name]


@pytest.mark.parametrize(
    "how",
    [{}, {"integrator": "rk4", "step": 1e-3}, {"integrator": "kennedy_carpenter_5"}],
    ids=["auto", "rk4", "implicit"],
)
def test_runs_are_those_of_simulate(how):
    batch = fa.simulate_batch(ARM, initial=STARTS, torque=TORQUES, **SHORT, **how)
    for k in (0, 5, 8):
        single = fa.simulate(ARM, initial=STARTS[k], torque=TORQUES[k], **SHORT, **how)
        assert_run(batch, k, single)
    assert batch.sizes == {"run": 9, "time": 16, "joint": 2, "axis": 2}
    np.testing.assert_array_equal(batch["time"], single["time"])
    np.testing.assert_array_equal(batch["end_time"], np.full(9, DURATION))


def test_forces_of_closures_are_those_of_simulate():
    closed = four_bar()
    arm, masses = fa.Arm(closed.spec), [0.1, 0.4]
    start = fa.assembled(arm, arm.rest(closed.joints), held=[1]).q
    batch = fa.simulate_batch(
        arm, 0.05, initial=start, parameters={"payload.mass": masses}, channels=["closure_force"]
    )
    assert batch["closure_force"].dims == ("run", "time", "closure")
    for k, mass in enumerate(masses):
        single = fa.simulate(
            fa.Arm(with_number(arm.spec, "payload.mass", mass)), 0.05, initial=start
        )
        assert_run(batch, k, single, ["closure_force"])
    np.testing.assert_array_equal(batch["closure"], single["closure"])
    with pytest.raises(fa.InputError, match="there is no closure"):
        fa.simulate_batch(ARM, 0.05, initial=STARTS, channels=["closure_force"])


@pytest.mark.thorough
@settings(max_examples=10)
@given(
    runs=st.lists(st.integers(0, 8), min_size=1, max_size=12),
    threads=st.integers(1, 4),
    integrator=st.sampled_from(["auto", "kennedy_carpenter_5"]),
)
def test_a_run_does_not_depend_on_the_others(runs, threads, integrator):
    how = {"integrator": integrator, "initial_rate": [1.0, 0.0, 0.0, -2.0, 0.0, 0.0], **SHORT}
    peak = {"reductions": {"peak": fa.Reduction("rms", "tip_velocity")}}
    everything = fa.simulate_batch(ARM, initial=STARTS, torque=TORQUES, threads=1, **how, **peak)
    part = fa.simulate_batch(
        ARM, initial=STARTS[runs], torque=TORQUES[runs], threads=threads, **how, **peak
    )
    expected = everything.isel(run=runs)
    for name in part.data_vars:
        np.testing.assert_array_equal(part[name], expected[name], err_msg=name)


def test_all_threads_give_the_same_dataset():
    one, three = (
        fa.simulate_batch(ARM, initial=STARTS, threads=threads, **SHORT) for threads in (1, 3)
    )
    assert same(one, three)
    assert not same(one, fa.simulate_batch(ARM, initial=STARTS[::-1], **SHORT))


def test_parameters_change_the_simulated_arm():
    values = {"payload.mass": [0.0, 0.3, 0.6], "links[1].flexural_rigidity": [105.0, 50.0, 105.0]}
    batch = fa.simulate_batch(ARM, initial=STARTS[1], parameters=values, **SHORT)
    for k in range(3):
        spec = ARM.spec
        for path, row in values.items():
            spec = with_number(spec, path, row[k])
        assert_run(batch, k, fa.simulate(fa.Arm(spec), initial=STARTS[1], **SHORT))
    np.testing.assert_array_equal(batch.coords["payload.mass"], values["payload.mass"])
    assert batch.coords["payload.mass"].dims == ("run",)


def test_arms_of_one_structure():
    heavy = fa.varied(ARM, payload_mass=0.5)
    batch = fa.simulate_batch([ARM, heavy], initial=STARTS[2], **SHORT)
    for k, arm in enumerate((ARM, heavy)):
        assert_run(batch, k, fa.simulate(arm, initial=STARTS[2], **SHORT))


def test_a_function_of_time_and_one_for_each_run():
    def pull(size):
        return lambda t: [size * np.sin(40.0 * t), 0.1]

    both = fa.simulate_batch(ARM, torque=[pull(1.0), pull(2.0)], **SHORT)
    for k, size in enumerate((1.0, 2.0)):
        assert_run(both, k, fa.simulate(ARM, torque=pull(size), **SHORT))
    shared = fa.simulate_batch(ARM, torque=pull(2.0), initial=STARTS[:2] * 0.0, **SHORT)
    np.testing.assert_array_equal(shared["tip"][1], both["tip"][1])


def test_the_motion_of_a_torque_is_the_start():
    torque = fa.rigid_torque(ARM, MOTION)
    batch = fa.simulate_batch(ARM, torque=[torque, torque], **SHORT)
    np.testing.assert_allclose(batch["joint_angle"][:, 0], [[0.1, 0.2]] * 2, rtol=0.0, atol=1e-15)


def test_controllers_references_and_seeds():
    hardware = fa.Hardware([fa.Instrument("joint_angle", noise=1e-3, rate_cutoff=50.0)])
    weak, strong = (fa.JointPD([g, g], [g / 9, g / 9], sample_time=0.005) for g in (4.0, 9.0))
    other = fa.joint_motion(ARM, [0.1, 0.2], [0.0, 0.3], 0.4)
    loop = {"hardware": hardware, **SHORT}
    batch = fa.simulate_batch(
        ARM,
        controller=[weak, strong, weak],
        reference=[MOTION, MOTION, other],
        seeds=[3, 3, 8],
        channels=["tip", "torque_command"],
        **loop,
    )
    pairs = ((weak, MOTION, 3), (strong, MOTION, 3), (weak, other, 8))
    for k, (controller, reference, seed) in enumerate(pairs):
        noisy = {**loop, "hardware": hardware.replace(seed=seed)}
        single = fa.simulate(ARM, controller=controller, reference=reference, **noisy)
        assert_run(batch, k, single, ("tip", "torque_command"))
    np.testing.assert_array_equal(batch.coords["seed"], [3, 3, 8])


def test_parameters_of_a_run_are_valid_together():
    """The lower limit exceeds the upper limit of the arm, but not that of the run."""
    limits = fa.JointLimits(lower=-1.0, upper=0.25, stiffness=1e3)
    link = fa.Link(length=1.0, mass_per_length=1.0, flexible=False)
    arm = fa.Arm(links=[link], joints=[fa.Joint(limits=limits)])
    moved = {"joints[0].limits.lower": [0.26, -1.0], "joints[0].limits.upper": [0.5, 0.25]}
    found = fa.simulate_batch(arm, 0.01, initial=[[0.4], [0.0]], parameters=moved)
    assert not found.failure.values.any()


def test_parameters_leave_the_model_of_the_controller():
    own = {"controller": fa.JointPD(4.0, 0.5, sample_time=0.005), "reference": MOTION, **SHORT}
    batch = fa.simulate_batch(ARM, parameters={"payload.mass": [0.0, 0.4]}, **own)
    heavy = fa.Arm(with_number(ARM.spec, "payload.mass", 0.4))
    assert_run(batch, 1, fa.simulate(ARM, plant=heavy, **own))
    given = fa.simulate_batch(ARM, plant=[ARM, heavy], **own)
    np.testing.assert_array_equal(given["tip"], batch["tip"])
    same = fa.simulate_batch(ARM, plant=heavy, controller=[own.pop("controller")] * 2, **own)
    np.testing.assert_array_equal(same["tip"], batch["tip"][[1, 1]])


def test_contacts_loads_and_prescribed_joints():
    x, y, *_ = ARM.tip(STARTS[0])
    floor = fa.Contact(fa.Wall((float(x), float(y) - 1e-3), (0.0, 1.0)), 1e4)
    push = fa.Load(2, force=(0.0, -1.0), factor=lambda t: 1.0 + t)
    for how in (
        {"contacts": [floor]},
        {"loads": [push], "base_acceleration": lambda t: [0.0, t]},
        {"prescribed": {1: fa.PrescribedAngle.hold(0.2)}, "torque": TORQUES[0]},
    ):
        rates = [[0.0] * 6, [0.0, 0.0, 0.0, 0.3, 0.0, 0.0]]
        batch = fa.simulate_batch(
            ARM, initial=STARTS[0], initial_rate=rates, channels=["tip", "torque"], **how, **SHORT
        )
        for k in range(2):
            single = fa.simulate(ARM, initial=STARTS[0], initial_rate=rates[k], **how, **SHORT)
            assert_run(batch, k, single, ("tip", "torque"))


def test_impacts_on_joint_stops_are_repeated_as_in_simulate():
    stop = fa.JointLimits(lower=-0.2, upper=0.41, stiffness=500.0)
    arm = fa.Arm(links=ARM.spec.links, joints=[fa.Joint(hub_inertia=0.1, limits=stop), HUBS[1]])
    rates = np.zeros((2, 6))
    rates[1, 0] = 4.0
    start = arm.rest([0.4, 0.1])
    batch = fa.simulate_batch(arm, initial=start, initial_rate=rates, **SHORT)
    for k in range(2):
        assert_run(batch, k, fa.simulate(arm, initial=start, initial_rate=rates[k], **SHORT))
    assert batch["evaluations"][1] > 2 * batch["evaluations"][0]


def test_an_event_ends_its_run_alone():
    event = fa.joint_event(ARM, 1, 0.0, name="level", terminal=True)
    options = {"events": [event], "channels": ["tip"], **SHORT}
    reductions = {"lowest": fa.Reduction(lambda t, tip: t[-1], "tip")}
    starts = [ARM.rest([0.001, 0.0]), ARM.rest([0.9, 0.0])]
    batch = fa.simulate_batch(ARM, initial=starts, reductions=reductions, **options)
    assert list(batch["ended_by"].values) == ["level", "duration"]
    end = batch["end_time"].values[0]
    assert 0.0 < end < DURATION
    seen = batch["time"].values < end
    assert np.isfinite(batch["tip"].values[0, seen]).all()
    assert np.isnan(batch["tip"].values[0, ~seen]).all()
    np.testing.assert_array_equal(batch["lowest"], [end, DURATION])


def test_a_failure_keeps_the_other_runs():
    rates = np.zeros((3, 6))
    rates[1, 0] = 4000.0  # more than half a turn in a step
    how = {"integrator": "rk4", "step": 1e-3, "initial": STARTS[0], **SHORT}
    batch = fa.simulate_batch(
        ARM, initial_rate=rates, reductions={"peak": fa.Reduction("peak", "torque")}, **how
    )
    with pytest.raises(fa.SimulationError) as failed:
        fa.simulate(ARM, initial_rate=rates[1], **how)
    assert list(batch["ended_by"].values) == ["duration", "failure", "duration"]
    assert list(batch["failure"].values) == ["", str(failed.value), ""]
    assert batch["end_time"].values[1] == failed.value.time
    got = len(failed.value.result["time"])
    assert got < 16
    np.testing.assert_array_equal(batch["tip"][1, :got], failed.value.result["tip"])
    assert np.isnan(batch["tip"].values[1, got:]).all()
    assert np.isnan(batch["peak"].values).tolist() == [[False] * 2, [True] * 2, [False] * 2]
    alone = fa.simulate_batch(ARM, initial_rate=rates[2:], **how)
    np.testing.assert_array_equal(batch["tip"][2], alone["tip"][0])


def broken(t):
    if t > 0.01:
        raise RuntimeError("no more data")
    return [0.0, 0.0]


@pytest.mark.parametrize("stations", [0, 3], ids=["lanes", "alone"])
def test_a_factor_that_fails_is_the_failure_of_each_run(stations):
    load = fa.Load(1, (0.0, 1.0), factor=lambda t: 1.0 + broken(t)[0])
    for more in ({}, {"controller": fa.JointPD(4.0, 0.5)}):
        batch = fa.simulate_batch(
            ARM, loads=[load], initial=STARTS[:2], stations=stations, **SHORT, **more
        )
        assert list(batch["ended_by"].values) == ["failure"] * 2
        for text in batch["failure"].values:
            assert text.startswith(
                "stopped at t = 0.01 s: Load.factor failed with RuntimeError: no"
            )


@pytest.mark.parametrize(
    ("torque", "reason"),
    [(broken, "no more data"), (lambda t: [0.0], "must be numbers of shape (2,)")],
    ids=["raises", "wrong shape"],
)
def test_a_function_that_fails_in_a_later_run(torque, reason):
    batch = fa.simulate_batch(ARM, torque=[lambda t: [0.0, 0.0], torque], **SHORT)
    assert list(batch["ended_by"].values) == ["duration", "failure"]
    assert reason in batch["failure"].values[1]
    assert np.isnan(batch["tip"].values[1]).all()


def test_a_reduction_that_fails():
    def picky(times, rates):
        if rates[0, 0] > 0.0:
            raise ValueError("too fast")
        return 1.0

    rates = np.zeros((2, 6))
    rates[1, 0] = 0.1
    batch = fa.simulate_batch(
        ARM, initial_rate=rates, reductions={"x": fa.Reduction(picky, "joint_rate")}, **SHORT
    )
    np.testing.assert_array_equal(batch["x"], [1.0, np.nan])
    assert batch["failure"].values[1] == "The reduction 'x' failed with ValueError: too fast"
    assert batch["ended_by"].values[1] == "failure"


def test_only_the_requested_samples_are_stored():
    batch = fa.simulate_batch(
        ARM, initial=STARTS[:2], channels=["tip_angle"], stride=4, torque=TORQUES[0], **SHORT
    )
    single = fa.simulate(ARM, initial=STARTS[1], torque=TORQUES[0], **SHORT)
    np.testing.assert_array_equal(batch["time"], single["time"][::4])
    np.testing.assert_array_equal(batch["tip_angle"][1], single["tip_angle"][::4])
    assert "tip" not in batch
    assert "axis" not in batch.coords
    nothing = fa.simulate_batch(ARM, initial=STARTS[:2], channels=[], **SHORT)
    assert set(nothing.data_vars) == {
        *("end_time", "ended_by", "failure", "warning", "integrator", "steps", "evaluations")
    }


@pytest.mark.thorough
def test_memory_is_that_of_the_dataset_and_of_one_run():
    runs, samples = 40, 20_000
    reductions = {"peak": fa.Reduction("peak", "tip")}
    how = {"channels": [], "reductions": reductions, "integrator": "rk4", "step": 1e-3}

    def simulated():
        fa.simulate_batch(
            ARM, 0.02, rate=(samples - 1) / 0.02, initial=np.zeros((runs, 6)), threads=1, **how
        )

    simulated()  # compile
    tracemalloc.start()
    simulated()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    one = samples * 12 * 8  # states of one run: 12 numbers
    # States of eight runs, and all channels of one; the states of all runs would need 40 times one.
    assert peak < 20 * one


def test_warnings_are_kept_and_reported_once():
    soft = fa.Arm(links=[fa.Link(length=1.0, **ROD).replace(flexural_rigidity=0.5)])
    torque = np.ones((3, 15, 1)) * [[[0.01]], [[1.0]], [[1.0]]]
    with pytest.warns(fa.FlexarmWarning, match="2 of 3 runs have warnings") as issued:
        batch = fa.simulate_batch(soft, torque=torque, **SHORT)
    assert len(issued) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.LargeDeflectionWarning)
        single = fa.simulate(soft, torque=torque[1], **SHORT)
    assert list(batch["warning"].values) == ["", *[single.attrs["warning"]] * 2]


def test_a_file_keeps_a_batch(tmp_path):
    parameters = {"payload.mass": [0.0, 0.3]}
    batch = fa.simulate_batch(ARM, parameters=parameters, initial=STARTS[1], **SHORT)
    fa.write_result(batch, tmp_path / "batch.nc")
    assert fa.read_result(tmp_path / "batch.nc").identical(batch)
