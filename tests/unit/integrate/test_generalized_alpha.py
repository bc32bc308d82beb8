"""The generalised-alpha method against its theory, Chung and Hulbert (1993)."""

from __future__ import annotations

import numpy as np
import pytest
from one_mode import clamped_beam, vibrate

import flexarm as fa
from flexarm.integrate import GeneralizedAlpha

each_radius = pytest.mark.parametrize("radius", [0.0, 0.3, 0.8, 1.0])


def amplification(radius: float, turn: float, decay: float) -> np.ndarray:
    """Return the matrix of a step of h for (q, h v, h^2 averaged acceleration).

    ``turn``: h times the frequency; ``decay``: h times damping. From the paper's equations, solved
    directly: unknown are the new three values and the new true acceleration.
    """
    alpha_m = (2 * radius - 1) / (radius + 1)
    alpha_f = radius / (radius + 1)
    gamma = 1 / 2 - alpha_m + alpha_f
    beta = (1 - alpha_m + alpha_f) ** 2 / 4
    true = np.array([-(turn**2), -decay, 0.0])
    new = np.array(
        [[1.0, 0.0, -beta], [0.0, 1.0, -gamma], [*(-(1 - alpha_f) * true[:2]), 1 - alpha_m]]
    )
    old = np.array(
        [[1.0, 1.0, 1 / 2 - beta], [0.0, 1.0, 1 - gamma], [*(alpha_f * true[:2]), -alpha_m]]
    )
    return np.linalg.solve(new, old)


@each_radius
@pytest.mark.parametrize("turn", [0.01, 0.5, 3.0, 50.0])
@pytest.mark.parametrize("damping", [0.0, 0.2])
def test_vibration_follows_the_closed_form(radius, turn, damping) -> None:
    arm, frequency = clamped_beam(damping)
    step = turn / frequency
    seen = vibrate(arm, GeneralizedAlpha(step, radius), step, 30)
    decay = 2 * damping * turn
    matrix = amplification(radius, turn, decay)
    point = np.array([*seen[0], -(turn**2) * seen[0, 0] - decay * seen[0, 1]])
    wanted = [point := matrix @ point for _ in range(30)]
    # 30 steps of rounding; fast modes multiply it by the square of their turn.
    size = np.abs(seen).max()
    np.testing.assert_allclose(seen[1:], np.array(wanted)[:, :2], rtol=0, atol=1e-12 * size)


@each_radius
def test_too_fast_vibration_is_damped_by_the_chosen_factor(radius) -> None:
    """At infinity all three eigenvalues are -radius, so three earlier values determine each
    step."""
    arm, frequency = clamped_beam()
    step = 1e4 / frequency
    q = vibrate(arm, GeneralizedAlpha(step, radius), step, 40)[:, 0]
    left = q[3:] + 3 * radius * q[2:-1] + 3 * radius**2 * q[1:-2] + radius**3 * q[:-3]
    # The rest is of the order of the inverse square of the turn, plus rounding times it.
    assert np.abs(left).max() < 1e-6 * np.abs(q).max()
    if radius == 0.0:
        assert np.abs(q[3:]).max() < 1e-6 * q[0]
    else:
        # Up to a quadratic in the number of steps: a triple eigenvalue.
        assert np.abs(q[-1]) < 40**2 * radius**37 * np.abs(q[:4]).max()


def test_vibration_keeps_its_energy_at_radius_one_for_any_step() -> None:
    arm, frequency = clamped_beam()
    for turn in (0.1, 1.0, 20.0):
        step = turn / frequency
        seen = vibrate(arm, GeneralizedAlpha(step, 1.0), step, 500)
        energy = (turn * seen[:, 0]) ** 2 + seen[:, 1] ** 2
        np.testing.assert_allclose(energy, energy[0], rtol=1e-11)  # 500 steps of rounding


class Wave:
    """A smooth torque with unevenly spaced breaks, one per step."""

    def __init__(self, count: int) -> None:
        shift = np.random.default_rng(3).uniform(-0.3, 0.3, count)
        self.breaks = tuple((np.arange(1, count) + shift[1:]) / count)

    def __call__(self, t: float) -> np.ndarray:
        return np.array([0.4 * np.sin(5.0 * t), 0.2 * np.cos(3.0 * t)])


