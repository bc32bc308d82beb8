"""Exported controllers against the controllers in Python, in runs of ``simulate``."""

from copy import deepcopy

import numpy as np
import pytest
from typer.testing import CliRunner

import flexarm as fa
from bridges.c_code_tools import Library, make
from conformance.controller_examples import (
    EXAMPLES,
    LATE,
    LIMIT,
    SAMPLE_TIME,
    example,
    joint_pd,
    two_links,
)
from flexarm.cli.main import app

PD = ([8.0, 3.0], [0.8, 0.3])


def heavy():
    """The arm with gravity, friction and a payload, so that every term of a law acts."""
    spec = two_links().spec
    joints = [
        fa.Joint(
            hub_inertia=0.05, damping=0.02, friction=fa.Friction(coulomb=0.02, smoothing_rate=0.01)
        ),
        fa.Joint(hub_inertia=0.03),
    ]
    payload = fa.Payload(mass=0.05)
    return fa.Arm(spec.replace(joints=joints, gravity=(0.0, -1.0), payload=payload))


def feedforward(t):
    return np.array([0.3 * np.sin(5.0 * t), 0.1 * t])


class OwnController(fa.Controller):
    """A controller of a user: velocity feedback with a filtered reference angle."""

    sample_time = SAMPLE_TIME

    def initial_memory(self, readings, inputs):
        return {"angle": inputs["reference_angle"]}

    def step(self, memory, readings, inputs):
        angle = 0.9 * memory["angle"] + 0.1 * inputs["reference_angle"]
        error = np.clip(angle - readings["joint_angle"], -0.05, 0.05)
        return {"angle": angle}, 8.0 * error - np.tanh(readings["joint_rate"])


class WithConditions(OwnController):
    """A controller of a user that switches, counts and remembers a truth value."""

    def initial_memory(self, readings, inputs):
        error = inputs["reference_angle"] - readings["joint_angle"]
        return {"angle": error, "fast": False, "samples": 0, "level": np.zeros(2)}

    def step(self, memory, readings, inputs):
        error = inputs["reference_angle"] - readings["joint_angle"]
        rate = readings["joint_rate"]
        after = {
            "angle": 0.9 * memory["angle"] + 0.1 * error,
            "fast": memory["fast"] or abs(rate[0]) > 0.1,
            "samples": memory["samples"] + 1,
            "level": memory["level"] + np.array([max(0.0, min(error[0], 0.1)), 0.0]),
        }
        if after["samples"] < 4 or rate[1] == 0.0:
            return after, np.zeros(2)
        if not after["fast"] and error[0] < 0.0:
            return after, np.array([-1.0, 2.0]) * np.sqrt(-error[0])
        turned = np.where(error > 0.0, 1.0, -0.5) * after["level"]
        return after, 8.0 * after["angle"] + turned - rate


