"""The slowest files run first, in an order that does not depend on earlier runs."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from slowest import SLOWEST

TESTS = Path(__file__).parents[1]


@pytest.fixture
def suite(pytestconfig: pytest.Config) -> Any:
    """Return the conftest of the whole suite."""
    return pytestconfig.pluginmanager.getplugin(str(TESTS / "conftest.py"))


def test_every_file_of_the_list_exists() -> None:
    assert [name for name in SLOWEST if not (TESTS / name).is_file()] == []
    assert len(set(SLOWEST)) == len(SLOWEST)


def test_slow_files_come_first_and_the_others_stay_in_order(suite: Any) -> None:
    names = ("bridges/b.py", SLOWEST[1], "cli/a.py", SLOWEST[0], SLOWEST[1], "cli/a.py")
    items: list[Any] = [
        SimpleNamespace(
            path=TESTS / name, number=number, name="test", get_closest_marker=lambda marker: None
        )
        for number, name in enumerate(names)
    ]
    suite.pytest_collection_modifyitems(items)
    assert [item.number for item in items] == [3, 1, 4, 0, 2, 5]
