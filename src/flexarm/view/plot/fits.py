"""Plots of a fit for reports: measured and simulated channels, residuals, correlations."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib import rc_context

from flexarm.arm.assembly.assemble import FloatArray
from flexarm.view.plot.animation.scene import thin
from flexarm.view.plot.drawn_result import Signals, readable_unit
from flexarm.view.plot.style import BLUE, GREY, VERMILLION, Sheet, legend_above, margins, styled

#: Width, height of a row, and edges (inches).
_WIDTH, _ROW, _EDGES = 9.5, 1.7, 0.75
#: Intervals of a history in which its peaks are kept.
_INTERVALS = 400


class FittedChannel(NamedTuple):
    """A channel of a record: values (T,), NaN where samples are missing."""

    name: str
    unit: str
    times: FloatArray
    measured: FloatArray
    simulated: FloatArray


class Correlation(NamedTuple):
    """A correlation (lags,) at each lag, and the bound that 99 % of those by chance do not pass."""

    title: str
    lags: FloatArray
    values: FloatArray
    bound: float


def fit_picture(channels: Sequence[FittedChannel], simulated: str) -> str:
    """Return channels and their residuals over time as SVG."""
    sheet = Sheet(_WIDTH, _EDGES + _ROW * len(channels))
    with styled("screen"):
        axes = sheet.subplots(len(channels), 2, sharex=True, squeeze=False)
        margins(sheet, 0.75, 0.45, 0.1, 0.3, wspace=0.24, hspace=0.35)
        for (left, right), channel in zip(axes, channels, strict=True):
            scale, unit = readable_unit(channel.unit, channel.measured)
            for name, values, color in (
                ("measured", channel.measured, GREY),
                (simulated, channel.simulated, BLUE),
            ):
                left.plot(*_thinned(channel.times, scale * values), color=color, label=name)
            left.set_title(channel.name.replace("_", " "))
            left.set_ylabel(unit)
            missed = channel.measured - channel.simulated
            scale, unit = readable_unit(channel.unit, missed)
            right.plot(*_thinned(channel.times, scale * missed), color=VERMILLION)
            right.set_ylabel(unit)
        legend_above(axes[0, 0])
        axes[0, 1].set_title("measured minus " + simulated)
        for each in axes[-1]:
            each.set_xlabel("time [s]")
    return _svg(sheet, "fit " + channels[0].name)


def correlations_picture(rows: Sequence[Sequence[Correlation]]) -> str:
    """Return correlations over lags as SVG, a row of panels for each channel."""
    sheet = Sheet(_WIDTH, _EDGES + _ROW * len(rows))
    with styled("screen"):
        axes = sheet.subplots(len(rows), max(map(len, rows)), sharex="col", squeeze=False)
        margins(sheet, 0.75, 0.45, 0.1, 0.3, wspace=0.24, hspace=0.4)
        for line, panels in zip(axes, rows, strict=True):
            for axis, one in zip(line, panels, strict=False):
                axis.axhspan(-one.bound, one.bound, color=GREY, alpha=0.25, linewidth=0.0)
                axis.vlines(one.lags, 0.0, one.values, color=BLUE)
                axis.set_title(one.title)
            for axis in line[len(panels) :]:
                axis.remove()
        for axis in axes[-1, : len(rows[-1])]:
            axis.set_xlabel("lag [s]")
    return _svg(sheet, "correlation " + rows[0][0].title)


def matrix_picture(names: Sequence[str], correlation: FloatArray) -> str:
    """Return the correlations (n, n) of estimates as SVG."""
    count = len(names)
    side = 0.5 * count
    sheet = Sheet(side + 3.6, side + 0.3)
    with styled("screen"):
        axis = sheet.subplots()
        margins(sheet, 3.3, 0.1, 0.2, 0.2)
        # Cells, because a report shows no pixel images.
        shown = np.where(np.isfinite(correlation), correlation, 0.0)
        places = np.arange(count)
        axis.pcolormesh(places, places, shown, cmap="RdBu", vmin=-1, vmax=1, shading="nearest")
        axis.invert_yaxis()
        axis.set_yticks(range(count), [f"{k}  {name}" for k, name in enumerate(names, 1)])
        axis.set_xticks([])
        axis.grid(False)
        for (row, column), value in np.ndenumerate(correlation):
            color = "white" if abs(value) > 0.6 else "black"
            axis.text(column, row, f"{value:.2f}", ha="center", va="center", color=color, size=8)
    return _svg(sheet, "matrix")


def _thinned(times: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    filled = np.where(np.isfinite(values), values, 0.0)
    kept = thin(Signals("", times, filled[:, None], "", ("",), ("",)), _INTERVALS)
    return kept.time, np.where(
        np.isin(kept.time, times[~np.isfinite(values)]), np.nan, kept.values[:, 0]
    )


def _svg(sheet: Sheet, salt: str) -> str:
    """Return the element ``svg`` of a figure; ``salt`` makes its identifiers unique on a page."""
    stream = io.StringIO()
    with rc_context({"svg.hashsalt": salt}):
        sheet.savefig(stream, format="svg")
    text = stream.getvalue()
    return text[text.index("<svg") :]