#: Controllers whose law can be exported, by a name for the test; those without an entry have that
#: of the conformance tests.
LAWS = {
    "joint_pd": lambda: joint_pd(),
    "joint_pd_feedforward": lambda: fa.JointPD(*PD, SAMPLE_TIME, feedforward),
    "joint_pid": lambda: fa.JointPID(
        *PD, [2.0, 1.0], arm=heavy(), torque_limit=[0.9, 0.15], sample_time=SAMPLE_TIME
    ),
    "joint_pid_sag": lambda: fa.JointPID(
        *PD, [2.0, 1.0], arm=heavy(), sag=True, sample_time=SAMPLE_TIME
    ),
    "computed_torque": lambda: fa.ComputedTorque(heavy(), 0.3, 0.5, sample_time=SAMPLE_TIME),
    "computed_torque_feedforward": lambda: fa.ComputedTorque(
        heavy(), 0.3, 0.5, feedforward=feedforward, sample_time=SAMPLE_TIME
    ),
    "sliding_mode": lambda: fa.SlidingMode(
        heavy(),
        2.0,
        0.5,
        {"link_2.mass": 0.02, "joint_1.coulomb": 0.01},
        reaching=[0.1, 0.02],
        strain_gain=[5.0, 0.0],
        sample_time=SAMPLE_TIME,
    ),
    "adaptive": lambda: fa.Adaptive(
        heavy(),
        8.0,
        [0.8, 0.2],
        0.5,
        parameters=["payload.mass", "joint_1.coulomb"],
        leakage=0.1,
        dead_zone=0.3,
        bounds={"payload.mass": (0.049, 0.051)},
        strain_gain=[5.0, 0.0],
        sample_time=SAMPLE_TIME,
    ),
    "rbf_adaptive": lambda: fa.RBFAdaptive(
        heavy(),
        8.0,
        [0.8, 0.3],
        0.5,
        lower=-0.5,
        upper=1.0,
        centres=[2, 3],
        leakage=0.2,
        prior=True,
        strain_gain=[5.0, 0.0],
        sample_time=SAMPLE_TIME,
    ),
    "prescribed_performance": lambda: fa.PrescribedPerformance(
        8.0, [0.8, 0.3], 0.02, 1.0, 0.1, 20.0, sample_time=SAMPLE_TIME, feedforward=feedforward
    ),
    "disturbance_observer": lambda: fa.DisturbanceObserver(heavy(), joint_pd(), 0.2),
    "lqg": lambda: fa.LQG(heavy(), [0.4, 0.1], sample_time=SAMPLE_TIME),
    "lqg_hardware": lambda: fa.LQG(
        heavy(), [0.4, 0.1], hardware=LATE, integral=True, sample_time=SAMPLE_TIME
    ),
    "lqg_integral": lambda: fa.LQG(
        heavy(), [0.4, 0.1], integral=True, torque_limit=[30.0, 3.0], sample_time=SAMPLE_TIME
    ),
    "lqg_tip_integral": lambda: fa.LQG(
        heavy(),
        [0.4, 0.1],
        measured={"joint_angle": 1e-4, "strain": 2e-5, "tip": 1e-3},
        integral="tip",
        torque_limit=[35.0, 1.5],
        sample_time=SAMPLE_TIME,
    ),
    "lqg_scheduled": lambda: fa.LQG(
        heavy(), schedule=[None, [-1.0, -0.1, 0.5, 1.6]], sample_time=SAMPLE_TIME
    ),
    "composite": lambda: fa.Composite(
        heavy(), [0.4, 0.1], torque_limit=LIMIT, sample_time=SAMPLE_TIME
    ),
    "loop_shaping": lambda: fa.LoopShaping(
        heavy(), [0.4, 0.1], integral=0.8, feedforward=feedforward, sample_time=SAMPLE_TIME
    ),
    "loop_shaping_scheduled": lambda: fa.LoopShaping(
        heavy(), schedule=[[0.1, 0.4], [-0.15, -0.05, 0.3]], sample_time=SAMPLE_TIME
    ),
    "mu_synthesis": lambda: example(
        "mu_synthesis",
        arm=heavy(),
        bandwidth=8.0,
        rigidity_uncertainty=0.02,
        sensitivity=10.0,
        feedforward=lambda: feedforward,
    ),
    "hybrid_force": lambda: fa.HybridForce(
        heavy(), frequency=1.5, force_proportional=0.2, sample_time=SAMPLE_TIME
    ),
    "impedance": lambda: fa.Impedance(
        heavy(), posture_frequency=1.5, force_integral=2.0, sample_time=SAMPLE_TIME
    ),
    "admittance": lambda: fa.Admittance(
        heavy(), frequency=1.5, stiffness=3.0, sample_time=SAMPLE_TIME
    ),
    "adaptive_force": lambda: fa.AdaptiveForce(
        heavy(), frequency=1.5, friction_adaptation=0.5, sample_time=SAMPLE_TIME
    ),
    "neural_force": lambda: fa.NeuralForce(
        heavy(), frequency=1.5, features=6, sample_time=SAMPLE_TIME
    ),
    "positive_position_feedback": lambda: fa.PositivePositionFeedback(
        heavy(), joint_pd(), damping_ratio=0.2
    ),
    "integral_resonant_control": lambda: fa.IntegralResonantControl(
        heavy(), fa.JointPD(*PD, SAMPLE_TIME, feedforward)
    ),
    "wave_based_control": lambda: fa.WaveBasedControl(heavy(), joint_pd(), posture=[0.4, 0.1]),
    "output_redefinition": lambda: fa.OutputRedefinition(heavy(), joint_pd(), weight=-0.5),
    "own": OwnController,
    "own_with_conditions": WithConditions,
}
#: Controllers of the registry that are refused.
REFUSED = ("estimator", "mpc", "nonlinear_mpc", "repetitive")
LAWS |= {name: EXAMPLES[name] for name in EXAMPLES if name not in {*LAWS, *REFUSED}}
#: Those that damp vibration around a joint controller.
DAMPING = [
    "integral_resonant_control",
    "output_redefinition",
    "positive_position_feedback",
    "wave_based_control",
]


@pytest.mark.thorough
@pytest.mark.parametrize("name", sorted(LAWS))
def test_recorded_run(name, tmp_path):
    arm = heavy()
    fa.export_c(arm, tmp_path, controller=LAWS[name]())
    for cc in ("gcc", "clang"):
        make(tmp_path, "clean")
        done = make(tmp_path, "test", cc)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "controller " in done.stdout


