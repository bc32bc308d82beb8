"""Small things that several pictures of the gallery need."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, NullLocator

from flexarm.view.plot.style import INK

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
