"""Margins of a drive for all plants of a study, and the best of several settings."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.errors import FlexarmError, FlexarmWarning
from flexarm.cases.scenario.motions import TaskReference, motion_of
from flexarm.cases.scenario.references import Followed
from flexarm.cases.scenario.scenario import prepare
from flexarm.control.analysis.margins import loop_at, loop_margins, without_friction
from flexarm.integrate.base import FloatArray
from flexarm.model import Contact, Hardware, Scenario
from flexarm.model.checks import checked_arguments
from flexarm.planning.proposals.candidates import Candidate, Drive

if TYPE_CHECKING:
    import xarray as xr

#: Margins in tables: name in `loop_margins`, the worst of several values.
MARGINS = {
    "disk_margin": np.min,
    "gain_margin": np.min,
    "phase_margin": np.min,
    "delay_margin": np.min,
    "growth": np.max,
}


class Assessed(NamedTuple):
    """A drive with its worst margins over plants and postures.

    Attributes:
        drive: as in a file.
        margins: by name, see ``MARGINS``; SI units.
        states: numbers that the controller keeps between samples.
    """

    drive: Drive
    margins: dict[str, float]
    states: int

    @property
    def stable(self) -> bool:
        """Whether the loop is stable on all plants at all postures."""
        return self.margins["growth"] <= 0.0

    def value(self, disk_margin: float) -> tuple[bool, float, float]:
        """Return the value by which settings are compared; larger is better.

        Settings with the required margin come first, and among them the fastest decay; of the
        others, the largest margin.
        """
        margins = self.margins
        enough = bool(self.stable and margins["disk_margin"] >= disk_margin)
        return enough, -margins["growth"] if enough else margins["disk_margin"], -margins["growth"]


class Loops:
    """Loops of drives with the plants of a study, at the start and at the end of its motion.

    Args:
        content: the keys of the study.
        plants: the simulated arms by name.
        postures: (k, joints) rad.

    Attributes:
        error: text of the last error of a design; empty without one.
    """

    def __init__(
        self, content: Mapping[str, Any], plants: Mapping[str, Arm], postures: FloatArray
    ) -> None:
        self._content, self._plants, self._postures = content, plants, postures
        self._motion: TaskReference | None = None
        self._arm: Arm | None = None
        self._followed: dict[str | None, Followed] = {}
        self.error = ""

    def scenario(self, drive: Drive) -> Scenario:
        """Return the scenario of a drive on the arm of the model."""
        return scenario_of(self._content, drive)

    def prepare_motion(self, drive: Drive) -> None:
        """Create the motion, which all drives share.

        Raises:
            InputError: if it leaves the reach of the arm.
        """
        scenario = self.scenario(drive)
        self._arm = Arm(scenario.arm)
        self._motion = motion_of(self._arm, scenario)

    def assess(self, drive: Drive) -> Assessed:
        """Return the margins of a drive.

        Raises:
            FlexarmError: if the controller cannot be designed for the arm.
        """
        scenario = self.scenario(drive)
        kind = scenario.drive.reference_kind
        known = self._followed.get(kind)
        prepared = prepare(scenario, motion=self._motion, followed=known, arm=self._arm)
        self._followed[kind] = prepared.followed
        controller = prepared.options["controller"]
        around: dict[str, Any] = {"hardware": prepared.options.get("hardware")}
        places: Any = self._postures
        if scenario.contacts:
            reference: Any = prepared.followed.motion
            around |= {"contacts": scenario.contacts, "reference": reference}
            places = [reference.start_time, reference.end_time]
        found = loop_margins(controller, self._plants, places, **around)
        margins = {name: float(worst(found[name].values)) for name, worst in MARGINS.items()}
        margins["damping_ratio"] = _slowest_vibration(found)
        nominal = next(iter(self._plants.values()))
        return Assessed(drive, margins, _states(controller, nominal, self._postures[0], **around))

    def best(self, candidate: Candidate, disk_margin: float) -> Assessed | None:
        """Return the best setting of a candidate; None if none can be designed.

        ``error`` is then the text of the last error.
        """
        found = []
        with warnings.catch_warnings():  # the table shows what they warn of
            warnings.simplefilter("ignore", FlexarmWarning)
            for drive in candidate.drives:
                try:
                    found.append(self.assess(drive))
                except FlexarmError as error:  # no solution of a Riccati equation, no equilibrium
                    self.error = str(error)
        return max(found, key=lambda one: one.value(disk_margin), default=None)


def scenario_of(content: Mapping[str, Any], drive: Drive) -> Scenario:
    """Return the scenario of a drive, with the keys of a study that has one motion."""
    shared = {
        name: content[name] for name in ("arm", "loads", "contacts", "hardware") if name in content
    }
    (motion,) = content["motions"].values()
    run = {name: value for name, value in content["run"].items() if name != "settling"}
    return checked_arguments(Scenario, **shared, motion=motion, drive=drive, run=run)


def _slowest_vibration(found: xr.Dataset) -> float:
    """Return the damping ratio of the vibration that decays slowest; 1 if nothing vibrates."""
    ratio = found["damping_ratio"].values
    decay = ratio * found["pole_frequency"].values
    vibrates = ratio < 1.0 - 1e-9
    return float(ratio[vibrates][np.argmin(decay[vibrates])]) if vibrates.any() else 1.0


def _states(
    controller: Any,
    plant: Arm,
    posture: FloatArray,
    hardware: Hardware | None,
    contacts: Sequence[Contact] = (),
    reference: Any = None,
) -> int:
    """Return the number of states of a controller."""
    start = 0.0 if reference is None else reference.start_time
    bare = without_friction(contacts)
    loop = loop_at(controller, plant, posture, hardware, bare, reference, start)
    return len(loop.controller.A)
