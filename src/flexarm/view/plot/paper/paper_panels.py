"""Plots of the paper in given axes: figures 3 to 16 and the comparison of the two theories."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.ticker import MultipleLocator

from flexarm.view.plot.paper.paper_data import TIP_FRAME, FloatArray, Histories, Panel
from flexarm.view.plot.style import (
    BLUE,
    FLEXIBLE,
    GREY,
    INK,
    RIGID,
    SECOND_ORDER,
    VERMILLION,
)

_TIME = "time [s]"
_END_OF_TORQUES: dict[str, Any] = {
    "color": GREY,
    "linewidth": 0.6,
    "linestyle": ":",
    "zorder": 0.5,
}
#: Colours by time: early postures light, late ones dark.
_AGES = LinearSegmentedColormap.from_list("ages", ["#BBDDF0", BLUE])


def draw_history(axes: Axes, panel: Panel, case: Histories, frame: bool = False) -> None:
    """Draw a time history of the flexible arm, and of the rigid arm as a dashed line.

    Args:
        axes: axes to draw into.
        panel, case: link and channel, and their data.
        frame: whether the title states the reference of the tip's channels.
    """
    for model, look in (("flexible", FLEXIBLE), ("rigid", RIGID)):
        axes.plot(case.time, _values(panel, case, model), **look)
    of_tip = panel.channel.startswith("link_tip")
    title = f"{panel.title} {TIP_FRAME}" if frame and of_tip else panel.title
    _label_history(axes, title, panel.label, case)


def draw_from_rigid(axes: Axes, panel: Panel, case: Histories) -> None:
    """Draw the difference of a link's angle from that of the rigid arm."""
    difference = _values(panel, case, "flexible") - _values(panel, case, "rigid")
    axes.plot(case.time, 1e3 * difference, color=INK, linewidth=1.0)
    _label_history(axes, "", "difference [mrad]", case)


def draw_tip_distance(axes: Axes, case: Histories) -> None:
    """Draw the distance of the flexible arm's tip from the rigid arm's tip."""
    away = case.runs["flexible"]["tip"] - case.runs["rigid"]["tip"]
    axes.plot(case.time, 1e3 * np.linalg.norm(away, axis=1), color=INK, linewidth=1.0)
    _label_history(axes, "Between the tips [mm]", "", case)


def _values(panel: Panel, case: Histories, model: str) -> FloatArray:
    return panel.scale * case.runs[model][panel.channel][:, panel.link]


def draw_torques(axes: Axes, case: Histories) -> None:
    """Draw figure 4: the torques of both joints, which are the same in all models."""
    torque = case.runs["flexible"]["torque"]
    axes.plot(case.time, torque[:, 0], color=BLUE, linewidth=1.0, label="joint 1")
    axes.plot(
        case.time, torque[:, 1], color=VERMILLION, linewidth=1.0, linestyle="-.", label="joint 2"
    )
    _label_history(axes, "Joint torques", "torque [N m]", case)


def draw_path(axes: Axes, case: Histories) -> None:
    """Draw figure 3: the arm in ten postures, and the path of its tip."""
    bent, straight = case.postures["flexible"], case.postures["rigid"]
    ages = np.linspace(0.0, 1.0, len(bent))
    rigid_look = {**RIGID, "linewidth": 0.5, "label": "_"}
    for links, rigid_links, age in zip(bent, straight, ages, strict=True):
        color = _AGES(age)
        axes.plot(*links.reshape(-1, 2).T, color=color, linewidth=1.4)
        axes.plot(*links[1:, 0].T, "o", color=color, markersize=3.2, markeredgewidth=0.0)
        axes.plot(*rigid_links.reshape(-1, 2).T, **rigid_look)
    moving = case.time <= case.duration
    tips = {model: run["tip"][moving] for model, run in case.runs.items()}
    links_of_last, dashes_of_last = axes.get_lines()[-3], axes.get_lines()[-1]
    links_of_last.set_label("flexible")
    dashes_of_last.set_label("rigid")
    axes.plot(*tips["flexible"].T, color=VERMILLION, linewidth=1.2, label="path")
    axes.plot(*tips["rigid"].T, **rigid_look)
    axes.plot(0.0, 0.0, "o", color=INK, markersize=4.5, clip_on=False)
    near: dict[str, Any] = {"textcoords": "offset points", "ha": "left"}
    axes.annotate("start", tips["rigid"][0], xytext=(4, 2), **near)
    axes.annotate("end", tips["rigid"][-1], xytext=(3, 3), **near)
    axes.set_aspect("equal")
    axes.grid(True, axis="both")
    axes.yaxis.set_major_locator(MultipleLocator(0.5))
    axes.set(xlabel="x [m]", ylabel="y [m]", title="Ten postures")
    axes.set(xlim=(-0.1, 2.25), ylim=(-0.1, 2.15))


def draw_theories(axes: Axes, case: Histories) -> None:
    """Draw the tip deflection of link 1 in the paper's theory and in the second-order theory."""
    looks = {
        "flexible": {**FLEXIBLE, "label": "linear, as the paper"},
        "second_order": {**SECOND_ORDER, "linestyle": "-."},
        "rigid": RIGID,
    }
    for model, look in looks.items():
        axes.plot(case.time, _first_deflection(case, model), **look)
    _label_history(axes, "Tip deflection of link 1", "deflection [mm]", case)


def draw_difference(axes: Axes, case: Histories) -> None:
    """Draw the difference of link 1's tip deflection: linear minus second-order theory."""
    difference = _first_deflection(case, "flexible") - _first_deflection(case, "second_order")
    axes.plot(case.time, difference, color=INK, linewidth=1.0)
    _label_history(axes, "", "difference [mm]", case)


def _first_deflection(case: Histories, model: str) -> FloatArray:
    """Return the tip deflection of link 1, (T,) mm."""
    return 1e3 * case.runs[model]["link_tip_deflection"][:, 0]


def _label_history(axes: Axes, title: str, label: str, case: Histories) -> None:
    axes.axvline(case.duration, label="end of torques", **_END_OF_TORQUES)
    axes.set(xlabel=_TIME, ylabel=label, title=title, xlim=(0.0, case.time[-1]))
    axes.locator_params(axis="x", nbins=4)
    axes.locator_params(axis="y", nbins=5)
