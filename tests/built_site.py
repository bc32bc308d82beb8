"""The documentation site, built once for all tests of a session."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
#: The page that is run as a notebook here; `make docs FULL=1` runs all pages with plots.
NOTEBOOK = "tutorials/first-run.md"
_PACKAGES = ("sphinx", "myst_nb", "furo", "math_core", "ipykernel", "ziglang")
#: Seconds that one build may take on a busy machine.
_LONGEST = 1500


def built_site(factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the site's pages; parallel workers wait for the one that builds it."""
    for package in _PACKAGES:
        pytest.importorskip(package, reason="it comes with the extra: pip install 'flexarm[docs]'")
    shared = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent  # that of the session
    folder, report = shared / "site", shared / "site.log"
    try:
        (shared / "site.lock").mkdir()  # only one process can
    except FileExistsError:
        end = time.monotonic() + _LONGEST
        while not report.exists() and time.monotonic() < end:
            time.sleep(1.0)
    else:
        command = [sys.executable, "docs/site", str(folder), "--run", NOTEBOOK]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=_LONGEST)
        text = "" if done.returncode == 0 else done.stdout + done.stderr
        (shared / "site.part").write_text(text, encoding="utf-8")
        (shared / "site.part").rename(report)
    assert report.read_text(encoding="utf-8") == "", "the site is not built"
    return folder / "html"
