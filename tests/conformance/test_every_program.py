"""Laws that run as programs: the same numbers as their steps in Python, to the last bit."""

from functools import partial

import numpy as np
import pytest
from controller_examples import EXAMPLES, example, two_links
from hypothesis import given, settings
from hypothesis import strategies as st

import flexarm as fa
from flexarm.control.contract.law_program import program_of
from flexarm.kernels.controller_terms.law_program import OPERATIONS, law_step
from flexarm.simulation.loop import programmed_samples
from flexarm.simulation.loop.control_loop import ClosedLoop

pytestmark = [
    pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning"),
    pytest.mark.filterwarnings("ignore::flexarm.LimitWarning"),
    pytest.mark.filterwarnings("ignore::flexarm.UnstableLoopWarning"),
]
ARM = two_links()
MOTION = fa.joint_motion(ARM, [0.4, 0.1], [0.5, 0.0], 0.1)
#: Laws of matrices, elementary operations and terms of a model. The others solve a problem at every
#: sample, decide on numbers, or use functions that NumPy rounds otherwise than compiled code.
PROGRAMMED = {
    *("adaptive", "composite", "computed_torque", "disturbance_observer"),
    *("integral_resonant_control", "joint_pd", "joint_pid", "loop_shaping", "lqg"),
    *("mu_synthesis", "output_redefinition", "positive_position_feedback", "sliding_mode"),
    *("strain_feedback", "wave_based_control"),
}


def program_after_a_sample(controller):
    controller.reset()
    readings = fa.Measurement(
        joint_angle=np.array([0.4, 0.1]),
        joint_rate=np.array([0.01, 0.02]),
        strain=np.zeros(len(ARM.gauges)),
    )
    controller.update(0.0, readings, MOTION)
    inputs = controller.planned(controller.sample_time, MOTION)
    return program_of(controller, controller.memory, readings, inputs)


#: Laws that read other signals, whose loops have no programs.
OTHERS = {"estimator", "nonlinear_mpc", "adaptive_force", "hybrid_force", "neural_force"}


@pytest.mark.parametrize("name", sorted(set(EXAMPLES) - OTHERS))
def test_laws_with_programs(name):
    controller = example(name)
    assert (program_after_a_sample(controller) is not None) == (name in PROGRAMMED)


def simulated(monkeypatch, programmed, controller, arm=ARM, **options):
    monkeypatch.setattr(ClosedLoop, "_is_programmed", programmed)
    monkeypatch.setattr(programmed_samples, "_WORTH", 2)
    options = {"reference": MOTION, "initial": arm.rest([0.4, 0.1]), **options}
    return fa.simulate(arm, 0.1, controller=controller, **options)


def assert_equal_runs(one, other):
    for name in one.variables:
        np.testing.assert_array_equal(one[name].values, other[name].values, err_msg=name)
    left_out = {"wall_seconds", "controller_seconds", "loop_growth"}
    # Of eigenvalues, which another law with the same step has up to rounding.
    assert one.attrs.get("loop_growth", 0.0) == pytest.approx(other.attrs.get("loop_growth", 0.0))
    for name in one.attrs.keys() - left_out:
        assert one.attrs[name] == other.attrs[name], name


@pytest.mark.parametrize("reference", [MOTION, None], ids=["motion", "rest"])
@pytest.mark.parametrize("name", sorted(PROGRAMMED))
def test_program_equals_the_step(monkeypatch, name, reference):
    python, program = example(name), example(name)
    results = [
        simulated(monkeypatch, programmed, controller, reference=reference)
        for programmed, controller in ((False, python), (True, program))
    ]
    assert_equal_runs(*results)
    assert python.report() == program.report()
    for key, value in python.memory.items():
        np.testing.assert_array_equal(value, program.memory[key], err_msg=key)
        assert np.asarray(value).dtype == np.asarray(program.memory[key]).dtype


GRAVITY = fa.Arm(ARM.spec.replace(gravity=(0.0, -9.81)))
RATE = {"sample_time": 4e-3}


def pid(**options):
    return fa.JointPID([8.0, 3.0], [0.8, 0.3], [2.0, 1.0], arm=GRAVITY, **RATE, **options)


