"""Run a scenario file: the same calls that a user of the Python interface would make."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm import Arm
from flexarm.control import JointPD
from flexarm.errors import InputError, SimulationError
from flexarm.model import (
    JointPDDrive,
    LineMotionSpec,
    RigidInverseDynamicsDrive,
    Scenario,
    TorqueDrive,
    file_text,
    load_scenario,
)
from flexarm.motion import Motion, joint_motion, line_motion, rigid_torque
from flexarm.simulate.choice import check_integrator
from flexarm.simulate.run import simulate
from flexarm.simulate.torque_history import sampled_torque

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, eq=False)
class Prepared:
    """A scenario turned into objects, every check done, ready to run.

    Attributes:
        arm: the arm. motion: what it is asked to do, or None. options: arguments of ``simulate``.
        text: the scenario as a file, which results keep.
    """

    arm: Arm
    motion: Motion | None
    options: dict[str, Any]
    text: str

    def run(self, *, arm: Arm | None = None, progress: bool | None = None) -> xr.Dataset:
        """Simulate, with another ``arm`` of as many joints (its rigid twin, say) if given."""
        options = dict(self.options)
        if arm is not None:
            options["initial"] = arm.rest(self.arm.joint_angles(options["initial"]))
            if "initial_rate" in options:
                rates = self.arm.joint_angles(options["initial_rate"])
                options["initial_rate"] = arm.rest(rates)
        try:
            result = simulate(arm or self.arm, progress=progress, **options)
        except SimulationError as error:
            if error.result is not None:
                error.result.attrs["scenario"] = self.text
            raise
        result.attrs["scenario"] = self.text
        return result


def prepare(scenario: Scenario, where: str = "scenario") -> Prepared:
    """Make the arm, the motion and the drive of a scenario.

    Args:
        scenario: what to run.
        where: the file that it comes from, for messages.

    Raises:
        InputError: the motion leaves the arm's reach, or the torques do not cover the run.
    """
    arm = Arm(scenario.arm)
    with _told_as(where, "motion"):
        motion = _motion(arm, scenario)
    run = scenario.run
    options: dict[str, Any] = {"duration": run.duration, "rate": run.rate}
    options["integrator"] = run.integrator
    for name in ("rtol", "atol", "step"):
        if getattr(run, name) is not None:
            options[name] = getattr(run, name)
    with _told_as(where, "drive"):
        _set_drive(arm, scenario, motion, options)
    check_integrator(run.integrator, run.step, where)
    angles: ArrayLike = np.zeros(arm.joints)
    if scenario.initial.joint_angle is not None:
        angles = scenario.initial.joint_angle
    elif motion is not None:
        angles = motion.joint_angle(0.0)
    options["initial"] = arm.rest(angles)
    if scenario.initial.joint_rate is not None:
        options["initial_rate"] = arm.rest(scenario.initial.joint_rate)
    return Prepared(arm, motion, options, file_text(scenario))


def run_scenario(
    scenario: Scenario | str | PathLike[str], *, progress: bool | None = None
) -> xr.Dataset:
    """Simulate a scenario, given as an object or as the path of its file.

    Raises:
        ModelError: the file is wrong; every problem with its line.
        InputError, SimulationError: as ``simulate``.
    """
    where = "scenario"
    if not isinstance(scenario, Scenario):
        where = str(scenario)
        scenario = load_scenario(scenario)
    return prepare(scenario, where).run(progress=progress)


@contextmanager
def _told_as(where: str, key: str) -> Iterator[None]:
    """Name problems by the file and the key path that they come from."""
    try:
        yield
    except InputError as error:
        raise InputError(
            *(
                replace(problem, where=where, name=f"{key}.{problem.name}")
                for problem in error.problems
            )
        ) from None


def _motion(arm: Arm, scenario: Scenario) -> Motion | None:
    asked = scenario.motion
    if asked is None:
        return None
    common: dict[str, Any] = {"profile": asked.profile, "start_time": asked.start_time}
    if isinstance(asked, LineMotionSpec):
        return line_motion(arm, asked.start, asked.end, asked.duration, elbow=asked.elbow, **common)
    return joint_motion(arm, asked.start, asked.end, asked.duration, **common)


def _set_drive(
    arm: Arm, scenario: Scenario, motion: Motion | None, options: dict[str, Any]
) -> None:
    drive = scenario.drive
    if isinstance(drive, TorqueDrive):
        options["torque"] = sampled_torque(
            drive.values, drive.rate, scenario.run.duration, arm.joints, drive.interpolation
        )
        return
    if motion is None:
        return  # a drive that follows a motion was refused without one when the file was read
    if isinstance(drive, RigidInverseDynamicsDrive):
        options["torque"] = rigid_torque(arm, motion)
    if isinstance(drive, JointPDDrive):
        feedforward = (
            rigid_torque(arm, motion) if drive.feedforward == "rigid_inverse_dynamics" else None
        )
        options["controller"] = JointPD(
            drive.proportional, drive.derivative, drive.sample_time, feedforward
        )
        options["reference"] = motion
