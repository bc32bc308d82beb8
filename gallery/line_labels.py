"""Labels beside the lines of a plot, instead of a legend."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.text import Text
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Distance of a label from its line, and spacing of the samples of a line, in points.
_GAP, _SPACING = 3.0, 3.0
#: Places along a line that are tried, and directions from there.
_PLACES = 60
_SIDES = np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if (x, y) != (0, 0)])
#: Distance, in points, at which another line is not mistaken for that of the label.
_CLEAR = 14.0


def label_lines(
    axes: Axes, lines: Sequence[Line2D] | None = None, *, size: float = 8.0
) -> list[Text]:
    """Write labels of lines, by default all, beside them where they cover nothing else.

    Call it last, because the places depend on the limits and the layout.
    """
    figure = axes.figure
    figure.draw_without_rendering()  # type: ignore[union-attr]  # applies the layout
    drawn = [_course(axes, line) for line in axes.get_lines()]
    named = [line for line in axes.get_lines() if not str(line.get_label()).startswith("_")]
    chosen = named if lines is None else lines
    taken = [np.asarray(text.get_window_extent().extents) for text in axes.texts]
    made: list[Text] = []
    for line in chosen:
        text = axes.annotate(
            str(line.get_label()), (0.0, 0.0), xycoords="axes fraction", color=line.get_color()
        )
        text.set(fontsize=size, ha="center", va="center")
        box = text.get_window_extent()
        others = [drawn[k] for k, each in enumerate(axes.get_lines()) if each is not line]
        place = _best_place(
            axes, _course(axes, line), np.array([box.width, box.height]), others, taken
        )
        text.xy = tuple((place - axes.bbox.min) / axes.bbox.size)
        text.set_position(text.xy)
        taken.append(np.asarray(text.get_window_extent().extents))
        made.append(text)
    return made


def _course(axes: Axes, line: Line2D) -> FloatArray:
    """Return points close together along a line, or its markers if it has no line, in pixels."""
    points: FloatArray = np.asarray(line.get_transform().transform(line.get_xydata()), float)
    points = points[np.isfinite(points).all(axis=1)]
    if line.get_linestyle() == "None" or len(points) < 2:
        return points
    step = _SPACING * axes.figure.dpi / 72.0
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    at = np.linspace(0.0, along[-1], int(along[-1] / step) + 2)
    return np.stack([np.interp(at, along, part) for part in points.T], axis=1)


def _best_place(
    axes: Axes,
    own: FloatArray,
    size: FloatArray,
    others: Sequence[FloatArray],
    taken: Sequence[FloatArray],
) -> FloatArray:
    """Return the centre of a label, in pixels: free, close to its line and far from the others."""
    point = axes.figure.dpi / 72.0
    left_bottom, right_top = np.array(axes.bbox.min), np.array(axes.bbox.max)
    seen = np.all((own >= left_bottom - 1.0) & (own <= right_top + 1.0), axis=1)
    inside = own[seen] if seen.any() else own
    places = inside[np.unique(np.linspace(0, len(inside) - 1, _PLACES).round().astype(int))]
    reach = _SIDES * (0.5 * size + _GAP * point)
    centers = (places[:, None] + reach).reshape(-1, 2)
    low, high = centers - 0.5 * size, centers + 0.5 * size
    outside = np.maximum(left_bottom - low, high - right_top).max(axis=1)
    cost = 1e4 * (outside > 0.0) + 1e2 * np.maximum(outside, 0.0)
    for box in taken:
        cost += 1e4 * np.all((low < box[2:]) & (high > box[:2]), axis=1)
    cost += 20.0 * np.sum(_distances(low, high, inside) < point, axis=1)
    if others:
        away = _distances(low, high, np.concatenate(others))
        cost += 40.0 * np.sum(away < point, axis=1)
        cost += 10.0 * np.maximum(0.0, 1.0 - away.min(axis=1, initial=np.inf) / (_CLEAR * point))
    # Prefer the end of the line if all else is equal, because readers look there first.
    cost += np.repeat(np.linspace(1.0, 0.0, len(places)), len(_SIDES))
    return np.asarray(centers[np.argmin(cost)])


def _distances(low: FloatArray, high: FloatArray, points: FloatArray) -> FloatArray:
    """Return the distances of boxes (k, 2) from points (n, 2): (k, n)."""
    beside = np.maximum(low[:, None] - points, points - high[:, None])
    return np.asarray(np.linalg.norm(np.maximum(beside, 0.0), axis=-1))
