"""Tip errors of arms whose base moves: of a rigid arm on the base of the run, in closed form."""

from __future__ import annotations

import numpy as np
import pytest

import flexarm as fa
from flexarm.simulation.calls.metrics import metrics_of

LINK = fa.Link(length=0.8, mass_per_length=0.5, flexible=False)
FLYER = fa.Arm(
    base=fa.Base(mass=5.0, inertia=0.8, free=("x", "y", "angle")),
    links=[LINK],
    joints=[fa.Joint(offset=(0.4, 0.1))],
)


def test_the_tip_error_of_a_rigid_flyer_is_the_chord_of_its_joint_error():
    """The base starts anywhere, drifts and turns; the joint error alone moves the tip."""
    motion = fa.joint_motion(FLYER, [0.3], [0.9], 1.0)
    start = FLYER.rest([0.25], base=[1.0, -2.0, 0.7])
    rates = FLYER.rest([0.0], base=[0.1, 0.2, -0.3])
    law = fa.ComputedTorque(FLYER, 2.0)
    run = fa.simulate(
        FLYER, 1.0, controller=law, reference=motion, initial=start, initial_rate=rates
    )
    errors = run.joint_angle.values[:, 0] - motion.joint_angle(run.time.values)[:, 0]
    chords = 2.0 * LINK.length * np.abs(np.sin(0.5 * errors))
    found = metrics_of(run, FLYER, motion)
    assert found["tip_error_peak"] == pytest.approx(chords.max(), rel=1e-9)
    assert found["tip_error_rms"] == pytest.approx(np.sqrt(np.mean(chords**2)), rel=1e-9)
