"""Coverage of the stated intervals: ``python tests/identification/measure_coverage.py --help``.

For every bench and every seed of the noise, the arm starts with parameters that are wrong by up to
20 %. The script prints the share of 95 % intervals that contain the true value, for each parameter
and for all of them, and the time of a fit. A second fit of each seed also frees parameters that the
record cannot determine; the script counts the seeds in which exactly these are reported.

With ``--rough`` the joints have friction that the model lacks, and the errors of the readings are
correlated over time.

With ``--halves`` the two halves of each record are fitted, and the script prints how often the
estimates of both agree within their intervals, and contain the true values.

With ``--first-order`` it does not fit: one Gauss-Newton step from the true values gives the
estimates of every seed, and the bias without noise, in seconds.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import flexarm as fa
from data.bench_records import ONE, TWO, Bench
from data.geared_bench import THREE
from flexarm.identification.fitting import FitProblem
from flexarm.identification.runs import RecordRun
from flexarm.identification.space import Space, check_free
from identification.benches import (
    FREE,
    MESH,
    NOISE,
    OPTIONS,
    arm_of,
    believed,
    names_unclear,
    record,
    rough_record,
    truth,
)  # fmt: skip

#: Part of each record that is fitted, and part that is fitted with unclear parameters (s).
END, SHORT = 3.0, 1.5


def main(seeds: range, names: list[str], elements: int | None, rough: bool = False) -> None:
    """Print the coverage for each bench."""
    for bench in (ONE, TWO, THREE):
        if names and bench.name not in names:
            continue
        free, scores, seconds, determined, named = FREE[bench.name], [], [], 0, 0
        for seed in seeds:
            arm = believed(bench, seed, elements)
            measured = (rough_record if rough else record)(
                bench if rough else bench.name, seed, end=END
            )
            started = time.perf_counter()
            options = OPTIONS.get(bench.name, {})
            found = fa.identify(arm, measured, free, progress=False, **options)
            seconds.append(time.perf_counter() - started)
            determined += not found.undetermined
            if not rough:
                named += names_unclear(found.arm, bench, record(bench.name, seed, end=SHORT))
            deviations = found.parameters["standard_deviation"].values
            estimates = np.array([found[path] for path in free])
            scores.append((estimates - [truth(bench, path) for path in free]) / deviations)
        show(bench, np.array(scores))
        print(f"  all determined in {determined} seeds,", end=" ")
        print(f"unclear parameters named in {named} of {len(seeds)},", end=" ")
        print(f"median time of a fit {np.median(seconds):.2f} s")


def halves(seeds: range, names: list[str], elements: int | None) -> None:
    """Print the agreement of the halves of rough records, and the coverage of both."""
    for bench in (ONE, TWO):
        if names and bench.name not in names:
            continue
        free, differences, scores = FREE[bench.name], [], []
        true = np.array([truth(bench, path) for path in free])
        for seed in seeds:
            arm, found = believed(bench, seed, elements), []
            for part in ({"end": END}, {"start": END, "initial": "estimate"}):
                measured = rough_record(bench, seed, **part)
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    fit = fa.identify(arm, measured, free, progress=False)
                table = fit.parameters
                found.append((table["estimate"].values, table["standard_deviation"].values))
            (first, one), (second, two) = found
            differences.append((first - second) / np.hypot(one, two))
            scores += [(first - true) / one, (second - true) / two]
            print(seed, np.round(differences[-1], 1), np.round(scores[-2:], 1), flush=True)
        print("halves against each other:")
        show(bench, np.array(differences))
        print("both against the true values:")
        show(bench, np.array(scores))


def first_order(seeds: range, names: list[str], elements: int | None) -> None:
    """Print the coverage for each bench, to first order in noise and errors of the mesh."""
    for bench in (ONE, TWO, THREE):
        if names and bench.name not in names:
            continue
        arm = arm_of(bench, elements or MESH[bench.name])
        noise = {channel: NOISE[channel] for channel in ("joint_angle", "strain")}

        def run_of(seed: int | None, arm=arm, bench=bench, noise=noise) -> RecordRun:
            measured = record(bench.name, seed, end=END, noise=noise)
            return RecordRun(bench.name, measured, arm, OPTIONS.get(bench.name, {}))

        clean = run_of(None)
        space = Space(arm, None, check_free(FREE[bench.name]), {clean.name: clean.record})
        problem = FitProblem(space, [clean], None)
        rows = problem.rows(problem.scaled(space.start))
        (outputs,) = problem.outputs(space.start)
        step = -np.linalg.pinv(rows)  # the rows are derivatives of the residuals
        deviations = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))

        def score(run, problem=problem, outputs=outputs, step=step, size=deviations) -> np.ndarray:
            residuals = problem.whitened(0, run.measured - outputs)[run.valid]
            return (step @ residuals / size)[: len(problem.space.slots)]

        count = len(FREE[bench.name])
        show(bench, np.array([score(run_of(seed))[:count] for seed in seeds]))
        print("  without noise:", np.round(score(clean)[:count], 2))


def show(bench: Bench, scores: np.ndarray) -> None:
    """Print the coverage of errors (seeds, parameters) in standard deviations."""
    covered = np.abs(scores) < 1.96
    print(f"{bench.name}: {100 * covered.mean():.1f} % of {covered.size} intervals,", end=" ")
    print(f"largest error {np.abs(scores).max():.2f} deviations")
    for k, path in enumerate(FREE[bench.name]):
        mean = scores[:, k].mean()
        print(f"  {path}: {100 * covered[:, k].mean():.0f} %, mean {mean:+.2f} deviations")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Coverage of the stated intervals.")
    parser.add_argument("seeds", nargs="?", type=int, default=50, help="number of seeds")
    parser.add_argument(
        "benches", nargs="*", help="bench_one_link, bench_two_links, bench_geared_link; all"
    )
    parser.add_argument("--elements", type=int, help="of each link; by default MESH")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--first-order", action="store_true", help="do not fit")
    parser.add_argument("--rough", action="store_true", help="friction and coloured errors")
    parser.add_argument("--halves", action="store_true", help="halves of such records")
    given = parser.parse_args()
    chosen = range(given.first, given.first + given.seeds)
    if given.halves:
        halves(chosen, given.benches, given.elements)
    elif given.first_order:
        first_order(chosen, given.benches, given.elements)
    else:
        main(chosen, given.benches, given.elements, given.rough)
