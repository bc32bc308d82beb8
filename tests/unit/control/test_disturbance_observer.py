"""The momentum observer against the first-order filter of its theory."""

import numpy as np
import pytest
from rigid_loops import Swing, rigid_arm

import flexarm as fa
from closed_mechanisms import five_bar
from flexarm.control.design.rigid_model import RigidParameters


def test_momentum_and_its_flow_equal_derivatives_of_energy():
    arm = rigid_arm(payload=0.5, joints=[fa.Joint(damping=0.3), fa.Joint(stiffness=2.0)])
    angle, rate = np.array([0.4, -0.9]), np.array([1.3, -2.1])
    momentum, flow = RigidParameters(arm).momentum(angle, rate)
    np.testing.assert_allclose(momentum, arm.mass_matrix(angle) @ rate, rtol=1e-13)
    step = 1e-5  # central differences of the kinetic energy: error 1e-10
    by_angle = [
        (arm.energy(angle + step * e, rate).kinetic - arm.energy(angle - step * e, rate).kinetic)
        / (2 * step)
        for e in np.eye(2)
    ]
    holding = arm.bias_force(angle, np.zeros(2)) + np.array([0.3 * rate[0], 0.0])
    np.testing.assert_allclose(flow, np.array(by_angle) - holding, atol=1e-8)


class Kept(fa.DisturbanceObserver):
    def reset(self):
        super().reset()
        self.kept = []

    def update(self, t, measurement, reference):
        torque = super().update(t, measurement, reference)
        self.kept.append(self.estimate)
        return torque


def test_estimate_follows_a_constant_torque_as_a_first_order_filter():
    """The arm swings, and the model's torques are not part of the disturbance."""
    arm, pushed = rigid_arm(payload=0.4), np.array([-1.5, 0.8])
    sample_time, hertz = 1e-3, np.array([2.0, 4.0])
    inner = fa.JointPD([80.0, 30.0], [20.0, 6.0], sample_time=sample_time)
    observer = Kept(arm, inner, hertz, compensation=0.0)
    # A moment on each link; that on the second also acts on the first joint's coordinate.
    loads = [fa.Load(1, moment=pushed[0] - pushed[1]), fa.Load(2, moment=pushed[1])]
    fa.simulate(arm, 1.5, controller=observer, reference=Swing(), loads=loads)
    found = np.array(observer.kept)
    t = sample_time * np.arange(len(found))[:, None]
    law = pushed * (1.0 - np.exp(-2 * np.pi * hertz * t))
    # The flow of momentum is taken as linear over a sample: second order in 1 ms.
    np.testing.assert_allclose(found, law, rtol=0, atol=2e-3)


@pytest.mark.thorough
def test_compensation_removes_a_disturbance():
    arm = rigid_arm(payload=0.3)
    plant = fa.varied(arm, payload_factor=3.0, friction=fa.Friction(coulomb=0.5, viscous=0.2))
    motion = fa.joint_motion(arm, [0.0, 0.0], [0.8, -0.6], 1.5)
    ends = []
    for part in (0.0, 1.0):
        inner = fa.JointPD([80.0, 30.0], [20.0, 6.0], feedforward=fa.rigid_torque(arm, motion))
        controller = fa.DisturbanceObserver(arm, inner, 3.0, compensation=part)
        run = fa.simulate(arm, 4.0, controller=controller, reference=motion, plant=plant)
        ends.append(abs(run.joint_angle.values[-1] - [0.8, -0.6]).max())
    assert ends[0] > 0.02
    assert ends[1] < 0.02 * ends[0]


@pytest.mark.filterwarnings("ignore::flexarm.LimitWarning")  # intended
def test_measured_torque_is_used_instead_of_the_command():
    """Motors with less than the requested torque do not cause a disturbance estimate."""
    arm = rigid_arm(gravity=(0.0, 0.0))
    motion = fa.joint_motion(arm, [0.0, 0.0], [1.5, -1.0], 0.5)
    largest = []
    for extra in ([], [fa.Instrument("torque")]):
        instruments = [fa.Instrument("joint_angle"), fa.Instrument("joint_rate"), *extra]
        hardware = fa.Hardware(instruments, fa.Motors(torque_limit=[1.0, 0.5]))
        inner = fa.JointPD([80.0, 30.0], [20.0, 6.0])
        observer = Kept(arm, inner, 5.0, compensation=0.0)
        fa.simulate(arm, 0.5, controller=observer, reference=motion, hardware=hardware)
        largest.append(abs(np.array(observer.kept)).max())
    assert largest[0] > 5.0
    assert largest[1] < 1e-2


def test_closure_forces_are_not_part_of_the_estimate_in_a_closed_mechanism():
    """Moments on the links of the motors of a five-bar; the closure forces are ten times larger."""
    closed = five_bar(gravity=(0.0, -9.81))
    arm, pushed, driven = fa.Arm(**closed.fields).rigid(), np.array([-1.5, 0.0, 0.8, 0.0]), [1, 3]
    end = closed.joints + np.array([0.4, 0.0, 0.3, 0.0])
    motion = fa.joint_motion(arm, closed.joints, end, 0.6, driven=driven)
    torque = fa.rigid_torque(arm, motion)
    inner = fa.JointPD([80.0, 0.0, 80.0, 0.0], [8.0, 0.0, 8.0, 0.0], feedforward=torque)
    hertz = np.array([2.0, 1.0, 4.0, 1.0])
    observer = Kept(arm, inner, hertz, compensation=0.0, actuated=driven)
    loads = [fa.Load(1, moment=pushed[0]), fa.Load(3, moment=pushed[2])]
    start = arm.rest(motion.joint_angle(0.0))
    fa.simulate(arm, 0.6, controller=observer, reference=motion, loads=loads, initial=start)
    found = np.array(observer.kept)
    law = pushed * (1.0 - np.exp(-2 * np.pi * hertz * 1e-3 * np.arange(len(found))[:, None]))
    np.testing.assert_allclose(found, law, rtol=0, atol=1e-5)
    assert not np.any(found[:, [1, 3]])
