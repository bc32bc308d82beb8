"""Figures of the paper: single ones, all on one page, and a comparison of the two theories."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from matplotlib.axes import Axes

from flexarm.view.plot.paper.paper_data import HISTORY_NAMES, PANELS, TIP_FRAME, Histories, Panel
from flexarm.view.plot.paper.paper_panels import (
    draw_difference,
    draw_from_rigid,
    draw_history,
    draw_path,
    draw_theories,
    draw_tip_distance,
    draw_torques,
)
from flexarm.view.plot.style import Sheet, legend_above, margins, place_labels, styled

Draw = Callable[..., None]

_COLUMN = 4.0  # width of one column of print, inches
_ABOVE_LEGEND = 19.0  # points between a title and its axes, which leaves a row for the legend


def _single(draw: Draw, case: Histories, *, figure: int, height: float = 2.6) -> Sheet:
    sheet = Sheet(_COLUMN, height)
    with styled():
        axes = sheet.subplots()
        draw(axes, case=case)
        _finish(sheet, axes, figure)
        place_labels(axes)
    return sheet


def _finish(sheet: Sheet, axes: Axes, figure: int) -> None:
    """Set the margins, add the figure's number to its title, and add the legend below the title."""
    margins(sheet, left=0.58, bottom=0.4, right=0.14, top=0.48, hspace=0.14)
    axes.set_title(f"Fig. {figure}   {axes.get_title(loc='left')}", pad=_ABOVE_LEGEND)
    legend_above(axes)


def _path(case: Histories) -> Sheet:
    """Draw figure 3, with an inset for the distance between the tips, which is too small in it."""
    sheet = _single(draw_path, case, figure=3, height=4.15)
    with styled():
        inset = sheet.axes[0].inset_axes((0.56, 0.16, 0.4, 0.22))
        draw_tip_distance(inset, case)
    return sheet


def _history(panel: Panel, case: Histories) -> Sheet:
    """Draw one history; below an angle also its difference from the rigid arm.

    The difference has its own axes, because it is a thousandth of the angle.
    """
    if panel.channel != "link_angle":
        draw = partial(draw_history, panel=panel, frame=True)
        return _single(draw, case, figure=panel.figure)
    sheet = Sheet(_COLUMN, 3.5)
    with styled():
        above, below = sheet.subplots(2, sharex=True, height_ratios=(2.0, 1.0))
        draw_history(above, panel, case)
        draw_from_rigid(below, panel, case)
        above.set(xlabel="")
        _finish(sheet, above, panel.figure)
        place_labels(above)
        place_labels(below)
    return sheet


def overview(case: Histories) -> Sheet:
    """Draw all figures of the paper on one page, A4 landscape.

    The rows are angles, deflections and slopes; in each, link 1 and its rate, link 2 and its rate.
    """
    sheet = Sheet(11.69, 8.27)
    with styled():
        margins(sheet, left=0.65, bottom=0.45, right=0.3, top=1.0)
        rows = sheet.add_gridspec(2, 1, height_ratios=(1.0, 1.75), hspace=0.22)
        top = rows[0].subgridspec(1, 2, width_ratios=(1.0, 2.6), wspace=0.13)
        path, torques = sheet.add_subplot(top[0]), sheet.add_subplot(top[1])
        cells = rows[1].subgridspec(3, 4, wspace=0.34, hspace=0.42)
        histories = [sheet.add_subplot(cells[k]) for k in range(12)]
        draw_path(path, case)
        path.set_anchor("W")
        draw_torques(torques, case)
        for axes, panel in zip(histories, PANELS, strict=True):
            draw_history(axes, panel, case)
        for axes in histories[:-4]:  # all rows have the same time axis
            axes.set_xlabel("")
        numbers = (3, 4, *(panel.figure for panel in PANELS))
        for number, axes in zip(numbers, (path, torques, *histories), strict=True):
            axes.set_title(f"Fig. {number}   {axes.get_title(loc='left')}")
            place_labels(axes)
        legend_above(torques)
        _head(sheet, histories[0], case)
    return sheet


def _head(sheet: Sheet, example: Axes, case: Histories) -> None:
    """Write the title of a page, and the legend of all its plots."""
    width, height = sheet.get_size_inches()
    level = 1.0 - 0.4 / height
    title = f"Two flexible links, tip sent along a line in {case.duration:g} s"
    sheet.text(0.65 / width, level, title, fontsize=11.0)
    note = f"Path, timing and torques: our choice. Figs. 9 to 16: tip of each link {TIP_FRAME}."
    sheet.text(0.65 / width, level - 0.19 / height, note, fontsize=9.0)
    handles, labels = example.get_legend_handles_labels()
    corner = (1.0 - 0.3 / width, level - 0.07 / height)
    sheet.legend(handles, labels, loc="lower right", bbox_to_anchor=corner, ncols=3)


def theories(case: Histories) -> Sheet:
    """Draw the tip deflection in both theories, and their difference below it."""
    sheet = Sheet(_COLUMN, 3.4)
    with styled():
        above, below = sheet.subplots(2, sharex=True, height_ratios=(2.0, 1.0))
        margins(sheet, left=0.58, bottom=0.4, right=0.14, top=0.28, hspace=0.14)
        draw_theories(above, case)
        draw_difference(below, case)
        above.set(xlabel="", xlim=(0.0, 2.0 * case.duration))
        above.legend(loc="lower right", borderaxespad=1.0)
        place_labels(above)
        place_labels(below)
    return sheet


#: All figures by file name; "theories" also needs the second-order run.
FIGURES: dict[str, Callable[[Histories], Sheet]] = {
    "fig03_path": _path,
    "fig04_torques": partial(_single, draw_torques, figure=4),
    **{name: partial(_history, panel) for name, panel in HISTORY_NAMES.items()},
    "overview": overview,
    "theories": theories,
}
