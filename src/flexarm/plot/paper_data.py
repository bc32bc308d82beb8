"""What the paper's figures show, as plain arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import xarray as xr

    from flexarm.arm import Arm
    from flexarm.paper import PaperCase

FloatArray = NDArray[np.float64]

#: Postures in figure 3.
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


@dataclass(frozen=True, eq=False)
class Histories:
    """One case of the paper.

    Plain arrays, so that it can be sent to another process at little cost.

    Attributes:
        duration: of the motion, s.
        time: (T,) s.
        runs: model to channel to (T, links), (T, joints) or (T, 2). The models are attributes of
            ``PaperCase``.
        postures: model to (postures, links, stations, 2) m, evenly spread over the motion;
            "flexible" and "rigid".
    """

    duration: float
    time: FloatArray
    runs: dict[str, dict[str, FloatArray]]
    postures: dict[str, FloatArray]


def histories(case: PaperCase, models: Sequence[str] = ("flexible", "rigid")) -> Histories:
    """Take what the figures show out of the results of a case."""
    return Histories(
        duration=case.duration,
        time=case.flexible["time"].values,
        runs={model: _taken(getattr(case, model)) for model in models},
        postures={
            "flexible": _postures(case.arm, case.flexible, case.duration),
            "rigid": _postures(case.twin, case.rigid, case.duration),
        },
    )


def _taken(result: xr.Dataset) -> dict[str, FloatArray]:
    return {name: result[name].values for name in _CHANNELS}


def _postures(arm: Arm, result: xr.Dataset, duration: float) -> FloatArray:
    moments = np.linspace(0.0, duration, POSTURES)
    states = result["q"].sel(time=moments, method="nearest").values
    return np.stack([arm.shape(q, _STATIONS) for q in states])
