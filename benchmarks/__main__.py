"""Measure everything and write docs/performance: `make bench`."""

from __future__ import annotations

from pathlib import Path

from benchmarks import forward_dynamics, report, simulation, startup

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "performance"


def main() -> None:
    """Run all benchmarks, a minute or two."""
    print("start-up ...", flush=True)
    first, second = startup.paper_seconds()
    times = {
        "`import flexarm`, beyond starting Python": startup.import_seconds(),
        "`flexarm --help`, process start included": startup.help_seconds(),
        "`flexarm paper`, the first time on a machine, all compilation included": first,
        "`flexarm paper`, the second time": second,
    }
    print("forward dynamics ...", flush=True)
    comparison = forward_dynamics.compare()
    links = forward_dynamics.scaling_in_links()
    modes = forward_dynamics.scaling_in_modes()
    print("simulation ...", flush=True)
    points = simulation.work_precision()
    report.write(FOLDER, comparison, links, modes, points, times)
    print((FOLDER / "index.md").read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
