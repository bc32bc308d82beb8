"""The paper's example, computed: three models of the same arm under the same torques.

``library/paper.yaml`` holds the case. The flexible arm in the paper's theory and its rigid twin are
what the paper shows; the second-order theory, which knows that bent links shorten, shows how far
the paper's goes. The same line in half the time bends the arm four times as much.
"""

from __future__ import annotations

from functools import cached_property
from importlib.resources import as_file, files
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm import Arm
from flexarm.linear import modes
from flexarm.model import Scenario, load_scenario
from flexarm.scenarios.scenario import prepare

if TYPE_CHECKING:
    import xarray as xr

FloatArray = NDArray[np.float64]

#: Motion times (s): the scenario's own, and half of it.
SLOW, FAST = 2.0, 1.0
#: Elements on each link of the fine mesh whose frequencies are shown beside the paper's: its lowest
#: four differ from the exact ones by less than 0.1 %.
FINE_ELEMENTS = 16


def paper_scenario(duration: float = SLOW) -> Scenario:
    """Return the paper's case, with the line run through in ``duration`` (s)."""
    with as_file(files("flexarm") / "library" / "paper.yaml") as path:
        scenario = load_scenario(path)
    assert scenario.motion is not None  # the packaged file has one
    return scenario.replace(motion=scenario.motion.replace(duration=duration))


class PaperCase:
    """One motion, and what three models of the arm make of its torques.

    Each model is run when its result is first asked for.

    Args:
        duration: of the motion and its torques, s; the runs go on after it.
        progress: as in ``simulate``.

    Attributes:
        arm: the flexible arm in the theory of the paper. twin: its rigid twin.
    """

    def __init__(self, duration: float = SLOW, *, progress: bool | None = None) -> None:
        self.duration = duration
        self.progress = progress
        self.prepared = prepare(paper_scenario(duration))
        self.arm = self.prepared.arm
        self.twin = self.arm.rigid()

    @cached_property
    def flexible(self) -> xr.Dataset:
        """The flexible arm in the theory of the paper."""
        return self.prepared.run(progress=self.progress)

    @cached_property
    def rigid(self) -> xr.Dataset:
        """The rigid twin, which follows the motion."""
        return self.prepared.run(arm=self.twin, progress=self.progress)

    @cached_property
    def second_order(self) -> xr.Dataset:
        """The flexible arm in the second-order theory."""
        other = Arm(self.arm.spec.replace(theory="second_order"))
        return self.prepared.run(arm=other, progress=self.progress)


class LinkNumbers(NamedTuple):
    """How much one link bends in one run, m.

    Attributes:
        peak: largest tip deflection during the motion.
        residual: half the peak-to-peak of the tip deflection after the torques have ended, the
            amplitude of the vibration that is left.
        theory: largest difference of the tip deflection between the paper's and the second-order
            theory during the motion.
    """

    peak: float
    residual: float
    theory: float


class TipNumbers(NamedTuple):
    """How far the flexible arm's tip is from the rigid arm's, m.

    Attributes:
        largest: during the motion.
        at_end: when the torques end.
    """

    largest: float
    at_end: float


def link_numbers(case: PaperCase) -> list[LinkNumbers]:
    """Return the numbers of each link."""
    deflection = case.flexible["link_tip_deflection"].values
    other = case.second_order["link_tip_deflection"].values
    moving = case.flexible["time"].values <= case.duration
    peak = np.max(np.abs(deflection[moving]), axis=0)
    residual = 0.5 * np.ptp(deflection[~moving], axis=0)
    theory = np.max(np.abs(deflection - other)[moving], axis=0)
    rows = np.stack([peak, residual, theory], axis=1)
    return [LinkNumbers(*(float(value) for value in row)) for row in rows]


def tip_numbers(case: PaperCase) -> TipNumbers:
    """Return how far the tip is from where the rigid arm has it."""
    away = np.linalg.norm((case.flexible["tip"] - case.rigid["tip"]).values, axis=1)
    moving = case.flexible["time"].values <= case.duration
    return TipNumbers(float(np.max(away[moving])), float(away[moving][-1]))


def torque_range(case: PaperCase) -> FloatArray:
    """Return the lowest and highest torque of each joint: (joints, 2) N m."""
    torque = case.flexible["torque"].values
    return np.stack([torque.min(axis=0), torque.max(axis=0)], axis=1)


class FrequencyTable(NamedTuple):
    """Lowest natural frequencies (Hz) at the start posture: the paper's mesh and a fine one."""

    joints: str
    paper_mesh: FloatArray
    fine_mesh: FloatArray


def frequency_tables(case: PaperCase, count: int = 4) -> list[FrequencyTable]:
    """Return the ``count`` lowest frequencies of vibration, joints locked and free."""
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
