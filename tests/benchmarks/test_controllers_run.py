"""The benchmark of controllers measures every controller of the registry."""

from __future__ import annotations

from benchmarks import controllers
from flexarm.control.laws import CONTROLLERS


def test_every_maker_is_of_a_controller() -> None:
    assert set(controllers.MAKERS) <= set(CONTROLLERS)


def test_every_controller_has_a_plausible_time() -> None:
    found = controllers.microseconds(repeats=1, duration=0.02)
    assert [key for key in found if not key[1]] == [(name, "") for name in sorted(CONTROLLERS)]
    assert set(controllers.CONDITIONS) <= set(found)
    # A call from Python takes longer than 0.1 us, and a loop of 20 samples takes less than a
    # minute.
    assert all(0.1 < value < 3e6 for value in found.values()), found
