"""Trees, sliding joints, bases and closures against material points and dense matrices."""

from __future__ import annotations

import numpy as np
import pytest

import flexarm as fa
from oracles.mechanisms import oracle_of
from random_mechanisms import random_mechanism, random_motion

#: Rounding of forces over the largest product of the mass matrix and the accelerations. Mass
#: matrices have conditions up to 1e7, so that accelerations themselves may differ by more.
FORCES = 1e-11
#: Closure forces follow from accelerations: the same, times the condition of J M^-1 J'.
CLOSURE_FORCES = 1e-9


def relative(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference over the largest number."""
    return float(np.abs(found - expected).max(initial=0.0) / np.abs(expected).max(initial=1e-300))


def angular(arm: fa.Arm) -> np.ndarray:
    """Whether each row of the closures is an angle."""
    rows = {"pin": [False] * 2, "weld": [False, False, True], "line": [False], "curve": [False]}
    return np.concatenate([rows[closure.kind] for closure in arm.spec.closures]).astype(bool)


def wrapped(angle: np.ndarray) -> np.ndarray:
    """Angles without whole turns."""
    return angle - 2 * np.pi * np.round(angle / (2 * np.pi))


@pytest.mark.parametrize("theory", ["linear", "second_order"])
@pytest.mark.parametrize("closures", ["", "straight", "curved"])
@pytest.mark.parametrize("seed", [*range(12), 13, 44])
def test_recursion_agrees_with_material_points(seed: int, closures: str, theory: str) -> None:
    curved = closures == "curved"
    fields = random_mechanism(seed, closures=bool(closures), curved=curved, theory=theory)
    arm = fa.Arm(**fields)
    oracle = oracle_of(arm)
    q, qd, torque = random_motion(np.random.default_rng(seed), oracle)
    if curved:  # near the curve, where the nearest point is unique
        q *= 0.02
    expected = oracle.at(q, qd, torque)

    assert relative(arm.mass_matrix(q), expected.mass) < 1e-12
    error = arm.forward_dynamics(q, qd, torque) - expected.acceleration
    largest = np.abs(expected.mass) @ np.abs(expected.acceleration)
    assert np.abs(expected.mass @ error).max() < FORCES * largest.max()
    energy = arm.energy(q, qd)
    assert energy.kinetic == pytest.approx(expected.kinetic, rel=1e-11)
    assert energy.strain == pytest.approx(expected.strain, rel=1e-11)
    assert arm.tip(q)[:2] == pytest.approx(expected.tips[-1, :2], rel=1e-11)
    if closures:
        gaps = np.where(angular(arm), wrapped(expected.gap), expected.gap)
        assert arm.closure_gaps(q) == pytest.approx(gaps, abs=1e-12 * max(1.0, arm.lengths.sum()))
        assert relative(arm.closure_jacobian(q), expected.gap_jacobian) < 1e-12
        forces = arm.closure_forces(q, qd, torque)
        assert relative(forces, expected.closure_force) < CLOSURE_FORCES
