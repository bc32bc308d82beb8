"""The benchmark of controllers runs, small, with every controller of the registry."""

from __future__ import annotations

from benchmarks import controllers
from flexarm.controllers import CONTROLLERS


def test_every_controller_is_measured() -> None:
    assert set(controllers.MAKERS) == set(CONTROLLERS), "add the newcomer to MAKERS"


def test_every_controller_runs_and_answers() -> None:
    found = controllers.microseconds(repeats=1, duration=0.02)
    assert [key for key in found if not key[1]] == [(name, "") for name in sorted(CONTROLLERS)]
    assert set(controllers.CONDITIONS) <= set(found)
    # Python takes longer than that to call anything, and no loop of 20 ticks lasts a minute.
    assert all(0.1 < value < 3e6 for value in found.values()), found
