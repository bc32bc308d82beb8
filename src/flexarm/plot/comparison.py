"""Figure of a comparison: a panel for each number, a line for each controller, a dot a plant."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from flexarm.arguments import check_kind
from flexarm.errors import InputError, Problem
from flexarm.plot.signals import series_colors
from flexarm.plot.style import GREY, Sheet, margins, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from flexarm.assemble import FloatArray

#: Numbers drawn where they are there: name, title, factor to the unit shown.
_PANELS = (
    ("tip_error_rms", "tip error, RMS [mm]", 1e3),
    ("residual_vibration", "residual vibration [mm]", 1e3),
    ("force_error_rms", "force error, RMS [N]", 1.0),
    ("torque_rms", "torque, RMS [N m]", 1.0),
)
#: Drawn in place of zeros.
_LEAST = 1e-9
_MARKS = "os^Dv<>ph*"
_WIDTH, _LINE, _EDGES = 8.27, 0.27, 1.0  # inches


def comparison_figure(table: xr.Dataset) -> Sheet:
    """Draw the numbers of ``flexarm.compare``; one row of panels for each reference.

    Runs that stopped early are marked by a cross at the right edge.

    Raises:
        InputError: if the table is not one of `compare`, or holds no finite number.
    """
    table = check_kind("comparison_figure", "table", table, xr.Dataset, "a table of compare")
    needed = ("controller", "plant", "reference", "failure", *(name for name, *_ in _PANELS))
    missing = [name for name in needed if name not in table.variables]
    if missing:
        value = f"without {missing[0]!r}"
        raise InputError(Problem("comparison_figure", "table", "be a table of compare", value))
    panels = [panel for panel in _PANELS if np.isfinite(table[panel[0]].values).any()]
    if not panels:
        rule = "hold the numbers of one run at least"
        raise InputError(Problem("comparison_figure", "table", rule, "of runs that stopped"))
    names = [str(name) for name in table["controller"].values]
    references = table["reference"].values
    height = _EDGES + (_LINE * len(names) + 0.75) * len(references)
    sheet = Sheet(_WIDTH, height)
    longest = max(map(len, names))
    with styled():
        grid = sheet.add_gridspec(len(references), len(panels))
        left = 0.35 + 0.068 * longest
        margins(sheet, left=left, bottom=0.45, right=0.2, top=0.55, wspace=0.12, hspace=0.55)
        for row, reference in enumerate(references):
            for column, (name, title, factor) in enumerate(panels):
                axes = sheet.add_subplot(grid[row, column])
                values = factor * table[name].sel(reference=reference)
                _draw(axes, values, table["failure"].sel(reference=reference))
                _scale(axes, factor * table[name].values)
                axes.set_yticks(range(len(names)), names if column == 0 else [])
                axes.set_ylim(len(names) - 0.4, -0.6)
                along = f" along {reference}" if len(references) > 1 and column == 0 else ""
                axes.set_title(title + along)
            if row == 0:
                last = axes
        if table.sizes["plant"] > 1:
            handles, labels = last.get_legend_handles_labels()
            sheet.legend(handles, labels, loc="upper right", ncols=min(len(labels), 6))
    return sheet


def _scale(axes: Axes, values: FloatArray) -> None:
    """Make the axis logarithmic, wide enough for the dots, the same for every reference."""
    seen = np.maximum(values[np.isfinite(values)], _LEAST)
    low, high = seen.min() / 1.5, seen.max() * 1.5
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    steps = (1.0, 2.0, 5.0) if high < 100.0 * low else (1.0,)
    axes.xaxis.set_major_locator(LogLocator(subs=steps, numticks=8))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.grid(axis="x", visible=True)


def _draw(axes: Axes, values: xr.DataArray, failure: xr.DataArray) -> None:
    """Draw one number of every controller (lines) on every plant (marks)."""
    plants = [str(name) for name in values["plant"].values]
    lines = np.arange(values.sizes["controller"])
    for k, (plant, color) in enumerate(zip(plants, series_colors(len(plants)), strict=True)):
        numbers = values.sel(plant=plant).values
        axes.plot(
            np.maximum(numbers, _LEAST),
            lines,
            linestyle="none",
            marker=_MARKS[k % len(_MARKS)],
            markersize=5,
            color=color,
            label=plant,
        )
        for line in lines[failure.sel(plant=plant).values != ""]:
            axes.plot(
                1.0,
                line,
                marker="x",
                markersize=5,
                color=color,
                transform=axes.get_yaxis_transform(),
                clip_on=False,
            )
    for line in lines:
        numbers = values.isel(controller=line).values
        numbers = numbers[np.isfinite(numbers)]
        if numbers.size:
            axes.hlines(line, numbers.min(), numbers.max(), color=GREY, linewidth=0.7, zorder=1)
