"""The benchmark of first uses runs with small programs and prints its table.

Times are not checked.
"""

from __future__ import annotations

import re

from benchmarks.first_run import ALONE, FURTHER, Feature

from benchmarks import first_run, report
from flexarm.integrate import INTEGRATORS

#: The programs check the files in the cache instead of compiling, which would take minutes.
_LOOK = """
import os, pathlib, sys
if os.environ["FLEXARM_KERNELS"] == "library":
    sys.exit()
cache = pathlib.Path(os.environ["FLEXARM_CACHE"])
found = sorted(path.name for path in cache.iterdir()) if cache.exists() else []
assert found == {found}, found
cache.mkdir(exist_ok=True)
(cache / "{name}").touch()
"""


def feature_that_checks_the_cache(name: str, found: list[str]) -> Feature:
    return Feature(name, ("-c", _LOOK.format(name=name, found=found)), 4.0)


def test_each_feature_starts_with_the_expected_cache() -> None:
    base = feature_that_checks_the_cache("simulate", [])
    alone = [feature_that_checks_the_cache("paper", []), base]
    further = [
        feature_that_checks_the_cache("modes", ["simulate"]),
        feature_that_checks_the_cache("force", ["simulate"]),
    ]
    found = first_run.first_uses(alone, further, after=base)
    assert [one.feature.name for one in found] == ["paper", "simulate", "modes", "force"]
    assert all(0.0 < w.wall < 600.0 for one in found for w in (one.library, one.wait))
    table = report.first_run_table(found)
    assert re.search(r"\| modes (\| \d+\.\d\d ){4}\| 4 \|", table)


def test_programs_run_without_errors() -> None:
    """They run in one process, with the kernels that are already in the cache."""
    for feature in (*ALONE[1:], *FURTHER):
        option, program = feature.arguments
        assert option == "-c"
        exec(compile(program, feature.name, "exec"), {"__name__": "program"})


def test_features_include_every_integrator_and_have_goals() -> None:
    names = [feature.name for feature in FURTHER]
    assert [name for name in INTEGRATORS if f"integrator `{name}`" not in names] == []
    assert [feature.goal for feature in ALONE] == [15.0, 8.0]
    assert {feature.goal for feature in FURTHER} == {4.0}
