"""Figures of the paper: single ones, all on one page, and a comparison of the two theories."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MultipleLocator

from flexarm.view.plot import style
from flexarm.view.plot.paper.paper_data import (
    HISTORY_NAMES,
    PANELS,
    TIP_FRAME,
    FloatArray,
    Histories,
    Panel,
)

_TIME = "time [s]"
_END_OF_TORQUES: dict[str, Any] = {
    "color": style.GREY,
    "linewidth": 0.6,
    "linestyle": ":",
    "zorder": 0.5,
}


def _draw_history(axes: Axes, panel: Panel, case: Histories, frame: bool = False) -> None:
    """Draw a history of the flexible arm, and of the rigid arm as a dashed line."""
    for model, look in (("flexible", style.FLEXIBLE), ("rigid", style.RIGID)):
        axes.plot(case.time, _values(panel, case, model), **look)
    of_tip = panel.channel.startswith("link_tip")
    title = f"{panel.title} {TIP_FRAME}" if frame and of_tip else panel.title
    _label_history(axes, title, panel.label, case)


def _values(panel: Panel, case: Histories, model: str) -> FloatArray:
    return panel.scale * case.runs[model][panel.channel][:, panel.link]


def _draw_torques(axes: Axes, case: Histories) -> None:
    """Draw figure 4: the torques of both joints, which are the same in all models."""
    torque = case.runs["flexible"]["torque"]
    axes.plot(case.time, torque[:, 0], color=style.BLUE, linewidth=1.0, label="joint 1")
    axes.plot(
        case.time,
        torque[:, 1],
        color=style.VERMILLION,
        linewidth=1.0,
        linestyle="-.",
        label="joint 2",
    )
    _label_history(axes, "Joint torques", "torque [N m]", case)


def _draw_path(axes: Axes, case: Histories) -> None:
    """Draw figure 3: the arm in ten postures, and the path of its tip."""
    bent, straight = case.postures["flexible"], case.postures["rigid"]
    ages = np.linspace(0.0, 1.0, len(bent))
    rigid_look = {**style.RIGID, "linewidth": 0.5, "label": "_"}
    for links, rigid_links, age in zip(bent, straight, ages, strict=True):
        color = style.AGES(age)
        axes.plot(*links.reshape(-1, 2).T, color=color, linewidth=1.4)
        axes.plot(*links[1:, 0].T, "o", color=color, markersize=3.2, markeredgewidth=0.0)
        axes.plot(*rigid_links.reshape(-1, 2).T, **rigid_look)
    moving = case.time <= case.duration
    tips = {model: run["tip"][moving] for model, run in case.runs.items()}
    links_of_last, dashes_of_last = axes.get_lines()[-3], axes.get_lines()[-1]
    links_of_last.set_label("flexible")
    dashes_of_last.set_label("rigid")
    axes.plot(*tips["flexible"].T, color=style.VERMILLION, linewidth=1.2, label="path")
    axes.plot(*tips["rigid"].T, **rigid_look)
    axes.plot(0.0, 0.0, "o", color=style.INK, markersize=4.5, clip_on=False)
    near: dict[str, Any] = {"textcoords": "offset points", "ha": "left"}
    axes.annotate("start", tips["rigid"][0], xytext=(4, 2), **near)
    axes.annotate("end", tips["rigid"][-1], xytext=(3, 3), **near)
    axes.set_aspect("equal")
    axes.grid(True, axis="both")
    axes.yaxis.set_major_locator(MultipleLocator(0.5))
    axes.set(xlabel="x [m]", ylabel="y [m]", title="Ten postures")
    axes.set(xlim=(-0.1, 2.25), ylim=(-0.1, 2.15))


def _first_deflection(case: Histories, model: str) -> FloatArray:
    """Return the tip deflection of link 1, (T,) mm."""
    return 1e3 * case.runs[model]["link_tip_deflection"][:, 0]


def _label_history(axes: Axes, title: str, label: str, case: Histories) -> None:
    axes.axvline(case.duration, label="end of torques", **_END_OF_TORQUES)
    axes.set(xlabel=_TIME, ylabel=label, title=title, xlim=(0.0, case.time[-1]))
    axes.locator_params(axis="x", nbins=4)
    axes.locator_params(axis="y", nbins=5)


Draw = Callable[..., None]

_COLUMN = 4.0  # width of one column of print, inches
_ABOVE_LEGEND = 19.0  # points between a title and its axes, which leaves a row for the legend


def _single(draw: Draw, case: Histories, *, figure: int, height: float = 2.6) -> style.Sheet:
    sheet = style.Sheet(_COLUMN, height)
    with style.styled():
        axes = sheet.subplots()
        draw(axes, case=case)
        _finish(sheet, axes, figure)
        style.place_labels(axes)
    return sheet


def _finish(sheet: style.Sheet, axes: Axes, figure: int) -> None:
    """Set the margins, add the figure's number to its title, and add the legend below the title."""
    style.margins(sheet, left=0.58, bottom=0.4, right=0.14, top=0.48, hspace=0.14)
    axes.set_title(f"Fig. {figure}   {axes.get_title(loc='left')}", pad=_ABOVE_LEGEND)
    style.legend_above(axes)


