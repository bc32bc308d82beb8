"""Starts and references that contacts refuse: deep in a surface, or pressing away from it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexarm.arm import Arm
from flexarm.contacts import Contact
from flexarm.errors import InputError, Problem, few
from flexarm.integrate.base import FloatArray
from flexarm.kernels.contact import ENERGY, EXPONENT, GAP, STIFFNESS
from flexarm.kernels.layout import Contacts
from flexarm.linear.pressed import PressedMotion
from flexarm.loads import SAME_PLACE
from flexarm.motion.kinematics import tip_jacobian
from flexarm.observe import contact_values

#: Parts of the reach: further in is seen by eye; nearer than that to a surface a path is on it.
_DEEP = 0.01
#: A force of so many times the arm's weight, where g is 9.81 m/s^2, is more than an arm holds at
#: rest: robots carry about their own weight at most. So nothing has pressed a point in that far.
_UNHELD, _GRAVITY = 10.0, 9.81
#: Times along a motion at which its normal is looked at.
_LOOKS = 41
#: Part of the reach by which a tip is moved to see on which side of it the surface is.
_NUDGE = 1e-6


def refuse_deep_start(where: str, arm: Arm, state: FloatArray, placed: Contacts) -> None:
    """Refuse a state (2, n, 1 + m) that a surface would throw away as no motion could have led to.

    A point may start in a surface, at rest or in a blow. It may not be deeper than a hundredth of
    the reach and be pushed by more than ten times the arm's weight, both at once.

    Raises:
        InputError: so it is.
    """
    if not placed.body.size:
        return
    constants = arm.assembly.constants
    weight = _GRAVITY * float(constants.mass.sum() + constants.tip_mass.sum())
    seen = contact_values(arm, placed, state[None])[0]
    for k, (law, values) in enumerate(zip(placed.law, seen, strict=True), start=1):
        if not np.isfinite(values[GAP]):  # the centre of a circle is near to all of it
            rule = f"not be at the centre of the surface of contact {k}"
            raise InputError(Problem(where, "initial", rule, "there", "Start outside of it."))
        depth = max(-float(values[GAP]), 0.0)
        force = float(law[STIFFNESS]) * depth ** float(law[EXPONENT])
        if depth > _DEEP * float(arm.lengths.sum()) and force > _UNHELD * weight:
            rule = f"not be deep inside the surface of contact {k}"
            value = (
                f"{depth:.3g} m deep, where it pushes with {force:.3g} N and stores "
                f"{values[ENERGY]:.3g} J"
            )
            hint = (
                f"That is {force / weight:.0f} times the arm's weight. Start outside of it, or "
                "pressed at rest (equilibrium, pressed_motion); a wall's normal points away from "
                "what is solid."
            )
            raise InputError(Problem(where, "initial", rule, value, hint))


def refuse_pressing_outward(
    where: str,
    arm: Arm,
    contacts: Sequence[Contact],
    placed: Contacts,
    reference: object,
    duration: float,
) -> None:
    """Refuse a motion that presses, whose normal points into the surface that its path is on.

    Looked at where the path, of rigid links, is on a surface that the tip may touch.

    Raises:
        InputError: so it is.
    """
    touching = [k for k, contact in enumerate(contacts) if _is_tip(arm, contact)]
    if not isinstance(reference, PressedMotion) or not touching:
        return
    reach, motion = float(arm.lengths.sum()), reference.motion
    times = np.linspace(0.0, min(motion.end_time, duration), _LOOKS)
    angles, normals = np.asarray(motion.joint_angle(times)), reference.normal(times)
    J = tip_jacobian(motion.chain.lengths, angles + motion.chain.offset)
    moved = angles + _NUDGE * reach * np.einsum("tij,tj->ti", np.linalg.pinv(J), normals)
    q = np.array([[arm.rest(row), np.zeros(arm.dof)] for row in (*angles, *moved)])
    gaps = contact_values(arm, placed, arm.padded(q))[:, touching, GAP].reshape(2, _LOOKS, -1)
    near = np.argmin(np.abs(gaps[0]), axis=1)
    at, beyond = (np.take_along_axis(gap, near[:, None], axis=1)[:, 0] for gap in gaps)
    inward = (np.abs(at) < _DEEP * reach) & (beyond < at)
    if inward.any():
        first = int(np.argmax(inward))
        rule = f"point away from the surface of contact {touching[near[first]] + 1}"
        value = f"({few(normals[first])}) at t = {times[first]:g} s, into it"
        hint = "With the normal the other way round pressed_motion presses on it."
        raise InputError(Problem(where, "reference.normal", rule, value, hint))


def _is_tip(arm: Arm, contact: Contact) -> bool:
    """Whether a contact's point is the tip of the arm."""
    last = float(arm.lengths[-1])
    there = contact.station is None or contact.station >= last * (1.0 - SAME_PLACE)
    return contact.link in (None, arm.links) and there
