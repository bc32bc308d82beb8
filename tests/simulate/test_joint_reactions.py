"""Forces and moments at joints, and their relation to the rate of momentum."""

import numpy as np
import pytest

import flexarm as fa
from arms import table_one_arm

ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
JOINTS = [
    fa.Joint(damping=0.4, stiffness=3.0, rest_angle=0.1, mass=0.5, hub_inertia=0.02),
    fa.Joint(mass=1.0, housing_inertia=0.01, friction=fa.Friction(coulomb=0.3, smoothing_rate=0.1)),
]


def two_links(theory="linear", **fields):
    more = {"segments": [2, 1], "gravity": (0.0, -9.81), "theory": theory}
    return table_one_arm(joints=JOINTS, **more, **fields)


def torque(t):
    return [8.0 + np.sin(5 * t), 3.0 * np.cos(4 * t)]


def test_moment_is_the_torque_and_the_passive_torque():
    result = fa.simulate(two_links("second_order"), 0.5, torque=torque, rate=200)
    angle, rate = result.joint_angle.values, result.joint_rate.values
    moment = result.joint_moment.values - result.torque.values
    exact = -0.4 * rate[:, 0] - 3.0 * (angle[:, 0] - 0.1)
    np.testing.assert_allclose(moment[:, 0], exact, rtol=0, atol=1e-9)
    np.testing.assert_allclose(moment[:, 1], -0.3 * np.tanh(rate[:, 1] / 0.1), rtol=0, atol=1e-9)
    given = np.array([torque(t) for t in result.time.values])
    np.testing.assert_allclose(result.torque.values, given, atol=1e-8)


def test_arm_at_rest_is_supported_against_its_weight():
    arm = two_links(payload=fa.Payload(mass=0.7, offset=0.1))
    at_rest = fa.equilibrium(arm, [1.2, -0.5])
    result = fa.simulate(arm, 0.01, initial=at_rest.q, torque=lambda t: at_rest.torque, rate=1000)
    second = 0.61732 * 1.0 + 0.7
    first = second + 0.61732 * 1.4142 + 1.0  # the elbow's motor too, the base's own not
    weights = 9.81 * np.array([first, second])
    np.testing.assert_allclose(result.joint_force.values[-1, :, 1], weights, rtol=1e-6)
    np.testing.assert_allclose(result.joint_force.values[-1, :, 0], 0.0, atol=1e-5)


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_forces_equal_the_rate_of_momentum(theory):
    """Reaction, weight and loads accelerate the mass centre of the part beyond a joint."""
    arm = two_links(theory, payload=fa.Payload(mass=0.7, inertia=0.01))
    push = fa.Load(2, (1.0, -2.0), station=0.5, factor=lambda t: float(np.cos(7 * t)))
    result = fa.simulate(arm, 0.2, torque=torque, loads=[push], rate=20000, rtol=1e-10, atol=1e-12)
    t = result.time.values
    some = np.arange(1, len(t) - 1, 20)
    # First moment of mass, exact for a uniform link: gravity energy with gravity along each axis.
    bare = arm.spec.replace(joints=[joint.replace(stiffness=0.0) for joint in JOINTS])
    unit = [fa.Arm(bare.replace(gravity=g)) for g in ((-1.0, 0.0), (0.0, -1.0))]

    def moments(k):
        rest = np.zeros(arm.dof)
        return [of.energy(result.q.values[k], rest).gravity for of in unit]

    total = np.array([[moments(k + d) for d in (-1, 0, 1)] for k in some])
    acceleration = (total[:, 0] - 2 * total[:, 1] + total[:, 2]) * 20000.0**2
    mass = 0.61732 * 2.4142 + 1.0 + 0.7
    load = np.cos(7 * t[some])[:, None] * [1.0, -2.0]
    force = acceleration - mass * np.array([0.0, -9.81]) - load
    found = result.joint_force.sel(link=1).values[some]
    # Second differences at 20 kHz of positions accurate to 1e-12: rounding 4e-4, truncation of
    # modes of 300 Hz a part in 1e3 of their share.
    np.testing.assert_allclose(found, force, rtol=0, atol=3e-3 * abs(found).max())


def test_reactions_under_loads_that_change():
    """Each sample has the loads of its time."""
    arm = two_links()
    factor = lambda t: 1.0 + np.sin(9 * t)  # noqa: E731
    load = fa.Load(1, (0.5, 2.0), 0.3, station=0.7, factor=factor)
    shaken = lambda t: (np.sin(3 * t), 1.0)  # noqa: E731
    result = fa.simulate(arm, 0.3, torque=torque, loads=[load], base_acceleration=shaken, rate=100)
    for k in (0, 7, 30):
        t = result.time.values[k]
        now = [fa.Load(1, factor(t) * np.array([0.5, 2.0]), 0.3 * factor(t), station=0.7)]
        q, qd = result.q.values[k], result.qd.values[k]
        qdd = arm.forward_dynamics(q, qd, torque(t), loads=now, base_acceleration=shaken(t))
        exact = arm.joint_reactions(q, qd, qdd, loads=now, base_acceleration=shaken(t))
        # Factors are interpolated to 1e-9; stiff modes respond with forces of 1e3.
        np.testing.assert_allclose(result.joint_force.values[k], exact[:, :2], rtol=0, atol=1e-6)
        np.testing.assert_allclose(result.joint_moment.values[k], exact[:, 2], rtol=0, atol=1e-6)


def test_constant_joint_has_the_static_reaction():
    hold = fa.PrescribedAngle(lambda t: 0.3, lambda t: 0.0, lambda t: 0.0)
    arm = two_links()
    held = fa.equilibrium(arm, [0.3, 0.3], tip_force=(1.0, 2.0, 0.3))
    result = fa.simulate(
        arm,
        0.05,
        prescribed={1: hold, 2: hold},
        initial=held.q,
        tip_force=(1.0, 2.0, 0.3),
        rate=100,
    )
    np.testing.assert_allclose(result.torque.values[-1], held.torque, rtol=1e-6)
