"""Plots of channels over time in given axes, and a page with the main channels of a result."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from flexarm.base.arguments import check_dataset
from flexarm.base.errors import public_call_as
from flexarm.view.plot.palette import series_colors
from flexarm.view.plot.selection import Signals, readable_unit, signals_of
from flexarm.view.plot.style import (
    BLUE,
    GREEN,
    INK,
    RIGID,
    VERMILLION,
    Sheet,
    legend_above,
    margins,
    place_labels,
    styled,
)

if TYPE_CHECKING:
    import xarray as xr

_ENERGIES = {"kinetic_energy": BLUE, "strain_energy": VERMILLION, "gravity_energy": GREEN}
_MOST_NAMES = 4  # that fit into a legend above a plot of this width
_WIDTH, _ROW, _EDGES = 8.27, 2.5, 0.85  # inches


@public_call_as("plot.signals_figure")
def signals_figure(result: xr.Dataset) -> Sheet:
    """Draw the main channels of a result of ``simulate`` on one page.

    The page shows tip path, joint angles, tip deflections, joint rates, energies and torques, and
    the strains if the arm has gauges.

    Raises:
        InputError: if the result is not one of `simulate`, or lacks one of these channels.
    """
    needed = ("tip", "joint_angle", "link_tip_deflection", "joint_rate", *_ENERGIES, "torque")
    check_dataset("result", result, ("time", *needed))
    rows = 4 if "strain" in result else 3
    sheet = Sheet(_WIDTH, _EDGES + _ROW * rows)
    with styled():
        grid = sheet.add_gridspec(rows, 2)
        margins(sheet, left=0.65, bottom=0.45, right=0.2, top=0.4, wspace=0.24, hspace=0.36)
        draw_tip_path(sheet.add_subplot(grid[0, 0]), result)
        _draw_channel(sheet.add_subplot(grid[0, 1]), result, "joint_angle")
        _draw_channel(sheet.add_subplot(grid[1, 0]), result, "link_tip_deflection")
        _draw_channel(sheet.add_subplot(grid[1, 1]), result, "joint_rate")
        draw_energies(sheet.add_subplot(grid[2, 0]), result)
        _draw_channel(sheet.add_subplot(grid[2, 1]), result, "torque")
        if "strain" in result:
            _draw_channel(sheet.add_subplot(grid[3, :]), result, "strain")
        for axes in sheet.axes:
            place_labels(axes)
    return sheet


def _draw_channel(axes: Axes, result: xr.Dataset, name: str) -> None:
    draw_signals(axes, signals_of("result", result, name))


def draw_signals(axes: Axes, signals: Signals) -> None:
    """Draw the lines of a channel over time."""
    colors = series_colors(len(signals.labels))
    lines = [
        axes.plot(signals.time, line, color=color, linewidth=1.0, label=label)[0]
        for line, label, color in zip(signals.values.T, signals.labels, colors, strict=True)
    ]
    axes.set(title=signals.title, xlabel="time [s]", ylabel=signals.axis_label)
    finish(axes, signals.labels, lines)


def draw_energies(axes: Axes, result: xr.Dataset) -> None:
    """Draw the energies over time, and their sum as a dashed line."""
    time = result["time"].values
    energies = np.stack([result[name].values for name in _ENERGIES])
    scale, unit = readable_unit("J", energies)
    for (name, color), energy in zip(_ENERGIES.items(), energies, strict=True):
        if np.any(energy):
            label = name.removesuffix("_energy")
            axes.plot(time, scale * energy, color=color, linewidth=1.0, label=label)
    axes.plot(time, scale * energies.sum(axis=0), **{**RIGID, "label": "total"})
    axes.set(title="Energy", xlabel="time [s]", ylabel=f"energy [{unit}]")
    finish(axes, [])


def draw_tip_path(axes: Axes, result: xr.Dataset) -> None:
    """Draw the path of the tip in the plane, from an open to a filled dot."""
    x, y = result["tip"].values.T
    axes.plot(x, y, color=BLUE, linewidth=1.0)
    mark_ends(axes, x, y)
    axes.set(title="Tip", xlabel="x [m]", ylabel="y [m]", xmargin=0.07)
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(True, axis="both")
    legend_above(axes)


def mark_ends(axes: Axes, x: Any, y: Any, named: bool = True) -> None:
    """Mark the start of a path by an open dot and its end by a filled one."""
    look: dict[str, Any] = {"color": INK, "markersize": 4.0, "linestyle": "none", "marker": "o"}
    start, end = ("start", "end") if named else ("_", "_")
    axes.plot(x[0], y[0], **look, markerfacecolor="white", label=start)
    axes.plot(x[-1], y[-1], **look, label=end)


def finish(axes: Axes, names: Sequence[str], lines: Sequence[Line2D] | None = None) -> None:
    """Limit the ticks and add a legend; of many lines only the first and the last have labels."""
    axes.locator_params(nbins=6)
    lines = axes.get_lines() if lines is None else lines
    for line in lines[1:-1] if len(names) > _MOST_NAMES else []:
        line.set_label("_")
    if len(axes.get_lines()) > 1:
        legend_above(axes)
