"""Plots of the samples of a study: a metric against each varied number."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from flexarm.base.arguments import check_choice, check_dataset
from flexarm.base.errors import InputError, Problem, public_call_as
from flexarm.simulation.calls.metrics import METRICS
from flexarm.view.plot.palette import series_colors
from flexarm.view.plot.style import WIDTH, AxesArray, Sheet, array_of, margins, panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ROW, _EDGES = 1.9, 0.9  # inches
_DIMS = ("sample", "controller", "plant", "reference")


@public_call_as("plot.samples")
def samples(table: xr.Dataset, metric: str = "tip_error_rms", *, axes: Any = None) -> AxesArray:
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
    drawing = _Samples(table, metric)
    shape = (len(drawing.references), len(drawing.paths))
    with panels(axes, shape[0] * shape[1], drawing.size, drawing.arrange) as made:
        drawing.draw(made)
    return array_of(made, *shape)


@public_call_as("plot.samples_figure")
def samples_figure(table: xr.Dataset, metric: str = "tip_error_rms") -> Sheet:
    """Draw a metric as `samples` does, in a figure that is not registered with pyplot.

    Raises:
        InputError: if the table is not one of a study with varied numbers, or has no such metric.
    """
    drawing = _Samples(table, metric)
    sheet = Sheet(*drawing.size)
    with styled():
        drawing.draw(drawing.arrange(sheet))
    return sheet


class _Samples:
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
        self.size = (WIDTH, _EDGES + _ROW * len(self.references))

    def arrange(self, sheet: Sheet) -> list[Axes]:
        """Add the axes, row by row."""
        made = sheet.subplots(
            len(self.references), len(self.paths), sharex="col", sharey=True, squeeze=False
        )
        margins(sheet, left=0.7, bottom=0.5, right=0.2, top=0.45)
        return list(made.ravel())

    def draw(self, made: Sequence[Axes]) -> None:
        """Draw every run, and a legend of the controllers and plants if there are several."""
        columns = len(self.paths)
        pairs = [(c, p) for c in self.table.controller.values for p in self.table.plant.values]
        colors = series_colors(len(pairs))
        for k, axes in enumerate(made):
            reference, path = self.references[k // columns], self.paths[k % columns]
            for (controller, plant), color in zip(pairs, colors, strict=True):
                chosen = {"controller": controller, "plant": plant, "reference": reference}
                one = self.table.sel(chosen)
                label = f"{controller} on {plant}" if self.table.sizes["plant"] > 1 else controller
                given, values = one[path].values, one[self.metric.name].values
                axes.plot(given, values, ".", markersize=3, color=color, label=str(label))
                failed = given[one["failure"].values != ""]
                edge = axes.get_xaxis_transform()
                axes.plot(
                    failed, np.ones_like(failed), "x", color=color, transform=edge, clip_on=False
                )
            if k >= len(made) - columns:
                axes.set_xlabel(path)
            if k % columns == 0:
                axes.set_ylabel(f"{self.metric.name} [{self.metric.unit}]")
                if len(self.references) > 1:
                    axes.set_title(f"along {reference}")
            axes.margins(x=0.02)
        if len(pairs) > 1 and isinstance(made[0].figure, Figure):
            handles, labels = made[columns - 1].get_legend_handles_labels()
            corner = made[columns - 1].get_position().x1, 1.0
            count = min(len(labels), 4)
            made[0].figure.legend(
                handles, labels, loc="upper right", bbox_to_anchor=corner, ncols=count
            )
