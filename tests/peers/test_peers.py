"""Independent programs converge to the same motion when they are refined.

They need the extra ``peers``; without it these tests are skipped. `make peers` prints distances.
For comparison: the linear theory is 4e-4 m from the second-order one on the Table I arm.
"""

from __future__ import annotations

import dataclasses
from functools import cache
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from peers.arms import PENDULUM, TABLE_ONE, Case, distance
from peers.flexarm_arm import tip

REASON = "the other programs come with an extra: pip install 'flexarm[peers]'"
pytestmark = pytest.mark.thorough


def peer(package: str, name: str) -> Any:
    """Return a fixture for a module of `peers`; its tests are skipped without the package."""

    def load() -> ModuleType:
        pytest.importorskip(package, reason=REASON)
        return import_module(f"peers.{name}")

    return pytest.fixture(name=name)(load)


exudyn = peer("exudyn", "exudyn_arm")
mujoco = peer("mujoco", "mujoco_arm")
pinocchio = peer("pinocchio", "pinocchio_arm")
drake = peer("pydrake", "drake_arm")
elastica = peer("elastica", "elastica_arm")
soromox = peer("soromox", "soromox_arm")


#: Half a second suffices to show that all programs simulate the same problem.
SHORT = [dataclasses.replace(case, duration=0.5, rate=100) for case in (TABLE_ONE, PENDULUM)]


@cache
def flexarm_tip(case: Case) -> np.ndarray:
    return tip(case)


@pytest.mark.parametrize(
    ("case", "tolerance"),
    [
        # flexarm is within 6e-6 m. From 8 elements to 16, with half the step, Exudyn's result
        # changes by about 5e-6 m on the arm and 2e-5 m on the pendulum, which is its remaining
        # error.
        pytest.param(TABLE_ONE, 2e-5, id="arm"),
        pytest.param(PENDULUM, 4e-5, id="pendulum"),
    ],
)
def test_exudyn_converges(exudyn_arm: ModuleType, case: Case, tolerance: float) -> None:
    ours = flexarm_tip(case)
    coarse = distance(exudyn_arm.tip(case, elements=4, step=1e-3), ours)
    fine = distance(exudyn_arm.tip(case, elements=8, step=2e-4), ours)
    assert fine < tolerance
    # A fifth of the step and half the element length: more than a factor of two, for any
    # combination of errors.
    assert fine < coarse / 2


def test_exudyn_with_exact_beams_is_as_accurate(exudyn_arm: ModuleType) -> None:
    """Four elements of order two are 2.4e-5 m from the exact solution, as the cables."""
    found = exudyn_arm.tip(TABLE_ONE, elements=4, step=1e-3, exact=True)
    assert distance(found, flexarm_tip(TABLE_ONE)) < 6e-5


@pytest.mark.parametrize("case", [TABLE_ONE, PENDULUM], ids=["arm", "pendulum"])
def test_mujoco_converges(mujoco_arm: ModuleType, case: Case) -> None:
    ours = flexarm_tip(case)
    coarse = mujoco_arm.tip(case, segments=8, step=2.5e-4)
    fine = mujoco_arm.tip(case, segments=16, step=5e-5)
    # Springs between bars have order two: a quarter, except for flexarm's own 6e-6 m.
    assert distance(fine, ours) < distance(coarse, ours) / 3
    # Without the square term, MuJoCo's next term remains: about 1e-5 m on the pendulum.
    assert distance(mujoco_arm.limit(coarse, fine), ours) < 2e-5


@pytest.mark.parametrize("case", SHORT, ids=["arm", "pendulum"])
@pytest.mark.parametrize(
    ("program", "setting"),
    [
        # Both have order 4 in their steps; MuJoCo keeps the torque constant in each of them.
        ("pinocchio_arm", {"step": 2.5e-4}),
        # With a tolerance of 1e-4 the difference is so small, on the Table I arm over 2 s as well.
        ("drake_arm", {"accuracy": 1e-4}),
    ],
)
def test_rigid_bars_have_the_same_motion_in_all_programs(
    program: str, setting: dict[str, float], mujoco_arm: ModuleType, case: Case, request: Any
) -> None:
    theirs = mujoco_arm.tip(case, segments=8, step=1e-4)
    found = request.getfixturevalue(program).tip(case, segments=8, **setting)
    assert distance(found, theirs) < 1e-6


@pytest.mark.parametrize(
    ("case", "elements"),
    [pytest.param(SHORT[0], (14, 10), id="arm"), pytest.param(SHORT[1], (10,), id="pendulum")],
)
def test_pyelastica_error_is_due_to_inertia(
    elastica_arm: ModuleType, case: Case, elements: tuple[int, ...]
) -> None:
    """Sections resist rotation by radius^2 / 4, masses at nodes by length^2 / 6."""
    ours = flexarm_tip(case)
    lengths = [h / count for h, count in zip(case.lengths, elements, strict=True)]
    finer = tuple(2 * count for count in elements)
    radius = 0.05
    coarse = distance(elastica_arm.tip(case, elements, radius, 1e-4), ours)
    fine = distance(elastica_arm.tip(case, finer, radius, 5e-5), ours)
    inertia = [radius**2 / 4 + (max(lengths) / split) ** 2 / 6 for split in (1, 2)]
    # Shear and stretch of the thick rod remain, and terms of higher order.
    assert fine / coarse == pytest.approx(inertia[1] / inertia[0], rel=0.2)


def test_soromox_converges(soromox_arm: ModuleType) -> None:
    """Segments of constant curvature: 3.4e-4 m with two on each link, 1.4e-4 m with four."""
    ours = flexarm_tip(SHORT[0])
    coarse, fine = (distance(soromox_arm.tip(SHORT[0], n, rtol=1e-4), ours) for n in (2, 4))
    assert fine < 2e-4
    assert fine < coarse / 2


def test_unstable_mujoco_run_is_an_error(
    mujoco_arm: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log to the working directory
    case = dataclasses.replace(TABLE_ONE, duration=0.5)
    with pytest.raises(RuntimeError, match="MuJoCo became unstable with 16 segments"):
        mujoco_arm.tip(case, segments=16, step=1e-3)


def test_unstable_pinocchio_run_is_an_error(pinocchio_arm: ModuleType) -> None:
    case = dataclasses.replace(TABLE_ONE, duration=0.5)
    with (
        np.errstate(all="ignore"),
        pytest.raises(RuntimeError, match="Pinocchio became unstable with 16 segments"),
    ):
        pinocchio_arm.tip(case, segments=16, step=1e-3)


def test_unstable_pyelastica_run_is_an_error(elastica_arm: ModuleType) -> None:
    case = dataclasses.replace(TABLE_ONE, duration=0.5, rate=100)
    with pytest.raises(RuntimeError, match="PyElastica became unstable"):
        elastica_arm.tip(case, (14, 10), 0.02, 1e-4)
