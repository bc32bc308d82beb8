"""Derivatives of runs with controllers, against complex steps and differences of ``simulate``."""

import sys
from pathlib import Path

import numpy as np
import pytest

import flexarm as fa
from central_differences import differences
from controllers import Law, Plain
from flexarm.control.hardware.measurement import Measurement
from flexarm.kernels.layout import ArmConstants
from flexarm.linear.step_derivatives.parameters import constants_at
from flexarm.linear.step_derivatives.sampled_step import stepper_of
from flexarm.model.paths import number_at, number_paths, with_number
from random_arms import random_spec

sys.path.append(str(Path(__file__).parents[1] / "conformance"))
from controller_examples import EXAMPLES, LATE, LIMIT, SAMPLE_TIME, example, two_links

pytestmark = [
    pytest.mark.compiled,
    pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning"),
    pytest.mark.filterwarnings("ignore::flexarm.UnstableLoopWarning"),
]
STEP = 1e-30
#: Rounding of two ways to compute the same derivative, over a hundred steps.
SAME = 1e-10


def a_motion(arm):
    return fa.joint_motion(arm, [0.2, -0.4], [0.9, 0.5], 0.3)


def in_complex_steps(arm, controller, reference, path, duration, steps):
    """Return the derivative of the last state [q, qd], from the loop in complex numbers."""
    dof, joints = arm.dof, arm.joint_index
    x = np.concatenate([arm.rest(np.array(reference.joint_angle(0.0))), np.zeros(dof)])
    x, constants = x.astype(complex), arm.assembly.constants
    if path.startswith("initial"):
        x[int(path[:-1].partition("[")[2]) + dof * path.startswith("initial_rate")] += 1j * STEP
    else:
        constants = constants_at(arm, {path: number_at("", arm.spec, path) + 1j * STEP}, complex)[0]
    constants = ArmConstants(*(array.astype(complex) for array in constants))
    controller.reset()
    dt = controller.sample_time
    step = stepper_of(arm, "rk4", dt / steps)
    for k in range(round(duration / dt)):
        strain = arm.strains(arm.padded(x.reshape(1, 2, dof))) if arm.gauges else np.zeros((1, 0))
        read = {"joint_angle": x[joints], "joint_rate": x[dof:][joints], "strain": strain[0]}
        torque = controller.update(k * dt, Measurement(**read), reference)
        padded = np.zeros(arm.assembly.bodies, dtype=complex)
        padded[arm.assembly.joint_body] = torque
        for _ in range(steps):
            x = step(x, padded, constants)
    return x.imag / STEP


LINEAR = {
    "joint_pd": {},
    "joint_pid": {"arm": None, "sag": False},
    "joint_pid with limits": {"arm": None, "sag": False, "torque_limit": [0.4, 0.15]},
    "strain_feedback": {},
    "lqg": {"torque_limit": [1e3, 1e3]},
    "lqg with hardware": {"torque_limit": [1e3, 1e3], "hardware": LATE},
    "loop_shaping": {},
}


@pytest.mark.parametrize("name", LINEAR)
def test_linear_laws_against_complex_steps(name):
    arm = two_links()
    controller = example(name.split()[0], **LINEAR[name])
    paths = [
        *("links[0].flexural_rigidity", "links[1].mass_per_length", "joints[1].hub_inertia"),
        *("initial[0]", "initial[1]", "initial_rate[2]"),
    ]
    reference, duration, steps = a_motion(arm), 10 * SAMPLE_TIME, 8
    found = fa.sensitivities(
        arm, duration, paths, controller=controller, reference=reference, channels=["q", "qd"],
        integrator="rk4", step=SAMPLE_TIME / steps, rate=1.0 / SAMPLE_TIME,
    )  # fmt: skip
    for k, path in enumerate(paths):
        wanted = in_complex_steps(arm, controller, reference, path, duration, steps)
        both = np.concatenate([found[channel].values[k, -1] for channel in ("q", "qd")])
        for part in (slice(None, arm.dof), slice(arm.dof, None)):
            allowed = SAME * np.abs(wanted[part]).max()
            np.testing.assert_allclose(both[part], wanted[part], rtol=0, atol=allowed, err_msg=path)


def agrees(arm, duration, path, given, step=2e-3, **more):
    """Compare the derivatives of the tip with differences; return the largest one."""
    found = fa.sensitivities(arm, duration, [path], channels=["tip"], **given, **more)

    def tip(value):
        own, changed = arm, dict(given)
        if path.startswith("initial["):
            changed["initial"] = np.array(given["initial"])
            changed["initial"][int(path[8:-1])] = value
        else:
            own = fa.Arm(with_number(arm.spec, path, value))
        # The controller keeps its model: it is designed for the arm that does not change.
        return [fa.simulate(own, duration, **changed)["tip"].values]

    start = path.startswith("initial[")
    value = given["initial"][int(path[8:-1])] if start else number_at("", arm.spec, path)
    step *= max(abs(value), 0.1)
    ((wanted, error),) = differences(tip, value, step)
    allowed = 10.0 * error + 1e-8 * np.abs(wanted).max() + 1e-12 / step
    assert allowed < 1e-3 * np.abs(wanted).max()
    np.testing.assert_allclose(found["tip"].values[0], wanted, rtol=0, atol=allowed)


