"""Rigid arms against the double pendulum in closed form."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import flexarm as fa
from oracles.rigid_double_pendulum import RigidDoublePendulum
from strategies import between

positive = between(0.1, 3.0)
maybe = st.one_of(st.just(0.0), between(0.001, 2.0))
rate = between(-5.0, 5.0)


@settings(max_examples=60)
@given(
    lengths=st.tuples(positive, positive),
    masses=st.tuples(positive, positive),
    hubs=st.tuples(maybe, maybe),
    lumps=st.tuples(maybe, maybe, maybe, maybe),
    gravity=st.tuples(between(-10, 10), between(-10, 10)),
    state=st.tuples(between(-3, 3), between(-3, 3), rate, rate, rate, rate),
    theory=st.sampled_from(["linear", "second_order"]),
)
def test_double_pendulum_in_closed_form(lengths, masses, hubs, lumps, gravity, state, theory):
    mass, inertia, payload, payload_inertia = lumps
    arm = fa.Arm(
        links=[
            fa.Link(length=length, mass_per_length=m / length, flexible=False)
            for length, m in zip(lengths, masses, strict=True)
        ],
        joints=[
            fa.Joint(hub_inertia=hubs[0]),
            fa.Joint(hub_inertia=hubs[1], mass=mass, housing_inertia=inertia),
        ],
        payload=fa.Payload(mass=payload, inertia=payload_inertia),
        gravity=gravity,
        theory=theory,
    )
    exact = RigidDoublePendulum(
        length=lengths,
        mass=masses,
        hub_inertia=hubs,
        elbow_mass=mass,
        elbow_inertia=inertia,
        payload_mass=payload,
        payload_inertia=payload_inertia,
        gravity=gravity,
    )
    angles, rates, torque = np.reshape(state, (3, 2))
    M = exact.mass_matrix(angles)
    np.testing.assert_allclose(arm.mass_matrix(angles), M, rtol=1e-13)
    # Each force is a sum of terms; the largest one determines the rounding.
    terms = abs(exact.bias_force(angles, rates)).max() + M.max() * abs(rates).max() ** 2
    terms += 10.0 * (sum(masses) + mass + payload) * sum(lengths)
    np.testing.assert_allclose(
        arm.bias_force(angles, rates), exact.bias_force(angles, rates), rtol=0, atol=1e-14 * terms
    )
    found = arm.forward_dynamics(angles, rates, torque)
    wanted = exact.acceleration(angles, rates, torque)
    # Rounding of the forces, multiplied by the condition number of M.
    lost = abs(np.linalg.inv(M)).max() * (terms + abs(torque).max())
    np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-14 * lost)


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_rigid_table_one_arm(theory):
    """The paper's arm with an elbow angle of a quarter turn, to all digits."""
    links = [
        fa.Link(length=length, mass_per_length=0.61732, flexural_rigidity=105.0, elements=n)
        for length, n in [(1.4142, 2), (1.0, 1)]
    ]
    arm = fa.Arm(links=links, theory=theory).rigid()
    exact = RigidDoublePendulum(length=(1.4142, 1.0), mass=(1.4142 * 0.61732, 0.61732))
    rng = np.random.default_rng(4)
    for _ in range(20):
        angles, rates, torque = rng.normal(size=(3, 2)) * [[2], [3], [5]]
        wanted = exact.acceleration(angles, rates, torque)
        found = arm.forward_dynamics(angles, rates, torque)
        assert np.linalg.norm(found - wanted) < 1e-12 * np.linalg.norm(wanted)
