"""The network controller against its theory: Lyapunov's function, learning, bounded weights."""

import numpy as np
import pytest
from rigid_loops import Swing, errors, rigid_arm

import flexarm as fa


def made(arm, **options):
    options = {"adaptation": 20.0, "e_modification": 0.0, "centres": 5, **options}
    return fa.RBFAdaptive(arm, 5.0, [8.0, 4.0], lower=-1.0, upper=1.0, **options)


def followed(controller, arm, duration, **options):
    swing = Swing()
    start = arm.rest(swing.joint_angle(0.0))
    rate = arm.rest(swing.joint_rate(0.0))
    return errors(
        fa.simulate(
            arm,
            duration,
            controller=controller,
            reference=swing,
            initial=start,
            initial_rate=rate,
            **options,
        ),
        swing,
    )[0]


@pytest.mark.thorough
def test_network_learns_an_arm_without_a_model():
    arm = rigid_arm(payload=0.4)
    # Torques constant for h let weights oscillate if adaptation approaches damping / (h
    # |signals|^2), about 40 here; well below, the integral of s^2 is bounded by V, so that errors
    # fall all the time.
    error = followed(made(arm, adaptation=5.0), arm, 20.0)
    still = followed(made(arm, adaptation=1e-9), arm, 20.0)
    quarters = np.sqrt(np.mean(error[:20000].reshape(4, 5000, -1) ** 2, axis=(1, 2)))
    assert np.all(np.diff(quarters) < 0.0)
    # Five Gaussians per joint leave less than a tenth of the whole torque.
    assert abs(error[-5000:]).max() < 0.1 * abs(still[-5000:]).max()


@pytest.mark.thorough
def test_representable_torques_are_cancelled_exactly():
    """A single Gaussian of infinite width is a constant, which fits a pendulum of constant inertia.

    Then V = 1/2 M s^2 + 1/2 |W - W*|^2 / adaptation falls by damping s^2, (C.50).
    """
    inertia, viscous = 0.6 / 3 + 0.1, 0.3
    arm = fa.Arm(
        links=[fa.Link(length=1.0, mass_per_length=0.6, flexible=False)],
        joints=[fa.Joint(hub_inertia=0.1, damping=viscous)],
    )
    sample_time = 2e-4

    class Kept(fa.RBFAdaptive):
        def reset(self):
            super().reset()
            self.s, self.w = [], []

        def step(self, memory, readings, inputs):
            self.w.append(memory["weights"][0, 0])
            self.s.append(float(self._slid(memory, readings, inputs)[1].s[0]))
            return super().step(memory, readings, inputs)

    class Wave:
        def joint_angle(self, t):
            return np.array([0.8 * np.sin(3.0 * t)])

        def joint_rate(self, t):
            return np.array([2.4 * np.cos(3.0 * t)])

        def joint_acceleration(self, t):
            return np.array([-7.2 * np.sin(3.0 * t)])

    controller = Kept(
        arm, 5.0, 1.0, 0.5, -1.0, 1.0, centres=1, e_modification=0.0, sample_time=sample_time
    )
    fa.simulate(arm, 2.0, controller=controller, reference=Wave(), initial=arm.rest([0.3]))
    s, w = np.array(controller.s), np.array(controller.w)
    best = np.zeros(w.shape[1])  # signals: 1, acceleration, rate, sign, product of rates
    best[1], best[2] = inertia, viscous
    V = 0.5 * inertia * s**2 + 0.5 * np.sum((w - best) ** 2, axis=1) / 0.5
    taken = np.concatenate([[0.0], np.cumsum((1.0 + viscous) * s**2)])[:-1] * sample_time
    # Torques constant for 0.2 ms: terms of first order in the sample time.
    np.testing.assert_allclose(V + taken, V[0], rtol=5e-3)
    assert V[-1] < 0.5 * V[0]


def test_prior_model_reduces_the_learned_torque():
    arm = rigid_arm(payload=0.4)
    plant = fa.varied(arm, payload_factor=1.5)
    without = followed(made(arm, adaptation=2.0), arm, 2.0, plant=plant)
    knowing = followed(made(arm, adaptation=2.0, prior=True), arm, 2.0, plant=plant)
    assert abs(knowing).max() < 0.5 * abs(without).max()


@pytest.mark.thorough
def test_modification_bounds_weights_under_noise():
    """Without it, noise of the readings would let weights drift without bound."""
    arm = rigid_arm()
    hardware = fa.Hardware(
        [fa.Instrument("joint_angle", noise=2e-3), fa.Instrument("joint_rate", noise=0.3)], seed=3
    )
    sizes = []
    for forget in (0.0, 0.2):
        controller = made(arm, adaptation=1.0, leakage=forget)
        followed(controller, arm, 10.0, hardware=hardware)
        sizes.append(np.linalg.norm(controller.weights))
    assert sizes[1] < 0.8 * sizes[0]
