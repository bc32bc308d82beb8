"""Small things that several pictures of the gallery need."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, NullLocator

from flexarm.plot.style import INK

#: What is known, drawn as a line; what the package computes, as points upon it.
KNOWN: dict[str, Any] = {"color": INK, "linewidth": 0.9}
OURS: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 3.6}


def logarithmic_ticks(axes: Axes, values: Sequence[float], axis: str = "x") -> None:
    """Make an axis logarithmic and name these values on it, as plain numbers."""
    getattr(axes, f"set_{axis}scale")("log")
    chosen = axes.xaxis if axis == "x" else axes.yaxis
    chosen.set_major_locator(FixedLocator(values))
    chosen.set_minor_locator(NullLocator())
    chosen.set_major_formatter(lambda value, _: f"{value:g}")


def legend_above(axes: Axes, columns: int | None = None, **options: Any) -> None:
    """Put the legend above the axes, at the left, where no line can hide it."""
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(
        handles,
        labels,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.02),
        ncols=columns or len(handles),
        handlelength=1.4,
        columnspacing=1.0,
        **options,
    )
