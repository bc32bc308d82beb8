"""The work-precision figure of the page "Accuracy": its script runs with a small
problem."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from docs_pages import ROOT

from flexarm.integrate import INTEGRATORS

FOLDER = ROOT / "docs" / "performance"


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    monkeypatch.syspath_prepend(FOLDER)
    import draw_work_precision

    yield draw_work_precision
    for name in ("draw_work_precision", "measure_integrators"):
        sys.modules.pop(name, None)


@pytest.mark.thorough
def test_every_integrator_is_measured_and_drawn(script: ModuleType, tmp_path: Path) -> None:
    case = script.Case(script.BASES[0], duration=0.1)
    points = script.measure(case, repeats=2, tolerances=(1e-4, 1e-6), steps=(2e-3, 5e-4))
    assert {point.integrator for point in points} == set(INTEGRATORS)
    for name in INTEGRATORS:
        own = sorted((p for p in points if p.integrator == name), key=lambda p: -p.setting)
        assert all(point.seconds > 0.0 for point in own)
        if INTEGRATORS[name].order >= 6 and len(own) == 1:
            continue  # the finer step is as accurate as the reference, and is left out
        coarse, fine = own
        assert fine.error < coarse.error, name
    assert all(len(basis.arm().lengths) == 2 for basis in script.BASES)
    script.draw(tmp_path / "figure.png", {"one": points, "none": []})
    assert (tmp_path / "figure.png").stat().st_size > 10_000


def test_failed_runs_and_the_reference_itself_are_left_out(script: ModuleType) -> None:
    case = script.Case(script.BASES[0], duration=0.1)
    assert case.measured("rk4", 0.05) is None  # far too long a step
    assert case.measured("dormand_prince_8", 1e-11) is None  # the reference itself
