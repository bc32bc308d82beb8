"""The benchmark of many runs runs, small, and prints its table. No time is judged here."""

from __future__ import annotations

import re

import pytest

from benchmarks import programs, rollouts


@pytest.mark.thorough
def test_all_programs_find_the_same_motion() -> None:
    found = rollouts.rollouts(runs=9, few=2, repeats=1)
    assert len(found) == 7 - len({"MuJoCo", "JAX"} & set(programs.missing()))
    for one in found:
        # The goal is for this error; MuJoCo's bars are the least accurate.
        assert one.error < 1.3e-4, one
        assert one.rate > 0.0
    table = rollouts.table(found)
    assert re.search(r"\| flexarm, lanes, 2 threads \| .* \| \d.* \| \d.* \| 1 \|", table)


def test_every_program_has_the_same_starts() -> None:
    assert (rollouts.starts(5) == rollouts.starts(5)).all()
    assert tuple(rollouts.starts(5)[0]) == rollouts.CASE.joint_angles
    assert abs(rollouts.starts(50) - rollouts.CASE.joint_angles).max() <= 0.1