def _path(case: Histories) -> style.Sheet:
    """Draw figure 3, with an inset for the distance between the tips, which is too small in it."""
    sheet = _single(_draw_path, case, figure=3, height=4.15)
    with style.styled():
        inset = sheet.axes[0].inset_axes((0.56, 0.16, 0.4, 0.22))
        away = case.runs["flexible"]["tip"] - case.runs["rigid"]["tip"]
        inset.plot(case.time, 1e3 * np.linalg.norm(away, axis=1), color=style.INK, linewidth=1.0)
        _label_history(inset, "Between the tips [mm]", "", case)
    return sheet


def _history(panel: Panel, case: Histories) -> style.Sheet:
    """Draw one history; below an angle also its difference from the rigid arm, a thousandth."""
    if panel.channel != "link_angle":
        draw = partial(_draw_history, panel=panel, frame=True)
        return _single(draw, case, figure=panel.figure)
    sheet = style.Sheet(_COLUMN, 3.5)
    with style.styled():
        above, below = sheet.subplots(2, sharex=True, height_ratios=(2.0, 1.0))
        _draw_history(above, panel, case)
        difference = _values(panel, case, "flexible") - _values(panel, case, "rigid")
        below.plot(case.time, 1e3 * difference, color=style.INK, linewidth=1.0)
        _label_history(below, "", "difference [mrad]", case)
        above.set(xlabel="")
        _finish(sheet, above, panel.figure)
        style.place_labels(above)
        style.place_labels(below)
    return sheet


def overview(case: Histories) -> style.Sheet:
    """Draw all figures of the paper on one page, A4 landscape, one row for each quantity."""
    sheet = style.Sheet(11.69, 8.27)
    with style.styled():
        style.margins(sheet, left=0.65, bottom=0.45, right=0.3, top=1.0)
        rows = sheet.add_gridspec(2, 1, height_ratios=(1.0, 1.75), hspace=0.22)
        top = rows[0].subgridspec(1, 2, width_ratios=(1.0, 2.6), wspace=0.13)
        path, torques = sheet.add_subplot(top[0]), sheet.add_subplot(top[1])
        cells = rows[1].subgridspec(3, 4, wspace=0.34, hspace=0.42)
        histories = [sheet.add_subplot(cells[k]) for k in range(12)]
        _draw_path(path, case)
        path.set_anchor("W")
        _draw_torques(torques, case)
        for axes, panel in zip(histories, PANELS, strict=True):
            _draw_history(axes, panel, case)
        for axes in histories[:-4]:  # all rows have the same time axis
            axes.set_xlabel("")
        numbers = (3, 4, *(panel.figure for panel in PANELS))
        for number, axes in zip(numbers, (path, torques, *histories), strict=True):
            axes.set_title(f"Fig. {number}   {axes.get_title(loc='left')}")
            style.place_labels(axes)
        style.legend_above(torques)
        width, height = sheet.get_size_inches()
        level = 1.0 - 0.4 / height
        title = f"Two flexible links, tip sent along a line in {case.duration:g} s"
        sheet.text(0.65 / width, level, title, fontsize=11.0)
        note = f"Path, timing and torques: our choice. Figs. 9 to 16: tip of each link {TIP_FRAME}."
        sheet.text(0.65 / width, level - 0.19 / height, note, fontsize=9.0)
        handles, labels = histories[0].get_legend_handles_labels()
        corner = (1.0 - 0.3 / width, level - 0.07 / height)
        sheet.legend(handles, labels, loc="lower right", bbox_to_anchor=corner, ncols=3)
    return sheet


def theories(case: Histories) -> style.Sheet:
    """Draw the tip deflection in both theories, and their difference below it."""
    sheet = style.Sheet(_COLUMN, 3.4)
    with style.styled():
        above, below = sheet.subplots(2, sharex=True, height_ratios=(2.0, 1.0))
        style.margins(sheet, left=0.58, bottom=0.4, right=0.14, top=0.28, hspace=0.14)
        looks = {
            "flexible": {**style.FLEXIBLE, "label": "linear, as the paper"},
            "second_order": {**style.SECOND_ORDER, "linestyle": "-."},
            "rigid": style.RIGID,
        }
        for model, look in looks.items():
            above.plot(case.time, _first_deflection(case, model), **look)
        _label_history(above, "Tip deflection of link 1", "deflection [mm]", case)
        theories = [_first_deflection(case, name) for name in ("flexible", "second_order")]
        below.plot(case.time, theories[0] - theories[1], color=style.INK, linewidth=1.0)
        _label_history(below, "", "difference [mm]", case)
        above.set(xlabel="", xlim=(0.0, 2.0 * case.duration))
        above.legend(loc="lower right", borderaxespad=1.0)
        style.place_labels(above)
        style.place_labels(below)
    return sheet


#: All figures by file name; "theories" also needs the second-order run.
FIGURES: dict[str, Callable[[Histories], style.Sheet]] = {
    "fig03_path": _path,
    "fig04_torques": partial(_single, _draw_torques, figure=4),
    **{name: partial(_history, panel) for name, panel in HISTORY_NAMES.items()},
    "overview": overview,
    "theories": theories,
}
