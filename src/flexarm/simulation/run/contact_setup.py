"""Contacts of a run: placement on the arm, and the highest frequency of a contact."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexarm.arm.actions.contacts import place_contacts, point_of
from flexarm.arm.arm import Arm
from flexarm.integrate.base import FloatArray
from flexarm.integrate.nearness import turning_time
from flexarm.kernels.compilation.cache import undecorated
from flexarm.kernels.forces.contact import EXPONENT, MOBILITY, STIFFNESS
from flexarm.kernels.layout import Contacts
from flexarm.model import Contact

#: Depth relative to the reach at which the first step evaluates contacts whose stiffness depends on
#: the depth or the speed.
_DEPTH = 1e-3
#: Bend angle (rad) between the links at which a point is often more mobile than at the start.
_BENT = 0.5 * np.pi


def contacts_of_run(arm: Arm, contacts: Sequence[Contact], state: FloatArray) -> Contacts:
    """Place the contacts of a run on the arm and set their mobilities.

    Args:
        state: initial state (2, n, 1 + m).

    Raises:
        InputError: under the conditions of ``place_contacts``.
    """
    placed = place_contacts(arm, contacts)
    if contacts:
        bent = np.full(arm.joints, _BENT)
        postures = [arm.unpadded(state[0]), arm.rest(0.0 * bent), arm.rest(bent)]
        for law, contact in zip(placed.law, contacts, strict=True):
            law[MOBILITY] = max(_mobility(arm, contact, q) for q in postures)
    return placed


def _mobility(arm: Arm, contact: Contact, q: FloatArray) -> float:
    """Compute the largest acceleration of the contact point per force on it at a posture, 1/kg."""
    rest, still = np.zeros(arm.dof), np.zeros(arm.joints)
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
    turning, law = undecorated(turning_time), placed.law
    depth = _DEPTH * float(arm.lengths.sum())
    # The speed is that of an undamped vibration of this depth.
    speed = np.sqrt(law[:, STIFFNESS] * law[:, MOBILITY] * depth ** (law[:, EXPONENT] + 1.0))
    times = [turning(placed, k, float(speed[k])) for k in range(placed.body.size)]
    return max((1.0 / time for time in times), default=0.0)
