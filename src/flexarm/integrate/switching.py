"""Instants at which a one-sided spring (a contact, a joint stop) begins or ceases to push.

The force has a kink there, across which no formula keeps its order: a step whose stages lie on both
sides is inaccurate, and its derivative is wrong by the slope of the kink times the weight of those
stages. Therefore a method with step control

1. fixes at the start of each step, by the signs of gap and push alone, whether the spring pushes,
   so that the force is smooth in all stages, also in those that overshoot;
2. ends the step where the spring changes (``first_change``), and evaluates the dynamics again.

The state at the start of a step determines all, so runs that pause there continue bit for bit. As
the force is continuous, the derivative of the motion is continuous as well, and the derivative of
the steps, at constant lengths, is that of the motion. Theory page "integration", (I.18).

Another law with a kink follows the same steps: a function of the state whose sign selects the
smooth branch, that branch fixed in the arrays of the kernel (``Workspace.body``, for a joint),
``first_change`` in ``steps.judge_step``, and its count where the branch is fixed. If the force
itself jumps, the derivative of the state needs one more term: the jump of the rate, times the
derivative of the time of the change.

=============  =================================================================================
symbol         meaning
=============  =================================================================================
``g, r``       gap (negative where the spring is compressed) and its rate; 0 at the start of the
               step, 1 at its end
``push``       1 - damping * rate, relative force of the spring; none below zero
``x``          position inside a step, 0 at its start and 1 at its end
=============  =================================================================================
"""

from __future__ import annotations

import math

from flexarm.integrate.memory import AHEAD, RESUMED, STEP, TIME
from flexarm.kernels.compilation.cache import apart, merged
from flexarm.kernels.layout import Array

#: Allowed distance in time of a change from the end of a step, as a fraction of the time in which
#: the spring reverses the motion. It is the relative error of the derivative.
_SHARE = 1e-8
#: The same as a fraction of the current time, several times its rounding error.
_ROUNDING = 2e-15
#: Intervals of a step that are searched for a change, and bisections that locate it. One interval
#: beyond the end predicts a change in the next step.
_PARTS, _HALVINGS = 8, 50
#: A cubic has no zero if the gaps at its ends add up to more than this many paths of the faster
#: end.
_REACH = 1.5
#: Push within which its sign is a rounding error.
_NO_PUSH = 1e-12
#: Error of the interpolated gap, relative to its distance from a straight line. At 1.5 rad of a
#: vibration per step it is half as much.
_INACCURATE = 0.1
#: First step of a spring that pushes, and longest step that needs no caution near its change,
#: relative to the time in which the spring reverses the motion.
_FIRST, _CAREFUL = 0.5, 0.1


@merged
def _gap(x: float, h: float, g0: float, r0: float, g1: float, r1: float) -> float:
    """Return the gap at x by cubic Hermite interpolation."""
    y = 1.0 - x
    ends: float = g0 * y * y * (1.0 + 2.0 * x) + g1 * x * x * (3.0 - 2.0 * x)
    return ends + h * x * y * (r0 * y - r1 * x)


@merged
def _rate(x: float, h: float, g0: float, r0: float, g1: float, r1: float) -> float:
    """Return the derivative of ``_gap`` by time."""
    y = 1.0 - x
    slopes: float = r0 * y * (1.0 - 3.0 * x) + r1 * x * (3.0 * x - 2.0)
    return 6.0 * x * y * (g1 - g0) / h + slopes


@merged
def pushes(g: float, r: float, damping: float) -> bool:
    """Return whether a spring pushes."""
    return g < 0.0 and 1.0 - damping * r > 0.0


@merged
def _changed(
    x: float, h: float, g0: float, r0: float, g1: float, r1: float, damping: float, pushing: bool,
    slack: float,
) -> bool:  # fmt: skip
    """Return whether the spring at x has changed from the start, by more than rounding errors."""
    g = _gap(x, h, g0, r0, g1, r1)
    push = 1.0 - damping * _rate(x, h, g0, r0, g1, r1)
    if pushing:
        return g > slack or push < -_NO_PUSH
    return g < -slack and push > _NO_PUSH


@apart
def first_change(
    h: float, g0: float, r0: float, g1: float, r1: float, damping: float, pushing: bool,
    slack: float,
) -> float:  # fmt: skip
    """Return the time (s) of the first change in or shortly after a step, or inf.

    Args:
        pushing: whether the spring pushes at the start.
        slack: rounding error of the gap.
    """
    apart_by = abs(g0) + abs(g1)
    outside = min(g0, g1) > 0.0 and not pushing
    if (outside or damping == 0.0) and apart_by > _REACH * h * max(abs(r0), abs(r1)):
        return math.inf
    for part in range(_PARTS + 1):
        low = part / _PARTS
        high = (part + 1.0) / _PARTS
        if not _changed(high, h, g0, r0, g1, r1, damping, pushing, slack):
            continue
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if _changed(middle, h, g0, r0, g1, r1, damping, pushing, slack):
                high = middle
            else:
                low = middle
        return high * h
    return math.inf


@merged
def _may_change(h: float, g0: float, r0: float, g1: float, r1: float, pushing: bool) -> bool:
    """Return whether the interpolated gap comes so near to zero that its error matters."""
    chord = (g1 - g0) / h
    error = _INACCURATE * 0.125 * h * (abs(r0 - chord) + abs(r1 - chord))
    near = False
    for part in range(1, _PARTS):
        x = part / _PARTS
        y = 1.0 - x
        g = _gap(x, h, g0, r0, g1, r1)
        if pushing:
            g = -g
        near = near or g < 16.0 * x * x * y * y * error
    return near


@apart
def step_to_change(
    clock: Array, h: float, longest: float, time: float, g0: float, r0: float, g1: float,
    r1: float, damping: float, pushing: bool, slack: float,
) -> float:  # fmt: skip
    """Return the step (s) to a change of one spring, at most ``longest``; h if it does not change.

    A change shortly after the step is written to ``clock[AHEAD]``.

    Args:
        time: in which the spring reverses the motion, s.
    """
    found = first_change(h, g0, r0, g1, r1, damping, pushing, slack)
    allowed = max(_SHARE * time, _ROUNDING * abs(clock[TIME]))
    # Aim beyond the change: after a step that ends before it, a tiny one would follow.
    aim = max(found, allowed) + 0.5 * allowed
    if found + allowed < h:
        if aim < longest:
            longest = aim
            if clock[RESUMED] == 0.0:
                clock[RESUMED] = h
    elif found == math.inf:
        if h > _CAREFUL * time and _may_change(h, g0, r0, g1, r1, pushing):
            longest = min(longest, max(0.5 * h, _CAREFUL * time))
    elif found > h and (clock[AHEAD] == 0.0 or aim - h < clock[AHEAD]):
        clock[AHEAD] = aim - h
    return longest


@merged
def begin_pushing(clock: Array, time: float) -> None:
    """Limit the step after a spring has begun to push, which reverses the motion in ``time`` (s).

    The step control knows the motion without the spring only.
    """
    clock[STEP] = min(clock[STEP], _FIRST * time)
