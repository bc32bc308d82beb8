"""Write what was measured: docs/performance/index.md and its figures."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.forward_dynamics import Comparison
from benchmarks.simulation import Point

#: The C++ template with compile-time sizes that the goal is measured by, on the machine where it
#: was written (microseconds; linear theory, two links of four modes).
LIMIT_MICROSECONDS = 0.11


def machine() -> str:
    """Describe where the numbers were measured."""
    cores = os.cpu_count()
    names = ("flexarm", "numba", "numpy", "scipy")
    versions = ", ".join(f"{name} {version(name)}" for name in names)
    return f"{platform.machine()}, {cores} cores, Python {platform.python_version()}, {versions}"


def write(
    folder: Path,
    comparison: Comparison,
    links: dict[int, float],
    modes: dict[int, float],
    points: list[Point],
    startup: dict[str, float],
) -> None:
    """Write the page and its figures into ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    _draw_scaling(folder / "scaling.png", links, modes)
    _draw_work_precision(folder / "work-precision.png", points)
    page = "\n".join(
        [
            "# Performance",
            "",
            "Measured by `make bench`; the numbers below are from one run on one machine:",
            f"{machine()}. Times vary from machine to machine and with what else runs on it;",
            "ratios taken in the same run are what to compare.",
            "",
            "## Forward dynamics, two links of four modes",
            "",
            _comparison_table(comparison),
            "",
            "## Scaling",
            "",
            _scaling_table(links, modes),
            "",
            "![Cost per link and per evaluation](scaling.png)",
            "",
            "## Two seconds of the two-link arm of Table I",
            "",
            "Full 2+1 element mesh, linear theory, torques sampled at 1 kHz, 2001 samples of every",
            "channel recorded. SciPy's solvers call the same compiled dynamics from Python, which",
            "is what one would write by hand. Error: largest distance of the tip from a run at",
            "`rtol=1e-11`.",
            "",
            _points_table(points),
            "",
            "![Work-precision diagram](work-precision.png)",
            "",
            "## Start-up",
            "",
            _startup_table(startup),
            "",
        ]
    )
    (folder / "index.md").write_text(page, encoding="utf-8")


def _table(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [header, tuple("---" for _ in header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _comparison_table(c: Comparison) -> str:
    best = c.compile_time_sizes
    rows = [
        ("compiled code calls it, sizes known to the compiler", f"{best:.3f}", "1"),
        (
            "compiled code calls it, sizes at run time",
            f"{c.run_time_sizes:.3f}",
            f"{c.run_time_sizes / best:.2f}",
        ),
        (
            "Python calls it: `arm.forward_dynamics`",
            f"{c.from_python:.1f}",
            f"{c.from_python / best:.0f}",
        ),
        (
            "SciPy: Cholesky of `arm.mass_matrix`, solve for `arm.bias_force`",
            f"{c.scipy_dense:.1f}",
            f"{c.scipy_dense / best:.0f}",
        ),
    ]
    table = _table(("who calls what", "microseconds", "ratio"), rows)
    note = (
        f"\n\nThe goal is 1.5 times a C++ template, which took {LIMIT_MICROSECONDS} microseconds "
        "on the machine where it was written."
    )
    return table + note


def _scaling_table(links: dict[int, float], modes: dict[int, float]) -> str:
    first = _table(
        ("links of four modes", "microseconds per link"),
        [(str(count), f"{time:.3f}") for count, time in links.items()],
    )
    second = _table(
        ("modes on each of two links", "microseconds per evaluation"),
        [(str(count), f"{time:.3f}") for count, time in modes.items()],
    )
    return f"{first}\n\n{second}"


def _points_table(points: list[Point]) -> str:
    fastest = min(point.seconds for point in points)
    rows = [
        (
            point.method,
            f"{point.tolerance:.0e}",
            f"{point.error:.1e}",
            f"{1e3 * point.seconds:.1f}",
            f"{point.seconds / fastest:.1f}",
        )
        for point in points
    ]
    return _table(("method", "rtol", "tip error (m)", "milliseconds", "ratio"), rows)


def _startup_table(startup: dict[str, float]) -> str:
    return _table(
        ("what", "seconds"), [(name, f"{seconds:.2f}") for name, seconds in startup.items()]
    )


def _draw_scaling(path: Path, links: dict[int, float], modes: dict[int, float]) -> None:
    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.semilogx(list(links), list(links.values()), "o-", base=2)
    left.set(xlabel="links", ylabel="µs per link", title="four modes a link")
    right.semilogx(list(modes), list(modes.values()), "o-", base=2)
    right.set(xlabel="modes a link", ylabel="µs per evaluation", title="two links")
    for axes, counts in ((left, links), (right, modes)):
        axes.set_xticks(list(counts), [str(count) for count in counts])
        axes.set_ylim(bottom=0.0)
        axes.margins(y=0.1)
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=150)


def _draw_work_precision(path: Path, points: list[Point]) -> None:
    figure = Figure(figsize=(6.0, 3.8), layout="constrained")
    axes = figure.subplots()
    for method in dict.fromkeys(point.method for point in points):
        own = [point for point in points if point.method == method]
        axes.loglog(
            [1e3 * point.seconds for point in own],
            [point.error for point in own],
            "o-" if "SciPy" not in method else "s--",
            label=method,
        )
    axes.set(xlabel="wall time (ms)", ylabel="largest tip error (m)")
    axes.grid(alpha=0.3, which="both")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=150)
