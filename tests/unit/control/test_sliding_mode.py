"""Sliding mode against its theory: time to the boundary layer, and motion within it."""

import numpy as np
import pytest
from rigid_loops import Swing, rigid_arm

import flexarm as fa


class Kept(fa.SlidingMode):
    def reset(self):
        super().reset()
        self.s = []

    def step(self, memory, readings, inputs):
        self.s.append(self._slid(memory, readings, inputs)[1].s)
        return super().step(memory, readings, inputs)


def test_one_joint_reaches_the_layer_at_the_time_of_a_constant_torque():
    """M s' = -reaching outside the layer, then s decays at the rate reaching / (layer M)."""
    arm = fa.Arm(links=[fa.Link(length=1.0, mass_per_length=0.6, flexible=False)])
    inertia = 0.6 / 3
    controller = Kept(arm, 4.0, 0.1, reaching=0.8, sample_time=1e-4)
    fa.simulate(arm, 0.4, controller=controller, reference=Still(), initial=arm.rest([0.25]))
    s, t = np.array(controller.s)[:, 0], 1e-4 * np.arange(4000)
    assert s[0] == pytest.approx(4.0 * 0.25)
    arrival = (s[0] - 0.1) * inertia / 0.8
    outside = t < arrival - 1e-3
    # The zero-order hold delays the model's torques by half a sample: first order in 0.1 ms.
    np.testing.assert_allclose(s[outside], s[0] - 0.8 / inertia * t[outside], rtol=0, atol=1e-3)
    late = t - arrival
    inside = (late > 0.0) & (late < 0.1)
    law = 0.1 * np.exp(-0.8 / 0.1 / inertia * late[inside])
    np.testing.assert_allclose(s[inside], law, rtol=0, atol=1e-3)


class Still:
    def joint_angle(self, t):
        return np.zeros(1)

    joint_rate = joint_acceleration = joint_angle


@pytest.mark.thorough
def test_two_joints_with_bounded_errors_reach_the_layer_in_time_and_stay():
    arm = rigid_arm(payload=0.3)
    plant = fa.varied(arm, payload_mass=0.6, friction=fa.Friction(coulomb=0.4))
    layer, reaching = 0.15, 4.0
    controller = Kept(
        arm,
        5.0,
        layer,
        {"payload.mass": 0.3, "joint_1.coulomb": 0.4, "joint_2.coulomb": 0.4},
        reaching=reaching,
        sample_time=2e-4,
    )
    swing = Swing()
    fa.simulate(
        arm,
        3.0,
        controller=controller,
        reference=swing,
        plant=plant,
        initial=plant.rest([0.2, 0.0]),
    )
    s, times = np.array(controller.s), 2e-4 * np.arange(15000)
    widest = max(np.linalg.eigvalsh(plant.mass_matrix([0.0, b]))[-1] for b in np.linspace(0, 3, 31))
    V = 0.5 * s[0] @ plant.mass_matrix([0.2, 0.0]) @ s[0]
    bound = np.sqrt(2.0 * V * widest) / reaching  # (C.48)
    arrived = times > bound
    assert bound < 2.0
    assert abs(s[0]).max() > 5 * layer
    assert abs(s[arrived]).max() <= layer


def test_without_a_switching_gain_the_same_errors_leave_the_layer():
    """The test above would be useless if any controller passed it."""
    arm = rigid_arm(payload=0.3)
    plant = fa.varied(arm, payload_mass=0.6, friction=fa.Friction(coulomb=0.4))
    controller = Kept(arm, 5.0, 0.15, reaching=4.0, sample_time=1e-3)
    fa.simulate(arm, 3.0, controller=controller, reference=Swing(), plant=plant)
    assert abs(np.array(controller.s)[2000:]).max() > 0.3


def test_wrong_arguments_are_reported_together():
    with pytest.raises(fa.InputError) as caught:
        fa.SlidingMode(rigid_arm(), 1.0, 0.0, {"payload.mass": -1.0}, reaching=0.0)
    text = str(caught.value)
    assert len(caught.value.problems) == 3
    for words in ("boundary_layer", "uncertainty.payload.mass", "reaching"):
        assert words in text
    with pytest.raises(fa.InputError, match=r"payload\.size"):
        fa.SlidingMode(rigid_arm(), 1.0, 0.1, {"payload.size": 1.0})
