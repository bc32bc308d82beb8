"""Step length near contacts, so that no contact event is skipped between steps.

Theory page "contact", (T.8) to (T.10). A method evaluates contacts only at its stages. A point
cannot have had contact between two instants if its path is shorter than the sum of its distances at
both. Otherwise the step has to resolve the time in which a contact reverses the motion of the
point. During a contact, the error control is sufficient, as for a vibration. At its beginning it is
not, because the stages in contact may have zero weight in the estimate.
"""

from __future__ import annotations

import math

from flexarm.kernels.compilation.cache import apart, merged
from flexarm.kernels.compilation.numbers import real
from flexarm.kernels.forces.contact import (
    BEND,
    DAMPING,
    EXPONENT,
    FRICTION,
    FRICTION_SPEED,
    GAP,
    MOBILITY,
    STIFFNESS,
    VELOCITY,
)
from flexarm.kernels.layout import Contacts

#: A step that exceeds the allowed length by less than this ratio is accepted, because it may have
#: been extended to a stop.
_NEARLY = 0.999
#: Fraction of the turning time that a step may take if a contact is possible.
_SHARE = 0.1
_TINY = 1e-300
#: Longest fixed step, relative to the turning time or the time constant of friction and damping in
#: a contact. Explicit methods are stable up to more than twice that.
_STABLE = 1.0
#: Fraction of the distances that a repeated step may use.
_BACK = 0.9
#: Maximum depth relative to the radius of a convex surface: at its centre the normal reverses.
_DEEPEST = 0.9
#: Path of a step inside a convex surface, relative to its radius, so that no step crosses the
#: centre.
_WITHIN = 0.15


@merged
def _bulge(contacts: Contacts, k: int) -> float:
    """Return the larger curvature (1/m) at the ends of a step; almost zero if not convex."""
    bend: float = max(contacts.seen[0, k, BEND], contacts.seen[1, k, BEND], _TINY)
    return bend


@merged
def turning_time(contacts: Contacts, k: int, speed: float) -> float:
    """Return the approximate time (s) to maximum depth of a contact at a closing speed, (T.9).

    If the radius of the surface is smaller than that depth, return the time to travel the radius,
    because a point can pass through a soft post.
    """
    law = contacts.law
    above = real(law[k, EXPONENT]) + 1.0
    pull = real(law[k, STIFFNESS] * law[k, MOBILITY] * (2.0 + law[k, DAMPING] * speed))
    if pull <= 0.0 or speed <= 0.0:
        return math.inf
    deepest: float = (above * speed * speed / pull) ** (1.0 / above)
    time: float = min(deepest, 1.0 / _bulge(contacts, k)) / speed
    return time


@merged
def _speed(contacts: Contacts, end: int, k: int) -> float:
    vx = contacts.seen[end, k, VELOCITY]
    vy = contacts.seen[end, k, VELOCITY + 1]
    return math.sqrt(vx * vx + vy * vy)


@merged
def _fastest_change(contacts: Contacts, k: int) -> float:
    """Return the time constant (s) of the fastest vibration or decay in a contact during a step."""
    law = contacts.law
    depth = -min(contacts.seen[0, k, GAP], contacts.seen[1, k, GAP])
    exponent = real(law[k, EXPONENT])
    push = real(law[k, STIFFNESS]) * depth**exponent
    spring = push * exponent / max(depth, _TINY) * real(law[k, MOBILITY])
    loss = real(law[k, FRICTION] / law[k, FRICTION_SPEED] + law[k, DAMPING])
    decay = push * real(law[k, MOBILITY]) * loss
    rate: float = max(math.sqrt(spring), decay, _TINY)
    return _STABLE / rate


@merged
def step_on(contacts: Contacts) -> None:
    """Make the end of a step, where the dynamics was evaluated last, the start of the next one."""
    for k in range(contacts.body.shape[0]):
        for column in range(contacts.seen.shape[2]):
            contacts.seen[0, k, column] = contacts.seen[1, k, column]


@apart
def step_allowed(contacts: Contacts, h: float, adaptive: bool) -> float:
    """Return the longest step (s) that skips no contact, or h if the step of length h is accepted.

    The last evaluation of the dynamics must be at the end of the step. Returns zero if a point is
    about to leave a convex surface on its other side, (T.10), which no step can prevent.
    """
    longest = h
    for k in range(contacts.body.shape[0]):
        before = max(contacts.seen[0, k, GAP], 0.0)
        after = max(contacts.seen[1, k, GAP], 0.0)
        speed = max(_speed(contacts, 0, k), _speed(contacts, 1, k))
        touching = before + after == 0.0
        path = h * speed
        if not touching and path <= before + after:
            continue
        turning = turning_time(contacts, k, speed)
        if touching and adaptive:
            allowed = _WITHIN / (speed * _bulge(contacts, k))
        elif touching:
            allowed = min(turning, _fastest_change(contacts, k))
        elif adaptive:
            allowed = max(_SHARE * turning, _BACK * h * (before + after) / path)
        else:
            allowed = turning
        if allowed < _NEARLY * h:
            longest = min(longest, allowed)
    if longest == h:
        for k in range(contacts.body.shape[0]):
            if -contacts.seen[1, k, GAP] * contacts.seen[1, k, BEND] > _DEEPEST:
                return 0.0
    return longest
