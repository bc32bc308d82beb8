"""For large bending stiffness a flexible arm approaches its rigid model, with an error of 1/EI."""

import numpy as np
import pytest

import flexarm as fa
from arms import chain


def two_links(rigidity, theory="linear", gravity=(0.0, -9.81)):
    rod = {"flexural_rigidity": [rigidity, 0.7 * rigidity], "mass_per_length": [0.5, 0.4]}
    joints = [0.01, fa.Joint(mass=0.2, hub_inertia=0.01)]
    more = {"payload": fa.Payload(mass=0.3, inertia=0.001, offset=(0.02, 0.01)), "elements": 1}
    return chain((0.6, 0.5), joints, gravity=gravity, theory=theory, **rod, **more)


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_pendulum_frequencies_approach_the_rigid_ones(theory):
    """The two slow modes of the hanging arm are those of the rigid double pendulum."""
    rigidities = np.array([1e3, 4e3, 16e3, 64e3])
    hanging = [-np.pi / 2, 0.0]
    exact = fa.modes(two_links(1.0).rigid(), hanging, joints="free").squared_frequency
    errors = []
    for rigidity in rigidities:
        found = fa.modes(two_links(rigidity, theory), hanging, joints="free").squared_frequency
        errors.append(abs(found[:2] / exact - 1.0))
    orders = -np.polyfit(np.log(rigidities), np.log(errors), 1)[0]
    # The next term of the series is smaller by another 1/EI: a part in a hundred at the softest.
    np.testing.assert_allclose(orders, 1.0, atol=0.02)


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_smooth_motion_approaches_the_rigid_one(theory):
    """The torque is so smooth that it excites no vibration; the distance of the tips is
    proportional to 1/EI."""

    def torque(t):
        s = np.clip(t / 0.8, 0.0, 1.0)
        pulse = (s * (1.0 - s)) ** 5 * 4.0**5
        return [1.5 * pulse, -0.6 * pulse]

    def tip(arm):
        result = fa.simulate(
            arm, 1.0, torque=torque, initial=arm.rest([0.3, 0.5]), rate=50.0, rtol=1e-9, atol=1e-11
        )
        return result.tip.values

    level = (0.0, 0.0)
    exact = tip(two_links(1.0, theory, level).rigid())
    assert np.ptp(exact[:, 0]) > 0.1  # the tip moves
    rigidities = np.array([300.0, 1200.0, 4800.0])
    errors = [abs(tip(two_links(rigidity, theory, level)) - exact).max() for rigidity in rigidities]
    order = -np.polyfit(np.log(rigidities), np.log(errors), 1)[0]
    # The pulse leaves small vibrations.
    assert order == pytest.approx(1.0, abs=0.05)
    assert errors[-1] < 1e-3


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_rigid_model_has_the_same_mass_matrix(theory):
    arm = two_links(50.0, theory)
    rigid_counterpart = arm.rigid()
    angles, rates = np.array([0.7, -1.1]), np.array([1.3, -0.4])
    q, qd = arm.rest(angles), arm.rest(rates)
    assert rigid_counterpart.dof == rigid_counterpart.n_joints == 2
    # For a straight arm without bending, both are equal.
    np.testing.assert_allclose(
        arm.mass_matrix(q)[np.ix_(arm.joint_index, arm.joint_index)],
        rigid_counterpart.mass_matrix(angles),
        rtol=1e-12,
    )
    np.testing.assert_allclose(
        arm.bias_force(q, qd)[arm.joint_index],
        rigid_counterpart.bias_force(angles, rates),
        rtol=1e-12,
    )
    np.testing.assert_allclose(
        arm.energy(q, qd), rigid_counterpart.energy(angles, rates), rtol=1e-12
    )
    np.testing.assert_allclose(arm.tip(q), rigid_counterpart.tip(angles), rtol=1e-14)
