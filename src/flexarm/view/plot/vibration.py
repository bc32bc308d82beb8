"""Plots of modes: their shapes in the plane, and their frequencies over a parameter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from flexarm.base.arguments import check_count, check_kind
from flexarm.base.errors import public_call_as
from flexarm.linear import Modes, ModeTracks
from flexarm.view.plot.palette import series_colors
from flexarm.view.plot.style import (
    BLUE,
    GREY,
    RIGID,
    WIDTH,
    AxesArray,
    Sheet,
    array_of,
    legend_above,
    margins,
    panels,
    place_labels,
    rows,
    styled,
)

_WIDTH, _ROW, _EDGES = 8.27, 2.3, 0.85  # inches
_COLUMNS = 3
_MOST_NAMES = 6


@public_call_as("plot.modes")
def modes(found: Modes, count: int = 6, *, axes: Any = None) -> AxesArray:
    """Draw the lowest mode shapes, one per panel: displaced to both sides, arm at rest dashed.

    Args:
        found: modes from `flexarm.modes`.
        count: number of modes to draw.
        axes: Matplotlib axes to draw into, one for each mode; None for a new figure.

    Returns:
        An array of Matplotlib axes, one for each mode: ``count``, or fewer if the arm has fewer.

    Raises:
        InputError: if ``found`` is not a `Modes` object, ``count`` is not a positive integer, or
            ``axes`` does not have one item for each mode.
    """
    found = check_kind("found", found, Modes)
    shown = min(check_count("count", count), found.frequency_hz.size)
    size = (_WIDTH, _EDGES + _ROW * _rows(shown))
    with panels(axes, shown, size, lambda sheet: _grid(sheet, shown)) as made:
        _draw_shapes(made, found)
    return array_of(made)


@public_call_as("plot.modes_figure")
def modes_figure(modes: Modes, count: int = 6) -> Sheet:
    """Draw the lowest mode shapes as `modes` does, in a figure not registered with pyplot.

    Args:
        modes: modes from `flexarm.modes`.
        count: number of modes to draw.

    Raises:
        InputError: if ``modes`` is not a `Modes` object, or ``count`` is not a positive integer.
    """
    found = check_kind("modes", modes, Modes)
    shown = min(check_count("count", count), found.frequency_hz.size)
    sheet = Sheet(_WIDTH, _EDGES + _ROW * _rows(shown))
    with styled():
        made = _grid(sheet, shown)
        _draw_shapes(made, found)
        for each in made:
            place_labels(each)
    return sheet


def _rows(count: int) -> int:
    return max(1, -(-count // _COLUMNS))


def _grid(sheet: Sheet, count: int) -> list[Axes]:
    grid = sheet.add_gridspec(_rows(count), _COLUMNS)
    margins(sheet, left=0.6, bottom=0.5, right=0.2, top=0.35, wspace=0.3, hspace=0.5)
    return [sheet.add_subplot(grid[k // _COLUMNS, k % _COLUMNS]) for k in range(count)]


def _draw_shapes(made: Sequence[Axes], found: Modes) -> None:
    curves = found.curves(amplitude=0.12 * float(found.arm.lengths.sum()))
    rest = found.arm.shape(found.q)
    for k, axes in enumerate(made):
        for link in range(found.arm.links):
            axes.plot(*rest[link].T, **{**RIGID, "label": "_"})
            axes.plot(*curves[k, link].T, color=BLUE, linewidth=1.3)
            axes.plot(*(2 * rest[link] - curves[k, link]).T, color=GREY, linewidth=0.7)
        axes.set(title=_title(found, k), xlabel="x [m]", ylabel="y [m]", xmargin=0.07)
        axes.set_aspect("equal", adjustable="datalim")


def _title(modes: Modes, k: int) -> str:
    hertz, ratio = modes.frequency_hz[k], modes.damping_ratio[k]
    if hertz == 0.0:
        return f"{k + 1}: does not vibrate"
    damping = f", {float(f'{100.0 * ratio:.2g}'):g} %" if abs(ratio) > 1e-9 else ""
    return f"{k + 1}: {hertz:.4g} Hz{damping}"


@public_call_as("plot.campbell")
def campbell(tracks: ModeTracks, *, axes: Any = None) -> Axes:
    """Draw frequencies over a spin rate, a time, or a sequence of postures.

    Over the spin rate this is the Campbell diagram: dashed lines are the spin frequency and its
    multiples, whose intersections are resonances with excitations that rotate with the arm.

    Args:
        tracks: from `flexarm.campbell` or `track_modes`.
        axes: Matplotlib axes to draw into; None for a new figure.

    Returns:
        The Matplotlib axes. `tracks_figure` also draws the damping ratios.

    Raises:
        InputError: if ``tracks`` is not a `ModeTracks` object.
    """
    tracks = check_kind("tracks", tracks, ModeTracks)
    with panels(axes, 1, (WIDTH, 3.6), rows(1)) as (panel,):
        _draw_frequencies(panel, tracks)
        legend_above(panel)
    return panel


@public_call_as("plot.tracks_figure")
def tracks_figure(tracks: ModeTracks) -> Sheet:
    """Draw frequencies as `campbell` does, and below them the damping ratios if there is damping.

    Raises:
        InputError: if ``tracks`` is not a `ModeTracks` object.
    """
    tracks = check_kind("tracks", tracks, ModeTracks)
    damped = bool(np.nanmax(np.abs(tracks.damping_ratio), initial=0.0) > 1e-6)
    sheet = Sheet(_WIDTH, 4.2 if not damped else 6.4)
    with styled():
        grid = sheet.add_gridspec(1 + damped, 1)
        margins(sheet, left=0.65, bottom=0.45, right=0.2, top=0.4, hspace=0.3)
        axes = sheet.add_subplot(grid[0])
        _draw_frequencies(axes, tracks)
        if damped:
            below = sheet.add_subplot(grid[1])
            _draw_lines(below, tracks, 100.0 * tracks.damping_ratio, "damping ratio [%]")
        legend_above(axes)
        for each in sheet.axes:
            place_labels(each)
    return sheet


def _draw_frequencies(axes: Axes, tracks: ModeTracks) -> None:
    _draw_lines(axes, tracks, tracks.frequency_hz, "frequency [Hz]")
    if tracks.parameter_name == "spin":
        _draw_orders(axes, tracks)


def _draw_lines(axes: Axes, tracks: ModeTracks, values: np.ndarray, label: str) -> None:
    count = values.shape[1]
    for j, color in enumerate(series_colors(count)):
        name = f"mode {j + 1}" if count <= _MOST_NAMES or j in (0, count - 1) else "_"
        axes.plot(tracks.parameter, values[:, j], color=color, linewidth=1.2, label=name)
    unit = f" [{tracks.parameter_unit}]" if tracks.parameter_unit else ""
    axes.set(xlabel=f"{tracks.parameter_name}{unit}", ylabel=label)
    axes.set_ylim(bottom=min(0.0, float(np.nanmin(values, initial=0.0))))


def _draw_orders(axes: Axes, tracks: ModeTracks) -> None:
    """Draw the lines of one, two, ... cycles per revolution that are within the plot."""
    top = axes.get_ylim()[1]
    turns = tracks.parameter / (2.0 * np.pi)
    for order in (1, 2, 3, 4):
        if order * turns[-1] > 0.05 * top:
            axes.plot(tracks.parameter, order * turns, **{**RIGID, "label": "_"})
            at = min(turns[-1], 0.97 * top / order)
            white = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
            place = (2.0 * np.pi * at, order * at)
            axes.annotate(f"{order}×", place, ha="right", va="center", bbox=white)
    axes.set_ylim(top=top)
