"""Data of the paper's figures as plain arrays, and the table of figures; without Matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import xarray as xr

    from flexarm.arm.arm import Arm

FloatArray = NDArray[np.float64]

#: Number of postures in figure 3.
POSTURES = 10
_STATIONS = 25
_CHANNELS = (
    "torque",
    "link_angle",
    "link_rate",
    "link_tip_deflection",
    "link_tip_deflection_rate",
    "link_tip_slope",
    "link_tip_slope_rate",
    "tip",
)


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


def _file_name(panel: Panel) -> str:
    return f"fig{panel.figure:02d}_link{panel.link + 1}_{panel.channel.removeprefix('link_')}"


#: Figures 5 to 16 by file name.
HISTORY_NAMES = {_file_name(panel): panel for panel in PANELS}
#: Names of all the paper's figures.
FIGURE_NAMES = ("fig03_path", "fig04_torques", *HISTORY_NAMES)


class Case(Protocol):
    """Interface of ``flexarm.view.paper.PaperCase``, which is in a higher layer."""

    duration: float
    arm: Arm
    rigid_counterpart: Arm

    @property
    def flexible(self) -> xr.Dataset:
        """Result of the arm."""

    @property
    def rigid(self) -> xr.Dataset:
        """Result of its rigid counterpart."""


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


def histories(case: Case, models: Sequence[str] = ("flexible", "rigid")) -> Histories:
    """Extract the data of the figures from the results of a case."""
    return Histories(
        duration=case.duration,
        time=case.flexible["time"].values,
        runs={
            model: {name: getattr(case, model)[name].values for name in _CHANNELS}
            for model in models
        },
        postures={
            "flexible": _postures(case.arm, case.flexible, case.duration),
            "rigid": _postures(case.rigid_counterpart, case.rigid, case.duration),
        },
    )


def _postures(arm: Arm, result: xr.Dataset, duration: float) -> FloatArray:
    moments = np.linspace(0.0, duration, POSTURES)
    states = result["q"].sel(time=moments, method="nearest").values
    return np.stack([arm.shape(q, _STATIONS) for q in states])
