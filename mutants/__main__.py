"""Put small errors into copies of the code and count how many the tests notice: `make mutants`.

A sample of fixed size for each area (``areas``, ``sample``); exit status 1 if the tests notice less
than nine in ten. `python -m mutants --only src/flexarm/cli/commands/run.py:60` tries all errors of
a line.
"""

from __future__ import annotations

import argparse
import itertools
import os
import queue
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from mutants.areas import AREAS, ROOT, Group
from mutants.sample import Mutant, mutants_at, sample

#: Share of mutants that the tests must notice.
REQUIRED = 0.9

#: A mutant may run this much longer than the unchanged code, plus some time on a busy machine.
_LONGER, _MORE_SECONDS = 3.0, 60.0

#: What pytest returns: all passed; a test failed; a module cannot be imported.
_PASSED, _FAILED, _INTERRUPTED = 0, 1, 2

#: Seconds that tests without a mutant are supposed to take at most.
_TRUSTED = 200.0

_NUMBERS = itertools.count(1)

#: Not copied: history, environments, caches and results.
_NOT_COPIED = shutil.ignore_patterns(".*", "__pycache__", "out", "dist", "build")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the mutants that the command line requests; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m mutants", description=__doc__)
    parser.add_argument("--area", action="append", choices=list(AREAS), help="repeatable")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", metavar="FILE:LINE", help="every mutant of one line")
    parser.add_argument(
        "--trust", action="store_true", help="do not run the tests without a mutant first"
    )
    parser.add_argument("--list", action="store_true", help="show the sample and run nothing")
    options = parser.parse_args(arguments)
    chosen = mutants_at(options.only) if options.only else sample(options.area or AREAS)
    if not chosen:
        parser.error(f"--only: no mutant at {options.only}")
    if options.list:
        print(*chosen, sep="\n")
        return 0
    with copies(options.workers) as places:
        return report(chosen, run_all(chosen, places, options.trust))


@contextmanager
def copies(count: int) -> Iterator[list[Path]]:
    """Copy the repository once for each worker."""
    with tempfile.TemporaryDirectory(prefix="flexarm-mutants-") as folder:
        places = [Path(folder) / str(number) for number in range(count)]
        for place in places:
            shutil.copytree(ROOT, place, ignore=_NOT_COPIED)
        yield places


def run_all(mutants: Sequence[Mutant], places: Sequence[Path], trust: bool) -> list[float]:
    """Return the seconds after which the tests noticed each mutant; inf if they did not.

    With ``trust``, the tests without a mutant are supposed to pass within minutes.
    """
    free: queue.SimpleQueue[Path] = queue.SimpleQueue()
    for place in places:
        free.put(place)

    def in_a_copy(job: Callable[[Path], float]) -> float:
        place = free.get()
        try:
            return job(place)
        finally:
            free.put(place)

    groups = list(dict.fromkeys(mutant.group for mutant in mutants))
    with ThreadPoolExecutor(len(places)) as pool:
        unchanged = pool.map(
            lambda group: _TRUSTED if trust else in_a_copy(lambda p: run_unchanged(group, p)),
            groups,
        )
        usual = dict(zip(groups, unchanged, strict=True))
        results = pool.map(
            lambda mutant: in_a_copy(lambda place: run_mutant(mutant, place, usual[mutant.group])),
            mutants,
        )
        return list(results)


def run_unchanged(group: Group, place: Path) -> float:
    """Return the seconds of a group's tests without a mutant.

    Raises:
        RuntimeError: if they fail, because then they would notice every mutant.
    """
    started = time.monotonic()
    code, text = run_tests(group, place, None)
    if code != _PASSED:
        raise RuntimeError(f"These tests fail without a mutant:\n{text}")
    seconds = time.monotonic() - started
    print(f"{seconds:6.0f} s without a mutant: {' '.join(group.tests)}", flush=True)
    return seconds


def run_mutant(mutant: Mutant, place: Path, usual: float) -> float:
    """Return the seconds after which the tests noticed a mutant; inf if they did not."""
    file = place / mutant.file
    original, before = file.read_bytes(), file.stat()
    file.write_text(mutant.applied(original.decode()), encoding="utf-8")
    # Python recognises compiled files by size and time in seconds: no two mutants share a time.
    os.utime(file, (before.st_atime, before.st_mtime + next(_NUMBERS)))
    started = time.monotonic()
    try:
        code, text = run_tests(mutant.group, place, _LONGER * usual + _MORE_SECONDS)
    finally:
        file.write_bytes(original)
        os.utime(file, (before.st_atime, before.st_mtime))
    seconds = time.monotonic() - started
    if code not in (_PASSED, _FAILED, _INTERRUPTED):
        raise RuntimeError(f"pytest ended with {code}:\n{text}")
    noticed = code != _PASSED
    print(f"{seconds:6.0f} s {'  noticed' if noticed else 'SURVIVED'}  {mutant}", flush=True)
    return seconds if noticed else float("inf")


def run_tests(group: Group, place: Path, seconds: float | None) -> tuple[int, str]:
    """Run a group's tests in a copy until one fails; a run that takes too long has failed."""
    tests = [f"tests/{name}" for name in group.tests]
    options = ("-x", "-q", "--no-header", "--tb=short", "-p", "no:cacheprovider")
    process = subprocess.Popen(
        [sys.executable, "-m", "pytest", *options, *tests],
        cwd=place,
        env={**os.environ, **group.environment, "PYTHONPATH": str(place / "src")},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,  # with its children, to end them together
    )
    try:
        text, _ = process.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        return _FAILED, "too long"
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
    return process.returncode, text


def report(mutants: Sequence[Mutant], seconds: Sequence[float]) -> int:
    """Print a table and the survivors; return 1 if too many survived."""
    survivors = [m for m, found in zip(mutants, seconds, strict=True) if found == float("inf")]
    print(f"\n{'area':<14}{'mutants':>8}{'noticed':>9}{'share':>8}")
    rows = {name: [m for m in mutants if m.area == name] for name in AREAS}
    for name, part in {**rows, "all": list(mutants)}.items():
        if part:
            noticed = sum(m not in survivors for m in part)
            print(f"{name:<14}{len(part):>8}{noticed:>9}{noticed / len(part):>8.0%}")
    if survivors:
        print("\nNot noticed:", *survivors, sep="\n")
    return int(len(survivors) > (1.0 - REQUIRED) * len(mutants))


if __name__ == "__main__":
    sys.exit(main())
