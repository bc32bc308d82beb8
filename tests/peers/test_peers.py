"""Independent programs arrive at the same motion, the closer the finer they are set.

They need the extra ``peers``; without it these tests are skipped. `make peers` prints distances.
For scale: the linear theory is 4e-4 m from the second-order one on the Table I arm.
"""

from __future__ import annotations

import dataclasses
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from peers.arms import PENDULUM, TABLE_ONE, Case, distance
from peers.flexarm_arm import tip

REASON = "the other programs come with an extra: pip install 'flexarm[peers]'"


@pytest.fixture
def exudyn_arm() -> ModuleType:
    pytest.importorskip("exudyn", reason=REASON)
    from peers import exudyn_arm

    return exudyn_arm


@pytest.fixture
def mujoco_arm() -> ModuleType:
    pytest.importorskip("mujoco", reason=REASON)
    from peers import mujoco_arm

    return mujoco_arm


@cache
def flexarm_tip(case: Case) -> np.ndarray:
    return tip(case)


@pytest.mark.parametrize(
    ("case", "tolerance"),
    [
        # flexarm is within 6e-6 m. From 8 elements to 16, with half the step, Exudyn moves by
        # about 5e-6 m on the arm and 2e-5 m on the pendulum, which is what it is still off.
        pytest.param(TABLE_ONE, 2e-5, id="arm"),
        pytest.param(PENDULUM, 4e-5, id="pendulum"),
    ],
)
def test_exudyn_comes_closer(exudyn_arm: ModuleType, case: Case, tolerance: float) -> None:
    ours = flexarm_tip(case)
    coarse = distance(exudyn_arm.tip(case, elements=4, step=1e-3), ours)
    fine = distance(exudyn_arm.tip(case, elements=8, step=2e-4), ours)
    assert fine < tolerance
    # Steps a fifth as long and half the element: more than twice, however the errors combine.
    assert fine < coarse / 2


@pytest.mark.parametrize("case", [TABLE_ONE, PENDULUM], ids=["arm", "pendulum"])
def test_mujoco_tends_to_the_same_path(mujoco_arm: ModuleType, case: Case) -> None:
    ours = flexarm_tip(case)
    coarse = mujoco_arm.tip(case, segments=8, step=2.5e-4)
    fine = mujoco_arm.tip(case, segments=16, step=5e-5)
    # Springs between bars are of second order: a quarter, but for flexarm's own 6e-6 m.
    assert distance(fine, ours) < distance(coarse, ours) / 3
    # The square removed, MuJoCo's next term is left: about 1e-5 m on the pendulum.
    assert distance(mujoco_arm.limit(coarse, fine), ours) < 2e-5


def test_an_unstable_peer_is_no_witness(
    mujoco_arm: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log where it runs
    case = dataclasses.replace(TABLE_ONE, duration=0.5)
    with pytest.raises(RuntimeError, match="MuJoCo became unstable with 16 segments"):
        mujoco_arm.tip(case, segments=16, step=1e-3)
