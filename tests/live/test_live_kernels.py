"""Kernels as WebAssembly, run by Node: the numbers of the live pages are those of Python."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_pages import AS_PYTHON, COMPARED, LARGEST, PAGES, PLAYER, live_module, runs_of

import flexarm as fa

pytestmark = pytest.mark.thorough
#: Sliders that are set at the start, besides the values at which the page starts.
OTHERS = {
    "torques": {"first": -0.7, "second": 0.35},
    "spin": {"rate": 9.0},
    "shaping": {"payload": 0.3},
    "gains": {"proportional": 24.0, "derivative": 2.5, "sample": 5.0},
    "payload": {"mass": 0.8},
}
#: Sliders that the script of a page changes during the run.
LATER = {"payload": [(1.0, {"mass": 0.0})]}


def node(written: Path, jobs: list[dict[str, Any]]) -> list[Any]:
    """Return the runs of pages after some jobs."""
    program = shutil.which("node")
    if program is None:
        pytest.skip("no test of the kernels in WebAssembly: Node is not installed")
    script = Path(__file__).with_name("drive.js")
    command = [program, str(script), str(PLAYER), str(written), json.dumps(jobs)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    results: list[Any] = json.loads(done.stdout)
    return results


def assert_as_python(run: dict[str, Any], result: Any, arm: fa.Arm) -> None:
    """Compare the coordinates of the first seconds of a run of a page with a result of Python."""
    assert run["error"] == ""
    states = np.array(run["states"]).reshape(-1, 2, arm.assembly.bodies, 1 + arm.assembly.modes)
    q = np.array([arm.unpadded(state)[0] for state in states])
    count = round(COMPARED * live_module("scenes").RATE) + 1
    expected = result.q.values[:count]
    assert q.shape == expected.shape
    assert np.ptp(expected) > 0.01, "the arm must move"
    assert np.abs(q - expected).max() <= AS_PYTHON * np.abs(expected).max()


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
            assert_as_python(run, results[run["label"]], case.arguments.get("plant") or case.arm)
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
        scene = live_module("scenes").SCENES[page]
        cases = scene.cases(**{**scene.start(), **OTHERS[page]})
        for run in runs:
            case = cases[run["label"]]
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", fa.FlexarmWarning)
                result = fa.simulate(
                    case.arm, scene.duration, integrator="dormand_prince_8",
                    rate=live_module("scenes").RATE, **case.arguments,
                )  # fmt: skip
            assert_as_python(run, result, case.arguments.get("plant") or case.arm)


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
