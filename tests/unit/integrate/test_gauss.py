"""Gauss collocation: energy without drift, reversal, and its closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from one_mode import clamped_beam, vibrate

import flexarm as fa
from arms import table_one_arm
from flexarm.integrate import Gauss6


@pytest.mark.parametrize("turn", [0.3, 2.0, 40.0])
@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_vibration_follows_the_pade_approximant(turn, damping) -> None:
    """With three stages a step is the approximant (3, 3) of the exponential."""
    arm, frequency = clamped_beam(damping)
    step = turn / frequency
    seen = vibrate(arm, Gauss6(step), step, 50)
    z = np.array([[0.0, 1.0], [-(turn**2), -2 * damping * turn]])
    even, odd = np.eye(2) + z @ z / 10, z / 2 + z @ z @ z / 120
    matrix = np.linalg.solve(even - odd, even + odd)
    point = seen[0]
    wanted = [point := matrix @ point for _ in range(50)]
    # Rounding of 50 steps, amplified by the stiffness: a stage has an error of eps times turn^2.
    size = np.array([1.0, turn]) * np.abs(seen[:, 0]).max() + np.abs(seen).max(axis=0)
    allowed = 50 * 4 * np.finfo(float).eps * max(1.0, turn**2)
    assert np.all(np.abs(seen[1:] - wanted) < allowed * size)


def swinging_arm() -> fa.Arm:
    return table_one_arm(elements=2, modes=2, gravity=(0.0, -9.81), theory="second_order")


def energy_error(result) -> np.ndarray:
    energy = (result.kinetic_energy + result.strain_energy + result.gravity_energy).values
    return (energy - energy[0]) / float((result.kinetic_energy + result.strain_energy).max())


@pytest.mark.thorough
@pytest.mark.compiled
def test_energy_of_a_large_swing_does_not_drift() -> None:
    """About forty swings of half a radian to each side, 60000 steps."""
    arm = swinging_arm()
    start = arm.rest([-1.0, 0.3])
    run = fa.simulate(arm, 60.0, initial=start, integrator="gauss_6", step=1e-3, rate=200.0)
    error = energy_error(run)
    # Order 6 in the step times the frequencies that vibrate; the error oscillates about zero.
    assert np.abs(error).max() < 1e-10
    trend = np.polyfit(run.time.values, error, 1)[0] * 60.0
    assert abs(trend) < 0.1 * np.abs(error).max()


@pytest.mark.compiled
def test_reversed_motion_returns_to_its_start() -> None:
    arm = swinging_arm()
    start, rates = arm.rest([-0.6, 0.3]), arm.rest([0.5, -1.0])
    settings = {"integrator": "gauss_6", "step": 2e-3}
    there = fa.simulate(arm, 5.0, initial=start, initial_rate=rates, **settings)
    back = fa.simulate(
        arm, 5.0, initial=there.q.values[-1], initial_rate=-there.qd.values[-1], **settings
    )
    # Rounding times the amplification by the motion in 10 s; the motion itself is less accurate.
    np.testing.assert_allclose(back.q.values[-1], start, rtol=0, atol=1e-11)
    exact = fa.simulate(
        arm, 5.0, initial=start, initial_rate=rates, rtol=1e-12, atol=1e-14
    ).q.values[-1]
    assert np.abs(there.q.values[-1] - exact).max() > 1e-9


@pytest.mark.compiled
def test_stiff_bending_needs_few_sweeps() -> None:
    """A full mesh whose fastest mode turns by hundreds of radians in a step."""
    rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732, "elements": 10}
    arm = fa.Arm(links=[fa.Link(length=1.4142, **rod), fa.Link(length=1.0, **rod)])
    torque = lambda t: [4.0 * np.sin(6.0 * t), 1.5 * np.sin(6.0 * t)]  # noqa: E731
    run = fa.simulate(arm, 0.2, torque=torque, integrator="gauss_6", step=1e-3)
    # A sweep reduces the error of a linear vibration at least to 0.57 of it: 60 for all digits.
    assert run.attrs["evaluations"] < 3 * 60 * run.attrs["steps"]


@pytest.mark.parametrize("integrator", ["gauss_6", "generalized_alpha"])
def test_step_too_long_for_the_motion_ends_the_run_with_its_reason(integrator: str) -> None:
    rigid = {"mass_per_length": 1.0, "flexible": False}
    links = [fa.Link(length=0.8, **rigid), fa.Link(length=0.5, **rigid)]
    arm = fa.Arm(links=links, gravity=(0.0, -9.81))
    with pytest.raises(fa.SimulationError, match=r"could not be solved.*too long.*smaller step"):
        fa.simulate(arm, 20.0, integrator=integrator, step=2.0)
