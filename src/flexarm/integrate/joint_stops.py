"""Detection of joint stops: steps that end where a joint meets or leaves a stop.

The torque of a stop (R.33) has a corner there, across which no formula keeps its order. The error
estimate of a step may not detect it, because stages inside the stop may have zero weight in the
estimate. Theory page "integration", below (I.4).
"""

from __future__ import annotations

import math

from flexarm.integrate.base import System
from flexarm.kernels.columns import FREE, JOINT_UW, LOWER_STOP, STOP_STIFFNESS
from flexarm.kernels.compilation.cache import merged
from flexarm.kernels.compilation.numbers import real
from flexarm.kernels.layout import Array

#: Allowed distance in time of a corner from an end of a step, as a fraction of the time in which
#: the stop reverses the joint. The relative error of the rate is then half its square.
_SHARE = 1e-6
#: The same as a fraction of the current time, several times its rounding error.
_ROUNDING = 2e-15
#: Intervals of a step that are searched for a crossing, and bisections that locate it.
_PARTS, _HALVINGS = 8, 50
#: A cubic has no crossing if the distances of its ends add up to more than this many paths of the
#: faster end.
_REACH = 1.5


@merged
def _angle(x: float, h: float, q0: float, v0: float, q1: float, v1: float) -> float:
    """Return the joint angle at x (0 to 1) of a step, by cubic Hermite interpolation."""
    y = 1.0 - x
    ends: float = q0 * y * y * (1.0 + 2.0 * x) + q1 * x * x * (3.0 - 2.0 * x)
    return ends + h * x * y * (v0 * y - v1 * x)


@merged
def _crossing(
    corner: float, h: float, q0: float, v0: float, q1: float, v1: float, allowed: float
) -> float:
    """Return the first time (s) after ``allowed`` at which the angle crosses the corner, or inf."""
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
    """Return the step length from t at which a joint meets or leaves a stop, or h if none does.

    ``state`` and ``new`` (2, n, 1 + m) are the ends of a step of length h; the last evaluation of
    the dynamics must be the one at ``new``.
    """
    sizes = system.sizes
    c = system.constants
    longest = h
    for _ in range(len(sizes.joint_laws)):
        for i in range(len(sizes.bodies)):
            stiffness = real(c.body[i, STOP_STIFFNESS] * c.body[i, FREE])
            if stiffness <= 0.0:
                continue
            inertia = max(real(system.work.body[i, JOINT_UW]), 0.0)
            allowed = max(_SHARE * math.sqrt(inertia / stiffness), _ROUNDING * abs(t))
            for side in range(2):
                found = _crossing(
                    real(c.body[i, LOWER_STOP + side]), h, real(state[0, i, 0]),
                    real(state[1, i, 0]), real(new[0, i, 0]), real(new[1, i, 0]), allowed,
                )  # fmt: skip
                # Aim beyond the corner: after a step that ends before it, a tiny one would follow.
                if found + allowed < h:
                    longest = min(longest, found + 0.5 * allowed)
    return longest
