"""Regressor and momentum of branches, slides and offsets against the kernels of the whole arm."""

from __future__ import annotations

import numpy as np
import pytest

import flexarm as fa
from flexarm.control.design.rigid_model import RigidParameters, parameter_names

LINK = fa.Link(length=0.8, mass_per_length=0.5, flexible=False)
TREES = {
    "branches": fa.Arm(
        links=[LINK, LINK, LINK.replace(parent=1)],
        joints=[
            fa.Joint(),
            fa.Joint(damping=0.2),
            fa.Joint(offset=(0.1, 0.05), mounting_angle=1.0),
        ],
        payload=fa.Payload(mass=0.3, inertia=0.01, offset=(0.1, 0.05)),
        gravity=(0.0, -9.81),
    ),
    "gantry": fa.Arm(
        links=[LINK.replace(mass_per_length=20.0), LINK, LINK],
        joints=[
            fa.Joint(kind="prismatic", mass=0.5),
            fa.Joint(kind="prismatic", axis=(0.0, 1.0)),
            fa.Joint(mounting_angle=-1.5, rotor_inertia=1e-3, gear_ratio=20.0),
        ],
        payload=fa.Payload(mass=0.3),
        gravity=(0.0, -9.81),
    ),
}


@pytest.mark.parametrize("name", TREES)
def test_rows_and_momentum_are_those_of_the_arm(name):
    arm = TREES[name]
    q, qd, qdd = np.random.default_rng(4).normal(size=(3, arm.n_joints))
    model = RigidParameters(arm, parameter_names(arm))
    rows = model.regressor(q, qd, qd, qdd).copy()
    total = rows[: model.known].sum(axis=0) + model.values @ rows[model.known :]
    np.testing.assert_allclose(total, arm.inverse_dynamics(q, qd, qdd), rtol=1e-12, atol=1e-12)
    momentum, flow = model.momentum(q, qd)
    np.testing.assert_allclose(momentum, arm.mass_matrix(q) @ qd, rtol=1e-12, atol=1e-13)
    step = 1e-5  # central differences: error 1e-10
    ahead, behind = (arm.mass_matrix(q + sign * step * qd) for sign in (1.0, -1.0))
    change = (ahead - behind) @ qd / (2.0 * step)
    expected = change - arm.inverse_dynamics(q, qd, np.zeros(arm.n_joints))
    np.testing.assert_allclose(flow, expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize("name", TREES)
def test_a_row_is_the_torque_per_unit_of_the_payload(name):
    arm = TREES[name]
    q, qd, qdd = np.random.default_rng(5).normal(size=(3, arm.n_joints))
    model = RigidParameters(arm, ["payload.mass"])
    row = model.regressor(q, qd, qd, qdd)[model.known].copy()
    payload = arm.spec.payload
    heavy = fa.Arm(arm.spec.replace(payload=payload.replace(mass=payload.mass + 1.0)))
    more = heavy.inverse_dynamics(q, qd, qdd) - arm.inverse_dynamics(q, qd, qdd)
    np.testing.assert_allclose(row, more, rtol=1e-11, atol=1e-11)


def test_an_adaptive_law_learns_the_payload_of_a_gantry():
    arm = TREES["gantry"]
    plant = fa.varied(arm, payload_mass=1.0)
    motion = fa.joint_motion(arm, [0.0, 0.0, 0.0], [1.0, 0.3, 0.8], 1.5)
    errors = []
    for rate in (0.0, 20.0):
        law = fa.Adaptive(arm, 5.0, [200.0, 200.0, 20.0], rate, parameters="payload.mass")
        run = fa.simulate(arm, 3.0, controller=law, reference=motion, plant=plant)
        errors.append(np.abs(run.joint_angle.values[-1] - [1.0, 0.3, 0.8]).max())
    assert errors[1] < 0.1 * errors[0]
