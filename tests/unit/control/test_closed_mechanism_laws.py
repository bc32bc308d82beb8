"""Controllers of closed mechanisms: computed torque and feedforward of the actuated joints."""

from __future__ import annotations

import numpy as np
import pytest

import flexarm as fa
from closed_mechanisms import Closed, five_bar, four_bar
from flexarm.control.hardware.measurement import Measurement

FREQUENCY = 2.0


def rigid(closed: Closed) -> fa.Arm:
    return fa.Arm(**closed.fields).rigid()


def off_the_motion(arm: fa.Arm, motion: fa.Motion, driven: list[int], by: float) -> np.ndarray:
    """Return a closed posture near the start of a motion, with driven joints turned by ``by``."""
    q = motion.joint_angle(0.0)
    q[np.array(driven) - 1] += by
    return fa.assembled(arm, q, held=driven).q


@pytest.mark.parametrize(
    ("closed", "driven"), [(four_bar(), [1]), (five_bar(), [1, 3])], ids=["four-bar", "five-bar"]
)
def test_errors_of_actuated_joints_decay_as_in_closed_form(closed, driven):
    arm = rigid(closed)
    motion = fa.joint_motion(arm, closed.joints, closed.joints + 0.4, 1.0, driven=driven)
    law = fa.ComputedTorque(arm, FREQUENCY, actuated=driven)
    by = 0.05
    start = off_the_motion(arm, motion, driven, by)
    run = fa.simulate(arm, 0.3, controller=law, reference=motion, initial=start)
    t, omega = run.time.values, 2.0 * np.pi * FREQUENCY
    expected = by * (1.0 + omega * t) * np.exp(-omega * t)  # critically damped
    places = np.array(driven) - 1
    errors = (run.joint_angle.values - motion.joint_angle(t))[:, places]
    # The zero-order hold delays by half a sample, 0.6 % of 1 / omega.
    np.testing.assert_allclose(errors, np.tile(expected[:, None], len(driven)), atol=0.02 * by)
    passive = np.setdiff1d(np.arange(arm.n_joints), places)
    assert not np.any(run.torque.values[:, passive])


def test_with_a_feedforward_the_mass_matrix_is_that_of_the_independent_motions():
    closed = four_bar()
    arm = rigid(closed)
    motion = fa.joint_motion(arm, closed.joints, closed.joints + 0.4, 1.0, driven=[1])
    torque = fa.rigid_torque(arm, motion)
    law = fa.ComputedTorque(arm, FREQUENCY, actuated=[1], feedforward=torque)
    turned = off_the_motion(arm, motion, [1], 0.01)
    found = law.update(0.0, Measurement(joint_angle=turned, joint_rate=np.zeros(3)), motion)
    slope = fa.assembled(arm, turned, [1.0, 0.0, 0.0], held=[1]).qd
    inertia = slope @ arm.mass_matrix(turned) @ slope
    wanted = -((2.0 * np.pi * FREQUENCY) ** 2) * 0.01 * inertia
    np.testing.assert_allclose(found - torque(0.0005), [wanted, 0.0, 0.0], rtol=1e-9, atol=1e-12)


def test_rows_of_many_runs_are_those_of_each():
    closed = five_bar(gravity=(0.0, -9.81))
    arm = rigid(closed)
    law = fa.ComputedTorque(arm, FREQUENCY)  # all joints: torques of least norm
    angles = np.array([closed.joints, off_the_motion(arm, Still(closed.joints), [1, 3], 0.1)])
    readings = Measurement(joint_angle=angles, joint_rate=np.full((2, 4), 0.1))
    inputs = law.planned(0.0, Still(angles))
    _, torques = law.step({}, readings, inputs)
    for k in range(2):
        reading = Measurement(joint_angle=angles[k], joint_rate=np.full(4, 0.1))
        _, torque = law.step({}, reading, law.planned(0.0, Still(angles[k])))
        np.testing.assert_array_equal(torques[k], torque)


class Still:
    """Reference at rest."""

    def __init__(self, angle: np.ndarray) -> None:
        self._angle = angle

    def joint_angle(self, t: float) -> np.ndarray:
        return self._angle.copy()

    def joint_rate(self, t: float) -> np.ndarray:
        return 0.0 * self._angle

    joint_acceleration = joint_rate


@pytest.mark.thorough
def test_a_flexible_four_bar_follows_with_feedforward():
    closed = four_bar()
    joints = [fa.Joint(hub_inertia=0.005), *closed.fields["joints"][1:]]  # with a motor
    arm = fa.Arm(**{**closed.fields, "joints": joints})
    motion = fa.joint_motion(arm, closed.joints, closed.joints + 1.0, 1.0, driven=[1])
    gains = {"proportional": [10.0, 0.0, 0.0], "derivative": [0.1, 0.0, 0.0]}
    start, errors = arm.rest(closed.joints), []
    for feedforward in (None, fa.rigid_torque(arm, motion)):
        law = fa.JointPD(**gains, feedforward=feedforward, sample_time=2e-4)
        run = fa.simulate(arm, 1.0, controller=law, reference=motion, initial=start)
        errors.append(np.max(np.abs(run.joint_angle - motion.joint_angle(run.time.values))[:, 0]))
    assert errors[1] < 0.1 * errors[0]
