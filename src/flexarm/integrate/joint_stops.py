"""Steps that end where a joint meets or leaves a stop.

The torque of a stop (R.33) has a corner there, over which no formula keeps its order, and the error
estimate of a step may miss it: single stages inside the stop may have no weight in the estimate.
Theory page "integration", below (I.4).
"""

from __future__ import annotations

import math

from flexarm.integrate.base import System
from flexarm.kernels.cache import merged
from flexarm.kernels.columns import FREE, JOINT_UW, LOWER_STOP, STOP_STIFFNESS
from flexarm.kernels.layout import Array

#: A corner may lie inside a step by this part of the time in which the stop turns the joint back.
#: The rate then errs by half its square, relative to the rate of the impact.
_SHARE = 1e-6
#: The same as a part of the clock's reading, several times its rounding.
_ROUNDING = 2e-15
#: Parts of a step that are searched for a crossing, and halvings that locate one.
_PARTS, _HALVINGS = 8, 50
#: A cubic of which both ends are this far away, in paths of the faster end, does not get there.
_REACH = 1.5


@merged
def _angle(x: float, h: float, q0: float, v0: float, q1: float, v1: float) -> float:
    """Joint angle at x (0 to 1) of a step: cubic Hermite."""
    y = 1.0 - x
    ends: float = q0 * y * y * (1.0 + 2.0 * x) + q1 * x * x * (3.0 - 2.0 * x)
    return ends + h * x * y * (v0 * y - v1 * x)


@merged
def _crossing(
    corner: float, h: float, q0: float, v0: float, q1: float, v1: float, allowed: float
) -> float:
    """First time (s) after ``allowed`` at which the angle passes the corner; infinity for none."""
    if abs(q0 - corner) + abs(q1 - corner) > _REACH * h * max(abs(v0), abs(v1)):
        return math.inf
    for part in range(_PARTS):
        low = part / _PARTS
        high = (part + 1.0) / _PARTS
        before = _angle(low, h, q0, v0, q1, v1) - corner
        after = _angle(high, h, q0, v0, q1, v1) - corner
        if (before < 0.0) == (after < 0.0):
            continue
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if (_angle(middle, h, q0, v0, q1, v1) - corner < 0.0) == (before < 0.0):
                low = middle
            else:
                high = middle
        if high * h > allowed:
            return high * h
    return math.inf


@merged
def step_to_stop(system: System, t: float, state: Array, new: Array, h: float) -> float:
    """Length of the step from t after which a joint meets or leaves a stop; h where none does.

    ``state`` and ``new`` (2, n, 1 + m): the ends of a step of length h, after which the dynamics
    was evaluated last.
    """
    c = system.constants
    longest = h
    for _ in range(len(system.sizes.joint_laws)):
        for i in range(len(system.sizes.bodies)):
            stiffness = c.body[i, STOP_STIFFNESS] * c.body[i, FREE]
            if stiffness <= 0.0:
                continue
            inertia = max(system.work.body[i, JOINT_UW], 0.0)
            allowed = max(_SHARE * math.sqrt(inertia / stiffness), _ROUNDING * abs(t))
            for side in range(2):
                found = _crossing(
                    c.body[i, LOWER_STOP + side], h, state[0, i, 0], state[1, i, 0], new[0, i, 0],
                    new[1, i, 0], allowed,
                )  # fmt: skip
                # Aim beyond the corner: a step that ends before it needs a tiny one after it.
                if found + allowed < h:
                    longest = min(longest, found + 0.5 * allowed)
    return longest
