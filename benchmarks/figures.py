"""The figures of docs/performance."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from benchmarks.work_precision import Point

#: Largest error (m) that is drawn and listed: larger ones come from steps that are too long.
USEFUL = 5e-3
_MARKS = "os^Dv<>pPX*hd"


def draw_scaling(path: Path, links: dict[int, float], modes: dict[int, float]) -> None:
    """Draw the cost of an evaluation over links and over modes."""
    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.semilogx(list(links), list(links.values()), "o-", base=2)
    left.set(xlabel="links", ylabel="µs per link", title="four modes a link")
    right.semilogx(list(modes), list(modes.values()), "o-", base=2)
    right.set(xlabel="modes a link", ylabel="µs per evaluation", title="two links")
    for axes, counts in ((left, links), (right, modes)):
        axes.set_xticks(list(counts), [str(count) for count in counts])
        axes.set_ylim(0.0, 1.1 * max(axes.lines[0].get_ydata()))
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=150)


def draw_work_precision(path: Path, points: Sequence[Point], titles: dict[str, str]) -> None:
    """Draw error over time, with one panel per reference solution; flexarm has filled markers."""
    figure = Figure(figsize=(4.4 * len(titles) + 2.4, 4.2), layout="constrained")
    panels = figure.subplots(1, len(titles), squeeze=False, sharey=True)[0]
    names = list(dict.fromkeys(label(point) for point in points))
    ours = [name for name in names if name.startswith("flexarm")]
    peers = [name for name in names if name not in ours]
    shown = {}
    for axes, (truth, title) in zip(panels, titles.items(), strict=True):
        for number, name in [*enumerate(ours), *enumerate(peers)]:
            own = [p for p in points if label(p) == name and p.truth == truth and p.error < USEFUL]
            if not own:
                continue
            shown[name] = axes.loglog(
                [1e3 * point.seconds for point in own],
                [point.error for point in own],
                _MARKS[number % len(_MARKS)],
                color=f"C{number % 10}",
                markerfacecolor="none" if name in peers else None,
                markersize=6,
                linestyle="none",
            )[0]
        axes.set(xlabel="wall time of the integration (ms)", title=title)
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.margins(0.1)
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("largest tip error (m)")
    figure.legend(shown.values(), shown.keys(), loc="outside right upper", frameon=False)
    figure.savefig(path, dpi=150)


def label(point: Point) -> str:
    """Return the label of a point: flexarm with its integrator, or another program."""
    if point.program != "flexarm":
        return point.program
    return f"flexarm {point.setting.split(',')[0]}"