FIXED = {"integrator": "rk4", "step": SAMPLE_TIME / 8, "rate": 1.0 / SAMPLE_TIME}
#: Controllers without a step that can be linearised, with a text of the message.
REFUSED = dict.fromkeys(("estimator", "nonlinear_mpc", "rbf_adaptive", "repetitive"), "have a step")


@pytest.mark.sampled("joint_pd")
@pytest.mark.parametrize("name", EXAMPLES)
def test_every_controller_against_differences_or_with_a_reason(name):
    arm = two_links()
    given = {"controller": EXAMPLES[name](), "reference": a_motion(arm), **FIXED}
    if name in REFUSED:
        with pytest.raises(fa.InputError, match=REFUSED[name]):
            fa.sensitivities(arm, 0.06, ["links[1].mass_per_length"], **given)
        return
    agrees(arm, 0.06, "links[1].mass_per_length", given, step=1e-4)
    # A short step, because the torques of some controllers are at their limits nearby.
    agrees(arm, 0.06, "initial[0]", {**given, "initial": arm.rest([0.25, -0.4])}, step=1e-5)


@pytest.mark.thorough_cases("2")
@pytest.mark.parametrize("seed", [1, 2])
def test_random_arms(seed):
    arm = fa.Arm(random_spec(np.random.default_rng(seed), links=2, elements=2))
    size = np.diag(arm.rigid().mass_matrix(arm.rigid().rest([0.0, 0.0])))
    controller = fa.JointPD(30.0 * size, 5.0 * size, sample_time=SAMPLE_TIME)
    step = 0.5 / fa.modes(arm).frequency_hz[-1] / 2 / np.pi
    given = {"controller": controller, "reference": a_motion(arm), "integrator": "rk4"}
    given |= {"step": step, "rate": 500.0, "initial": arm.rest([0.25, -0.4])}
    moving = [path for path in number_paths(arm.spec) if path.startswith(("joints", "gravity"))]
    moving = [path for path in moving if number_at("", arm.spec, path) != 0.0]
    for path in ["initial[0]", *moving[::4]]:
        agrees(arm, 0.02, path, given)


HARDWARE = fa.Hardware(
    instruments=[
        fa.Instrument("joint_angle", noise=1e-4, rate_cutoff=30.0, delay=SAMPLE_TIME),
        fa.Instrument("strain", bias=1e-6, sample_time=2 * SAMPLE_TIME),
    ],
    motors=fa.Motors(
        torque_limit=[0.3, 10.0], delay=0.3 * SAMPLE_TIME, time_constant=0.6 * SAMPLE_TIME,
        torque_constant=0.5, resistance=2.0, voltage_limit=1.2,
    ),
    seed=3,
)  # fmt: skip


@pytest.mark.thorough
def test_instruments_and_motors():
    arm, controller = two_links(), example("strain_feedback")
    given = {"controller": controller, "reference": a_motion(arm), "hardware": HARDWARE, **FIXED}
    applied = fa.simulate(arm, 0.1, **given)["torque"].values
    assert np.any(np.abs(applied[:, 0]) > 0.25)  # close to the limit
    agrees(arm, 0.1, "links[0].flexural_rigidity", given)


def test_other_channels_as_readings():
    class TipSpring(fa.Controller):
        sample_time = SAMPLE_TIME

        def planned(self, t, reference):
            return {}

        def step(self, memory, readings, inputs):
            x, y = readings.tip
            return memory, [-3.0 * np.sin(y) * x, 2.0 * x * y - 0.1 * readings.joint_rate[1]]

    arm = two_links()
    read = [fa.Instrument("tip"), fa.Instrument("joint_rate")]
    given = {"hardware": fa.Hardware(instruments=read), **FIXED}
    given["controller"] = TipSpring()
    given["initial"] = arm.rest([0.2, 0.4])
    agrees(arm, 0.1, "links[0].mass_per_length", given)
    agrees(arm, 0.1, "initial[1]", given)


