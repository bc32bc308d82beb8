"""What a user waits for before anything moves, and the memory it takes."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"


def _seconds(command: list[str], environment: dict[str, str] | None = None) -> float:
    environment = dict(environment or os.environ)
    # Installers write bytecode. Without it, 250 files would be compiled anew at each start.
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    started = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True, env=environment)
    return time.perf_counter() - started


def import_seconds(repeats: int = 5) -> float:
    """Return the time that ``import flexarm`` adds to starting Python."""
    bare = min(_seconds([sys.executable, "-c", "pass"]) for _ in range(repeats))
    full = min(_seconds([sys.executable, "-c", "import flexarm"]) for _ in range(repeats))
    return full - bare


def help_seconds(repeats: int = 5) -> float:
    """Return the time of ``flexarm --help``, process start included."""
    command = [sys.executable, "-m", "flexarm", "--help"]
    return min(_seconds(command) for _ in range(repeats))


class Wait(NamedTuple):
    """How long a command takes: by the clock, and of one processor (idle machines: the same)."""

    wall: float
    processor: float


def first_runs(repeats: int = 3, cache: Path | None = None) -> dict[str, Wait]:
    """Return what the commands take with an empty kernel cache and with a full one.

    ``cache``: a folder to begin with instead of an empty one, where nothing is to be measured.
    """
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "XDG_CACHE_HOME": str(cache or Path(folder, "cache"))}
        start = [sys.executable, "-m", "flexarm"]
        paper = [*start, "paper", "--out", str(Path(folder, "out"))]
        scenario = EXAMPLES / "paper.yaml"
        run = [*start, "run", str(scenario), "--out", str(Path(folder, "result.nc"))]
        first = _wait(paper, environment)
        _wait(run, environment)
        return {
            "`flexarm paper`, the first time on a machine, all compilation included": first,
            "`flexarm paper`, from then on": _least(paper, environment, repeats),
            "`flexarm run examples/paper.yaml`, from then on": _least(run, environment, repeats),
        }


def _least(command: list[str], environment: dict[str, str], repeats: int) -> Wait:
    return min(_wait(command, environment) for _ in range(repeats))


def _wait(command: list[str], environment: dict[str, str]) -> Wait:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    wall = _seconds(command, environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return Wait(wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def memory_megabytes(seconds: float = 60.0) -> dict[str, float]:
    """Return the most memory that a process held after the imports, and with a long run."""
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
        f"more for a run of {seconds:g} s at 1 kHz, every channel kept": after - before,
    }
