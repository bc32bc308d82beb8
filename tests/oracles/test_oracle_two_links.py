"""Two links in closed form: rigid, and flexible in the linear theory; a published trajectory."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexarm.model import ArmSpec, Joint, Link, Payload
from random_arms import random_state

from .lagrangian import LagrangianOracle
from .rigid_double_pendulum import RigidDoublePendulum
from .two_link_closed_form import two_link_closed_form

# Tip (m), absolute root angles (rad) and tip deflections (m) at 50 ms.
TABLE_I_50_MS = (
    [1.707913852946, 0.2930940724169],
    [0.7920706148291, -0.7834126423587],
    [-0.009864394056640, -0.001293587141421],
)


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_rigid_double_pendulum_equals_its_closed_form(theory):
    spec = ArmSpec(
        links=[
            Link(length=1.4142, mass_per_length=0.61732, flexible=False),
            Link(length=1.0, mass_per_length=0.8, flexible=False),
        ],
        joints=[
            Joint(hub_inertia=0.11),
            Joint(hub_inertia=0.05, mass=0.7, housing_inertia=0.02),
        ],
        payload=Payload(mass=0.4, inertia=0.03),
        gravity=(1.5, -9.81),
        theory=theory,
    )
    exact = RigidDoublePendulum(
        length=(1.4142, 1.0),
        mass=(1.4142 * 0.61732, 0.8),
        hub_inertia=(0.11, 0.05),
        elbow_mass=0.7,
        elbow_inertia=0.02,
        payload_mass=0.4,
        payload_inertia=0.03,
        gravity=(1.5, -9.81),
    )
    oracle = LagrangianOracle(spec)
    rng = np.random.default_rng(1)
    for _ in range(5):
        angles, rates, torque = rng.normal(size=(3, 2)) * [[2], [3], [5]]
        # Rounding; the forces of this arm are sums of terms of 1 to 40 N m.
        np.testing.assert_allclose(oracle.mass_matrix(angles), exact.mass_matrix(angles), 1e-13)
        np.testing.assert_allclose(
            oracle.bias_force(angles, rates), exact.bias_force(angles, rates), atol=1e-13 * 100
        )
        found = oracle.acceleration(angles, rates, torque)
        np.testing.assert_allclose(found, exact.acceleration(angles, rates, torque), rtol=1e-11)


def test_constants_of_the_papers_arm():
    arm = RigidDoublePendulum(length=(1.4142, 1.0), mass=(1.4142 * 0.61732, 0.61732))
    expected = [1.8166144527, 0.2057733333, 0.4365069720]  # printed to ten decimals
    np.testing.assert_allclose(arm._constants(), expected, atol=6e-11)


@pytest.mark.parametrize("elements", [(2, 1), (1, 3), (4, 4)])
def test_flexible_two_link_arm_equals_its_closed_form(elements):
    properties = {"lengths": (1.4142, 1.0), "rigidity": (105.0, 60.0), "density": (0.61732, 0.4)}
    links = [
        Link(length=length, flexural_rigidity=ei, mass_per_length=mu, elements=n)
        for length, ei, mu, n in zip(*properties.values(), elements, strict=True)
    ]
    spec = ArmSpec(links=links)
    oracle = LagrangianOracle(spec)
    state = random_state(np.random.default_rng(2), spec)
    q = oracle.coordinates(state.angles, state.nodal)
    qd = oracle.coordinates(state.angle_rates, state.nodal_rates)
    mass, bias = two_link_closed_form(*properties.values(), elements, q, qd)
    np.testing.assert_allclose(oracle.mass_matrix(q), mass, rtol=0, atol=1e-14 * mass.max())
    # Stiffness entries of 12 EI/h^3 cancel in the force of a smooth shape, which loses two digits.
    np.testing.assert_allclose(oracle.bias_force(q, qd), bias, rtol=0, atol=1e-13 * abs(bias).max())


@pytest.mark.thorough
def test_first_50_ms_of_the_papers_arm():
    """Table I arm, 2 + 1 elements, linear theory, 50 ms after rest at 45 and -45 degrees.

    tau_1 = 4 sin(2 pi t), tau_2 = 1.5 sin(2 pi t) N m. The numbers come from an independent
    solution certain to 1e-11 m.
    """
    tip, angles, deflections = TABLE_I_50_MS
    links = [
        Link(length=length, flexural_rigidity=105.0, mass_per_length=0.61732, elements=n)
        for length, n in [(1.4142, 2), (1.0, 1)]
    ]
    oracle = LagrangianOracle(ArmSpec(links=links), precision=np.float64)
    n = oracle.dof
    start = oracle.coordinates([np.pi / 4, -np.pi / 2], [np.zeros((2, 2)), np.zeros((1, 2))])

    def rate(t, y):
        torque = np.array([4.0, 1.5]) * np.sin(2 * np.pi * t)
        return np.concatenate([y[n:], oracle.acceleration(y[:n], y[n:], torque)])

    start = np.concatenate([start, np.zeros(n)])
    q = solve_ivp(rate, (0, 0.05), start, "DOP853", rtol=1e-9, atol=1e-12).y[:n, -1]
    second = q[0] + q[4] + q[5]  # absolute: joint 1, slope at the tip of link 1, joint 2
    # Ten times the difference from a solution at ten times tighter tolerances.
    np.testing.assert_allclose(oracle.tip(q)[:2], tip, rtol=0, atol=1e-10)
    np.testing.assert_allclose([q[0], second], angles, rtol=0, atol=1e-10)
    np.testing.assert_allclose([q[3], q[6]], deflections, rtol=0, atol=1e-10)
