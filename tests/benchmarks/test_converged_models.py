"""The benchmark of the models that `flexarm.converged` chooses runs and counts its errors."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import converged


def row(kind: str, error: float, warned: bool, cost: float) -> dict[str, object]:
    numbers = {"cost": cost, "study": 60.0, "seconds": 2.0}
    return {"kind": kind, "error": error, "warned": warned, **numbers}


def test_random_arms_are_those_of_their_seed() -> None:
    one, again, other = (converged.draw(seed) for seed in (4, 4, 5))
    assert one.arm.spec == again.arm.spec != other.arm.spec
    assert one.arm.n_joints == 1 + 4 % 3
    assert one.kind.endswith("no hub inertia")
    assert np.array_equal(one.torque(0.1), again.torque(0.1))


def test_summary_counts_errors_and_warnings() -> None:
    rows = [row("a", 0.5, False, 1.5), row("a", 0.9, False, 0.9), row("a", 2.0, True, np.nan)]
    text = converged.summary([*rows, row("a", 0.1, True, 9.0), row("a", 3.0, False, 1.0)])
    assert text.startswith(
        "5 arms: 2 accurate, 1 inaccurate and warned, 1 accurate and warned, "
        "1 inaccurate without a warning; cost over that of the best manual choice 1 (at most 1.5)"
    )


@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")  # of coarse manual choices
def test_choice_of_a_model_is_measured() -> None:
    """An arm with one link and Rayleigh damping, whose study takes less than a second."""
    found = converged.measure(6)
    assert not found["warned"]
    # The estimate contains a quarter of the accuracy for the reference, so it exceeds the error.
    assert 0.0 < found["error"] <= found["estimate"] <= 1.0
    assert 0.0 < found["cost"] < 3.0
    assert found["runs"] >= 3
