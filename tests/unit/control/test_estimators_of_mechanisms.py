"""Estimators on branches, sliding joints and bases that move: their deviations are right."""

from __future__ import annotations

import numpy as np
import pytest

import flexarm as fa
from flexarm.control.filters.estimator import tip_mass

STEP, SAMPLES = 2e-3, 400
GAUGE = fa.Gauge(station=0.05, distance=0.004)
LINK = fa.Link(
    length=0.6,
    mass_per_length=0.5,
    flexural_rigidity=20.0,
    elements=1,
    damping=fa.ModalDamping(ratio=0.01),
    gauges=[GAUGE],
)
JOINT = fa.Joint(hub_inertia=0.02, damping=0.05)
SLIDE = fa.Joint(kind="prismatic", axis=(1.0, 0.0), mass=1.0, damping=1.0)
TWO = {"links": [LINK, LINK], "joints": [JOINT, JOINT]}
ARMS = {
    "branches": fa.Arm(links=[LINK, LINK, LINK.replace(parent=1)], joints=[JOINT] * 3),
    "slide": fa.Arm(links=[LINK, LINK], joints=[SLIDE, JOINT], gravity=(0.0, -9.81)),
    "springs": fa.Arm(
        **TWO, base=fa.Base(mass=2.0, free=("x",), stiffness=(500.0, 0, 0), damping=(5.0, 0, 0))
    ),
    "free": fa.Arm(**TWO, base=fa.Base(mass=2.0, inertia=0.3, free=("x", "y", "angle"))),
}
NOISE = {"joint_angle": 1e-4, "strain": 1e-6}


@pytest.mark.sampled("branches-ExtendedKalmanFilter", "free-ExtendedKalmanFilter")
@pytest.mark.parametrize("kind", [fa.ExtendedKalmanFilter, fa.UnscentedKalmanFilter])
@pytest.mark.parametrize("name", ARMS)
def test_deviations_of_estimates_are_right(name: str, kind: type) -> None:
    arm, rng = ARMS[name], np.random.default_rng(0)
    torque = np.repeat(0.5 * rng.standard_normal((SAMPLES // 25 + 1, arm.n_joints)), 25, axis=0)
    torque = torque[: SAMPLES + 1]
    disturbed = torque + 0.02 * rng.standard_normal(torque.shape)
    start = arm.rest(np.full(arm.n_joints, 0.3))
    options = {"torque_interpolation": "hold", "rate": 1.0 / STEP, "initial": start}
    run = fa.simulate(arm, SAMPLES * STEP, torque=disturbed, **options)
    readings = {
        label: run[label].values[:SAMPLES] + noise * rng.standard_normal(run[label].shape)[:SAMPLES]
        for label, noise in NOISE.items()
    }
    instruments = [fa.Instrument(label, noise=noise) for label, noise in NOISE.items()]
    estimator = kind(arm, instruments, torque_noise=0.02, sample_time=STEP)
    found = estimator.run(torque[:SAMPLES], readings)
    assert found.consistent
    # Normalised squares have the mean one; single samples of 400 depend on each other, so that the
    # mean of the errors scatters by a few tenths.
    assert found.innovation.mean() == pytest.approx(1.0, abs=0.1)
    errors = found.squared_errors(run.q.values[:SAMPLES], run.qd.values[:SAMPLES], 0.0)
    assert 0.5 < errors.mean() < 1.5
    # Joint angles are better than one reading.
    angles = np.abs(found.q - run.q.values[:SAMPLES])[50:, arm.joint_index]
    assert np.sqrt(np.mean(angles**2)) < NOISE["joint_angle"]


def test_exported_filters_refuse_a_base_that_moves(tmp_path) -> None:
    arm = ARMS["free"]
    observer = fa.ExtendedKalmanFilter(arm, [fa.Instrument("joint_angle", noise=1e-4)])
    with pytest.raises(fa.InputError, match="observer is not supported for arms with a free base"):
        fa.export_c(arm, tmp_path / "c", observer=observer)


def test_the_mass_at_the_tip_of_a_slide_is_a_mass() -> None:
    for length in (0.1, 10.0):
        rod = fa.Link(length=length, mass_per_length=2.0 / length, flexible=False)
        arm = fa.Arm(links=[rod], joints=[fa.Joint(kind="prismatic")])
        assert tip_mass(arm) == pytest.approx(2.0, rel=1e-12)
