"""Run a scenario file: the same calls that a user of the Python interface would make."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import inf
from os import PathLike
from typing import TYPE_CHECKING, Any

from flexarm.arm import Arm
from flexarm.control import ComputedTorque, Controller, JointPD, JointPID, StrainFeedback
from flexarm.errors import InputError, Problem, SimulationError
from flexarm.loads import Load
from flexarm.model import (
    ComputedTorqueDrive,
    EventSpec,
    JointPDDrive,
    JointPIDDrive,
    LineMotionSpec,
    RigidInverseDynamicsDrive,
    Scenario,
    StrainFeedbackDrive,
    TorqueDrive,
    file_text,
    locate_scenario,
)
from flexarm.model.wording import Path, path_of
from flexarm.motion import Motion, joint_motion, line_motion
from flexarm.simulate.choice import check_integrator
from flexarm.simulate.events import events_of
from flexarm.simulate.hardware_file import hardware_of
from flexarm.simulate.outside import base_acceleration_of, contacts_of, loads_of
from flexarm.simulate.run import simulate
from flexarm.simulate.start import Start, feedforward, start_of
from flexarm.simulate.torque_history import constant_torque, sampled_torque

if TYPE_CHECKING:
    import xarray as xr

#: Drives that are controllers.
_CONTROLLERS = (ComputedTorqueDrive, JointPDDrive, JointPIDDrive, StrainFeedbackDrive)
#: Where a key path stands in its file: ``file:line``.
Where = Callable[[Path], str]


@dataclass(frozen=True, eq=False)
class Prepared:
    """A scenario turned into objects, every check done, ready to run.

    Attributes:
        arm: the arm. motion: what it is asked to do, or None. options: arguments of ``simulate``.
        text: the scenario as a file, which results keep. events: what it asks to watch for; in
        the options they are those of ``arm``.
    """

    arm: Arm
    motion: Motion | None
    options: dict[str, Any]
    text: str
    events: Sequence[EventSpec] = ()

    def run(
        self,
        *,
        arm: Arm | None = None,
        plant: Arm | None = None,
        loads: Sequence[Load] = (),
        progress: bool | None = None,
    ) -> xr.Dataset:
        """Simulate, with another ``arm`` of as many joints (its rigid twin, say) if given.

        With ``plant``, what is made for the arm of the scenario acts on that one instead; with
        ``loads``, these act beside those of the scenario.
        """
        options = dict(self.options)
        if plant is not None:
            options["plant"] = plant
        if loads:
            options["loads"] = [*options.get("loads", ()), *loads]
        if arm is not None:
            options["initial"] = arm.rest(self.arm.joint_angles(options["initial"]))
            if "initial_rate" in options:
                rates = self.arm.joint_angles(options["initial_rate"])
                options["initial_rate"] = arm.rest(rates)
            options["events"] = events_of(self.events, arm)
        try:
            result = simulate(arm or self.arm, progress=progress, **options)
        except SimulationError as error:
            if error.result is not None:
                error.result.attrs["scenario"] = self.text
            raise
        result.attrs["scenario"] = self.text
        return result


def prepare(scenario: Scenario, where: str | Where = "scenario") -> Prepared:
    """Make the arm, the motion and the drive of a scenario.

    Args:
        scenario: what to run.
        where: the file that it comes from, or where in it a key path stands, for messages.

    Raises:
        InputError: the motion leaves the arm's reach, or the torques do not cover the run.
        EquilibriumError: the equilibrium to start from was not found.
    """
    place = where if callable(where) else lambda _: where
    with _told_as(place, ""):
        arm = Arm(scenario.arm)
    with _told_as(place, "motion"):
        motion = _motion(arm, scenario)
    run = scenario.run
    options: dict[str, Any] = {"duration": run.duration, "rate": run.rate}
    options["integrator"] = run.integrator
    options["stations"] = run.stations
    for name in ("rtol", "atol", "step"):
        if getattr(run, name) is not None:
            options[name] = getattr(run, name)
    if scenario.loads:
        options["loads"] = loads_of(scenario.loads)
    if scenario.events:
        options["events"] = events_of(scenario.events, arm)
    if scenario.contacts:
        options["contacts"] = contacts_of(scenario)
    if scenario.base_acceleration is not None:
        options["base_acceleration"] = base_acceleration_of(scenario)
    with _told_as(place, "initial"):
        start = start_of(arm, scenario, motion)
    options["initial"] = start.q
    if scenario.initial.joint_rate is not None:
        options["initial_rate"] = arm.rest(scenario.initial.joint_rate)
    if start.prescribed:
        options["prescribed"] = start.prescribed
    with _told_as(place, "drive", {"torque": "values", "torque_interpolation": "interpolation"}):
        _set_drive(arm, scenario, motion, start, options)
    if scenario.hardware is not None:
        with _told_as(place, "hardware"):
            options["hardware"] = hardware_of(scenario.hardware)
    with _told_as(place, "run"):
        check_integrator(run.integrator, run.step, "scenario", bool(scenario.contacts))
    return Prepared(arm, motion, options, file_text(scenario), scenario.events)


def run_scenario(
    scenario: Scenario | str | PathLike[str], *, progress: bool | None = None
) -> xr.Dataset:
    """Simulate a scenario, given as an object or as the path of its file.

    Raises:
        ModelError: the file is wrong; every problem with its line.
        InputError, SimulationError: as ``simulate``.
    """
    where: str | Where = "scenario"
    if not isinstance(scenario, Scenario):
        scenario, where = locate_scenario(scenario)
    return prepare(scenario, where).run(progress=progress)


@contextmanager
def _told_as(place: Where, key: str, names: dict[str, str] | None = None) -> Iterator[None]:
    """Name problems by the line and the key path that they come from.

    Args:
        key: where the values stand that may be refused; nothing where problems say it themselves.
        names: keys of the file for arguments that are called otherwise.
    """
    try:
        yield
    except InputError as error:
        placed = []
        for problem in error.problems:
            told = (names or {}).get(problem.name, problem.name)
            name = f"{key or problem.where}.{told}"
            placed.append(replace(problem, where=place(path_of(name)), name=name))
        raise InputError(*placed) from None


def _motion(arm: Arm, scenario: Scenario) -> Motion | None:
    asked = scenario.motion
    if asked is None:
        return None
    common: dict[str, Any] = {"profile": asked.profile, "start_time": asked.start_time}
    if isinstance(asked, LineMotionSpec):
        return line_motion(arm, asked.start, asked.end, asked.duration, elbow=asked.elbow, **common)
    return joint_motion(arm, asked.start, asked.end, asked.duration, **common)


def _set_drive(
    arm: Arm, scenario: Scenario, motion: Motion | None, start: Start, options: dict[str, Any]
) -> None:
    drive = scenario.drive
    if isinstance(drive, TorqueDrive):
        history = sampled_torque(
            drive.values, drive.rate, scenario.run.duration, arm.joints, drive.interpolation
        )
        options["torque"] = history if start.holding is None else history.shifted(start.holding)
    elif isinstance(drive, RigidInverseDynamicsDrive) and motion is not None:
        options["torque"] = feedforward(arm, motion, start)
    elif motion is not None and (made := _controller(arm, scenario, motion, start)) is not None:
        options["controller"], options["reference"] = made, motion
    elif start.holding is not None:
        options["torque"] = constant_torque(start.holding)


def _controller(arm: Arm, scenario: Scenario, motion: Motion, start: Start) -> Controller | None:
    """Make the controller of a drive that is one."""
    drive: Any = scenario.drive
    if not isinstance(drive, _CONTROLLERS):
        return None
    rigid = motion if drive.feedforward == "rigid_inverse_dynamics" else None
    common: dict[str, Any] = {
        "sample_time": drive.sample_time,
        "feedforward": feedforward(arm, rigid, start),
    }
    if isinstance(drive, ComputedTorqueDrive):
        return ComputedTorque(arm, drive.frequency_hz, drive.damping_ratio, **common)
    gains = drive.proportional, drive.derivative
    if isinstance(drive, JointPIDDrive):
        common |= {"torque_limit": inf if drive.torque_limit is None else drive.torque_limit}
        common |= {"arm": None if drive.gravity == "none" else arm, "sag": drive.gravity == "sag"}
        return JointPID(*gains, drive.integral, **common)
    if isinstance(drive, StrainFeedbackDrive):
        if len(arm.gauges) != arm.joints:
            rule = f"have one gauge for each of the {arm.joints} joints for strain feedback"
            raise InputError(Problem("drive", "strain", rule, f"an arm with {len(arm.gauges)}"))
        common |= {"rate_cutoff": drive.rate_cutoff}
        return StrainFeedback(*gains, drive.strain, drive.strain_rate, **common)
    return JointPD(*gains, **common)
