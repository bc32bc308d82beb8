"""Live pages of the documentation: their files, and the modules that write them."""

from __future__ import annotations

import importlib.util
import re
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexarm as fa

ROOT = Path(__file__).resolve().parents[1]
PLAYER = ROOT / "docs" / "site" / "static" / "live.js"
STYLE = PLAYER.with_suffix(".css")
PAGES = sorted(path.stem for path in (ROOT / "docs" / "live").glob("*.md"))
#: Size of the kernels in bytes that a page may load.
LARGEST = 600_000
#: Difference of coordinates from those of Python over the largest of them: the instructions of
#: WebAssembly round products and sums separately, which two seconds of motion amplify.
AS_PYTHON = 1e-12
#: Interval of the comparison, s.
COMPARED = 2.0
#: Values of the sliders besides those at which the pages start.
OTHERS = {
    "torques": {"first": -0.7, "second": 0.35},
    "spin": {"rate": 9.0},
    "shaping": {"payload": 0.3},
    "gains": {"proportional": 24.0, "derivative": 2.5, "sample": 5.0},
    "payload": {"mass": 0.8},
}


def live_module(name: str) -> Any:
    """Return a module of ``docs/site/live``."""
    folder = str(ROOT / "docs" / "site")
    if folder not in sys.path:
        sys.path.append(folder)
    return importlib.import_module(f"live.{name}")


def written_pages(folder: Path) -> Path:
    """Write the kernels, the memory of all pages and a plain page for each into a folder."""
    if importlib.util.find_spec("ziglang") is None:
        pytest.skip("no test of live pages: ziglang comes with the extra flexarm[docs]")
    live_module("build").write(folder)
    for name in PAGES:
        scripts = ("kernels.js", f"{name}.js", PLAYER.as_uri())
        tags = "".join(f'<script defer src="{source}"></script>' for source in scripts)
        head = (
            f'<!doctype html><meta charset="utf-8"><link rel="stylesheet" href="{STYLE.as_uri()}">'
        )
        box = f'<body><div class="live" data-scene="{name}"></div>'
        (folder / f"{name}.html").write_text(f"{head}{box}{tags}", encoding="utf-8")
    return folder


def script_of(page: str) -> str:
    """Return the Python code of a live page."""
    text = (ROOT / "docs" / "live" / f"{page}.md").read_text(encoding="utf-8")
    match = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    assert match is not None
    return match[1]


def runs_of(page: str) -> dict[str, Any]:
    """Execute the code of a live page; return its runs by label."""
    scope: dict[str, Any] = {}
    exec(script_of(page), scope)
    runs: dict[str, Any] = scope["runs"]
    return runs


def simulated(page: str, sliders: dict[str, float]) -> list[tuple[Any, Any]]:
    """Return the cases of a page for some sliders, with their results from Python."""
    scenes = live_module("scenes")
    scene = scenes.SCENES[page]
    results = []
    for case in scene.cases(**{**scene.start(), **sliders}).values():
        options = {"integrator": "dormand_prince_8", "rate": scenes.RATE, **case.arguments}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fa.FlexarmWarning)
            results.append((case, fa.simulate(case.arm, scene.duration, **options)))
    return results


def assert_as_python(states: Any, result: Any, case: Any) -> None:
    """Compare the states of the first seconds of a run of a page with a result of Python."""
    arm = case.arguments.get("plant") or case.arm
    rows = np.reshape(states, (-1, 2, arm.assembly.bodies, 1 + arm.assembly.modes))
    q = np.array([arm.unpadded(row)[0] for row in rows])
    expected = result.q.values[: round(COMPARED * live_module("scenes").RATE) + 1]
    assert q.shape == expected.shape
    assert np.ptp(expected) > 0.01, "the arm must move"
    assert np.abs(q - expected).max() <= AS_PYTHON * np.abs(expected).max()
