"""Step length near contacts, so that no contact event is skipped between steps.

Theory page "contact", (T.8) to (T.10). A method evaluates contacts only at its stages. A point
cannot have had contact between two instants if its path is shorter than the sum of its distances at
both. Otherwise the step has to resolve the time in which a contact reverses the motion of the
point. During a contact, the error control is sufficient, as for a vibration. At its beginning it is
not, because the stages in contact may have zero weight in the estimate.
"""

from __future__ import annotations

import math

from flexarm.integrate.memory import TOUCHES
from flexarm.integrate.switching import begin_pushing, pushes, step_to_change
from flexarm.kernels.compilation.cache import apart, merged
from flexarm.kernels.compilation.numbers import real
from flexarm.kernels.forces.contact import (
    BEND,
    BRANCH,
    BY_SIGN,
    CLOSING,
    CORNER,
    DAMPING,
    EXPONENT,
    FRICTION,
    FRICTION_SPEED,
    GAP,
    MOBILITY,
    OPEN,
    POSITION,
    PUSHING,
    ROUNDED,
    STIFFNESS,
    SURFACE,
    VELOCITY,
)
from flexarm.kernels.forces.surface import COUNT
from flexarm.kernels.layout import Array, Contacts

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
#: Path of a step, relative to the radius of the surface, and the error of its trapezoidal rule,
#: relative to the path, below which a cubic through the ends of the step describes the gap, also
#: a little beyond its end. A path of 0.8 rad of a circle has that error.
_FLAT, _STRAIGHT, _BEYOND = 0.3, 0.05, 1.2
#: Rounding error of a gap, relative to the rounded corner: 1e-14 of the reach.
_SLACK = 1e-5
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
    because a point can pass through a soft post. The time of a slower point than one that gets as
    deep as the rounded corner is the time of the latter.
    """
    law = contacts.law
    above = real(law[k, EXPONENT]) + 1.0
    pull = real(law[k, STIFFNESS] * law[k, MOBILITY] * (2.0 + law[k, DAMPING] * speed))
    speed = max(speed, math.sqrt(max(pull, 0.0) * real(law[k, CORNER]) ** above / above))
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


@merged
def begin_branches(contacts: Contacts, adaptive: bool) -> None:
    """Select the branch of the laws for the first evaluation of a call."""
    for k in range(contacts.body.shape[0]):
        contacts.seen[1, k, BRANCH] = BY_SIGN if adaptive else ROUNDED


@apart
def fix_branches(contacts: Contacts, clock: Array, counts: Array) -> bool:
    """Fix which contacts push at the start of a step, after ``step_on``; return if any changed."""
    changed = False
    for k in range(contacts.body.shape[0]):
        before = contacts.seen[1, k, BRANCH]
        if before == ROUNDED:
            continue
        rate = -contacts.seen[0, k, CLOSING]
        now = OPEN
        if pushes(contacts.seen[0, k, GAP], rate, real(contacts.law[k, DAMPING])):
            now = PUSHING
        contacts.seen[1, k, BRANCH] = now
        if before != now and before != BY_SIGN:
            changed = True
            counts[TOUCHES] += 1
            if now == PUSHING:
                begin_pushing(clock, turning_time(contacts, k, _speed(contacts, 0, k)))
    return changed


@merged
def _is_smooth(contacts: Contacts, k: int, h: float, path: float) -> bool:
    """Return whether a cubic through the ends of a step describes the gap."""
    if contacts.law[k, SURFACE + COUNT] > 0.0 or path * _bulge(contacts, k) > _FLAT:
        return False
    seen = contacts.seen
    missed = 0.0
    for axis in range(2):
        mean = 0.5 * (seen[0, k, VELOCITY + axis] + seen[1, k, VELOCITY + axis])
        way = seen[1, k, POSITION + axis] - seen[0, k, POSITION + axis]
        missed += (way - h * mean) ** 2
    return missed < (_STRAIGHT * path) ** 2


@merged
def _step_within(contacts: Contacts, k: int, h: float, path: float, turning: float) -> float:
    """Return the longest step (s) with step control whose gap a cubic describes, near a surface.

    The path of such a step is smooth, or shorter than the gaps at both ends or than that of a short
    contact.
    """
    if contacts.seen[1, k, BRANCH] == PUSHING:
        within: float = h * _WITHIN / max(path * _bulge(contacts, k), _TINY)
        return within
    if _is_smooth(contacts, k, h, path):
        return h
    gaps = max(contacts.seen[0, k, GAP], 0.0) + max(contacts.seen[1, k, GAP], 0.0)
    allowed: float = max(_SHARE * turning, _BACK * h * gaps / path)
    return allowed


@apart
def step_to_contact(contacts: Contacts, clock: Array, h: float) -> float:
    """Return the longest step (s) that skips no contact and crosses no opening or closing.

    It is h if the step of length h, with step control, is accepted. The last evaluation of the
    dynamics must be at the end of the step. See ``step_allowed``.
    """
    longest = h
    for k in range(contacts.body.shape[0]):
        g0, g1 = contacts.seen[0, k, GAP], contacts.seen[1, k, GAP]
        pushing = contacts.seen[1, k, BRANCH] == PUSHING
        speed = max(_speed(contacts, 0, k), _speed(contacts, 1, k))
        path = h * speed
        gaps = max(g0, 0.0) + max(g1, 0.0)
        if not pushing and _BEYOND * path <= gaps:
            continue
        turning = turning_time(contacts, k, speed)
        if pushing or path > gaps:
            allowed = _step_within(contacts, k, h, path, turning)
            if allowed < _NEARLY * h:
                longest = min(longest, allowed)
                continue
        longest = step_to_change(
            clock, h, longest, turning, g0, -contacts.seen[0, k, CLOSING], g1,
            -contacts.seen[1, k, CLOSING], real(contacts.law[k, DAMPING]), pushing,
            _SLACK * real(contacts.law[k, CORNER]),
        )  # fmt: skip
    return longest


@apart
def step_allowed(contacts: Contacts, h: float) -> float:
    """Return the longest fixed step (s) that skips no contact, or h if a step of h is accepted.

    The last evaluation of the dynamics must be at the end of the step.
    """
    longest = h
    for k in range(contacts.body.shape[0]):
        before = max(contacts.seen[0, k, GAP], 0.0)
        after = max(contacts.seen[1, k, GAP], 0.0)
        speed = max(_speed(contacts, 0, k), _speed(contacts, 1, k))
        touching = before + after == 0.0
        if not touching and h * speed <= before + after:
            continue
        allowed = turning_time(contacts, k, speed)
        if touching:
            allowed = min(allowed, _fastest_change(contacts, k))
        if allowed < _NEARLY * h:
            longest = min(longest, allowed)
    return longest


@merged
def passed_through(contacts: Contacts) -> bool:
    """Return whether a point is about to leave a convex surface on its other side, (T.10)."""
    passed = False
    for k in range(contacts.body.shape[0]):
        passed = passed or -contacts.seen[1, k, GAP] * contacts.seen[1, k, BEND] > _DEEPEST
    return passed
