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
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from mutants.areas import AREAS
from mutants.groups import ROOT, Group
from mutants.sample import Mutant, mutants_at, sample

#: Share of mutants that the tests must notice.
REQUIRED = 0.9

#: A mutant may use this multiple of the processor time of the unchanged code, plus seconds for what
#: it compiles. The limit is on processor time, because a busy machine would stop more mutants.
_LONGER, _MORE_SECONDS = 3.0, 180.0
#: A mutant that only waits is stopped after this multiple of its processor time has passed. It
#: counts as not noticed, because the reason may be the machine.
_WAITING = 10.0

#: What pytest returns: all passed; a test failed; a module cannot be imported.
_PASSED, _FAILED, _INTERRUPTED = 0, 1, 2
#: What a stopped run returns: at the limit of processor time, or after too much waiting.
_ENDLESS, _WAITED = -signal.SIGXCPU, -signal.SIGKILL

#: Processor time that tests without a mutant are supposed to take at most, in seconds.
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
    """Return the processor time (s) until the tests noticed each mutant; inf if they did not.

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
    """Return the processor time of a group's tests without a mutant, in seconds.

    Raises:
        RuntimeError: if they fail, because then they would notice every mutant.
    """
    code, text, seconds = run_tests(group, place, None)
    if code != _PASSED:
        raise RuntimeError(f"These tests fail without a mutant:\n{text}")
    print(f"{seconds:6.0f} s without a mutant: {' '.join(group.tests)}", flush=True)
    return seconds


def run_mutant(mutant: Mutant, place: Path, usual: float) -> float:
    """Return the processor time until the tests noticed a mutant, in seconds; inf if they did not.

    A crash and an endless loop are noticed. ``usual`` is the time of the tests without a mutant.
    """
    file = place / mutant.file
    original, before = file.read_bytes(), file.stat()
    file.write_text(mutant.applied(original.decode()), encoding="utf-8")
    # Python recognises compiled files by size and time in seconds: no two mutants share a time.
    os.utime(file, (before.st_atime, before.st_mtime + next(_NUMBERS)))
    try:
        code, text, seconds = run_tests(mutant.group, place, _LONGER * usual + _MORE_SECONDS)
    finally:
        file.write_bytes(original)
        os.utime(file, (before.st_atime, before.st_mtime))
    if code > _INTERRUPTED:
        raise RuntimeError(f"pytest ended with {code}:\n{text}")
    noticed = code not in (_PASSED, _WAITED)
    words = {_PASSED: "SURVIVED", _WAITED: "WAITED", _ENDLESS: "endless"}.get(code, "noticed")
    print(f"{seconds:6.0f} s {words:>9}  {mutant}", flush=True)
    return seconds if noticed else float("inf")


def run_tests(group: Group, place: Path, limit: float | None) -> tuple[int, str, float]:
    """Run a group's tests in a copy until one fails; return code, output and processor time (s).

    ``limit`` is on the processor time of each process, in seconds.
    """
    # As plain Python, kernels are too slow for the runs among the wrong calls.
    messages = () if group.plain else ("messages",)
    tests = [f"tests/{name}" for name in (*group.tests, *messages)]
    options = ("-x", "-q", "--no-header", "--tb=short", "-p", "no:cacheprovider")
    command = [sys.executable, "-m", "pytest", *options, *tests]
    if limit is not None:
        command = ["sh", "-c", f'ulimit -S -t {limit:.0f}; exec "$@"', "sh", *command]
    with subprocess.Popen(
        command,
        cwd=place,
        env={**os.environ, **group.environment, "PYTHONPATH": str(place / "src")},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,  # with its children, to end them together
    ) as process:
        patience = threading.Timer(_WAITING * (limit or 0.0), _kill, (process,))
        if limit is not None:
            patience.start()
        try:
            assert process.stdout is not None
            text = process.stdout.read()
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        finally:
            patience.cancel()
            if process.returncode is None:  # interrupted
                _kill(process)
    return process.returncode, text, usage.ru_utime + usage.ru_stime


def _kill(process: subprocess.Popen[str]) -> None:
    os.killpg(process.pid, signal.SIGKILL)


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
