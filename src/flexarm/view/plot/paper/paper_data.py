"""Data of the paper's figures as plain arrays, and the table of figures; without Matplotlib."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Panel(NamedTuple):
    """Time history in the paper: one channel of one link.

    Channels of the link's tip are relative to the tangent at its root.
    """

    figure: int
    title: str  # after "Fig. N"
    channel: str
    link: int  # from 0
    label: str
    scale: float  # from SI to the unit of the label


#: Reference of the channels of a link's tip, printed once on a page of many plots.
TIP_FRAME = "relative to root tangent"

#: Figures 5 to 16, in the paper's order.
PANELS = (
    Panel(5, "Angle of link 1", "link_angle", 0, "angle [rad]", 1.0),
    Panel(6, "Angular velocity of link 1", "link_rate", 0, "velocity [rad/s]", 1.0),
    Panel(7, "Angle of link 2", "link_angle", 1, "angle [rad]", 1.0),
    Panel(8, "Angular velocity of link 2", "link_rate", 1, "velocity [rad/s]", 1.0),
    Panel(9, "Tip deflection of link 1", "link_tip_deflection", 0, "deflection [mm]", 1e3),
    Panel(10, "Tip velocity of link 1", "link_tip_deflection_rate", 0, "velocity [mm/s]", 1e3),
    Panel(11, "Tip deflection of link 2", "link_tip_deflection", 1, "deflection [mm]", 1e3),
    Panel(12, "Tip velocity of link 2", "link_tip_deflection_rate", 1, "velocity [mm/s]", 1e3),
    Panel(13, "Tip angle of link 1", "link_tip_slope", 0, "angle [mrad]", 1e3),
    Panel(14, "Tip angular velocity of link 1", "link_tip_slope_rate", 0, "velocity [mrad/s]", 1e3),
    Panel(15, "Tip angle of link 2", "link_tip_slope", 1, "angle [mrad]", 1e3),
    Panel(16, "Tip angular velocity of link 2", "link_tip_slope_rate", 1, "velocity [mrad/s]", 1e3),
)


#: Figures 5 to 16 by file name.
HISTORY_NAMES = {
    f"fig{panel.figure:02d}_link{panel.link + 1}_{panel.channel.removeprefix('link_')}": panel
    for panel in PANELS
}
#: Names of all the paper's figures.
FIGURE_NAMES = ("fig03_path", "fig04_torques", *HISTORY_NAMES)


@dataclass(frozen=True, eq=False)
class Histories:
    """Data of one case of the paper.

    The data are plain arrays, so that they can be sent to another process at low cost.
    """

    duration: float  # of the motion, s
    time: FloatArray  # (T,) s
    #: Model to channel to (T, links), (T, joints) or (T, 2). The models are attributes of the case:
    #: "flexible", "rigid", "second_order".
    runs: dict[str, dict[str, FloatArray]]
    #: Model to (postures, links, stations, 2) m, at evenly spaced times of the motion; "flexible"
    #: and "rigid"
    postures: dict[str, FloatArray]
