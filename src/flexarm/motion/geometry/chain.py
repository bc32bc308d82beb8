"""Rigid chain of an arm: straight bars between the joints that turn.

Links with fixed joints between them form one bar, from the root of the first to the next joint that
turns or to the tip. Its length is the sum of theirs if they are in line. Otherwise it is the
straight line between both ends, at an angle to the root tangent.

The functions of the tip accept leading axes, so that one call evaluates a whole motion:

| symbol | meaning | shape | unit | frame |
| --- | --- | --- | --- | --- |
| lengths | L_i, link lengths | (n,) | m | |
| angles | theta_i, relative joint angles | (..., n) | rad | joint 1 from world x |
| psi_i | theta_1 + ... + theta_i | (..., n) | rad | world |
| tip | sum of L_i (cos psi_i, sin psi_i) | (..., 2) | m | world |
| J | d tip / d theta | (..., 2, n) | m | world |
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm.base.errors import InputError, Problem, shown

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm.arm.arm import Arm

    Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RigidChain:
    """Straight bars between the joints that turn."""

    lengths: Floats  # lengths of the bars (n,), m
    #: Angles between bars minus joint angles (n,), rad; zero unless a fixed joint has a rest angle
    offset: Floats
    base: Floats  # position of the first joint that turns (2,), world axes, m

    def tip(self, joint_angles: Floats) -> Floats:
        """Return the tip position (..., 2) in world axes, m, at joint angles (..., n)."""
        return self.base + tip_position(self.lengths, joint_angles + self.offset)


def check_arm(arm: Arm) -> Arm:
    """Return an object that has the joints and links of an arm, or raise InputError."""
    parts = ("joints", "links", "lengths", "spec", "assembly")
    if isinstance(arm, type) or not all(hasattr(arm, name) for name in parts):
        given = f"the class {arm.__name__}" if isinstance(arm, type) else shown(arm)
        raise InputError(Problem("arm", "be an Arm", given))
    return arm


def rigid_chain(arm: Arm) -> RigidChain:
    """Return the rigid chain of an arm; InputError without joints, or if two of them coincide."""
    if check_arm(arm).joints == 0:
        raise InputError(Problem("arm", "has no joint that is not fixed"))
    turning = [seat.link for seat in arm.assembly.seats]
    base, before = _walk(arm, 0, turning[0])
    lengths, offset = [], []
    for first, end in zip(turning, [*turning[1:], arm.links], strict=True):
        bar, turned = _walk(arm, first, end)
        length, direction = float(np.hypot(*bar)), float(np.arctan2(bar[1], bar[0]))
        if length <= 1e-12 * float(np.sum(arm.lengths)):
            rule = f"has two joints at one place: its fixed links return to joint {first + 1}"
            raise InputError(Problem("arm", rule))
        lengths.append(length)
        offset.append(before + direction)
        before = turned - direction
    return RigidChain(np.array(lengths), np.array(offset), base)


def _walk(arm: Arm, first: int, end: int) -> tuple[Floats, float]:
    """Return position (2,) and angle from the root of a link, in its axes, to another or tip."""
    at, angle = np.zeros(2), 0.0
    for i in range(first, end):
        joint = arm.spec.joints[i]
        if joint.fixed:
            angle += joint.rest_angle
        at = at + arm.lengths[i] * np.array([np.cos(angle), np.sin(angle)])
    return at, angle


def tip_position(lengths: Floats, angles: Floats) -> Floats:
    """Return the tip (..., 2) in world axes (m)."""
    psi = np.cumsum(angles, axis=-1)
    return np.stack([np.cos(psi) @ lengths, np.sin(psi) @ lengths], axis=-1)


def tip_jacobian(lengths: Floats, angles: Floats) -> Floats:
    """Return J (..., 2, n); column j is the rotation about joint j of the links outboard of it."""
    psi = np.cumsum(angles, axis=-1)
    links = np.stack([-lengths * np.sin(psi), lengths * np.cos(psi)], axis=-2)
    return _outboard_sum(links)


def tip_jacobian_rate(lengths: Floats, angles: Floats, rates: Floats) -> Floats:
    """Return dJ/dt (..., 2, n) when the joints turn at `rates` (..., n), rad/s."""
    psi = np.cumsum(angles, axis=-1)
    spin = lengths * np.cumsum(rates, axis=-1)
    links = np.stack([-spin * np.cos(psi), -spin * np.sin(psi)], axis=-2)
    return _outboard_sum(links)


def _outboard_sum(links: Floats) -> Floats:
    """Return the sum over links j, j+1, ..., n in column j."""
    return np.flip(np.cumsum(np.flip(links, axis=-1), axis=-1), axis=-1)
