"""Reference path and surfaces that are drawn with an arm: given ones, or those of a scenario."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_list_of
from flexarm.base.errors import FlexarmError, InputError, Problem
from flexarm.cases.scenario.motions import motion_of
from flexarm.control.contract.base import check_reference
from flexarm.model import Contact
from flexarm.view.plot.drawn_arm import scenario_of

if TYPE_CHECKING:
    import xarray as xr


def surroundings(
    arm: Arm, result: xr.Dataset, reference: Any, contacts: Sequence[Contact] | None
) -> tuple[Any, Sequence[Contact]]:
    """Return the reference, or None, and the contacts to draw with a result.

    Args:
        arm: arm of the result.
        reference, contacts: as given by the user; None for those of the result's scenario.

    Raises:
        InputError: if ``reference`` is not a motion or has a different number of joints, or
            ``contacts`` is not a list of contacts.
    """
    if contacts is not None:
        contacts = check_list_of("contacts", contacts, Contact)
    if reference is not None:
        check_reference(reference)
        _check_joints(reference, arm)
    moved, touched = _of_scenario(arm, result)
    return (
        moved if reference is None else reference,
        touched if contacts is None else contacts,
    )


def _of_scenario(arm: Arm, result: xr.Dataset) -> tuple[Any, Sequence[Contact]]:
    """Return motion and contacts of a result's scenario, if it has one."""
    scenario = scenario_of(result)
    if scenario is None or len(scenario.arm.links) != arm.links:
        return None, []
    try:
        return motion_of(arm, scenario), scenario.contacts
    except FlexarmError:  # the plant differs from the arm of the scenario
        return None, scenario.contacts


def _check_joints(reference: Any, arm: Arm) -> None:
    """Raise if a reference has neither the arm's number of joints nor its own tip path.

    Raises:
        InputError: if it has a different number of joints.
    """
    if getattr(reference, "tip", None) is None:
        angles = np.asarray(reference.joint_angle(0.0))
        if angles.shape != (arm.joints,):
            rule = f"move the {arm.joints} joints of the arm"
            raise InputError(Problem("reference", rule, f"one for {angles.size} joints"))
