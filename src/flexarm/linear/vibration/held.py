"""Boundary conditions of the joints for modes: locked, free, or controlled by gains."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.arguments import as_list
from flexarm.base.errors import InputError, Problem, check_array, shown

JOINTS = ("locked", "free")
_RULE = "be 'locked', 'free' or [proportional, derivative] (N m/rad, N m s/rad) for each joint"


class Gains(Protocol):
    """Feedback gains of every joint, such as a `JointPD`: (joints,) N m/rad and N m s/rad."""

    @property
    def proportional(self) -> ArrayLike: ...

    @property
    def derivative(self) -> ArrayLike: ...


OneJoint = str | tuple[float, float]
Joints = str | Sequence[OneJoint] | Gains


class JointFeedback(NamedTuple):
    """Coordinates that can move, and stiffness and damping of the feedback, each (dof,)."""

    moving: NDArray[np.intp]
    stiffness: FloatArray
    damping: FloatArray


def joint_feedback(arm: Arm, joints: Joints) -> JointFeedback:
    """Convert the argument ``joints`` of `modes` to coordinates and gains."""
    stiffness, damping = np.zeros(arm.dof), np.zeros(arm.dof)
    index = arm.joint_index
    moving = np.ones(arm.dof, dtype=bool)
    if isinstance(joints, type):
        raise _unknown("joints", joints)
    if hasattr(joints, "proportional") and hasattr(joints, "derivative"):
        count = (arm.joints,)
        stiffness[index] = check_array("joints.proportional", joints.proportional, count)
        damping[index] = check_array("joints.derivative", joints.derivative, count)
        return JointFeedback(np.arange(arm.dof), stiffness, damping)
    if isinstance(joints, str):
        each: list[OneJoint] = [joints] * arm.joints
        if joints not in JOINTS:  # checked for an arm without joints, too
            raise _unknown("joints", joints)
    else:
        listed = as_list(joints)
        each = listed or []
        if listed is None or len(each) != arm.joints:
            rule = (
                "be 'locked', 'free', or a list with one of these, or with gains, for each of the "
            )
            raise InputError(Problem("joints", f"{rule}{arm.joints} joints", shown(joints)))
    for place, item in zip(index, each, strict=True):
        if isinstance(item, str):
            if item not in JOINTS:
                raise _unknown("joints", item)
            moving[place] = item == "free"
        else:
            if len(as_list(item) or ()) != 2:
                raise InputError(Problem("joints", _RULE, shown(item)))
            stiffness[place], damping[place] = check_array("joints", item, (2,))
    return JointFeedback(np.flatnonzero(moving), stiffness, damping)


def _unknown(name: str, value: object) -> InputError:
    rule = "be one of " + ", ".join(map(repr, JOINTS)) + " or gains (N m/rad, N m s/rad)"
    return InputError(Problem(name, rule, shown(value)))
