"""What a user waits for before anything moves: imports, help, first and second run."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def _seconds(command: list[str], environment: dict[str, str] | None = None) -> float:
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


def paper_seconds() -> tuple[float, float]:
    """Return the times of ``flexarm paper`` with an empty kernel cache and with a full one."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "XDG_CACHE_HOME": str(Path(folder, "cache"))}
        command = [sys.executable, "-m", "flexarm", "paper", "--out", str(Path(folder, "out"))]
        return _seconds(command, environment), _seconds(command, environment)