def computed_torque():
    return fa.ComputedTorque(GRAVITY, 0.3, 0.5, **RATE)


#: Arguments of laws that use other terms of their model.
VARIANTS = {
    "gravity": pid,
    "gravity with sag": partial(pid, sag=True),
    "gravity within limits": partial(pid, torque_limit=[0.4, 0.1]),
    "mass matrix": lambda: fa.ComputedTorque(
        GRAVITY, 0.3, 0.5, feedforward=fa.rigid_torque(GRAVITY, MOTION), **RATE
    ),
    "momentum with gravity": lambda: fa.DisturbanceObserver(GRAVITY, example("joint_pd"), 0.2),
    "friction": lambda: fa.Adaptive(GRAVITY, 2.0, [0.8, 0.2], 0.003, "friction", **RATE),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_terms_of_a_model(monkeypatch, name):
    python, program = VARIANTS[name](), VARIANTS[name]()
    assert program_after_a_sample(program) is not None
    results = [
        simulated(monkeypatch, programmed, controller, arm=GRAVITY)
        for programmed, controller in ((False, python), (True, program))
    ]
    assert_equal_runs(*results)


def test_a_law_with_two_models_runs_in_python(monkeypatch):
    laws = [fa.DisturbanceObserver(GRAVITY, computed_torque(), 0.2) for _ in range(2)]
    assert program_after_a_sample(laws[1]) is None
    assert_equal_runs(
        *(simulated(monkeypatch, on, law) for on, law in zip((0, 1), laws, strict=True))
    )


def fast():
    return fa.JointPD([8.0, 3.0], [0.8, 0.3], sample_time=1e-3)


ENCODER = {"resolution": 1e-4, "rate_cutoff": 100.0}
LIMIT = [0.6, 0.2]
VOLTAGE = {"torque_constant": 1.0, "resistance": 2.0, "voltage_limit": 1.0, "current_limit": 0.4}
INSTRUMENTS = {
    "encoder": [fa.Instrument("joint_angle", **ENCODER)],
    "noise": [
        fa.Instrument("joint_angle", noise=1e-4, **ENCODER),
        fa.Instrument("strain", noise=1e-6, name="gauge"),
    ],
    "delays": [
        fa.Instrument("joint_angle", delay=2e-3),
        fa.Instrument("joint_rate", delay=1e-3, bias=1e-3),
    ],
    "limit": [fa.Instrument("joint_angle", limit=0.45, rate_cutoff=50.0)],
}
MOTORS = {
    "limit": fa.Motors(torque_limit=LIMIT),
    "voltage": fa.Motors(**VOLTAGE),
    "delay": fa.Motors(delay=1e-3),
    "lag": fa.Motors(time_constant=1e-3),
    "short lag": fa.Motors(time_constant=2e-5, torque_limit=LIMIT),
    "all": fa.Motors(torque_limit=LIMIT, delay=2e-3, time_constant=5e-4),
}
HARDWARE = {f"instruments: {name}": fa.Hardware(items) for name, items in INSTRUMENTS.items()}
HARDWARE |= {f"motors: {name}": fa.Hardware(motors=motors) for name, motors in MOTORS.items()}
HARDWARE["both"] = fa.Hardware(INSTRUMENTS["noise"], MOTORS["all"], seed=3)
#: Hardware whose samples differ from each other.
IN_PYTHON = {
    "stride": fa.Hardware([fa.Instrument("joint_angle", sample_time=2e-3, rate_cutoff=50.0)]),
    "fault": fa.Hardware(
        [
            fa.Instrument("joint_rate"),
            fa.Instrument("joint_angle", faults=[fa.InstrumentFault("bias", 0.01, start=0.05)]),
        ]
    ),
    "part of a sample": fa.Hardware(motors=fa.Motors(delay=5e-4)),
    "other signal": fa.Hardware([*INSTRUMENTS["encoder"], fa.Instrument("tip")]),
}


def programs_of(monkeypatch):
    """Return a list to which each use of a program is appended."""
    used = []
    advance = programmed_samples.ProgrammedSamples.advance
    noting = lambda samples: used.append(samples) or advance(samples)  # noqa: E731
    monkeypatch.setattr(programmed_samples.ProgrammedSamples, "advance", noting)
    return used


@pytest.mark.parametrize("name", [*HARDWARE, *IN_PYTHON])
def test_programs_with_hardware(monkeypatch, name):
    """Also in several calls, which keep the state of the devices."""
    used, hardware = programs_of(monkeypatch), {**HARDWARE, **IN_PYTHON}[name]
    monkeypatch.setattr(programmed_samples, "_CHUNK", 40)
    results = [simulated(monkeypatch, on, fast(), hardware=hardware) for on in (False, True)]
    assert bool(used) == (name in HARDWARE)
    assert_equal_runs(*results)


def test_motors_of_an_arm_without_gauges(monkeypatch):
    """Its measurements contain an empty strain."""
    links = [link.replace(gauges=[]) for link in ARM.spec.links]
    bare, used = fa.Arm(ARM.spec.replace(links=links)), programs_of(monkeypatch)
    options = {"arm": bare, "hardware": HARDWARE["motors: limit"]}
    assert_equal_runs(*(simulated(monkeypatch, on, fast(), **options) for on in (False, True)))
    assert used


@pytest.mark.parametrize("name", sorted(PROGRAMMED))
def test_programs_of_laws_with_hardware(monkeypatch, name):
    used = programs_of(monkeypatch)
    encoder, gauge = INSTRUMENTS["encoder"], fa.Instrument("strain", noise=1e-7)
    hardware = fa.Hardware([*encoder, gauge], fa.Motors(delay=4e-3, torque_limit=[5.0, 2.0]))
    results = [simulated(monkeypatch, on, example(name), hardware=hardware) for on in (0, 1)]
    assert used
    assert_equal_runs(*results)


@pytest.mark.parametrize("method", ["dormand_prince_8", "kennedy_carpenter_5"])
def test_program_with_each_integrator(monkeypatch, method):
    results = [simulated(monkeypatch, on, fast(), integrator=method) for on in (False, True)]
    assert_equal_runs(*results)


def test_program_runs_in_several_calls(monkeypatch):
    """Also where a sample takes more steps than a call."""
    plain = simulated(monkeypatch, False, fast())
    monkeypatch.setattr(programmed_samples, "_CHUNK", 7)
    assert_equal_runs(simulated(monkeypatch, True, fast()), plain)


@pytest.mark.parametrize("name", sorted(PROGRAMMED))
def test_steps_of_a_sample_are_divided_between_calls(monkeypatch, name):
    """A law that looks ahead plans each sample once."""
    tight = {"rtol": 1e-13, "integrator": "dormand_prince_8"}
    slow = example(name)
    plain = simulated(monkeypatch, False, slow, **tight)
    assert plain.attrs["steps"] > 50
    original, seen = ClosedLoop.advance_samples, []

    def short(self, kernel, law):
        self.run.max_steps = 3
        seen.append(law.counts[0])
        return original(self, kernel, law)

    monkeypatch.setattr(ClosedLoop, "advance_samples", short)
    assert_equal_runs(simulated(monkeypatch, True, slow, **tight), plain)
    assert len(seen) > 3


def test_a_loop_uses_its_program(monkeypatch):
    calls = []
    step = fa.JointPD.step
    monkeypatch.setattr(fa.JointPD, "step", lambda *given: calls.append(1) or step(*given))
    simulated(monkeypatch, True, fast())
    # Of 100 samples the first; the others are the recording, the comparison and the poles.
    assert len(calls) < 20


class Noting(fa.JointPD):
    """A user's law that notes its samples."""

    def step(self, memory, readings, inputs):
        self.noted = [*getattr(self, "noted", []), 1]
        return super().step(memory, readings, inputs)


def test_a_law_of_a_user_has_no_program(monkeypatch):
    law = Noting([8.0, 3.0], [0.8, 0.3], sample_time=1e-3)
    result = simulated(monkeypatch, True, law)
    assert len(law.noted) == 100
    assert_equal_runs(
        result.assign_attrs(controller="JointPD"), simulated(monkeypatch, True, fast())
    )


@pytest.mark.parametrize("hardware", [None, fa.Hardware(INSTRUMENTS["noise"])])
@pytest.mark.parametrize("gain", [3e4, 1e200])
def test_failures_are_the_same(monkeypatch, gain, hardware):
    """Links that bend too far, and torques that are not finite."""
    texts = []
    law = fa.JointPD([gain] * 2, [gain] * 2, sample_time=1e-3)
    for programmed in (False, True):
        with pytest.raises(fa.SimulationError) as caught:
            simulated(monkeypatch, programmed, law, hardware=hardware)
        result = caught.value.result
        texts.append((str(caught.value), None if result is None else result["torque"].values))
    assert texts[0][0] == texts[1][0]
    np.testing.assert_array_equal(texts[0][1], texts[1][1])


class Bump:
    """Reference for one time, whose arrays of many times have the axes in another order."""

    def joint_angle(self, t):
        bump = 0.1 * np.sin(np.pi * t / 0.05) ** 2
        return np.array([0.4 + bump, 0.1 + bump])

    def joint_rate(self, t):
        return np.array([0.0 * t, 0.0 * t])

    joint_acceleration = joint_rate


class Counting(Bump):
    """Reference that depends on the number of its calls."""

    calls = 0

    def joint_angle(self, t):
        self.calls += 1
        return np.array([0.4 + 1e-4 * self.calls, 0.1])


@pytest.mark.parametrize("kind", [Bump, Counting])
def test_a_reference_of_a_user_is_asked_once_for_each_time(monkeypatch, kind):
    results = [simulated(monkeypatch, on, fast(), reference=kind()) for on in (False, True)]
    assert_equal_runs(*results)


class Ending:
    """Reference that ends."""

    def joint_angle(self, t):
        if t > 0.05:
            raise ValueError("after the end")
        return np.array([0.4, 0.1])

    def joint_rate(self, t):
        return np.zeros(2)

    joint_acceleration = joint_rate


def test_a_reference_that_fails_later(monkeypatch):
    for programmed in (False, True):
        with pytest.raises(fa.SimulationError, match=r"t = 0\.051 s.*after the end") as caught:
            simulated(monkeypatch, programmed, fast(), reference=Ending())
        assert caught.value.result.time.values[-1] >= 0.05


numbers = st.floats(-1e3, 1e3, allow_subnormal=False)
ufuncs = [name for name in OPERATIONS if name not in ("where", "sqrt")]


class Random(fa.JointPD):
    """A law of random operations."""

    operations = ()

    def step(self, memory, readings, inputs):
        values = [readings.joint_angle, readings.joint_rate, inputs["reference_angle"]]
        for name, first, second in self.operations:
            ufunc = getattr(np, name)
            operands = [values[k % len(values)] for k in (first, second)][: ufunc.nin]
            values.append(1.0 * ufunc(*operands))
        chosen = np.where(values[-1] > 0.5, values[-2], np.sqrt(np.abs(values[-1])))
        return {**memory}, np.concatenate([chosen[:1], np.add.accumulate(chosen, axis=0)[1:]])


Random.__module__ = "flexarm.tests"


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.sampled_from(ufuncs), st.integers(0, 20), st.integers(0, 20)), max_size=12
    ),
    st.lists(numbers, min_size=4, max_size=4),
)
def test_operations_equal_those_of_numpy(operations, values):
    law = Random([8.0, 3.0], [0.8, 0.3])
    law.operations = operations
    readings = fa.Measurement(
        joint_angle=np.array(values[:2]), joint_rate=np.array(values[2:]), strain=np.zeros(0)
    )
    inputs = law.planned(0.0, MOTION)
    program = program_of(law, {}, readings, inputs)
    with np.errstate(all="ignore"):
        _, torque = law.step({}, readings, inputs)
    if program is None:  # NaN is not equal to itself
        assert not np.all(np.isfinite(np.ravel(torque))) or "divide" in {o[0] for o in operations}
        return
    x = program.numbers
    x[program.readings], x[program.inputs] = values, np.ravel(list(inputs.values()))
    law_step(program)
    np.testing.assert_array_equal(x[program.torque], torque)