@pytest.mark.compiled
def test_steps_of_changing_length_keep_order_two() -> None:
    """The averaged acceleration belongs to a time that moves with the step."""
    rigid = {"mass_per_length": 1.0, "flexible": False}
    arm = fa.Arm(links=[fa.Link(length=0.8, **rigid), fa.Link(length=0.5, **rigid)])
    exact = fa.simulate(arm, 1.0, torque=Wave(1), rtol=1e-12, atol=1e-14).tip[-1]
    counts = np.array([100, 200, 400, 800])
    errors = []
    for count in counts:
        method = GeneralizedAlpha(step=0.1, spectral_radius=0.3)
        run = fa.simulate(arm, 1.0, torque=Wave(count), integrator=method)
        assert run.attrs["steps"] == count
        errors.append(float(np.hypot(*(run.tip[-1] - exact).values)))
    order = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert 1.8 < order < 2.2  # steps differ randomly


@pytest.mark.compiled
def test_full_mesh_is_accurate_at_steps_of_the_slow_motion() -> None:
    rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732, "elements": 12}
    arm = fa.Arm(links=[fa.Link(length=1.4142, **rod), fa.Link(length=1.0, **rod)])
    drive = {"torque": lambda t: [4.0 * np.sin(6.0 * t), 1.5 * np.sin(6.0 * t)], "rate": 100.0}
    exact = fa.simulate(arm, 0.5, integrator="kennedy_carpenter_5", rtol=1e-7, **drive)
    errors = []
    for step in (1e-3, 5e-4):
        # The fastest mode turns by a hundred radians and more in such a step.
        run = fa.simulate(arm, 0.5, integrator="generalized_alpha", step=step, **drive)
        errors.append(float(np.abs(run.tip - exact.tip).max()))
    # m. The torque starts with a jump of its slope, which excites modes that no such step resolves:
    # their error falls more slowly than with the square of the step.
    assert errors[0] < 2e-5
    assert errors[1] < 0.7 * errors[0]


def test_tiny_jumps_of_the_torque_hardly_change_the_steps() -> None:
    """The averaged acceleration is kept across jumps; steps that lost it would start with an error
    of order h, here a hundred times as large as the effect of the jumps."""
    arm, _ = clamped_beam()
    turning = fa.Arm(arm.spec.replace(joints=[fa.Joint(hub_inertia=0.1)]))
    step, count, jump = 2e-3, 60, 1e-9
    table = 0.2 + jump * (np.arange(count // 5)[:, None] % 2)
    runs = [
        fa.simulate(
            turning,
            count * step,
            initial=[0.1, 1e-3],
            torque=torque,
            integrator=GeneralizedAlpha(step, 0.8),
            rate=0.2 / step,
        )
        for torque in (lambda t: np.array([0.2]), table)
    ]
    assert runs[0].attrs["steps"] == runs[1].attrs["steps"] == count
    # A constant torque of the size of the jumps turns the hub alone by this angle.
    turned = 0.5 * jump / 0.1 * (count * step) ** 2
    difference = np.abs(runs[0].q.values - runs[1].q.values).max()
    assert 0.0 < difference < turned


@pytest.mark.parametrize("step", [5e-4, 2e-3])
def test_a_boom_at_rest_under_gravity(step):
    """Passes change the point by rounding errors alone, which are above the solved change."""
    link = fa.Link(length=2.5, flexural_rigidity=2e6, mass_per_length=20.0, elements=5)
    joints = [fa.Joint(hub_inertia=30.0)] * 2
    arm = fa.Arm(links=[link, link], joints=joints, gravity=(0.0, -9.81))
    rest = fa.equilibrium(arm, [0.3, -0.4])
    run = {"torque": lambda t: rest.torque, "initial": rest.q, "progress": False}
    result = fa.simulate(arm, 1.0, integrator="generalized_alpha", step=step, **run)
    assert result.attrs["failure"] == ""
    moved = np.abs(result.tip - result.tip[0]).max()
    assert moved < 1e-9  # a boom of 5 m
