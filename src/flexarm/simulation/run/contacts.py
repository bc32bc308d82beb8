"""Contacts of a run: placement, highest frequency, and validation of its start and reference."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexarm.arm.actions import SAME_PLACE, place_contacts, point_of
from flexarm.arm.arm import Arm
from flexarm.arm.observe import contact_values
from flexarm.base.errors import InputError, Problem, few
from flexarm.integrate.base import FloatArray
from flexarm.integrate.nearness import turning_time
from flexarm.kernels.compilation.cache import undecorated
from flexarm.kernels.forces.contact import ENERGY, EXPONENT, GAP, MOBILITY, STIFFNESS
from flexarm.kernels.layout import Contacts, empty_contacts
from flexarm.linear.bent_references import PressedMotion
from flexarm.model import Contact
from flexarm.motion.geometry.inverse_kinematics import tip_jacobian

#: Depth relative to the reach at which the first step evaluates contacts whose stiffness depends on
#: the depth or the speed.
_DEPTH = 1e-3
#: Bend angle (rad) between the links at which a point is often more mobile than at the start.
_BENT = 0.5 * np.pi
#: Fractions of the reach: a larger depth is a visible error of the initial state, and a path that
#: is closer than this to a surface counts as on it.
_DEEP = 0.01
#: Limit on the contact force, in multiples of the arm's weight with g = 9.81 m/s^2, because an arm
#: that moves horizontally has no other force to compare with. Robots carry about their own weight
#: at most, so no load at rest can have pressed a point in that deep.
_UNHELD, _GRAVITY = 10.0, 9.81
#: Number of times along a motion at which the direction of its normal is checked.
_LOOKS = 41
#: Displacement of the tip, as a fraction of the reach, that determines its side of the surface.
_NUDGE = 1e-6


def contacts_of_run(arm: Arm, contacts: Sequence[Contact], state: FloatArray) -> Contacts:
    """Place the contacts of a run on the arm and set their mobilities."""
    if not contacts:
        return empty_contacts(arm.assembly.constants, 0, 0)
    placed, bent = place_contacts(arm, contacts), np.full(arm.n_joints, _BENT)
    postures = [arm.unpadded(state[0])]
    if not arm.closure_rows:  # other postures would open loops
        postures += [arm.rest(0.0 * bent), arm.rest(bent)]
    for law, contact in zip(placed.law, contacts, strict=True):
        law[MOBILITY] = max(_mobility(arm, contact, q) for q in postures)
    return placed


def _mobility(arm: Arm, contact: Contact, q: FloatArray) -> float:
    """Compute the largest acceleration of the contact point per force on it at a posture, 1/kg."""
    rest, still = np.zeros(arm.dof), np.zeros(arm.n_joints)
    none = arm.forward_dynamics(q, rest, still), arm.inverse_dynamics(q, rest, rest)
    pushed, force = np.zeros((2, arm.dof)), np.zeros((2, arm.dof))
    for axis, unit in enumerate(np.eye(2)):
        load = point_of(arm, contact)
        push = [load.replace(force=unit)]
        pushed[axis] = arm.forward_dynamics(q, rest, still, loads=push) - none[0]
        force[axis] = none[1] - arm.inverse_dynamics(q, rest, rest, loads=push)
    return float(np.linalg.eigvalsh(force @ pushed.T)[-1])


def contact_frequency(arm: Arm, placed: Contacts) -> float:
    """Return the highest frequency (rad/s) of the arm on a surface; 0 without contacts."""
    if not placed.body.size:
        return 0.0
    turning, law = undecorated(turning_time), placed.law
    depth = _DEPTH * arm.reach
    # The speed is that of an undamped vibration of this depth.
    speed = np.sqrt(law[:, STIFFNESS] * law[:, MOBILITY] * depth ** (law[:, EXPONENT] + 1.0))
    times = [turning(placed, k, float(speed[k])) for k in range(placed.body.size)]
    return float(max(1.0 / time for time in times))


def refuse_deep_start(arm: Arm, state: FloatArray, placed: Contacts) -> None:
    """Raise if a contact point starts deeper inside a surface than any motion could have taken it.

    A point may start inside a surface, at rest or during an impact. The state (2, n, 1 + m) is
    rejected if the depth exceeds a hundredth of the reach and the contact force also exceeds ten
    times the arm's weight.
    """
    if not placed.body.size:
        return
    constants = arm.assembly.constants
    weight = _GRAVITY * float(constants.mass.sum() + constants.tip_mass.sum())
    seen = contact_values(arm, placed, state[None])[0]
    for k, (law, values) in enumerate(zip(placed.law, seen, strict=True), start=1):
        if not np.isfinite(values[GAP]):  # at the centre of a circle the nearest point is undefined
            rule = f"lies at the centre of the surface of contact {k}"
            raise InputError(Problem("initial", rule, hint="Start outside the surface."))
        depth = -float(values[GAP])
        if depth <= _DEEP * arm.reach:
            continue
        force = float(law[STIFFNESS]) * depth ** float(law[EXPONENT])
        if force > _UNHELD * weight:
            rule = f"start outside the surface of contact {k}"
            value = (
                f"{depth:.3g} m inside, with a contact force of {force:.3g} N and an energy of "
                f"{values[ENERGY]:.3g} J"
            )
            hint = (
                f"The force is {force / weight:.0f} times the arm's weight. Start outside, or at "
                "rest in contact (equilibrium, pressed_motion). The normal of a wall points out of "
                "the solid."
            )
            raise InputError(Problem("initial", rule, value, hint))


def refuse_pressing_outward(
    arm: Arm, contacts: Sequence[Contact], placed: Contacts, reference: object, duration: float
) -> None:
    """Raise if the normal of a pressed motion points into the surface that its path is on.

    The check covers the times at which the path, computed with rigid links, is on a surface that
    the tip can contact. Other references pass unchecked.
    """
    end = float(arm.lengths[-1]) * (1.0 - SAME_PLACE)  # of the last link
    stations = {k: one.station for k, one in enumerate(contacts) if one.link in (None, arm.n_links)}
    touching = [k for k, station in stations.items() if station is None or station >= end]
    if not isinstance(reference, PressedMotion) or not touching:
        return
    reach, motion = arm.reach, reference.motion
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
        value = f"({few(normals[first])}) at t = {times[first]:g} s, which points into it"
        hint = "Reverse the normal of pressed_motion."
        raise InputError(Problem("reference.normal", rule, value, hint))
