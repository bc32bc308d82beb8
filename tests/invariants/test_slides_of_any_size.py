"""Defaults of arms with sliding joints are relative to the arm: similar arms move alike."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import flexarm as fa
from flexarm.simulation.loop.stability import _passed
from flexarm.simulation.run.impacts import may_grow
from flexarm.simulation.run.tolerance import tip_units
from other_units import Units

#: About 0.1 mm, and about 100 m: powers of two, so that factors are not rounded.
SIZES = [Units(2.0**-13, 2.0**-30, 2.0**-13), Units(2.0**7, 2.0**17, 2.0**3)]
#: Differences of laws and equations of designs amplify rounding.
ROUNDING = 1e-7
BEAM = {"flexural_rigidity": 20.0, "mass_per_length": 0.5, "modes": 2}


def crane(units: Units) -> fa.Arm:
    """Return a trolley on a rail and a flexible link that turns on it."""
    damping = fa.ModalDamping(ratio=0.01)
    trolley = fa.Link(length=0.2, mass_per_length=10.0, flexible=False)
    beam = fa.Link(length=0.8, **BEAM, damping=damping)
    joints = [fa.Joint(kind="prismatic", axis=(0.6, 0.8)), fa.Joint(hub_inertia=0.02)]
    return units.arm(fa.Arm(links=[trolley, beam], joints=joints, payload=fa.Payload(mass=0.3)))


def stage(units: Units) -> fa.Arm:
    """Return a flexible link that slides sideways."""
    joint = fa.Joint(kind="prismatic", axis=(0.0, 1.0))
    link = fa.Link(length=1.0, **BEAM, damping=fa.ModalDamping(ratio=0.01))
    return units.arm(fa.Arm(links=[link], joints=[joint], payload=fa.Payload(mass=0.3)))


def torques(units: Units, arm: fa.Arm) -> np.ndarray:
    """Return the factors (joints,) of forces of sliding joints and of torques."""
    return units.factor("N m") / units.coordinates(arm)[arm.joint_index]


LAWS = {
    "LQG": lambda u, arm: fa.LQG(arm, sample_time=1e-3 * u.time),
    "integral": lambda u, arm: fa.LQG(arm, integral=True, sample_time=1e-3 * u.time),
    "disturbance": lambda u, arm: fa.LQG(
        arm, sample_time=1e-3 * u.time, acceptable_torque=2.0 * torques(u, arm), recovery=0.3
    ),
    "MPC": lambda u, arm: fa.MPC(
        arm, torque_limit=50.0 * torques(u, arm), sample_time=1e-3 * u.time
    ),
    "composite": lambda u, arm: fa.Composite(arm, sample_time=1e-3 * u.time),
    "sliding mode": lambda u, arm: fa.SlidingMode(
        arm,
        bandwidth=6.0 / u.time,
        boundary_layer=0.1 * u.coordinates(arm)[arm.joint_index] / u.time,
        sample_time=1e-3 * u.time,
    ),
}


def moved(units: Units, law, arm: fa.Arm, **options):
    """Return a run with a law, and the classes of its warnings."""
    size = units.coordinates(arm)[arm.joint_index]
    motion = fa.joint_motion(arm, 0.0 * size, 0.3 * size, 0.4 * units.time)
    with warnings.catch_warnings(record=True) as log:
        warnings.simplefilter("always")
        run = fa.simulate(
            arm, 0.5 * units.time, controller=law, reference=motion,
            rate=200.0 / units.time, **options,
        )  # fmt: skip
    return run, [message.category for message in log]


@pytest.mark.parametrize("make_arm", [crane, stage])
@pytest.mark.parametrize("name", LAWS)
def test_default_laws_move_similar_slides_alike(name, make_arm):
    for units in [Units(), *SIZES]:
        arm = make_arm(units)
        run, warned = moved(units, LAWS[name](units, arm), arm)
        numbers = {
            "position": run.joint_angle.values / units.coordinates(arm)[arm.joint_index],
            "torque": run.torque.values / torques(units, arm),
            "growth": run.loop_growth * units.time,
        }
        if units == Units():
            usual, texts = numbers, warned
        assert warned == texts
        for key, values in usual.items():
            np.testing.assert_allclose(numbers[key], values, atol=ROUNDING * np.abs(values).max())


def test_default_filters_estimate_the_payload_of_similar_slides_alike():
    masses = []
    for units in [Units(), *SIZES]:
        arm, rng = stage(units), np.random.default_rng(0)
        noise = {"joint_angle": 1e-3 * units.length, "joint_rate": 1e-2 * units.length / units.time}
        instruments = [fa.Instrument(name, noise=value) for name, value in noise.items()]
        filter_ = fa.ExtendedKalmanFilter(
            arm, instruments, sample_time=5e-3 * units.time, payload_deviation=0.1 * units.mass
        )
        push = torques(units, arm)
        run = fa.simulate(
            fa.varied(arm, payload_factor=1.5), 0.5 * units.time, rate=200.0 / units.time,
            torque=lambda t, push=push, time=units.time: 3.0 * np.sin(9.0 * t / time) * push,
        )  # fmt: skip
        readings = {
            name: run[name].values[:-1] + noise[name] * rng.normal(size=run[name].shape)[:-1]
            for name in noise
        }
        estimate = filter_.run(run.torque.values[:-1], readings)
        masses.append(np.asarray(estimate.payload_mass) / units.mass)
    np.testing.assert_allclose(masses, masses[:1] * 3, rtol=ROUNDING)


def test_networks_of_similar_slides_learn_friction_alike():
    shares = []
    for units in [Units(), *SIZES]:
        arm = stage(units)
        size, push = units.length, float(torques(units, arm)[0])
        law = fa.RBFAdaptive(
            arm, bandwidth=6.0 / units.time, damping=3.0 * push * units.time / size,
            adaptation=1e-12 * push / size, lower=0.0, upper=size, centres=1, e_modification=0.0,
            sample_time=1e-3 * units.time,
        )  # fmt: skip
        moved(units, law, arm)
        # Of weights that are too small to act: that of the sign of the rate over that of gravity.
        shares.append(law.weights[0, 0, 3] / law.weights[0, 0, 0])
    assert shares[0] == pytest.approx(1.0, abs=0.01)
    # Their torque, 1e-6 of that of the damping, has another ratio in each size.
    np.testing.assert_allclose(shares, shares[:1] * 3, rtol=1e-5)


def test_paths_of_slides_count_by_the_reach():
    arms = [stage(units) for units in [Units(), *SIZES]]
    times, decided = np.linspace(0.0, 1.0, 33), []
    for arm, units in zip(arms, [Units(), *SIZES], strict=True):
        unit, free = tip_units(arm), arm.assembly.constants
        for path in (3.0, 9.0):  # in reaches: the second is longer than the reach times 2 pi
            samples = np.zeros((33, *unit.shape))
            samples[:, 0, 0, 0] = path * units.length * times
            decided.append(may_grow("", samples, free, unit, times))
        motion = fa.joint_motion(arm, [0.0], [1.2 * units.length], units.time)
        # Two postures, at most half a reach apart.
        assert len(_passed(arm, motion, units.time)) == 2
    assert decided == [False, True] * 3
