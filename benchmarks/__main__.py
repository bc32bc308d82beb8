"""Measure everything and write docs/performance: `make bench`."""

from __future__ import annotations

from pathlib import Path

from benchmarks import (
    closed_loop,
    controllers,
    environments,
    first_run,
    forward_dynamics,
    long_chain,
    pictures,
    programs,
    raw,
    report,
    rollouts,
    startup,
    table_one,
    whole_call,
)
from benchmarks.limit import compiler

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "performance"


def main() -> None:
    """Run all benchmarks, which takes some minutes."""
    for peer in programs.missing():
        print(f"SKIPPED: {peer} is not installed (pip install 'flexarm[peers,casadi]').")
    if compiler() is None:
        print("SKIPPED: the C++ limit, there is no compiler on this machine.")
    print("start-up ...", flush=True)
    measured = report.Measured(
        imports=startup.import_seconds(),
        help=startup.help_seconds(),
        runs=startup.warm_runs(),
        first=first_run.first_uses(),
        memory=startup.memory_megabytes(),
        comparisons=[forward_dynamics.compare(theory) for theory in ("linear", "second_order")],
        links=forward_dynamics.scaling_in_links(),
        modes=forward_dynamics.scaling_in_modes(),
        table_one=(points := _announced("Table I arm", table_one.work_precision)),
        raw=_announced("Table I arm, steps alone", lambda: raw.beside_peers(points)),
        many=rollouts.rollouts(),
        learning=environments.environments(),
        chain=_announced("chain of 64 links", long_chain.work_precision),
        closed=list(closed_loop.rows()),
        controllers=controllers.microseconds(),
        simulations=whole_call.simulations(),
        calls=whole_call.microseconds(),
        pictures=pictures.waits(),
    )
    report.write(FOLDER, measured)
    print((FOLDER / "index.md").read_text(encoding="utf-8"))


def _announced(what, measure):  # type: ignore[no-untyped-def]
    print(f"{what} ...", flush=True)
    points, failed = measure()
    print(*failed, sep="\n", flush=True)
    return points


if __name__ == "__main__":
    main()
