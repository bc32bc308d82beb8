"""Requirements of a controller on arm, hardware and contacts, checked once before a run."""

from __future__ import annotations

from flexarm.arm import Arm
from flexarm.control.base import Reference, needs_of
from flexarm.errors import Problem
from flexarm.loop.sensors import measured_names
from flexarm.model import Hardware
from flexarm.model.wording import nearest


def misfits(
    controller: object,
    arm: Arm,
    reference: Reference | None,
    hardware: Hardware | None,
    contacts: int,
    where: str = "simulate",
    called: str = "",
) -> list[Problem]:
    """Return the requirements of a controller that are not met, one problem each.

    Args:
        arm: the simulated arm.
        contacts: number of contacts.
        where: name of the calling function, for messages.
        called: user's name of the controller; empty for the name of its class.
    """
    needs = needs_of(controller, arm, reference)
    called = called or type(controller).__name__
    if needs.joints not in (None, arm.joints):
        rule = f"be for an arm with {arm.joints} joint{'s' * (arm.joints != 1)}"
        return [Problem(where, "controller", rule, f"for one with {needs.joints}")]
    there = measured_names(arm, hardware, contacts)
    problems = []
    count = len(arm.gauges)
    if "strain" in needs.measured and needs.gauges not in (None, count):
        rule = f"have the {needs.gauges} gauge{'s' * (needs.gauges != 1)} that {called} reads"
        problems.append(Problem(where, "arm", rule, f"an arm with {count}"))
    for name in needs.measured:
        if name not in there and not (name == "strain" and problems):
            problems.append(_missing(where, called, name, arm, hardware, there, contacts))
    return problems


def _missing(
    where: str,
    called: str,
    name: str,
    arm: Arm,
    hardware: Hardware | None,
    there: tuple[str, ...],
    contacts: int,
) -> Problem:
    """Return the problem of a missing measurement, with a hint on its source."""
    if name == "contact_force" and not contacts:
        rule = f"be given: {called} measures {name}"
        return Problem(where, "contacts", rule, "missing")
    if name == "strain" and not arm.gauges:
        return Problem(where, "arm", f"have gauges: {called} reads {name}", "an arm with 0")
    hint = nearest(name, there)
    if name == "joint_rate" and "joint_angle" in there:
        hint = "An instrument of joint_angle with a rate_cutoff tells it, too."
    rule = f"have an instrument for {name}, which {called} reads"
    exact = hardware is None or hardware.instruments is None
    value = "missing" if exact else f"for {', '.join(there) or 'nothing'}"
    return Problem(where, "hardware", rule, value, hint)
