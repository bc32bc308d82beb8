"""A quick look at any result: how it moves, how it bends, what drives it, where the energy is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from flexarm.arguments import check_dataset
from flexarm.engine.channels import CHANNELS
from flexarm.errors import InputError, Problem
from flexarm.plot.style import (
    BLUE,
    GREEN,
    INK,
    RIGID,
    SERIES,
    VERMILLION,
    Sheet,
    legend_above,
    margins,
    place_labels,
    styled,
)

if TYPE_CHECKING:
    import xarray as xr

FloatArray = NDArray[np.float64]

_ENERGIES = {"kinetic_energy": BLUE, "strain_energy": VERMILLION, "gravity_energy": GREEN}
_MOST_NAMES = 4  # in a legend above a plot of this width
_WIDTH, _ROW, _EDGES = 8.27, 2.5, 0.85  # inches


def signals_figure(result: xr.Dataset) -> Sheet:
    """Draw the main channels of a result of ``simulate`` on one page.

    Tip path, joint angles, tip deflections, joint rates, energies and torques; strains in a row of
    their own if there are gauges.

    Raises:
        InputError: if the result is not one of `simulate`, or lacks one of these channels.
    """
    _check(result)
    rows = 4 if "strain" in result else 3
    sheet = Sheet(_WIDTH, _EDGES + _ROW * rows)
    with styled():
        grid = sheet.add_gridspec(rows, 2)
        margins(sheet, left=0.65, bottom=0.45, right=0.2, top=0.4, wspace=0.24, hspace=0.36)
        draw_tip_path(sheet.add_subplot(grid[0, 0]), result)
        draw_channel(sheet.add_subplot(grid[0, 1]), result, "joint_angle")
        draw_channel(sheet.add_subplot(grid[1, 0]), result, "link_tip_deflection")
        draw_channel(sheet.add_subplot(grid[1, 1]), result, "joint_rate")
        draw_energies(sheet.add_subplot(grid[2, 0]), result)
        draw_channel(sheet.add_subplot(grid[2, 1]), result, "torque")
        if "strain" in result:
            draw_channel(sheet.add_subplot(grid[3, :]), result, "strain")
        for axes in sheet.axes:
            place_labels(axes)
    return sheet


def _check(result: xr.Dataset) -> None:
    result = check_dataset("signals_figure", "result", result)
    needed = ("tip", "joint_angle", "link_tip_deflection", "joint_rate", *_ENERGIES, "torque")
    missing = [name for name in needed if name not in result]
    if missing:
        value = f"without {missing[0]!r}"
        raise InputError(Problem("signals_figure", "result", "be a result of simulate", value))


def draw_channel(axes: Axes, result: xr.Dataset, name: str) -> None:
    """Draw a channel (time, k) over time, one line each; deflections in mm."""
    channel = CHANNELS[name]
    scale, unit = readable_unit(channel.unit, result[name].values)
    values = scale * result[name].values
    (part,) = channel.dims
    # Joints and links have numbers; gauges have names that are too long for a legend.
    numbers = result[part].values if part in ("joint", "link") else range(1, values.shape[1] + 1)
    names = [f"{part} {number}" for number in numbers]
    for line, label, color in zip(values.T, names, series_colors(len(names)), strict=True):
        axes.plot(result["time"].values, line, color=color, linewidth=1.0, label=label)
    title = name.replace("_", " ").capitalize()
    axes.set(title=title, xlabel="time [s]", ylabel=f"{name.split('_')[-1]} [{unit}]")
    _finish(axes, names)


def draw_energies(axes: Axes, result: xr.Dataset) -> None:
    """Draw the energies over time, and their sum dashed."""
    time = result["time"].values
    energies = np.stack([result[name].values for name in _ENERGIES])
    scale, unit = readable_unit("J", energies)
    for (name, color), energy in zip(_ENERGIES.items(), energies, strict=True):
        if np.any(energy):
            label = name.removesuffix("_energy")
            axes.plot(time, scale * energy, color=color, linewidth=1.0, label=label)
    axes.plot(time, scale * energies.sum(axis=0), **{**RIGID, "label": "total"})
    axes.set(title="Energy", xlabel="time [s]", ylabel=f"energy [{unit}]")
    _finish(axes, [])


def draw_tip_path(axes: Axes, result: xr.Dataset) -> None:
    """Draw the path of the tip in the plane, from an open dot to a full one."""
    x, y = result["tip"].values.T
    axes.plot(x, y, color=BLUE, linewidth=1.0)
    axes.plot(x[0], y[0], "o", color=INK, markerfacecolor="white", markersize=4.0, label="start")
    axes.plot(x[-1], y[-1], "o", color=INK, markersize=4.0, label="end")
    axes.set(title="Tip", xlabel="x [m]", ylabel="y [m]", xmargin=0.07)
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(True, axis="both")
    legend_above(axes)


def readable_unit(unit: str, values: FloatArray) -> tuple[float, str]:
    """Return the unit for an axis that spares the reader long numbers, and the factor to it."""
    if unit == "m":
        return 1e3, "mm"
    if unit == "1":
        return 1e6, "µm/m"  # strain
    if unit in ("J", "N m") and values.size and np.max(np.abs(values)) >= 1e4:
        return 1e-3, f"k{unit}"
    return 1.0, unit


def series_colors(count: int) -> Sequence[str]:
    """Return colours for lines that are told apart by name if few, by order if many."""
    if count <= len(SERIES):
        return SERIES[:count]
    # The ends of this map are nearly black and too pale for a line on white.
    return [to_hex(color) for color in colormaps["viridis"](np.linspace(0.0, 0.9, count))]


def _finish(axes: Axes, names: Sequence[str]) -> None:
    """Bound the time axis and add a legend; of many lines the first and the last are named."""
    axes.locator_params(nbins=6)
    lines = axes.get_lines()
    for line in lines[1:-1] if len(names) > _MOST_NAMES else []:
        line.set_label("_")
    if len(lines) > 1:
        legend_above(axes)
