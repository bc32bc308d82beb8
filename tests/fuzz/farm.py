"""Random cases in parts of ten minutes, whose counts it writes to docs/reliability.md.

    python tests/fuzz/farm.py arms equations --seed 2 --minutes 10
    python tests/fuzz/farm.py arms --seed 2 --case 17   # one case again

``make fuzz`` runs it. A case follows from its part, the seed and its number alone, so that a
defect is repeated by these. The time limits the number of cases.
"""

from __future__ import annotations

import argparse
import re
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import chdir, contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "tests")]

PAGE = ROOT / "docs" / "reliability.md"
#: Seconds after which a case is interrupted, as by Ctrl-C, and counted as such.
PATIENCE = 60.0


class Part(NamedTuple):
    """Cases of one kind.

    Attributes:
        meaning: what is tried, and what is right.
        case: function of a random generator and the number of the case; raises for a defect.
    """

    meaning: str
    case: Callable[[np.random.Generator, int], None]


def parts() -> dict[str, Part]:
    """Return all parts by name."""
    from fuzz import arm_cases, call_cases, dependency_cases, fault_cases, file_cases

    return (
        call_cases.PARTS
        | file_cases.PARTS
        | arm_cases.PARTS
        | fault_cases.PARTS
        | dependency_cases.PARTS
    )


@contextmanager
def interrupted_after(seconds: float) -> Iterator[None]:
    """Raise KeyboardInterrupt once in the block after some time, where the system has timers."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    if not hasattr(signal, "setitimer"):
        yield
        return
    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def run_case(name: str, part: Part, seed: int, number: int) -> None:
    """Run one case in an empty folder."""
    rng = np.random.default_rng([seed, number, *name.encode()])
    with (
        tempfile.TemporaryDirectory() as folder,
        chdir(folder),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore")
        part.case(rng, number)


def run_part(name: str, part: Part, seed: int, seconds: float) -> Counter[str]:
    """Run cases for some time; print the defects and return the counts."""
    counts: Counter[str] = Counter()
    started = time.monotonic()
    while time.monotonic() - started < seconds:
        number = counts.total()
        try:
            with interrupted_after(PATIENCE):
                run_case(name, part, seed, number)
            counts["right"] += 1
        except KeyboardInterrupt:
            counts["interrupted"] += 1
            print(f"{name} --seed {seed} --case {number}: no end in {PATIENCE:g} s", flush=True)
        except StopIteration:
            break
        except Exception as error:
            counts["defects"] += 1
            notes = "; ".join(getattr(error, "__notes__", []))
            text = traceback.format_exception_only(error)[-1].strip()[:600]
            print(f"{name} --seed {seed} --case {number}: {notes} {text}", flush=True)
    return counts


def row(name: str, part: Part, seed: str, version: str, counts: Counter[str]) -> str:
    """Return the row of a part in the table of the page."""
    cells = [f"`{name}`", part.meaning, version, seed, str(counts.total())]
    cells += [str(counts["defects"]), str(counts["interrupted"])]
    return f"| {' | '.join(cells)} |"


def write_row(name: str, text: str) -> None:
    """Replace the row of a part in the table of the page."""
    page = PAGE.read_text()
    changed, count = re.subn(rf"^\| `{name}` \|.*$", lambda _: text, page, flags=re.MULTILINE)
    if count != 1:
        raise SystemExit(f"{PAGE} has {count} rows of {name}")
    PAGE.write_text(changed)


def main() -> None:
    """Run the parts of the command line."""
    known = parts()
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("parts", nargs="*", choices=[[], *known], help="default: all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--case", type=int, help="repeat this case and show its traceback")
    parser.add_argument("--write", action="store_true", help="write the counts to the page")
    options = parser.parse_args()
    import flexarm as fa

    defects = 0
    for name in options.parts or known:
        if options.case is not None:
            run_case(name, known[name], options.seed, options.case)
            continue
        counts = run_part(name, known[name], options.seed, 60.0 * options.minutes)
        print(f"{name}: {counts.total()} cases, {dict(counts)}", flush=True)
        defects += counts["defects"]
        if options.write:
            seed = str(options.seed)
            write_row(name, row(name, known[name], seed, fa.__version__, counts))
    sys.exit(bool(defects))


if __name__ == "__main__":
    main()
