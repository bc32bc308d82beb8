"""Results of the paper's example: three models of the same arm under the same torques.

``library/paper.yaml`` defines the case. The paper shows the flexible arm in its own theory and the
rigid model. The second-order theory, which includes the shortening of bent links, shows the error
of the paper's theory. The same line in half the time bends the arm four times as much.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from importlib.resources import as_file, files
from typing import NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.late import xr
from flexarm.cases.scenario.scenario import prepare
from flexarm.linear import modes
from flexarm.model import Scenario, load_scenario
from flexarm.view.plot.paper.paper_data import FloatArray, Histories

#: Motion times (s): the scenario's own, and half of it.
SLOW, FAST = 2.0, 1.0
#: Number of elements per link of the fine mesh for comparison of frequencies: its lowest four
#: differ from the exact ones by less than 0.1 %.
FINE_ELEMENTS = 16


def paper_scenario(duration: float = SLOW) -> Scenario:
    """Return the paper's case, with a motion along the line of given ``duration`` (s)."""
    with as_file(files("flexarm") / "library" / "paper.yaml") as path:
        scenario = load_scenario(path)
    assert scenario.motion is not None  # the packaged file has one
    return scenario.replace(motion=scenario.motion.replace(duration=duration))


class PaperCase:
    """One motion, and the response of three models of the arm to its torques.

    Each model is simulated when its result is first used. The runs continue after the ``duration``
    (s) of the motion. ``arm`` is the flexible arm in the theory of the paper.
    """

    def __init__(self, duration: float = SLOW, *, progress: bool | None = None) -> None:
        self.duration = duration
        self.progress = progress
        self.prepared = prepare(paper_scenario(duration))
        self.arm = self.prepared.arm
        self.rigid_counterpart = self.arm.rigid()

    @cached_property
    def flexible(self) -> xr.Dataset:
        """Result of the flexible arm in the theory of the paper."""
        return self.prepared.run(progress=self.progress)

    @cached_property
    def rigid(self) -> xr.Dataset:
        """Result of the rigid model, which follows the motion."""
        return self.prepared.run(arm=self.rigid_counterpart, progress=self.progress)

    @cached_property
    def second_order(self) -> xr.Dataset:
        """Result of the flexible arm in the second-order theory."""
        other = Arm(self.arm.spec.replace(theory="second_order"))
        return self.prepared.run(arm=other, progress=self.progress)


class LinkNumbers(NamedTuple):
    """Deflections of one link in one run, m."""

    peak: float  # largest tip deflection during the motion
    #: Half the peak-to-peak tip deflection after the end of the torques, which is the amplitude of
    #: the residual vibration
    residual: float
    #: Largest difference of the tip deflection between the paper's and the second-order theory
    #: during the motion
    theory: float


class TipNumbers(NamedTuple):
    """Largest distance (m) of the tip from the rigid one in the motion, and that at its end."""

    largest: float
    at_end: float


def link_numbers(case: PaperCase) -> list[LinkNumbers]:
    """Return the deflections of each link."""
    deflection = case.flexible["link_tip_deflection"].values
    other = case.second_order["link_tip_deflection"].values
    moving = case.flexible["time"].values <= case.duration
    peak = np.max(np.abs(deflection[moving]), axis=0)
    residual = 0.5 * np.ptp(deflection[~moving], axis=0)
    theory = np.max(np.abs(deflection - other)[moving], axis=0)
    rows = np.stack([peak, residual, theory], axis=1)
    return [LinkNumbers(*(float(value) for value in row)) for row in rows]


def tip_numbers(case: PaperCase) -> TipNumbers:
    """Return the distances between the tips of the flexible and the rigid arm."""
    away = np.linalg.norm((case.flexible["tip"] - case.rigid["tip"]).values, axis=1)
    moving = case.flexible["time"].values <= case.duration
    return TipNumbers(float(np.max(away[moving])), float(away[moving][-1]))


def torque_range(case: PaperCase) -> FloatArray:
    """Return the lowest and highest torque of each joint: (joints, 2) N m."""
    torque = case.flexible["torque"].values
    return np.stack([torque.min(axis=0), torque.max(axis=0)], axis=1)


class FrequencyTable(NamedTuple):
    """Lowest natural frequencies (Hz) at the initial posture, for the paper's and a fine mesh."""

    joints: str
    paper_mesh: FloatArray
    fine_mesh: FloatArray


def frequency_tables(case: PaperCase, count: int = 4) -> list[FrequencyTable]:
    """Return the ``count`` lowest vibration frequencies, with joints locked and free."""
    assert case.prepared.motion is not None
    angles = case.prepared.motion.joint_angle(0.0)
    links = [link.replace(elements=FINE_ELEMENTS) for link in case.arm.spec.links]
    meshes = (case.arm, Arm(case.arm.spec.replace(links=links)))
    return [
        FrequencyTable(joints, *(_vibrations(arm, angles, joints, count) for arm in meshes))
        for joints in ("locked", "free")
    ]


def _vibrations(arm: Arm, angles: FloatArray, joints: str, count: int) -> FloatArray:
    frequencies = modes(arm, angles, joints).frequency_hz
    return frequencies[frequencies > 0.0][:count]


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


def histories(case: PaperCase, models: Sequence[str] = ("flexible", "rigid")) -> Histories:
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
