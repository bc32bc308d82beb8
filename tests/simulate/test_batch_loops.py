"""Batches of runs with controllers: side by side in lanes, with the numbers of single runs."""

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import flexarm as fa
from conformance.controller_examples import EXAMPLES, LATE, SAMPLE_TIME, joint_pd
from flexarm.integrate.lanes.stepper import LaneStepper
from flexarm.model.paths import with_number
from loop_runs import ARM, CHANNELS, DURATION, MOTION, RATE, SHORT, STARTS, Integral, compare

pytestmark = pytest.mark.compiled

#: Controllers that measure the force of a contact.
TOUCHING = {"admittance", "hybrid_force"}
NOISY = fa.Hardware(
    instruments=[
        fa.Instrument("joint_angle", noise=1e-3, rate_cutoff=50.0, resolution=1e-4),
        fa.Instrument("strain", noise=1e-6, sample_time=2 * SAMPLE_TIME, delay=SAMPLE_TIME),
        fa.Instrument("tip", name="camera", bias=0.01),
    ]
)
MOTORS = fa.Motors(time_constant=0.003, delay=0.006, torque_limit=[0.3, 0.1])


def recorded():
    nominal = fa.simulate(ARM, 0.1, controller=EXAMPLES["lqg"](), reference=MOTION)
    return EXAMPLES["lqg"](nominal=nominal)


CONTROLLERS = {
    **{name: make for name, make in EXAMPLES.items() if name not in TOUCHING},
    "recorded": recorded,
    "fed forward": lambda: fa.ComputedTorque(
        ARM, 0.3, feedforward=fa.rigid_torque(ARM, MOTION), sample_time=SAMPLE_TIME
    ),
    "with hardware": lambda: EXAMPLES["lqg"](hardware=LATE),
    "limited": lambda: EXAMPLES["joint_pid"](torque_limit=0.2, sag=False),
}


@pytest.mark.sampled("motion-joint_pd", "rest-computed_torque", "rest-lqg")
@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("reference", [MOTION, None], ids=["motion", "rest"])
def test_every_controller(reference, name, executed):
    controller = CONTROLLERS[name]()
    hardware = None
    if name == "estimator":
        hardware = fa.Hardware(controller.estimator.instruments)
    elif name == "with hardware":
        hardware = LATE
    own = {"controller": controller, "reference": reference, "hardware": hardware}
    batch = fa.simulate_batch(ARM, initial=STARTS, channels=CHANNELS, threads=1, **own, **SHORT)
    assert executed == list(range(11))
    compare(batch, (0, 8, 10), **{key: lambda k, v=value: v for key, value in own.items()})


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::flexarm.FlexarmWarning")  # of motors at their limits
@settings(max_examples=5)
@given(runs=st.lists(st.integers(0, 10), min_size=1, max_size=14), threads=st.integers(1, 3))
def test_a_run_does_not_depend_on_the_others(runs, threads):
    controllers = [joint_pd(), EXAMPLES["strain_feedback"](), EXAMPLES["joint_pid"](), Integral()]
    chosen = [controllers[k % 4] for k in range(11)]
    seeds = np.arange(100, 111)
    how = {
        "hardware": fa.Hardware(instruments=NOISY.instruments, motors=MOTORS),
        "reference": MOTION,
        "reductions": {"peak": fa.Reduction("peak", "torque")},
        "channels": CHANNELS,
        **SHORT,
    }
    everything = fa.simulate_batch(
        ARM, controller=chosen, initial=STARTS, seeds=seeds, threads=1, **how
    )
    part = fa.simulate_batch(
        ARM,
        controller=[chosen[k] for k in runs],
        initial=STARTS[runs],
        seeds=seeds[runs],
        threads=threads,
        **how,
    )
    expected = everything.isel(run=runs)
    for name in part.data_vars:
        np.testing.assert_array_equal(part[name], expected[name], err_msg=name)


@pytest.mark.filterwarnings("ignore::flexarm.FlexarmWarning")  # of motors at their limits
@pytest.mark.parametrize("motors", [None, MOTORS], ids=["ideal", "motors"])
def test_instruments_and_motors(motors, executed):
    hardware = fa.Hardware(instruments=NOISY.instruments, motors=motors)
    controllers = [EXAMPLES["strain_feedback"](), Integral()] * 5 + [joint_pd()]
    seeds = np.arange(11)
    batch = fa.simulate_batch(
        ARM,
        controller=controllers,
        reference=MOTION,
        initial=STARTS,
        hardware=hardware,
        seeds=seeds,
        channels=CHANNELS,
        threads=1,
        **SHORT,
    )
    assert sorted(executed) == list(range(11))
    compare(
        batch,
        (0, 7, 10),
        controller=lambda k: controllers[k],
        reference=lambda k: MOTION,
        hardware=lambda k: hardware.replace(seed=int(seeds[k])),
    )


