"""Faults that commissioning names: ``python tests/identification/measure_faults.py --help``.

For every bench, kind of fault and seed it prints whether a sentence names the planted fault, and
the sentences on others. A record without a fault is one kind.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import flexarm as fa
from data.bench_records import ONE, TWO
from data.geared_bench import THREE
from identification.faults import (
    FAULTS,
    UNSEEN,
    data_sheet,
    false_findings,
    faulty_record,
    names_fault,
)


def main(seeds: range, kinds: list[str], names: list[str], end: float) -> None:
    """Print a line for each record, seed by seed."""
    for seed in seeds:
        for bench in (ONE, TWO, THREE):
            for fault in kinds:
                if bench.name not in names or fault in UNSEEN[bench.name]:
                    continue
                started = time.process_time()
                measured = faulty_record(fault, seed, end, bench)
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    model = fa.commission(data_sheet(fault, seed, bench), measured, progress=False)
                named = names_fault(model, fault) if fault else True
                others = false_findings(model, fault)
                seconds = time.process_time() - started
                words = "named" if named else "MISSED"
                print(f"{bench.name}, {seed}, {fault or 'clean'}: {words}, {seconds:.0f} s", others)
                sys.stdout.flush()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--end", type=float, default=2.0, help="part of each record, s")
    parser.add_argument("--kinds", nargs="*", default=["", *FAULTS])
    parser.add_argument("--benches", nargs="*", default=[ONE.name, TWO.name])
    given = parser.parse_args()
    main(range(given.first, given.first + given.seeds), given.kinds, given.benches, given.end)
