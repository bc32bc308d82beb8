"""Coverage of the stated intervals: ``python tests/identification/measure_coverage.py --help``.

For every bench and every seed of the noise, the arm starts with parameters that are wrong by up to
20 %. The script prints the share of 95 % intervals that contain the true value, for each parameter
and for all of them, and the time of a fit. A second fit of each seed also frees parameters that the
record cannot determine; the script counts the seeds in which exactly these are reported.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import flexarm as fa
from data.bench_records import ONE, TWO
from data.geared_bench import THREE
from identification.benches import FREE, OPTIONS, believed, names_unclear, record, truth

#: Part of each record that is fitted, and part that is fitted with unclear parameters (s).
END, SHORT = 3.0, 1.5


def main(seeds: range, names: list[str], elements: int) -> None:
    """Print the coverage for each bench."""
    for bench in (ONE, TWO, THREE):
        if names and bench.name not in names:
            continue
        free, scores, seconds, determined, named = FREE[bench.name], [], [], 0, 0
        for seed in seeds:
            arm = believed(bench, seed, elements)
            measured = record(bench.name, seed, end=END)
            started = time.perf_counter()
            options = OPTIONS.get(bench.name, {})
            found = fa.identify(arm, measured, free, progress=False, **options)
            seconds.append(time.perf_counter() - started)
            determined += not found.undetermined
            named += names_unclear(found.arm, bench, record(bench.name, seed, end=SHORT))
            deviations = found.parameters["standard_deviation"].values
            estimates = np.array([found[path] for path in free])
            scores.append((estimates - [truth(bench, path) for path in free]) / deviations)
        table = np.abs(np.array(scores))
        covered = table < 1.96
        print(f"{bench.name}: {100 * covered.mean():.1f} % of {covered.size} intervals,", end=" ")
        print(f"largest error {table.max():.2f} deviations, all determined in {determined} seeds,")
        print(f"unclear parameters named in {named} of {len(seeds)},", end=" ")
        print(f"median time of a fit {np.median(seconds):.2f} s")
        for k, path in enumerate(free):
            mean = np.mean(np.array(scores)[:, k])
            print(f"  {path}: {100 * covered[:, k].mean():.0f} %, mean {mean:+.2f} deviations")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Coverage of the stated intervals.")
    parser.add_argument("seeds", nargs="?", type=int, default=50, help="number of seeds")
    parser.add_argument(
        "benches", nargs="*", help="bench_one_link, bench_two_links, bench_geared_link; all"
    )
    parser.add_argument("--elements", type=int, default=3, help="of each link")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    given = parser.parse_args()
    chosen = range(given.first, given.first + given.seeds)
    main(chosen, given.benches, given.elements)
