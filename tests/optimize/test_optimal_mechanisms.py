"""Optimal motions and learning on branches and sliding joints."""

from __future__ import annotations

import numpy as np
import pytest

import flexarm as fa

LINK = fa.Link(length=0.6, mass_per_length=0.5, flexural_rigidity=50.0, elements=1, modes=1)
JOINT = fa.Joint(hub_inertia=0.02, damping=0.05)
SLIDE = fa.Joint(kind="prismatic", axis=(1.0, 0.0), mass=1.0, damping=1.0)
ARMS = {
    "gantry": fa.Arm(links=[LINK, LINK], joints=[SLIDE, JOINT], gravity=(0.0, -9.81)),
    "branches": fa.Arm(links=[LINK, LINK, LINK.replace(parent=1)], joints=[JOINT] * 3),
}


@pytest.mark.sampled("gantry")
@pytest.mark.parametrize("name", ARMS)
def test_an_optimal_motion_ends_at_rest(name: str) -> None:
    arm = ARMS[name]
    first, last = np.zeros(arm.n_joints), np.linspace(0.1, 0.3, arm.n_joints)
    limits = fa.MotionLimits(torque=40.0)
    found = fa.optimal_motion(arm, first, last, "energy", limits=limits, duration=0.8)
    start = fa.equilibrium(arm, first).q
    run = fa.simulate(arm, found.duration, torque=found.torque, initial=start, rtol=1e-9)
    end = run.isel(time=-1)
    # The tolerance of the transcription, 1e-8 of the reach and of the rates.
    np.testing.assert_allclose(end.joint_angle.values, last, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(end.joint_rate.values, 0.0, rtol=0.0, atol=1e-6)
    rest = fa.equilibrium(arm, last).q
    np.testing.assert_allclose(end.q.values, rest, rtol=0.0, atol=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize("name", ARMS)
def test_learning_reduces_the_error(name: str) -> None:
    arm = ARMS[name]
    motion = fa.joint_motion(arm, np.zeros(arm.n_joints), np.linspace(0.1, 0.3, arm.n_joints), 0.5)
    gains = ([300.0, 8.0], [40.0, 1.0]) if name == "gantry" else (8.0, 1.0)
    learned = fa.iterative_learning(arm, motion, fa.JointPD(*gains), trials=4)
    assert learned.error_rms[-1] < 0.1 * learned.error_rms[0]


@pytest.mark.thorough
def test_an_excitation_of_branches_is_better_than_the_first() -> None:
    found = fa.optimal_excitation(
        ARMS["branches"],
        ["links[0].flexural_rigidity", "joints[0].damping"],
        noise={"joint_angle": 1e-4},
        period=1.0,
        band=(1.0, 8.0),
        limits=fa.MotionLimits(torque=5.0),
        lines=3,
        iterations=3,
    )
    table = found.identifiability.parameters.standard_deviation
    assert np.all(table.values < found.first.parameters.standard_deviation.values)
