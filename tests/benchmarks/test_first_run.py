"""The benchmark of first uses runs, small, and prints its table. No time is judged here."""

from __future__ import annotations

import re

from benchmarks.first_run import ALONE, FURTHER, Feature

from benchmarks import first_run, report
from flexarm.integrate import INTEGRATORS

#: Programs say what they find in the cache, in place of compiling: that would be minutes.
_LOOK = """
import os, pathlib
cache = pathlib.Path(os.environ["XDG_CACHE_HOME"])
found = sorted(path.name for path in cache.iterdir()) if cache.exists() else []
assert found == {found}, found
cache.mkdir(exist_ok=True)
(cache / "{name}").touch()
"""


def looking(name: str, found: list[str]) -> Feature:
    return Feature(name, ("-c", _LOOK.format(name=name, found=found)), 4.0)


def test_each_begins_with_the_machine_code_that_it_may_find() -> None:
    base = looking("simulate", [])
    alone = [looking("paper", []), base]
    further = [looking("modes", ["simulate"]), looking("force", ["simulate"])]
    found = first_run.first_uses(alone, further, after=base)
    assert [one.feature.name for one in found] == ["paper", "simulate", "modes", "force"]
    assert all(0.0 < one.wait.wall < 600.0 for one in found)
    table = report.first_run_table(found)
    assert re.search(r"\| modes \| \d+\.\d\d \| \d+\.\d\d \| 4 \|", table)


def test_programs_run() -> None:
    """All in one process, with the kernels that this machine has compiled already."""
    for feature in (*ALONE[1:], *FURTHER):
        option, program = feature.arguments
        assert option == "-c"
        exec(compile(program, feature.name, "exec"), {"__name__": "program"})


def test_every_integrator_and_its_goal() -> None:
    names = [feature.name for feature in FURTHER]
    assert [name for name in INTEGRATORS if f"integrator `{name}`" not in names] == []
    assert [feature.goal for feature in ALONE] == [15.0, 8.0]
    assert {feature.goal for feature in FURTHER} == {4.0}
