"""Requirements of a controller on arm, hardware and contacts, checked once before a run."""

from __future__ import annotations

from dataclasses import replace

from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem
from flexarm.control.contract.base import Controller, Reference, requirements_of
from flexarm.control.hardware.instruments import stride_and_delay
from flexarm.model import Hardware
from flexarm.model.hardware import channel_faults
from flexarm.model.wording import nearest
from flexarm.simulation.loop.sensors import measured_names


def misfits(
    controller: Controller,
    arm: Arm,
    reference: Reference | None,
    hardware: Hardware | None,
    contacts: int,
    called: str = "",
) -> list[Problem]:
    """Return the requirements of a controller that are not met, one problem each.

    Faults of instruments at channels that the arm does not have, and sample times of instruments
    that do not fit the controller, are among them.

    Args:
        arm: the simulated arm.
        contacts: number of contacts.
        called: user's name of the controller; empty for the name of its class.
    """
    requirements = requirements_of(controller, arm, reference)
    called = called or type(controller).__name__
    if requirements.joints not in (None, arm.joints):
        own = f"{requirements.joints} joint{'s' * (requirements.joints != 1)}"
        return [Problem("controller", f"is for {own}, but the arm has {arm.joints}")]
    there = measured_names(arm, hardware, contacts)
    problems = []
    count = len(arm.gauges)
    if count and "strain" in requirements.measured and requirements.gauges not in (None, count):
        gauges = f"{requirements.gauges} gauge{'s' * (requirements.gauges != 1)}"
        problems.append(Problem("arm", f"have the {gauges} that {called} reads", str(count)))
    for name in requirements.measured:
        if name not in there and not (name == "strain" and problems):
            problems.append(_missing(called, name, arm, hardware, there, contacts))
    problems += [one.problem() for one in channel_faults(arm.spec, hardware, contacts)]
    return [*problems, *_unfitting_frames(hardware, controller.sample_time)]


def _unfitting_frames(hardware: Hardware | None, sample_time: float) -> list[Problem]:
    """Return the problems of instruments that do not sample at the controller's sample times."""
    problems: list[Problem] = []
    for k, item in enumerate((hardware and hardware.instruments) or ()):
        try:
            stride_and_delay(item, sample_time)
        except InputError as error:
            name = f"hardware.instruments[{k}].sample_time"
            problems += [replace(problem, name=name) for problem in error.problems]
    return problems


def _missing(
    called: str,
    name: str,
    arm: Arm,
    hardware: Hardware | None,
    there: tuple[str, ...],
    contacts: int,
) -> Problem:
    """Return the problem of a missing measurement, with a hint on its source."""
    if name == "contact_force" and not contacts:
        return Problem("contacts", f"are missing: {called} measures {name}")
    if name == "strain" and not arm.gauges:
        return Problem("arm", f"has no gauges, but {called} reads {name}")
    hint = nearest(name, there)
    if name == "joint_rate" and "joint_angle" in there:
        hint = "An instrument of joint_angle with a rate_cutoff also measures it."
    rule = f"has no instrument for {name}, which {called} reads"
    if hardware is not None and hardware.instruments is not None:
        rule += f"; it measures {', '.join(there) or 'nothing'}"
    return Problem("hardware", rule, hint=hint)
