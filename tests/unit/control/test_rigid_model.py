"""The rigid model of controllers against the methods of the arm."""

import numpy as np
import pytest

import flexarm as fa
from flexarm.control.design.rigid_model import RigidModel
from oracles.rigid_double_pendulum import RigidDoublePendulum

ANGLE, RATE, ACCELERATION = np.array([0.4, -0.9]), np.array([1.3, -2.1]), np.array([3.0, 5.0])


def links(**options):
    return [
        fa.Link(length=0.8, mass_per_length=0.5, **options),
        fa.Link(length=0.6, mass_per_length=0.4, **options),
    ]


ONE_SIDED = fa.Friction(coulomb=0.3, viscous=0.1, coulomb_negative=0.5, viscous_negative=0.05)


@pytest.mark.parametrize(
    "joint", [{}, {"stiffness": 4.0, "rotor_inertia": 0.02}, {"friction": ONE_SIDED}]
)
def test_rigid_model_equals_the_rigid_arm(joint):
    arm = fa.Arm(
        links=links(flexural_rigidity=20.0, elements=3),
        joints=[fa.Joint(hub_inertia=0.05, **joint), fa.Joint(mass=0.3)],
        payload=fa.Payload(mass=0.2, offset=(0.05, 0.02)),
        gravity=(0.0, -9.81),
    )
    model, rigid = RigidModel(arm), arm.rigid()
    for _ in range(2):  # a second evaluation does not depend on the first one
        found = model.torque(ANGLE, RATE, ACCELERATION)
        wanted = rigid.inverse_dynamics(ANGLE, RATE, ACCELERATION)
        np.testing.assert_allclose(found, wanted, rtol=1e-13)
        M = model.mass_matrix(ANGLE)
        np.testing.assert_allclose(M, rigid.mass_matrix(ANGLE), rtol=1e-13)
        still = model.gravity_torque(ANGLE)
        np.testing.assert_allclose(still, rigid.bias_force(ANGLE, 0 * RATE), rtol=1e-13)


def test_rigid_model_equals_the_double_pendulum_in_closed_form():
    arm = fa.Arm(links=links(flexible=False), gravity=(0.0, -9.81))
    pendulum = RigidDoublePendulum(length=(0.8, 0.6), mass=(0.4, 0.24), gravity=(0.0, -9.81))
    torque = RigidModel(arm).torque(ANGLE, RATE, ACCELERATION)
    found = pendulum.acceleration(ANGLE, RATE, torque)
    np.testing.assert_allclose(found, ACCELERATION, rtol=1e-12)
