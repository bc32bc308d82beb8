"""The figures of docs/performance."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gallery.line_labels import label_lines
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from benchmarks.work_precision import Point
from flexarm.view.plot.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    Sheet,
    styled,
)

#: Largest error (m) that is drawn and listed: larger ones come from steps that are too long.
USEFUL = 5e-3
#: The same colour for a program in all figures; those with one colour are never in one panel.
_COLORS = {
    "flexarm": BLUE,
    "Exudyn": VERMILLION,
    "MuJoCo": GREEN,
    "Pinocchio": PURPLE,
    "Drake": SKY,
    "PyElastica": ORANGE,
    "CasADi CVODES": VERMILLION,
    "JAX": GREEN,
    "SciPy DOP853": PURPLE,
    "SciPy LSODA": ORANGE,
}


def draw_scaling(path: Path, links: dict[int, float], modes: dict[int, float]) -> None:
    """Draw the cost of an evaluation over links and over modes."""
    sheet = Sheet(6.6, 2.7, layout="constrained")
    with styled():
        left, right = sheet.subplots(1, 2)
        left.plot(list(links), list(links.values()), "o-", color=BLUE, markersize=3.6)
        left.set(title="Four modes per link", xlabel="links", ylabel="time per link [µs]")
        right.plot(list(modes), list(modes.values()), "o-", color=BLUE, markersize=3.6)
        right.set(title="Two links", xlabel="modes per link", ylabel="time per evaluation [µs]")
        for axes, counts in ((left, links), (right, modes)):
            axes.set_xscale("log", base=2)
            axes.set_xticks(list(counts), [str(count) for count in counts])
            axes.set_ylim(0.0, 1.1 * max(axes.lines[0].get_ydata()))
            axes.margins(x=0.04)
    sheet.savefig(path, format="png")


def draw_work_precision(path: Path, points: Sequence[Point], titles: dict[str, str]) -> None:
    """Draw error over time, with one panel per reference solution.

    The best settings of each program are joined by a line with its name; the others are faint.
    """
    count = len(titles)
    sheet = Sheet(3.4 * count + 1.6 * (count == 1), 3.4, layout="constrained")
    with styled():
        panels = sheet.subplots(1, count, squeeze=False)[0]
        named = {}
        for axes, (truth, title) in zip(panels, titles.items(), strict=True):
            useful = [p for p in points if p.truth == truth and p.error < USEFUL]
            named[axes] = [
                _draw_program(axes, program, [p for p in useful if p.program == program])
                for program in dict.fromkeys(point.program for point in useful)
            ]
            axes.set(title=title, xlabel="time of the integration [ms]", xscale="log")
            axes.set_yscale("log")
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
            axes.xaxis.set_major_formatter("{x:g}")
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.minorticks_off()
            axes.margins(x=0.08, y=0.1)
            axes.grid(True, axis="both")
        panels[0].set_ylabel("largest tip error [m]")
        for axes, lines in named.items():
            label_lines(axes, lines)
    sheet.savefig(path, format="png")


def _draw_program(axes: Axes, program: str, points: Sequence[Point]) -> Line2D:
    color = _COLORS.get(program, GREY)
    look = {"color": color, "markeredgewidth": 0.0}
    for point in points:
        axes.plot(1e3 * point.seconds, point.error, "o", **look, markersize=2.6, alpha=0.3)
    front = best(points)
    return axes.plot(
        [1e3 * point.seconds for point in front],
        [point.error for point in front],
        "o-",
        **look,
        markersize=4.2,
        linewidth=1.2,
        label=program,
    )[0]


def best(points: Sequence[Point]) -> list[Point]:
    """Return the points that no other one beats in both time and error, the fastest first."""
    found: list[Point] = []
    for point in sorted(points, key=lambda point: (point.seconds, point.error)):
        if not found or point.error < found[-1].error:
            found.append(point)
    return found