class InC(fa.Controller):
    """An exported joint controller that ``simulate`` calls."""

    def __init__(self, folder, readings, references):
        self.library = Library(folder)
        self.sample_time = self.library.macros["sample_time"]
        self.readings, self.references = readings, references
        self.memory_now = np.zeros(int(self.library.macros["memory"]))
        self.added = []

    def reset(self):
        self.started = False

    def update(self, t, measurement, reference):
        given = [np.array(measurement[name]) for name in self.readings]
        given += [np.array(getattr(reference, name)(t)) for name in self.references]
        given += self.added
        torque = np.zeros(2)
        memory = [self.memory_now] if self.memory_now.size else []
        start = memory and not self.started
        self.started = True
        name = "controller_start" if start else "controller_update"
        self.library(name, *given, *memory, torque)
        return torque


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "readings", "references"),
    [
        (
            "computed_torque",
            ["joint_angle", "joint_rate"],
            ["joint_angle", "joint_rate", "joint_acceleration"],
        ),
        ("joint_pid", ["joint_angle", "joint_rate"], ["joint_angle", "joint_rate"]),
        ("loop_shaping_scheduled", ["joint_angle", "joint_rate"], ["joint_angle", "joint_rate"]),
        ("joint_pid_sag", ["joint_angle", "joint_rate"], ["joint_angle", "joint_rate"]),
        ("strain_feedback", ["joint_angle", "joint_rate", "strain"], ["joint_angle", "joint_rate"]),
        (
            "output_redefinition",
            ["joint_angle", "joint_rate", "strain"],
            ["joint_angle", "joint_rate", "joint_acceleration"],
        ),
    ],
)
def test_closed_loop(name, readings, references, tmp_path):
    """The same run, to rounding, whether the loop is closed by Python or by C."""
    arm, controller = heavy(), LAWS[name]()
    fa.export_c(arm, tmp_path, controller=controller)
    motion = fa.joint_motion(arm, [0.0, 0.0], [0.3, -0.2], 0.5)
    in_c = InC(tmp_path, readings, references)
    in_c.added = [None] if name in DAMPING else []  # no correction of strains
    runs = [fa.simulate(arm, 0.6, controller=one, reference=motion) for one in (controller, in_c)]
    # Stable loops do not amplify rounding errors, which add up over 150 samples.
    for channel in ("torque", "joint_angle", "link_tip_deflection"):
        found, wanted = (run[channel].values for run in runs)
        limit = 1e-11 * np.abs(wanted).max()
        np.testing.assert_allclose(found, wanted, rtol=0, atol=limit, err_msg=channel)


def test_both_sides_of_all_conditions(tmp_path):
    """Random readings, so that each of the conditions of `WithConditions` has both values."""
    controller, random = WithConditions(), np.random.default_rng(5)
    fa.export_c(heavy(), tmp_path, controller=controller)
    references = ["joint_angle"]
    in_c = InC(tmp_path, ["joint_angle", "joint_rate"], references)
    still, kinds = fa.joint_motion(heavy(), [0.0, 0.0], [0.0, 0.0], 1.0), set()
    for run in range(20):
        controller.reset()
        in_c.reset()
        for k in range(12):
            rate = random.normal(size=2) * [0.06, 1.0]
            rate[1] *= random.integers(2)
            angle = random.normal(size=2)
            measured = fa.Measurement(joint_angle=angle, joint_rate=rate)
            wanted = controller.update(0.01 * k, measured, still)
            found = in_c.update(0.01 * k, measured, still)
            np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-14, err_msg=f"{run} {k}")
            kinds.add((controller.memory["fast"], k < 3, rate[1] == 0.0, *(angle > 0.0)))
    assert all(len(set(values)) == 2 for values in zip(*kinds, strict=True))


def test_the_controller_is_not_modified(tmp_path):
    controller = LAWS["joint_pid"]()
    before = deepcopy(vars(controller)["proportional"])
    fa.export_c(heavy(), tmp_path, controller=controller)
    assert controller.proportional.dtype == np.float64
    assert np.array_equal(controller.proportional, before)


def test_a_memory_of_too_many_numbers(tmp_path):
    network = example("rbf_adaptive", centres=40)
    with pytest.raises(fa.InputError, match=r"memory of 32000 numbers, more than 500\."):
        fa.export_c(heavy(), tmp_path, controller=network)


@pytest.mark.thorough
def test_controllers_around_each_other(tmp_path):
    scheduled = LAWS["loop_shaping_scheduled"]()
    for controller in (
        fa.PositivePositionFeedback(heavy(), scheduled, damping_ratio=0.2),
        fa.DisturbanceObserver(heavy(), LAWS["joint_pid_sag"](), 0.2),
        fa.DisturbanceObserver(heavy(), LAWS["lqg"](), 0.2),
        fa.DisturbanceObserver(heavy(), LAWS["hybrid_force"](), 0.2),
    ):
        fa.export_c(heavy(), tmp_path, controller=controller)
        done = make(tmp_path, "test")
        assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.thorough
def test_scenario_with_a_controller(tmp_path):
    folder = tmp_path / "my-arm"
    assert CliRunner().invoke(app, ["init", str(folder)]).exit_code == 0
    out = tmp_path / "c"
    words = ["export", "c", str(folder / "scenario.yaml"), "--out", str(out), "--name", "swing"]
    found = CliRunner().invoke(app, words)
    assert found.exit_code == 0, found.output
    assert "swing_controller_update" in (out / "swing.h").read_text()
    done = make(out, "test")
    assert done.returncode == 0, done.stdout + done.stderr
