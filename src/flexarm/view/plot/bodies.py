"""Plots of the arm: postures, deflections of the links, bending moments."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.coordinates import station_of
from flexarm.base.arguments import check_count
from flexarm.base.errors import InputError, Problem, public_call_as
from flexarm.base.late import xr
from flexarm.simulation.calls.result import arm_of
from flexarm.view.plot import style
from flexarm.view.plot.drawn_result import (
    STATIONS,
    at_times,
    check_drawable,
    deflections,
    factor_of,
    joined,
    joints_of,
    readable_unit,
    rigid_result,
    shapes_of,
)
from flexarm.view.plot.magnified import Magnify, check_magnify
from flexarm.view.plot.mechanism import Marks, marks_of

_MOST = 200
_SPAN: dict[str, Any] = {"color": style.SKY, "alpha": 0.25, "linewidth": 0.0}


@public_call_as("plot.postures")
def postures(
    result: xr.Dataset,
    count: int = 10,
    *,
    rigid: bool | xr.Dataset = False,
    magnify: Magnify = 1.0,
    axes: Any = None,
) -> Axes:
    """Draw the arm at evenly spaced times, early ones light, and the path of its tip.

    Args:
        result: of ``simulate``, ``run_scenario`` or ``read_result``.
        count: number of postures, from the first sample to the last.
        rigid: True adds the rigid counterpart at the same joint angles, dashed; a result, such as
            that of ``arm.rigid()`` with the same torques, adds the arm of that result.
        magnify: factor on the bending of the links, or "auto" for one that draws the largest
            deflection at about 5 % of its link. The path is that of the drawn tip.
        axes: Matplotlib axes to draw into; None for a new figure.

    Returns:
        The Matplotlib axes.

    Raises:
        InputError: if the result does not contain the motion of an arm, ``count`` is not an
            integer from 2 to 200, ``magnify`` is neither from 0 to 10,000 nor "auto", or ``rigid``
            is neither a bool nor a result.
    """
    result = check_drawable("result", result)
    count = check_count("count", count, 2, _MOST)
    magnify = check_magnify(magnify)
    arm = arm_of("result", result)
    factor = factor_of(magnify, [(arm, result, False)])
    ghost = rigid_result(rigid, arm, result)
    time = result["time"].values
    times = np.linspace(time[0], time[-1], count)
    q = at_times(time, result["q"].values, times)
    shapes = shapes_of(arm, q, factor)
    marks = marks_of(arm, q, shapes)
    with style.panels(axes, 1, (4.8, 4.4), style.rows(1)) as (panel,):
        if ghost is not None:
            look = {**style.RIGID, "linewidth": 0.6}
            _draw_arms(panel, ghost.arm, ghost.shapes(times), [look] * count, "rigid")
        looks = [
            {"color": style.AGES(age), "linewidth": 1.5} for age in np.linspace(0.0, 1.0, count)
        ]
        _draw_marks(panel, marks, looks)
        name = "flexible" if factor == 1.0 else f"bending × {factor:g}"
        _draw_arms(panel, arm, shapes, looks, name)
        panel.plot(
            *_tip_path(arm, result, factor).T, color=style.VERMILLION, linewidth=1.2, label="tip"
        )
        panel.plot(*marks.feet.T, "o", color=style.INK, markersize=4.5, clip_on=False)
        for words, links in (("start", shapes[0]), ("end", shapes[-1])):
            _name_tip(panel, words, links[-1])
        panel.set(title="Postures", xlabel="x [m]", ylabel="y [m]", xmargin=0.07)
        panel.set_aspect("equal", adjustable="datalim")
        panel.grid(True, axis="both")
        style.legend_above(panel)
    return panel


def _draw_arms(
    panel: Axes, arm: Arm, shapes: FloatArray, looks: list[dict[str, Any]], name: str
) -> None:
    """Draw shapes (k, links, stations, 2) with inner joints as dots; the last one has a label."""
    for k, (links, look) in enumerate(zip(shapes, looks, strict=True)):
        label = name if k == len(shapes) - 1 else "_"
        panel.plot(*joined(arm.spec.is_serial, links).T, **{**look, "label": label})
        if "linestyle" not in look:
            joints = joints_of(arm, links[None])[0, 1:]
            panel.plot(*joints.T, "o", color=look["color"], markersize=3.2, label="_")


def _draw_marks(panel: Axes, marks: Marks, looks: list[dict[str, Any]]) -> None:
    """Draw slides, lines, curves, closures and a moving base of postures."""
    for k, look in enumerate(looks):
        pale: dict[str, Any] = {"color": style.GREY, "label": "_", "zorder": 1.2}
        for ends in marks.rails[k]:
            panel.plot(*ends.T, linewidth=0.8, **pale)
        if marks.body is not None:
            panel.plot(*marks.body[k].T, **{**look, "linewidth": 5.0, "label": "_"})
        panel.plot(*marks.pins[k].T, "o", color=look["color"], markersize=3.2, label="_")


def _name_tip(panel: Axes, words: str, link: FloatArray) -> None:
    """Label the tip of the last link (stations, 2) on the side that faces away from the link."""
    tip, right = link[-1], link[-1, 0] >= link[0, 0]
    near: dict[str, Any] = {"textcoords": "offset points", "ha": "left" if right else "right"}
    place = (float(tip[0]), float(tip[1]))
    panel.annotate(words, place, xytext=(4 if right else -4, 3), **near)


def _tip_path(arm: Arm, result: xr.Dataset, factor: float) -> FloatArray:
    if factor == 1.0:
        path: FloatArray = result["tip"].values
        return path
    time = result["time"].values
    fine = np.linspace(time[0], time[-1], min(len(time), 400))
    q = at_times(time, result["q"].values, fine)
    return shapes_of(arm, q, factor)[:, -1, -1]


@public_call_as("plot.deflection")
def deflection(result: xr.Dataset, count: int = 6, *, axes: Any = None) -> Axes:
    """Draw the deflection of the links from their root tangents: range of the run and some times.

    Args:
        result: as in `postures`.
        count: number of times at which the links are drawn, from the first sample to the last.
        axes: Matplotlib axes to draw into; None for a new figure.

    Returns:
        The Matplotlib axes. Horizontal: the distance from the base along the arm, m. For runs with
        more than 4000 samples the range is that of 4000 of them.

    Raises:
        InputError: if the result does not contain the motion of an arm, or ``count`` is not an
            integer from 1 to 200.
    """
    result = check_drawable("result", result)
    count = check_count("count", count, 1, _MOST)
    arm = arm_of("result", result)
    bent = deflections(arm, result)
    scale, unit = readable_unit("m", bent)
    chosen = np.linspace(0, len(bent) - 1, count).round().astype(int)
    shown_times = np.linspace(result["time"].values[0], result["time"].values[-1], count)
    along = _along(arm, np.linspace(0.0, 1.0, STATIONS))
    with style.panels(axes, 1, (style.WIDTH, 2.8), style.rows(1)) as (panel,):
        low, high = scale * bent.min(axis=0), scale * bent.max(axis=0)
        for link in range(arm.n_links):
            label = "range of the run" if link == 0 else "_"
            panel.fill_between(along[link], low[link], high[link], label=label, **_SPAN)
        ages = np.linspace(0.0, 1.0, count)
        for k, time, age in zip(chosen, shown_times, ages, strict=True):
            for link in range(arm.n_links):
                named = link == 0 and k in (chosen[0], chosen[-1])
                label = f"{time:.3g} s" if named else "_"
                look = {"color": style.AGES(age), "linewidth": 1.1, "label": label}
                panel.plot(along[link], scale * bent[k, link], **look)
        _finish_along(panel, arm, "Deflection from the root tangent", f"deflection [{unit}]")
    return panel


@public_call_as("plot.bending_moment")
def bending_moment(result: xr.Dataset, *, axes: Any = None) -> Axes:
    """Draw the envelope of the bending moment along the arm, and mark its largest value.

    Args:
        result: of a run with, for example, ``stations=11``, which records section forces.
        axes: Matplotlib axes to draw into; None for a new figure.

    Returns:
        The Matplotlib axes. Horizontal: the distance from the base along the arm, m.

    Raises:
        InputError: if the result does not contain bending moments.
    """
    result = check_drawable("result", result)
    if "bending_moment" not in result:
        hint = "Simulate with stations=11, for example, to record it."
        raise InputError(Problem("result", "has no 'bending_moment'", hint=hint))
    arm = arm_of("result", result)
    moment = result["bending_moment"].values
    scale, unit = readable_unit("N m", moment)
    low, high = scale * moment.min(axis=0), scale * moment.max(axis=0)
    along = _along(arm, result["station"].values)
    with style.panels(axes, 1, (style.WIDTH, 2.8), style.rows(1)) as (panel,):
        for link in range(arm.n_links):
            names = ("range of the run", "largest", "smallest") if link == 0 else ("_",) * 3
            panel.fill_between(along[link], low[link], high[link], label=names[0], **_SPAN)
            panel.plot(along[link], high[link], color=style.BLUE, linewidth=1.1, label=names[1])
            panel.plot(
                along[link], low[link], color=style.VERMILLION, linewidth=1.1, label=names[2]
            )
        _name_peak(panel, result, scale * moment, along, unit)
        _finish_along(panel, arm, "Bending moment", f"moment [{unit}]")
    return panel


def _name_peak(
    panel: Axes, result: xr.Dataset, moment: FloatArray, along: FloatArray, unit: str
) -> None:
    """Mark the largest absolute moment with its value and its time."""
    k, link, station = np.unravel_index(int(np.abs(moment).argmax()), moment.shape)
    value, place = float(moment[k, link, station]), float(along[link, station])
    panel.plot(place, value, "o", color=style.INK, markersize=4.0, label="_", clip_on=False)
    words = f"{value:.4g} {unit} at {result['time'].values[k]:.4g} s".replace("-", "−", 1)
    left = place < along.mean()
    near: dict[str, Any] = {"textcoords": "offset points", "va": "center"}
    near["ha"] = "left" if left else "right"
    outward = 9 if value > 0.0 else -9  # beyond the largest value there is no line
    panel.annotate(words, (place, value), xytext=(4 if left else -4, outward), **near)
    panel.margins(y=0.2)


def _along(arm: Arm, fraction: FloatArray) -> FloatArray:
    """Return distances from the base along the arm, (links, stations) m."""
    roots = _roots(arm)
    return np.asarray(roots[:, None] + arm.lengths[:, None] * fraction)


def _roots(arm: Arm) -> FloatArray:
    """Return the distances of the joints of the links from the base, along the arm, (links,) m."""
    if arm.spec.is_serial:
        return np.asarray(np.cumsum(arm.lengths) - arm.lengths)
    roots = np.zeros(arm.n_links)
    for i, parent in enumerate(arm.spec.parents):
        if parent >= 0:
            roots[i] = roots[parent] + arm.spec.links[parent].hub_radius + station_of(arm.spec, i)
    return roots


def _finish_along(panel: Axes, arm: Arm, title: str, label: str) -> None:
    panel.axhline(0.0, color=style.GREY, linewidth=0.7, zorder=1.0, label="_")
    for place in _roots(arm)[1:]:
        panel.axvline(place, color=style.GREY, linewidth=0.6, linestyle=":", zorder=0.5, label="_")
    panel.set(title=title, xlabel="distance from the base along the arm [m]", ylabel=label)
    panel.locator_params(nbins=7)
    style.legend_above(panel)
