"""Noise of measured torques: its size, deviations that contain it, effects that it resembles."""

import warnings

import numpy as np
import pytest

import flexarm as fa
from data.bench_records import ONE
from flexarm.identification.input_noise import noise_of
from identification.benches import NOISE, arm_of, truth

pytestmark = pytest.mark.compiled

RATE, SAMPLES = 200.0, 301
FREE = ["links[0].flexural_rigidity", "joints[0].damping", "joints[0].hub_inertia"]


def multisine() -> np.ndarray:
    phases = 2.0 * np.pi * np.outer(np.arange(SAMPLES) / RATE, [1.3, 2.9, 4.7, 7.1])
    return 0.5 * ONE.amplitude[0] * np.sin(phases + np.arange(4) ** 2).sum(axis=1)[:, None]


def switching() -> np.ndarray:
    signs = np.random.default_rng(3).integers(0, 2, SAMPLES // 20 + 1)
    return np.repeat(0.3 * (2.0 * signs - 1.0), 20)[:SAMPLES, None]


@pytest.mark.parametrize("torque", [multisine, switching])
def test_the_noise_on_samples_of_a_torque(torque):
    """Smooth torques, and those that switch, are not noise; five millinewton metres are."""
    assert noise_of(torque())[0] < 1e-4
    noise = [
        noise_of(torque() + 5e-3 * np.random.default_rng(k).standard_normal((SAMPLES, 1)))[0]
        for k in range(20)
    ]
    # Switches leave power near half the rate, and steps in one of five third differences.
    assert np.mean(noise) == pytest.approx(5e-3, rel=0.15)


def identified(arm, run, free, rough, seed, **settings):
    """Return the fit of a run, with noise on its torque and its readings."""
    random = np.random.default_rng(seed)
    for name, deviation in {**NOISE, "torque": rough}.items():
        if name in run:
            run[name] = run[name] + deviation * random.standard_normal(run[name].shape)
    outputs = [name for name in ("joint_angle", "strain") if name in run]
    measured = fa.MeasuredRecord(run, outputs=outputs, initial_angle=[0.0], **settings)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return fa.identify(arm, measured, free, starts=1, progress=False)


@pytest.mark.parametrize("seed", [0, 1, 5])
def test_errors_by_noise_of_the_torque_are_within_the_deviations(seed):
    """With deviations of the residuals alone, a third of such records has errors of 6 of them.

    Its drift resembles offsets and gains of the torque, which must not be named.
    """
    arm = arm_of(ONE)
    run = fa.simulate(arm, (SAMPLES - 1) / RATE, torque=multisine(), rate=RATE, progress=False)
    found = identified(arm, run, FREE, 5e-3, seed, interpolation="cubic")
    assert found.missing == ()
    deviations = found.parameters["standard_deviation"].values
    errors = np.array([found[path] - truth(ONE, path) for path in FREE])
    assert np.all(np.abs(errors) < 3.0 * deviations), errors / deviations


def test_the_deviation_by_stated_noise_is_that_of_a_double_integral():
    """A rigid arm: its angle is the double integral of the torque over its inertia."""
    arm = fa.Arm(
        links=[fa.Link(length=0.5, mass_per_length=0.1, flexible=False)],
        joints=[fa.Joint(hub_inertia=0.02)],
    )
    torque, noise = switching(), 5e-3
    run = fa.simulate(
        arm,
        (SAMPLES - 1) / RATE,
        torque=torque,
        rate=RATE,
        torque_interpolation="hold",
        progress=False,
    )
    deviations = [
        float(
            identified(arm, run.copy(deep=True), FREE[2:], noise, 1, interpolation="hold", **known)
            .parameters["standard_deviation"]
            .item()
        )
        for known in ({}, {"noise": {"torque": noise}})
    ]
    inertia = 0.02 + 0.1 * 0.5**3 / 3.0
    # Of each sample that a hold keeps: the double integral at the times of the samples.
    passed = np.arange(SAMPLES)[:, None] - np.arange(SAMPLES) - 0.5
    response = np.maximum(passed, 0.0) / RATE**2 / inertia
    slope = -response @ torque[:, 0] / inertia
    # The error of the inertia by least squares, by noise of the torque.
    exact = noise * np.linalg.norm(slope @ response) / (slope @ slope)
    # The scatter of 15 random samples is 18 %.
    assert np.sqrt(deviations[1] ** 2 - deviations[0] ** 2) == pytest.approx(exact, rel=0.4)
    assert deviations[0] < 0.6 * exact
