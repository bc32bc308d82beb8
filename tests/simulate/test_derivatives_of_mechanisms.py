"""Derivatives of runs of mechanisms: against differences of runs with other numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import flexarm as fa
from central_differences import differences
from closed_mechanisms import four_bar
from flexarm.model.paths import number_at, with_number

DURATION = 0.2
#: So tight that differences of runs have six digits.
SETTINGS: dict[str, Any] = {"rtol": 1e-11, "rate": 100.0}


def moving(**fields: Any) -> tuple[fa.Arm, dict[str, Any]]:
    """Return a flexible four-bar whose crank starts with 2 rad/s, and its start."""
    mechanism = four_bar(**fields)
    arm = fa.Arm(**mechanism.fields)
    rates = arm.rest([2.0, 0.0, 0.0])
    state = fa.assembled(arm, arm.rest(mechanism.joints), rates, held=[1])
    return arm, {"initial": state.q, "initial_rate": state.qd}


def samples(seed: int = 1) -> np.ndarray:
    """Return torques (samples, 3) of the crank alone."""
    torque = np.zeros((int(DURATION * SETTINGS["rate"]) + 1, 3))
    torque[:, 0] = 0.3 * np.random.default_rng(seed).standard_normal(len(torque))
    return torque


@pytest.mark.parametrize(
    "integrator",
    ["dormand_prince_8", pytest.param("kennedy_carpenter_5", marks=pytest.mark.thorough), "rk4"],
)
def test_sensitivities_of_a_closed_mechanism(integrator: str) -> None:
    arm, start = moving(theory="second_order")
    paths = ["links[1].flexural_rigidity", "links[2].mass_per_length", "gravity[1]"]
    fixed = {"step": 1e-4} if integrator == "rk4" else {}
    options = {**SETTINGS, **start, **fixed, "integrator": integrator, "torque": samples()}
    found = fa.sensitivities(arm, DURATION, paths, **options)
    channels = "q", "qd", "tip", "strain_energy"
    for k, path in enumerate(paths):

        def results(value: float, path: str = path) -> list[np.ndarray]:
            changed = fa.Arm(with_number(arm.spec, path, value))
            run = fa.simulate(changed, DURATION, **options)
            return [run[channel].values for channel in channels]

        value = number_at("", arm.spec, path)
        exact = differences(results, value, 5e-4 * abs(value))
        for channel, (slope, error) in zip(channels, exact, strict=True):
            # The steps of the runs differ, which the error of the differences does not contain.
            atol = error + 1e-5 * np.abs(slope).max()
            np.testing.assert_allclose(found[channel].values[k], slope, rtol=0.0, atol=atol)


@pytest.mark.parametrize(
    "path", ["links[0].length", "joints[2].offset[0]", "initial[0]", "initial_rate[1]"]
)
def test_a_parameter_that_opens_the_loops_is_refused(path: str) -> None:
    arm, start = moving()
    words = r"parameters\[1\] must keep the loops closed"
    with pytest.raises(fa.InputError, match=words):
        fa.sensitivities(arm, DURATION, ["gravity[1]", path], **SETTINGS, **start)


def test_the_gradient_of_a_goal_follows_the_closures() -> None:
    arm, start = moving()
    torque, options = samples(), dict(SETTINGS)
    weights = np.random.default_rng(2).standard_normal((len(torque), 2))

    def goal(torque: np.ndarray, q: np.ndarray, qd: np.ndarray) -> float:
        state = {"initial": q, "initial_rate": qd}
        run = fa.simulate(arm, DURATION, torque=torque, **state, **options)
        return float(np.sum(run.tip.values * weights))

    found = fa.goal_gradient(arm, DURATION, {"tip": weights}, torque=torque, **start, **options)
    place = start["initial"], start["initial_rate"]
    for sample in (0, 7, 20):
        unit = np.zeros_like(torque)
        unit[sample, 0] = 1e-3
        slope = (goal(torque + unit, *place) - goal(torque - unit, *place)) / 2e-3
        assert slope == pytest.approx(found.torque.values[sample, 0], rel=1e-6, abs=1e-9)
    # States on the closures near the start: the crank is held at other angles and rates.
    dependent = [k for k in range(arm.dof) if not np.any(found.initial_rate.values[k])]
    assert len(dependent) == arm.closure_rows
    ends = []
    for sign in (1.0, -1.0):
        q, qd = place[0].copy(), place[1].copy()
        others = np.setdiff1d(np.arange(arm.dof), dependent)
        q[others] += sign * 1e-7 * np.arange(1.0, len(others) + 1)
        qd[others] += sign * 1e-5
        for _ in range(20):
            J = arm.closure_jacobian(q)
            q[dependent] -= np.linalg.solve(J[:, dependent], arm.closure_gaps(q))
        J = arm.closure_jacobian(q)
        qd[dependent] = -np.linalg.solve(J[:, dependent], J[:, others] @ qd[others])
        ends.append((q, qd))
    change = (goal(torque, *ends[0]) - goal(torque, *ends[1])) / 2.0
    slopes = found.initial.values, found.initial_rate.values
    predicted = sum(s @ (a - b) / 2.0 for s, a, b in zip(slopes, *ends, strict=True))
    # The third derivative of the goal, of order 1e3, by the cube of the changes.
    assert change == pytest.approx(predicted, rel=1e-4)


@pytest.mark.parametrize("method", ["rk4", "dormand_prince_8", "kennedy_carpenter_5"])
def test_the_step_of_a_closed_mechanism_has_exact_derivatives(method: str) -> None:
    arm, start = moving()
    q, qd, torque = start["initial"], start["initial_rate"], np.array([0.3, 0.0, 0.0])

    def step(q: np.ndarray, qd: np.ndarray, torque: np.ndarray) -> Any:
        return fa.step_jacobian(arm, q, qd, torque, 2e-4, method=method)

    found = step(q, qd, torque)
    ends = [
        step(*fa.assembled(arm, q, qd + sign * 1e-3 * arm.rest([1.0, 0.0, 0.0]), held=[1])[:2],
             torque + sign * np.array([1e-3, 0.0, 0.0]))
        for sign in (1.0, -1.0)
    ]  # fmt: skip
    starts = [
        fa.assembled(arm, q, qd + sign * 1e-3 * arm.rest([1.0, 0.0, 0.0]), held=[1])
        for sign in (1.0, -1.0)
    ]
    before = np.concatenate([starts[0].q - starts[1].q, starts[0].qd - starts[1].qd])
    after = np.concatenate([ends[0].q - ends[1].q, ends[0].qd - ends[1].qd])
    predicted = found.state @ before + 2e-3 * found.torque[:, 0]
    np.testing.assert_allclose(predicted, after, rtol=0.0, atol=1e-6 * np.abs(after).max())
    with pytest.raises(fa.InputError, match="q must close the loops"):
        step(q + arm.rest([0.1, 0.0, 0.0]), qd, torque)
