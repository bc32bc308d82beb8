"""Modes drawn: their shapes in the plane, and their frequencies along a parameter."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from flexarm.arguments import check_count, check_kind
from flexarm.linear import Modes, ModeTracks
from flexarm.plot.signals import series_colors
from flexarm.plot.style import BLUE, GREY, RIGID, Sheet, legend_above, margins, place_labels, styled

_WIDTH, _ROW, _EDGES = 8.27, 2.3, 0.85  # inches
_COLUMNS = 3
_MOST_NAMES = 6


def modes_figure(modes: Modes, count: int = 6) -> Sheet:
    """Draw the lowest mode shapes: the arm at rest dashed, displaced to both sides.

    Args:
        modes: as `modes` computes them.
        count: of the modes to draw.

    Raises:
        InputError: if ``modes`` is not a `Modes` object, or ``count`` not a whole number from 1 on.
    """
    modes = check_kind("modes_figure", "modes", modes, Modes)
    count = check_count("modes_figure", "count", count)
    shown = min(count, modes.frequency_hz.size)
    rows = max(1, -(-shown // _COLUMNS))
    sheet = Sheet(_WIDTH, _EDGES + _ROW * rows)
    curves = modes.curves(amplitude=0.12 * float(modes.arm.lengths.sum()))
    rest = modes.arm.shape(modes.q)
    with styled():
        grid = sheet.add_gridspec(rows, _COLUMNS)
        margins(sheet, left=0.6, bottom=0.5, right=0.2, top=0.35, wspace=0.3, hspace=0.5)
        for k in range(shown):
            axes = sheet.add_subplot(grid[k // _COLUMNS, k % _COLUMNS])
            for link in range(modes.arm.links):
                axes.plot(*rest[link].T, **{**RIGID, "label": "_"})
                axes.plot(*curves[k, link].T, color=BLUE, linewidth=1.3)
                axes.plot(*(2 * rest[link] - curves[k, link]).T, color=GREY, linewidth=0.7)
            axes.set(title=_title(modes, k), xlabel="x [m]", ylabel="y [m]", xmargin=0.07)
            axes.set_aspect("equal", adjustable="datalim")
            place_labels(axes)
    return sheet


def _title(modes: Modes, k: int) -> str:
    hertz, ratio = modes.frequency_hz[k], modes.damping_ratio[k]
    if hertz == 0.0:
        return f"{k + 1}: does not vibrate"
    damping = f", {100.0 * ratio:.2g} %" if abs(ratio) > 1e-9 else ""
    return f"{k + 1}: {hertz:.4g} Hz{damping}"


def tracks_figure(tracks: ModeTracks) -> Sheet:
    """Draw frequencies and damping ratios along postures, time or spin.

    Over a spin it is the Campbell diagram: dashed lines are the spin itself and its multiples,
    whose crossings are resonances of what turns with the arm.

    Raises:
        InputError: if ``tracks`` is not a `ModeTracks` object.
    """
    tracks = check_kind("tracks_figure", "tracks", tracks, ModeTracks)
    damped = bool(np.nanmax(np.abs(tracks.damping_ratio), initial=0.0) > 1e-6)
    sheet = Sheet(_WIDTH, 4.2 if not damped else 6.4)
    with styled():
        grid = sheet.add_gridspec(1 + damped, 1)
        margins(sheet, left=0.65, bottom=0.45, right=0.2, top=0.4, hspace=0.3)
        axes = sheet.add_subplot(grid[0])
        _draw_lines(axes, tracks, tracks.frequency_hz, "frequency [Hz]")
        if tracks.parameter_name == "spin":
            _draw_orders(axes, tracks)
        if damped:
            below = sheet.add_subplot(grid[1])
            _draw_lines(below, tracks, 100.0 * tracks.damping_ratio, "damping ratio [%]")
        legend_above(axes)
        for each in sheet.axes:
            place_labels(each)
    return sheet


def _draw_lines(axes: Axes, tracks: ModeTracks, values: np.ndarray, label: str) -> None:
    count = values.shape[1]
    for j, color in enumerate(series_colors(count)):
        name = f"mode {j + 1}" if count <= _MOST_NAMES or j in (0, count - 1) else "_"
        axes.plot(tracks.parameter, values[:, j], color=color, linewidth=1.2, label=name)
    unit = f" [{tracks.parameter_unit}]" if tracks.parameter_unit else ""
    axes.set(xlabel=f"{tracks.parameter_name}{unit}", ylabel=label)
    axes.set_ylim(bottom=min(0.0, float(np.nanmin(values, initial=0.0))))


def _draw_orders(axes: Axes, tracks: ModeTracks) -> None:
    """Lines of one, two, ... events in each turn, as far as they are on the plot."""
    top = axes.get_ylim()[1]
    turns = tracks.parameter / (2.0 * np.pi)
    for order in (1, 2, 3, 4):
        if order * turns[-1] > 0.05 * top:
            axes.plot(tracks.parameter, order * turns, **{**RIGID, "label": "_"})
            at = min(turns[-1], 0.97 * top / order)
            axes.annotate(f"{order}×", (2.0 * np.pi * at, order * at), ha="right", va="bottom")
    axes.set_ylim(top=top)
