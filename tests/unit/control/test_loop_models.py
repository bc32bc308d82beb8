"""Models of the two parts of a sampled loop, against closed forms, runs and python-control."""

import numpy as np
import pytest
from test_loop_margins import STEP, D, K, robust_arm, turntable

import flexarm as fa

POSTURE = [0.8, 0.9]


def test_models_of_a_turntable_have_closed_forms():
    """PD control of J theta'' = torque with a hold, by z-transforms."""
    arm, inertia = turntable()
    plant, controller = fa.loop_models(fa.JointPD(K, D, sample_time=STEP), arm)
    assert plant.inputs == controller.outputs == ("torque[1]",)
    assert plant.outputs == controller.inputs == ("joint_angle[1]", "joint_rate[1]")
    assert plant.sample_time == controller.sample_time == STEP
    omega = np.array([0.3, 30.0, 1000.0])
    z = np.exp(1j * omega * STEP)
    found = plant.frequency_response(omega)[:, :, 0]
    np.testing.assert_allclose(
        found[:, 0], STEP**2 / (2.0 * inertia) * (z + 1.0) / (z - 1.0) ** 2, rtol=1e-6
    )
    np.testing.assert_allclose(found[:, 1], STEP / inertia / (z - 1.0), rtol=1e-6)
    wanted = np.broadcast_to([-K, -D], (3, 2))
    np.testing.assert_allclose(controller.frequency_response(omega)[:, 0], wanted, rtol=1e-8)


@pytest.mark.parametrize(
    "make",
    [
        lambda arm: fa.LQG(arm, POSTURE, integral=True),
        lambda arm: fa.LoopShaping(arm, POSTURE),
        lambda arm: fa.StrainFeedback(20.0, 3.0, [[300.0, 0.0], [0.0, 100.0]]),
    ],
    ids=["lqg", "loop_shaping", "strain_feedback"],
)
def test_python_control_closes_the_loop(make):
    """The poles of python-control's feedback are those of the loop, with motors and sensors."""
    control = pytest.importorskip("control")
    arm = robust_arm()
    made = make(arm)
    hardware = fa.Hardware(
        [
            fa.Instrument("joint_angle", rate_cutoff=200.0, delay=1e-3),
            fa.Instrument("strain"),
        ],
        motors=fa.Motors(time_constant=2e-3),
    )
    plant, controller = fa.loop_models(made, arm, POSTURE, hardware=hardware)
    gauges = ("strain[1]", "strain[2]")
    rates = ("joint_rate[1]", "joint_rate[2]")
    assert plant.outputs == ("joint_angle[1]", "joint_angle[2]", *rates, *gauges)
    P, C = plant.to_control(), controller.to_control()
    assert P.dt == C.dt == made.sample_time
    assert P.output_labels == C.input_labels == list(plant.outputs)
    closed = control.feedback(P, C, sign=1)
    growth = np.log(np.abs(closed.poles()).max()) / made.sample_time
    wanted = fa.loop_margins(made, arm, POSTURE, hardware=hardware).growth
    assert growth == pytest.approx(float(wanted.max()), abs=1e-6)


def test_default_posture_is_that_of_the_design():
    made = fa.LQG(robust_arm(), POSTURE)
    given = fa.loop_models(made, None, POSTURE)
    for default, wanted in zip(fa.loop_models(made), given, strict=True):
        np.testing.assert_array_equal(default.A, wanted.A)


def test_wrong_arguments_are_rejected():
    arm, _ = turntable()
    controller = fa.JointPD(1.0, 1.0)
    with pytest.raises(fa.InputError, match="plant must be given"):
        fa.loop_models(controller)
    with pytest.raises(fa.InputError, match="posture must be one posture"):
        fa.loop_models(controller, arm, [[0.0], [1.0]])
    with pytest.raises(fa.InputError, match=r"posture must be numbers of shape \(any, 1\)"):
        fa.loop_models(controller, arm, [0.0, 1.0])
    slow = fa.Hardware([fa.Instrument("joint_angle", sample_time=4e-3, rate_cutoff=20.0)])
    with pytest.raises(fa.InputError, match="sample_time"):
        fa.loop_models(controller, arm, hardware=slow)


def test_recovery_makes_the_loop_that_of_the_state_feedback():
    """Loop-transfer recovery (Maciejowski 1985): the loop opened at the motors, over frequency."""
    arm, errors = robust_arm(), []
    omega = np.geomspace(0.1, 200.0, 200)
    z = np.exp(1e-3j * omega)[:, None, None]
    for recovery in (0.0, 10.0, 100.0, 1000.0):
        made = fa.LQG(arm, POSTURE, recovery=recovery)
        plant, controller = fa.loop_models(made)
        loop = -controller.frequency_response(omega) @ plant.frequency_response(omega)
        item = made.designs[0]
        shifted = z * np.eye(len(item.A)) - item.A
        wanted = item.gain @ np.linalg.solve(shifted, item.B + 0.0 * shifted[:, :, :2])
        sizes = [np.linalg.norm(part, 2, axis=(1, 2)) for part in (loop - wanted, wanted)]
        errors.append(float((sizes[0] / sizes[1]).max()))
    # The deviation decreases in inverse proportion to the assumed torque noise.
    assert errors[0] > 1.0
    assert errors[1] < 0.05
    assert errors[2] < 0.11 * errors[1]
    assert errors[3] < 0.11 * errors[2]
