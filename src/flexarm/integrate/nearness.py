"""No step past a surface unseen: how long a step may be near what the arm can touch.

Theory page "contact", (T.8) to (T.10). A method sees a surface only at its stages. A point cannot
have touched anything between two moments if its path in between is shorter than the sum of its
distances at both; where it may have, the step has to resolve the time in which a touch turns the
point back. In a touch the error control sees it, as it sees a vibration; at its beginning that is
not enough, because single stages may touch whose weight in the estimate is zero.
"""

from __future__ import annotations

import math

from flexarm.kernels.cache import inner, merged
from flexarm.kernels.contact import (
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

#: A step that is longer than allowed by less than this stands: it may have been drawn to a stop.
_NEARLY = 0.999
#: Part of the time that turns a point back, which a step may take where it may have touched.
_SHARE = 0.1
_TINY = 1e-300
#: Lowest speed of a touch (m/s): one that only rests has its own time, that of its springs.
_SLOWEST = 1e-3
#: Steps of a fixed length may be as long as the turning time or the time constant of friction and
#: damping in a touch, times this: explicit methods are stable up to more than twice that.
_STABLE = 1.0
#: How much of the distances a step made anew may use.
_BACK = 0.9
#: Deepest touch as a part of the radius of a bulging surface: at its centre the normal turns over.
_DEEPEST = 0.9
#: Path of a step inside of a bulging surface, in its radius: no step leads past the centre.
_WITHIN = 0.15


@merged
def _bulge(contacts: Contacts, k: int) -> float:
    """Curvature (1/m) of a bulging surface at the worse end of a step, hardly any of others."""
    bend: float = max(contacts.seen[0, k, BEND], contacts.seen[1, k, BEND], _TINY)
    return bend


@merged
def turning_time(contacts: Contacts, k: int, speed: float) -> float:
    """Time (s) in which a touch at this speed of closing is at its deepest, about, (T.9).

    Or has gone as far as the surface's radius, where that is less: a soft post is passed there.
    """
    law = contacts.law
    above = law[k, EXPONENT] + 1.0
    pull = law[k, STIFFNESS] * law[k, MOBILITY] * (2.0 + law[k, DAMPING] * speed)
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
    """Time (s) of the fastest vibration or decay in a touch, at the worse end of a step."""
    law = contacts.law
    depth = -min(contacts.seen[0, k, GAP], contacts.seen[1, k, GAP])
    exponent = law[k, EXPONENT]
    push = law[k, STIFFNESS] * depth**exponent
    spring = push * exponent / max(depth, _TINY) * law[k, MOBILITY]
    decay = push * law[k, MOBILITY] * (law[k, FRICTION] / law[k, FRICTION_SPEED] + law[k, DAMPING])
    rate: float = max(math.sqrt(spring), decay, _TINY)
    return _STABLE / rate


@merged
def step_on(contacts: Contacts) -> None:
    """Make the end of a step, where the dynamics was evaluated last, the start of the next."""
    for k in range(contacts.body.shape[0]):
        for column in range(contacts.seen.shape[2]):
            contacts.seen[0, k, column] = contacts.seen[1, k, column]


@inner
def step_allowed(contacts: Contacts, h: float, adaptive: bool) -> float:
    """Longest step (s) that sees every touch, after one of length h: h itself if that stands.

    The dynamics has been evaluated last at the end of the step. Zero where a point is about to
    leave a bulging surface on its other side, (T.10): no step helps.
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
        turning = turning_time(contacts, k, max(speed, _SLOWEST))
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
