"""Kernels as WebAssembly, run by Node: the numbers of the live pages are those of Python."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from live_pages import (
    COMPARED,
    LARGEST,
    OTHERS,
    PAGES,
    PLAYER,
    assert_as_python,
    live_module,
    runs_of,
    simulated,
    written_pages,
)

pytestmark = pytest.mark.thorough
#: Sliders that the script of a page changes during the run.
LATER = {"payload": [(1.0, {"mass": 0.0})]}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the files of all live pages."""
    return written_pages(tmp_path_factory.mktemp("live"))


def node(written: Path, jobs: list[dict[str, Any]]) -> list[Any]:
    """Return the runs of pages after some jobs."""
    program = shutil.which("node")
    if program is None:
        pytest.skip("no test of the kernels in WebAssembly: Node is not installed")
    script = Path(__file__).with_name("live_runs.js")
    command = [program, str(script), str(PLAYER), str(written), json.dumps(jobs)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    results: list[Any] = json.loads(done.stdout)
    return results


def test_kernels_are_small(written: Path) -> None:
    text = re.search(r'kernels = "(.*)"', (written / "kernels.js").read_text(encoding="utf-8"))
    assert text is not None
    assert 50_000 < len(base64.b64decode(text[1])) < LARGEST


def test_runs_at_the_start_are_those_of_the_script_of_the_page(written: Path) -> None:
    jobs = [
        {"page": page, "sliders": {}, "times": LATER.get(page, []), "last": COMPARED}
        for page in PAGES
    ]
    scenes = live_module("scenes").SCENES
    assert sorted(scenes) == PAGES
    for page, runs in zip(PAGES, node(written, jobs), strict=True):
        results = runs_of(page)
        assert [run["label"] for run in runs] == list(results)
        cases = scenes[page].cases(**scenes[page].start())
        for run in runs:
            case = cases[run["label"]]
            assert run["error"] == ""
            assert_as_python(run["states"], results[run["label"]], case)
            bent = 1e3 * results[run["label"]].link_tip_deflection.values
            shown = np.array(run["traces"][-1])
            link = scenes[page].traces[-1].link - 1
            # The deflection is a sum over modes that are larger than it.
            assert np.abs(shown - bent[: len(shown), link]).max() <= 1e-9 * np.abs(bent).max()


def test_sliders_set_the_numbers_of_python(written: Path) -> None:
    jobs = [
        {"page": page, "sliders": OTHERS[page], "times": [], "last": COMPARED} for page in PAGES
    ]
    for page, runs in zip(PAGES, node(written, jobs), strict=True):
        for run, (case, result) in zip(runs, simulated(page, OTHERS[page]), strict=True):
            assert run["error"] == ""
            assert_as_python(run["states"], result, case)


def test_a_run_that_grows_without_bound_stops_with_a_reason(written: Path) -> None:
    sliders = {"proportional": 60.0, "derivative": 12.0, "sample": 40.0}
    job = {"page": "gains", "sliders": sliders, "times": [], "last": 4.0}
    ((run,),) = node(written, [job])
    assert run["error"] == "A link bends beyond the theory."
    assert len(run["traces"][0]) < 4.0 * live_module("scenes").RATE


def test_a_slider_acts_at_once_or_restarts_the_run(written: Path) -> None:
    times = [(1.0, {"mass": 0.2}), (1.5, {"mass": 0.6})]
    jobs = [
        {"page": "payload", "sliders": {}, "times": times[:1], "last": 1.5},
        {"page": "payload", "sliders": {}, "times": times, "last": 1.5},
        {"page": "payload", "sliders": {"mass": 0.6}, "times": [], "last": 1.5},
    ]
    lighter, restarted, heavy = (np.array(runs[0]["states"]) for runs in node(written, jobs))
    assert np.ptp(lighter[:240, 0]) < 1e-9 < np.ptp(lighter[:, 0])  # at rest up to the change
    assert np.array_equal(restarted, heavy)
