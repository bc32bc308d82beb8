"""Single plots of the paper, drawn into given axes: figures 3 to 16 and the two theories."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap

from flexarm.plot.paper_data import Histories
from flexarm.plot.style import (
    BLUE,
    FLEXIBLE,
    GREY,
    INK,
    RIGID,
    SECOND_ORDER,
    VERMILLION,
)

_TIME = "time [s]"
#: Early postures light, late ones dark.
_AGES = LinearSegmentedColormap.from_list("ages", ["#BBDDF0", BLUE])


class Panel(NamedTuple):
    """A time history of the paper: one channel of one link."""

    figure: int
    title: str
    channel: str
    link: int  # from 0
    label: str
    scale: float  # from SI to the unit of the label


def _of_both_links(
    first: int, step: int, title: str, channel: str, label: str, scale: float
) -> list[Panel]:
    return [
        Panel(first + k * step, title.format(k + 1), channel, k, label, scale) for k in range(2)
    ]


#: Figures 5 to 16, in the paper's order.
PANELS = sorted(
    [
        *_of_both_links(5, 2, "Angle of link {}", "link_angle", "angle [rad]", 1.0),
        *_of_both_links(6, 2, "Angular velocity of link {}", "link_rate", "velocity [rad/s]", 1.0),
        *_of_both_links(
            9, 2, "Tip deflection of link {}", "link_tip_deflection", "deflection [mm]", 1e3
        ),
        *_of_both_links(
            10, 2, "Tip velocity of link {}", "link_tip_deflection_rate", "velocity [mm/s]", 1e3
        ),
        *_of_both_links(13, 2, "Tip angle of link {}", "link_tip_slope", "angle [mrad]", 1e3),
        *_of_both_links(
            14,
            2,
            "Tip angular velocity of link {}",
            "link_tip_slope_rate",
            "velocity [mrad/s]",
            1e3,
        ),
    ]
)


def draw_history(axes: Axes, panel: Panel, case: Histories) -> None:
    """Draw a time history: the flexible arm, and the rigid one dashed."""
    for values, look in ((case.flexible, FLEXIBLE), (case.rigid, RIGID)):
        axes.plot(case.time, panel.scale * values[panel.channel][:, panel.link], **look)
    _label_history(axes, panel.title, panel.label, case)


def draw_torques(axes: Axes, case: Histories) -> None:
    """Draw figure 4: the torques of both joints, the same for every model."""
    torque = case.flexible["torque"]
    axes.plot(case.time, torque[:, 0], color=BLUE, linewidth=1.0, label="joint 1")
    axes.plot(
        case.time, torque[:, 1], color=VERMILLION, linewidth=1.0, linestyle="-.", label="joint 2"
    )
    _label_history(axes, "Joint torques", "torque [N m]", case)


def draw_path(axes: Axes, case: Histories) -> None:
    """Draw figure 3: the arm in ten postures, and the path of its tip."""
    ages = np.linspace(0.0, 1.0, len(case.postures))
    rigid_look = {**RIGID, "linewidth": 0.5}
    for posture, straight, age in zip(case.postures, case.rigid_postures, ages, strict=True):
        axes.plot(*posture.reshape(-1, 2).T, color=_AGES(age), linewidth=1.6)
        axes.plot(*posture[1:, 0].T, "o", color=_AGES(age), markersize=3.4, markeredgewidth=0.0)
        axes.plot(*straight.reshape(-1, 2).T, **rigid_look)
    moving = case.time <= case.duration
    axes.plot(*case.flexible["tip"][moving].T, color=VERMILLION, linewidth=1.2)
    axes.plot(*case.rigid["tip"][moving].T, **rigid_look)
    axes.plot(0.0, 0.0, "o", color=INK, markersize=4.5, clip_on=False)
    for point, text, across in (
        (case.rigid["tip"][0], "start", "left"),
        (case.rigid["tip"][moving][-1], "end", "center"),
    ):
        axes.annotate(
            text,
            point,
            xytext=(4 if across == "left" else 0, 3),
            textcoords="offset points",
            ha=across,
        )
    axes.set_aspect("equal")
    axes.set(xlabel="x [m]", ylabel="y [m]", title="Tip path and ten postures")
    axes.set(xlim=(-0.1, 2.25), ylim=(-0.1, 2.15))


def draw_theories(axes: Axes, case: Histories) -> None:
    """Draw the tip deflection of link 1 in the paper's theory and in the second-order theory."""
    deflection = "link_tip_deflection"
    paper = {**FLEXIBLE, "label": "linear, as the paper"}
    other = {**SECOND_ORDER, "linestyle": "-."}
    for values, look in ((case.flexible, paper), (case.second_order, other), (case.rigid, RIGID)):
        axes.plot(case.time, 1e3 * values[deflection][:, 0], **look)
    _label_history(axes, "Tip deflection of link 1", "deflection [mm]", case)


def draw_difference(axes: Axes, case: Histories) -> None:
    """Draw the linear theory's tip deflection of link 1 less the second-order theory's."""
    deflection = "link_tip_deflection"
    difference = case.flexible[deflection][:, 0] - case.second_order[deflection][:, 0]
    axes.plot(case.time, 1e3 * difference, color=INK, linewidth=1.0)
    _label_history(axes, "", "difference [mm]", case)


def _label_history(axes: Axes, title: str, label: str, case: Histories) -> None:
    axes.axvline(case.duration, color=GREY, linewidth=0.6, linestyle=":", zorder=0.5)
    axes.set(xlabel=_TIME, ylabel=label, title=title, xlim=(0.0, case.time[-1]))
    axes.locator_params(nbins=6)