@pytest.mark.parametrize("integrator", ["dormand_prince_8", "kennedy_carpenter_5"])
def test_controlled_steps(integrator):
    arm, controller = two_links(), example("computed_torque")
    given = {"controller": controller, "reference": a_motion(arm), "integrator": integrator}
    path = "links[1].mass_per_length"
    found = fa.sensitivities(arm, 0.2, [path], channels=["tip"], **given)["tip"].values[0]
    exact = fa.sensitivities(
        arm, 0.2, [path], channels=["tip"], **given | {"integrator": "rk4", "step": 1e-4}
    )["tip"].values[0]
    # Both differ from the exact motion by their tolerance, 1e-7 of the reach per step.
    np.testing.assert_allclose(found, exact, atol=1e-3 * np.abs(exact).max())


def test_first_angles_without_a_reference():
    arm = two_links()
    given = {"controller": example("joint_pd"), "initial": arm.rest([0.3, 0.1]), **FIXED}
    given["initial_rate"] = arm.rest([1.0, -0.5])
    agrees(arm, 0.1, "initial[0]", given)


@pytest.mark.thorough
def test_a_start_that_a_controller_stores_without_declaring_it():
    arm = two_links()
    given = {"controller": example("lqg"), "initial": arm.rest([0.3, 0.1]), **FIXED}
    given["initial_rate"] = arm.rest([0.2, -0.1])
    agrees(arm, 0.05, "links[1].mass_per_length", given)
    with pytest.raises(fa.InputError, match="stores its first joint_angle"):
        fa.sensitivities(arm, 0.05, ["initial[0]"], **given)


class Own(fa.Controller):
    """A law of a user; subclasses say how it goes on."""

    sample_time = SAMPLE_TIME

    def initial_memory(self, readings, inputs):
        return {"sum": np.zeros(2)}

    def step(self, memory, readings, inputs):
        total = memory["sum"] + 0.1 * np.tanh(readings.joint_angle)
        damping = [0.8, 0.3] * np.tanh(readings.joint_rate)
        torque = -np.sin(readings.joint_angle) - damping - 0.1 * total * np.cos(total)
        return {"sum": total}, torque


class Undeclared(Own):
    hidden = np.zeros(2)

    def step(self, memory, readings, inputs):
        self.hidden = self.hidden + readings.joint_angle
        return memory, -0.1 * self.hidden


SWITCHING = Law(lambda readings, inputs: -0.1 * np.sign(readings.joint_rate), SAMPLE_TIME)


@pytest.mark.thorough
def test_a_controller_of_the_user():
    arm = two_links()
    given = {"controller": Own(), "initial": arm.rest([0.5, -0.7]), **FIXED}
    agrees(arm, 0.1, "links[1].mass_per_length", given)
    agrees(arm, 0.1, "initial[1]", given)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"controller": Undeclared()}, "more than its memory, readings"),
        ({"controller": SWITCHING, "initial": None}, "be differentiable"),
        (
            {"hardware": fa.Hardware(instruments=[fa.Instrument("joint_angle", resolution=1e-3)])},
            r"instruments\[0\].resolution is not supported",
        ),
        (
            {"hardware": fa.Hardware(instruments=[fa.Instrument("torque")])},
            "channel that follows from q and qd",
        ),
        ({"integrator": "rk4", "step": None}, "step is required for rk4"),
        ({"torque": np.zeros((2, 2))}, "cannot be combined with a controller"),
        ({"parameters": ["torque[0][0]"]}, "without controller"),
        ({"controller": fa.JointPD}, "be a controller"),
        ({"controller": None, "hardware": fa.Hardware()}, "requires a controller"),
    ],
)
def test_what_has_no_derivative_is_named(changes, text):
    arm = two_links()
    given = {"controller": Own(), "initial": arm.rest([0.5, -0.7]), **FIXED}
    given["parameters"] = ["links[1].mass_per_length"]
    with pytest.raises(fa.InputError, match=text):
        fa.sensitivities(arm, 0.02, **given | changes)


def test_a_controller_without_a_step():
    plain = Plain(lambda t, measurement, reference: -measurement.joint_angle, SAMPLE_TIME)
    with pytest.raises(fa.InputError, match="have a step"):
        fa.sensitivities(two_links(), 0.02, ["links[1].mass_per_length"], controller=plain)


def test_more_than_eight_parameters_equal_single_ones():
    arm = two_links()
    paths = [f"initial[{k}]" for k in range(arm.dof)]
    paths += [f"initial_rate[{k}]" for k in range(arm.dof)]
    given = {"controller": example("joint_pid", sag=False), "reference": a_motion(arm), **FIXED}
    given |= {"channels": ["tip"], "hardware": fa.Hardware(motors=fa.Motors(torque_limit=LIMIT))}
    together = fa.sensitivities(arm, 0.02, paths, **given)["tip"].values
    for k in (0, 7, 8, len(paths) - 1):
        alone = fa.sensitivities(arm, 0.02, [paths[k]], **given)["tip"].values[0]
        # Directions share matrix products, which are rounded differently for other numbers of them.
        np.testing.assert_allclose(together[k], alone, rtol=1e-12, atol=1e-14)