@pytest.mark.parametrize("controller", [EXAMPLES["strain_feedback"](), Integral()])
def test_arms_of_their_own(controller, executed):
    mass = np.linspace(0.0, 0.2, 11)
    own = {"controller": controller, "reference": MOTION}
    hardware = fa.Hardware(
        [fa.Instrument(name) for name in ("joint_angle", "joint_rate", "strain", "tip")]
    )
    batch = fa.simulate_batch(
        ARM,
        initial=STARTS,
        parameters={"payload.mass": mass},
        hardware=hardware,
        channels=CHANNELS,
        **own,
        **SHORT,
    )
    assert sorted(executed) == list(range(11))
    compare(
        batch,
        (0, 9, 10),
        plant=lambda k: fa.Arm(with_number(ARM.spec, "payload.mass", mass[k])),
        hardware=lambda k: hardware,
        **{key: lambda k, v=value: v for key, value in own.items()},
    )


def test_different_sample_times(executed):
    controllers = [fa.JointPD(4.0, 0.4, sample_time=(0.004, 0.003)[k % 2]) for k in range(11)]
    own = {"initial": STARTS, "channels": CHANNELS, "threads": 1}
    batch = fa.simulate_batch(ARM, controller=controllers, reference=MOTION, **own, **SHORT)
    assert executed == [*range(0, 11, 2), *range(1, 11, 2)]
    compare(batch, (0, 1), controller=lambda k: controllers[k], reference=lambda k: MOTION)


@pytest.mark.parametrize(("duration", "sample_time"), [(0.027, 0.009), (0.07, 0.01), (0.3, 0.1)])
def test_the_last_sample_time_is_near_the_end(duration, sample_time, executed):
    """Multiples of the sample time differ from the duration by rounding."""
    own = {"controller": fa.JointPD(1.0, 0.1, sample_time=sample_time), "initial": STARTS[2]}
    batch = fa.simulate_batch(ARM, duration, rate=1000.0, channels=["tip"], **own)
    single = fa.simulate(ARM, duration, rate=1000.0, **own)
    assert executed == [0]
    count = single.sizes["time"]
    np.testing.assert_array_equal(batch["tip"][0, :count], single["tip"])
    assert np.isnan(batch["tip"][0, count:]).all()


def test_an_unstable_loop_fails_alone(executed, monkeypatch):
    steps, advance = [], LaneStepper.advance

    def counted(self, method, drive, runs, most):
        advance(self, method, drive, runs, most)
        steps.append(int(runs.counts[4].sum()))

    monkeypatch.setattr(LaneStepper, "advance", counted)
    controllers = [joint_pd() for _ in range(10)]
    controllers[4] = fa.JointPD(3000.0, 300.0, sample_time=SAMPLE_TIME)
    own = {"reference": MOTION, "channels": CHANNELS, "threads": 1, **SHORT}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.FlexarmWarning)
        batch = fa.simulate_batch(ARM, controller=controllers, initial=STARTS[:10], **own)
        with pytest.raises(fa.SimulationError) as failed:
            fa.simulate(
                ARM, controller=controllers[4], reference=MOTION, initial=STARTS[4], **SHORT
            )
    assert executed == [0, 1, 2, 3, 5, 6, 7, 8, 9]
    assert list(np.flatnonzero(batch["failure"] != "")) == [4]
    assert batch["failure"][4] == str(failed.value)
    got = failed.value.result.sizes["time"]
    assert 1 < got < batch.sizes["time"]
    np.testing.assert_array_equal(batch["tip"][4, :got], failed.value.result["tip"])
    # The run fails in the middle of its pack, whose other runs go on.
    end = batch["end_time"].values[4]
    assert 0.0 < end < DURATION - 2 * SAMPLE_TIME
    assert len(steps) == 13
    later = steps[round(end / SAMPLE_TIME) :]
    assert later == later[:1] * len(later)
    compare(batch, (3, 9), controller=lambda k: controllers[k], reference=lambda k: MOTION)


def test_a_link_that_bends_far_just_before_the_end(executed):
    """The integrator goes on; the check at the sample times ends the run."""
    own = {"controller": fa.JointPD(3000.0, 300.0, sample_time=SAMPLE_TIME), "reference": MOTION}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.FlexarmWarning)
        with pytest.raises(fa.SimulationError, match="times its length") as failed:
            fa.simulate(ARM, DURATION, **own)
        own |= {"duration": failed.value.time, "rate": RATE}
        with pytest.raises(fa.SimulationError, match="times its length") as failed:
            fa.simulate(ARM, **own)
        batch = fa.simulate_batch(ARM, **own)
    assert executed == []
    assert batch["failure"][0] == str(failed.value)


def test_wrong_arguments_of_the_first_run():
    with pytest.raises(fa.InputError, match="is for 3 joints, but the arm has 2"):
        fa.simulate_batch(ARM, controller=fa.JointPD([1.0] * 3, 1.0), **SHORT)
    later = [joint_pd(), fa.JointPD([1.0] * 3, 1.0, sample_time=SAMPLE_TIME)]
    batch = fa.simulate_batch(ARM, controller=later, reference=MOTION, **SHORT)
    assert list(batch["ended_by"].values) == ["duration", "failure"]
    assert "is for 3 joints" in batch["failure"].values[1]
