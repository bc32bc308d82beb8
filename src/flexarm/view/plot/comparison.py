"""Plots of tables: metrics of controllers and plants, and samples of a study."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.arguments import check_choice, check_dataset
from flexarm.base.errors import InputError, Problem, public_call_as
from flexarm.simulation.calls.metrics import METRICS
from flexarm.view.plot import style
from flexarm.view.plot.palette import series_colors

#: Metrics to draw if available: name, title, factor to the displayed unit.
_PANELS = (
    ("tip_error_rms", "tip error, RMS [mm]", 1e3),
    ("residual_vibration", "residual vibration [mm]", 1e3),
    ("force_error_rms", "force error, RMS [N]", 1.0),
    ("torque_rms", "torque, RMS [N m]", 1.0),
)
#: Ratio of the ends of an axis below which it has evenly spaced labels.
_NARROW = 8.0
#: Value drawn instead of zero on the logarithmic axis.
_LEAST = 1e-9
_MARKS = "os^Dv<>ph*"
_WIDTH, _LINE, _EDGES = 8.27, 0.27, 0.8  # inches


@public_call_as("plot.study")
def study(table: xr.Dataset, *, axes: Any = None) -> style.AxesArray:
    """Draw the metrics of ``flexarm.compare`` or ``run_study``, a row of panels per reference.

    A line is a controller, a mark a plant. A cross at the right edge marks a run that stopped
    early. Metrics without a finite value, such as a force without contact, have no panel.

    Args:
        table: as returned by these functions.
        axes: Matplotlib axes to draw into, one for each reference and metric; None for a new
            figure.

    Returns:
        An array (references, metrics) of Matplotlib axes.

    Raises:
        InputError: if the table is not one of `compare`, has no finite number, or ``axes`` does
            not have one item for each panel.
    """
    return _Numbers(table).on(axes)


@public_call_as("plot.comparison_figure")
def comparison_figure(table: xr.Dataset) -> style.Sheet:
    """Draw the metrics as `study` does, in a figure that is not registered with pyplot.

    Raises:
        InputError: if the table is not one of `compare`, or has no finite number.
    """
    return _Numbers(table).page(labels=False)


class _Numbers(style.Drawing):
    """Metrics of a table to draw, and their panels."""

    def __init__(self, table: xr.Dataset) -> None:
        needed = ("controller", "plant", "reference", "failure", *(name for name, *_ in _PANELS))
        self.table = check_dataset("table", table, needed, "a table of compare")
        if "sample" in table.dims:
            hint = "Draw it with plot.samples, or select one: table.isel(sample=0)."
            raise InputError(Problem("table", "has samples", hint=hint))
        self.chosen = [panel for panel in _PANELS if np.isfinite(table[panel[0]].values).any()]
        if not self.chosen:
            raise InputError(Problem("table", "contains only runs that failed"))
        self.names = [str(name) for name in table["controller"].values]
        self.references = table["reference"].values
        height = _EDGES + (_LINE * len(self.names) + 0.75) * len(self.references)
        self.size = (_WIDTH, height)
        self.shape = (len(self.references), len(self.chosen))

    def arrange(self, sheet: style.Sheet) -> list[Axes]:
        grid = sheet.add_gridspec(*self.shape)
        left = 0.35 + 0.068 * max(map(len, self.names))
        style.margins(sheet, left=left, bottom=0.3, right=0.2, top=0.5, wspace=0.12, hspace=0.55)
        return [sheet.add_subplot(grid[k]) for k in range(self.shape[0] * self.shape[1])]

    def draw(self, made: Sequence[Axes]) -> None:
        """Draw every metric, and a legend of the plants if there are several."""
        columns = len(self.chosen)
        for k, axes in enumerate(made):
            reference = self.references[k // columns]
            name, title, factor = self.chosen[k % columns]
            values = factor * self.table[name].sel(reference=reference)
            _draw(axes, values, self.table["failure"].sel(reference=reference))
            _scale(axes, factor * self.table[name].values)
            first = k % columns == 0
            axes.set_yticks(range(len(self.names)), self.names if first else [])
            axes.set_ylim(len(self.names) - 0.4, -0.6)
            along = f" along {reference}" if len(self.references) > 1 and first else ""
            axes.set_title(title + along)
        if self.table.sizes["plant"] > 1 and isinstance(made[0].figure, Figure):
            _add_legend(made[0].figure, made[columns - 1], 6)


def _add_legend(figure: Figure, axes: Axes, most: int) -> None:
    """Add a legend of some axes above them, at the right edge, in at most ``most`` columns."""
    handles, labels = axes.get_legend_handles_labels()
    corner, columns = (axes.get_position().x1, 1.0), min(len(labels), most)
    figure.legend(handles, labels, loc="upper right", bbox_to_anchor=corner, ncols=columns)


def _scale(axes: Axes, values: FloatArray) -> None:
    """Make the axis logarithmic, wide enough for the marks, and equal for all references."""
    seen = np.maximum(values[np.isfinite(values)], _LEAST)
    low, high = seen.min() / 1.5, seen.max() * 1.5
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    steps = (1.0, 2.0, 5.0) if high < 100.0 * low else (1.0,)
    # Within less than a decade the locator would place labels on each other.
    narrow = high < _NARROW * low
    locator = MaxNLocator(4) if narrow else LogLocator(subs=steps, numticks=8)
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.grid(axis="x", visible=True)


def _draw(axes: Axes, values: xr.DataArray, failure: xr.DataArray) -> None:
    """Draw one metric of every controller (lines) on every plant (marks)."""
    plants = [str(name) for name in values["plant"].values]
    lines = np.arange(values.sizes["controller"])
    for k, (plant, color) in enumerate(zip(plants, series_colors(len(plants)), strict=True)):
        numbers = values.sel(plant=plant).values
        look: dict[str, Any] = {"markersize": 5, "color": color, "linestyle": "none"}
        # Empty, so that marks at the same value remain visible.
        empty: dict[str, Any] = {"markerfacecolor": "none", "markeredgewidth": 1.2, "label": plant}
        mark = _MARKS[k % len(_MARKS)]
        axes.plot(np.maximum(numbers, _LEAST), lines, marker=mark, **look, **empty)
        edge = axes.get_yaxis_transform()
        for line in lines[failure.sel(plant=plant).values != ""]:
            axes.plot(1.0, line, marker="x", transform=edge, clip_on=False, **look)
    for line in lines:
        numbers = values.isel(controller=line).values
        numbers = numbers[np.isfinite(numbers)]
        if numbers.size:
            axes.hlines(
                line, numbers.min(), numbers.max(), color=style.GREY, linewidth=0.7, zorder=1
            )


_ROW, _SAMPLE_EDGES = 1.9, 0.9  # inches
_DIMS = ("sample", "controller", "plant", "reference")


@public_call_as("plot.samples")
def samples(
    table: xr.Dataset, metric: str = "tip_error_rms", *, axes: Any = None
) -> style.AxesArray:
    """Draw a metric of a study against each varied number, a row of panels per reference.

    A dot is a run, a colour a controller on a plant. Crosses at the upper edge are runs that
    failed. Runs whose numbers are not possible are left out.

    Args:
        table: as returned by ``Study.run`` or ``read_study``.
        metric: name of a metric of the table.
        axes: Matplotlib axes to draw into, one for each reference and number; None for a new
            figure.

    Returns:
        An array (references, numbers) of Matplotlib axes.

    Raises:
        InputError: if the table is not one of a study with varied numbers, has no such metric, or
            ``axes`` does not have one item for each panel.
    """
    return _Samples(table, metric).on(axes)


@public_call_as("plot.samples_figure")
def samples_figure(table: xr.Dataset, metric: str = "tip_error_rms") -> style.Sheet:
    """Draw a metric as `samples` does, in a figure that is not registered with pyplot.

    Raises:
        InputError: if the table is not one of a study with varied numbers, or has no such metric.
    """
    return _Samples(table, metric).page(labels=False)


class _Samples(style.Drawing):
    """Values of a metric to draw, and their panels."""

    def __init__(self, table: xr.Dataset, metric: str) -> None:
        self.table = check_dataset("table", table, (*_DIMS, "failure"), "a table of a study")
        known = {one.name: one for one in METRICS if one.name in table}
        self.metric = known[check_choice("metric", metric, known)]
        coords = table.coords.items()
        self.paths = [str(n) for n, item in coords if item.dims == ("sample",) and n != "sample"]
        if not self.paths:
            raise InputError(Problem("table", "has no varied numbers"))
        self.references = table["reference"].values
        self.size = (style.WIDTH, _SAMPLE_EDGES + _ROW * len(self.references))
        self.shape = (len(self.references), len(self.paths))

    def arrange(self, sheet: style.Sheet) -> list[Axes]:
        made = sheet.subplots(*self.shape, sharex="col", sharey=True, squeeze=False)
        style.margins(sheet, left=0.7, bottom=0.5, right=0.2, top=0.45)
        return list(made.ravel())

    def draw(self, made: Sequence[Axes]) -> None:
        """Draw every run, and a legend of the controllers and plants if there are several."""
        columns, (scale, unit) = len(self.paths), self.metric.display
        pairs = [(c, p) for c in self.table.controller.values for p in self.table.plant.values]
        colors = series_colors(len(pairs))
        for k, axes in enumerate(made):
            reference, path = self.references[k // columns], self.paths[k % columns]
            for (controller, plant), color in zip(pairs, colors, strict=True):
                chosen = {"controller": controller, "plant": plant, "reference": reference}
                one = self.table.sel(chosen)
                label = f"{controller} on {plant}" if self.table.sizes["plant"] > 1 else controller
                given, values = one[path].values, scale * one[self.metric.name].values
                axes.plot(given, values, ".", markersize=3, color=color, label=str(label))
                failed = given[one["failure"].values != ""]
                edge = axes.get_xaxis_transform()
                axes.plot(
                    failed, np.ones_like(failed), "x", color=color, transform=edge, clip_on=False
                )
            if k >= len(made) - columns:
                axes.set_xlabel(path)
            if k % columns == 0:
                axes.set_ylabel(f"{self.metric.name} [{unit}]")
                if len(self.references) > 1:
                    axes.set_title(f"along {reference}")
            axes.margins(x=0.02)
        if len(pairs) > 1 and isinstance(made[0].figure, Figure):
            _add_legend(made[0].figure, made[columns - 1], 4)
