"""Start-up times of the package and its commands, and memory."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"


def _seconds(
    command: list[str], environment: Mapping[str, str] | None = None, folder: Path | None = None
) -> float:
    environment = dict(environment or os.environ)
    # Installers write bytecode. Without it, Python would compile 250 files at each start.
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    started = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True, env=environment, cwd=folder)
    return time.perf_counter() - started


def import_seconds(repeats: int = 5) -> float:
    """Return the time of ``import flexarm``, without the start of Python."""
    bare = min(_seconds([sys.executable, "-c", "pass"]) for _ in range(repeats))
    full = min(_seconds([sys.executable, "-c", "import flexarm"]) for _ in range(repeats))
    return full - bare


def help_seconds(repeats: int = 5) -> float:
    """Return the time of ``flexarm --help``, with the start of the process."""
    command = [sys.executable, "-m", "flexarm", "--help"]
    return min(_seconds(command) for _ in range(repeats))


class Wait(NamedTuple):
    """Elapsed time and CPU time (s) of a command."""

    wall: float
    processor: float


def warm_runs(repeats: int = 3) -> dict[str, Wait]:
    """Return the times of the commands with compiled kernels on disk.

    The minimum of several runs does not include compilation, even if the cache was empty before.
    """
    with tempfile.TemporaryDirectory() as folder:
        start = [sys.executable, "-m", "flexarm"]
        paper = [*start, "paper", "--out", str(Path(folder, "out"))]
        scenario = EXAMPLES / "paper.yaml"
        run = [*start, "run", str(scenario), "--out", str(Path(folder, "result.nc"))]
        return {
            "`flexarm paper`, kernels compiled": _least(paper, repeats),
            "`flexarm run examples/paper.yaml`, kernels compiled": _least(run, repeats),
        }


def _least(command: list[str], repeats: int) -> Wait:
    return min(wait(command) for _ in range(repeats))


def wait(
    command: list[str], environment: Mapping[str, str] | None = None, folder: Path | None = None
) -> Wait:
    """Time a command; environment and working folder are by default those of this process."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    wall = _seconds(command, environment, folder)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return Wait(wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def memory_megabytes(seconds: float = 60.0) -> dict[str, float]:
    """Return the peak memory (MB) after a short run, and its increase in a long run."""
    program = (
        "import resource, sys; import flexarm as fa, xarray\n"
        "from benchmarks.arms import table_one\n"
        "arm = table_one(); fa.simulate(arm, 0.01, initial=arm.rest([0.3, -0.5]))\n"
        "most = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024\n"
        "print(most())\n"
        f"fa.simulate(arm, {seconds}, initial=arm.rest([0.3, -0.5]), progress=False)\n"
        "print(most())"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True
    )
    before, after = map(float, done.stdout.split())
    return {
        "Python, the libraries and the compiled code": before,
        f"in addition, a run of {seconds:g} s at 1 kHz with all channels": after - before,
    }
