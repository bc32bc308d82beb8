"""The rigid chain that a motion moves: links between joints that turn.

Links joined rigidly count as one, from the joint at its root to the next that turns, or to the
tip. In a straight line, that is their sum; with a fixed angle between them it is the line that
joins the two ends, which stands at an angle to the root tangent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm.errors import InputError, Problem, shown
from flexarm.motion.kinematics import tip_position

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm.arm import Arm

    Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RigidChain:
    """Straight bars between joints.

    Attributes:
        lengths: of the bars (n,), m.
        offset: what is added to the joint angles to give those between bars (n,), rad; zero but
            for links that are fixed to each other.
        base: place of the first joint that turns (2,), world axes, m.
    """

    lengths: Floats
    offset: Floats
    base: Floats

    def tip(self, joint_angles: Floats) -> Floats:
        """Return the tip (..., 2) in world axes, m, at joint angles (..., n)."""
        return self.base + tip_position(self.lengths, joint_angles + self.offset)


def check_arm(where: str, arm: Arm) -> Arm:
    """Return an object with the joints and links of an arm, which are all that a motion needs.

    Raises:
        InputError: if it has none.
    """
    parts = ("joints", "links", "lengths", "spec", "assembly")
    if isinstance(arm, type) or not all(hasattr(arm, name) for name in parts):
        given = f"the class {arm.__name__}" if isinstance(arm, type) else shown(arm)
        raise InputError(Problem(where, "arm", "be an Arm", given))
    return arm


def rigid_chain(where: str, arm: Arm) -> RigidChain:
    """Return the bars between the joints of an arm that turn.

    Raises:
        InputError: no joint turns, or two that do lie in one place.
    """
    if check_arm(where, arm).joints == 0:
        rule = "have a joint that turns"
        raise InputError(Problem(where, "arm", rule, "one whose joints are all fixed"))
    turning = [seat.link for seat in arm.assembly.seats]
    base, before = _walk(arm, 0, turning[0])
    lengths, offset = [], []
    for first, end in zip(turning, [*turning[1:], arm.links], strict=True):
        bar, turned = _walk(arm, first, end)
        length, direction = float(np.hypot(*bar)), float(np.arctan2(bar[1], bar[0]))
        if length <= 1e-12 * float(np.sum(arm.lengths)):
            rule = "keep its joints apart"
            value = f"one whose fixed links close a loop after joint {first + 1}"
            raise InputError(Problem(where, "arm", rule, value))
        lengths.append(length)
        offset.append(before + direction)
        before = turned - direction
    return RigidChain(np.array(lengths), np.array(offset), base)


def _walk(arm: Arm, first: int, end: int) -> tuple[Floats, float]:
    """From the root of a link to the root of another, or to the tip, in the first one's axes.

    The first link's own joint counts only where it is fixed: at the base.
    """
    at, angle = np.zeros(2), 0.0
    for i in range(first, end):
        joint = arm.spec.joints[i]
        if joint.fixed:
            angle += joint.rest_angle
        at = at + arm.lengths[i] * np.array([np.cos(angle), np.sin(angle)])
    return at, angle
