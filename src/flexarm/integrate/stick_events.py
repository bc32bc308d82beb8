"""Steps that end where a joint starts to stick or to slip, and the state after that.

Theory page "integration", below (I.4). Accelerations jump where a joint stops or turns back, and
their slopes where it breaks away, so steps end there, as at joint stops. The rest of the step after
that time is corrected with the accelerations from both sides. The correction is evaluated in the
number type of the run: in dual numbers it contains the derivative of that time.

=============  =================================================================================
symbol         meaning
=============  =================================================================================
``since``      time from the change to the end of the step, s
``before``     accelerations without the change; afterwards, ``after``
=============  =================================================================================
"""

from __future__ import annotations

import math

from flexarm.integrate.base import System
from flexarm.integrate.memory import (
    CHANGED,
    EVALUATIONS,
    LAST_NORM,
    REFUSED,
    REJECTED,
    RISE,
    STEP,
    WHOLE,
    Memory,
)
from flexarm.integrate.status import DONE, PAUSED
from flexarm.integrate.sticking import (
    SLACK,
    excess_torque,
    friction_holds,
    held_torque,
    slips,
    sticks,
)
from flexarm.integrate.torque import slope_at
from flexarm.kernels.columns import HELD_TORQUE, SLIDING, SLIP_TIME
from flexarm.kernels.compilation.cache import apart, merged
from flexarm.kernels.compilation.numbers import real
from flexarm.kernels.layout import Array

#: Largest share of a step after the change. The corrected error is of its square, and that of the
#: derivative of the time of the change of itself. A step within 1e-6 of a stop is extended to it.
_LATE = 1e-5
#: Shortest step to a change, in radians of the fastest vibration or, if it is faster, of the
#: swing that a spring with the torque of the friction would cause. In shorter ones, torques near
#: the limit are rounding errors, and no step might reach the change.
_SHORTEST = 1e-6
#: Intervals of a step that are searched for a zero of the rate, and bisections that locate it.
_PARTS, _HALVINGS = 8, 50
#: Largest ratio of a step to one that was shortened to examine a change, and found none.
_GROW = 5.0


@merged
def _rate(x: float, h: float, v0: float, a0: float, v1: float, a1: float) -> float:
    """Return the rate at x (0 to 1) of a step, by cubic Hermite interpolation."""
    y = 1.0 - x
    ends: float = v0 * y * y * (1.0 + 2.0 * x) + v1 * x * x * (3.0 - 2.0 * x)
    return ends + h * x * y * (a0 * y - a1 * x)


@merged
def _turning_time(h: float, v0: float, a0: float, v1: float, a1: float, side: float) -> float:
    """Return the first time (s) in a step at which a rate is not on a side, +1 or -1; inf if none.

    Only the ends of eight intervals are examined.
    """
    for part in range(1, _PARTS + 1):
        high = part / _PARTS
        if _rate(high, h, v0, a0, v1, a1) * side >= 0.0:
            continue
        low = high - 1.0 / _PARTS
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if _rate(middle, h, v0, a0, v1, a1) * side < 0.0:
                high = middle
            else:
                low = middle
        return high * h
    return math.inf


@merged
def _slip_time(system: System, i: int, t: float, h: float) -> float:
    """Return the time (s) in a step from t at which a locked joint slips; inf if it does not.

    It is found by interpolation of the torques at the ends of the step. If friction can hold the
    torque at the end, it is the time of the first stage with a torque that it cannot: the step is
    repeated to this time, and its end decides.
    """
    c = system.constants
    found: float = real(c.body[i, SLIP_TIME]) - t
    held = real(held_torque(system, i))
    if not slips(system, i, held):
        return found
    excess = real(excess_torque(system, i, held))
    first = math.copysign(1.0, held) * real(c.body[i, HELD_TORQUE])
    # Aim at twice the slack: after a step that ends below the slack, a tiny one would follow.
    share = (excess - 2.0 * SLACK * abs(held)) / (abs(held) - first)
    found = h * (1.0 - max(share, SLACK))
    return found


@merged
def _changes(system: System, memory: Memory, i: int) -> bool:
    """Return whether the joint of body i slips or has turned at the end of a step."""
    if sticks(system, i):
        return slips(system, i, real(held_torque(system, i)))
    turned: bool = real(system.constants.body[i, SLIDING] * memory.new[1, i, 0]) < 0.0
    return turned


@apart
def judge_sticking(
    system: System, fastest: float, memory: Memory, stages: Array, s: int, t: float, h: float,
    adaptive: bool,
) -> int:  # fmt: skip
    """Check a step of length h from t, after the evaluation of ``stages[s]`` at its end.

    Returns ``PAUSED`` if the step must be repeated to end where a joint sticks or slips, else
    ``DONE``, with the joint that does so at its end in ``clock[CHANGED]``. The system must have
    laws of joints.
    """
    c, clock = system.constants, memory.clock
    earliest, changed = math.inf, -1
    for i in range(len(system.sizes.bodies)):
        if not friction_holds(system, i):
            continue
        found = math.inf
        side = math.copysign(1.0, real(c.body[i, SLIDING]))
        if sticks(system, i):
            found = _slip_time(system, i, t, h)
        else:
            v0, v1 = real(memory.state[1, i, 0]), real(memory.new[1, i, 0])
            a0, a1 = real(stages[0, 1, i, 0]), real(stages[s, 1, i, 0])
            found = _turning_time(h, v0, a0, v1, a1, side)
        if found < min(h, earliest):
            earliest, changed = found, i
    earliest = max(earliest, _SHORTEST / fastest)
    if adaptive and h - earliest > _LATE * h:
        memory.counts[REJECTED] += 1
        clock[WHOLE] = max(clock[WHOLE], h)
        # Aim beyond the change: after a step that ends before it, a tiny one would follow.
        clock[STEP] = earliest * (1.0 + 0.5 * _LATE)
        clock[REFUSED] = 1.0
        return PAUSED
    if changed >= 0 and not _changes(system, memory, changed):
        changed = -1
    for i in range(len(system.sizes.bodies)):
        if sticks(system, i):
            held = held_torque(system, i)
            if i == changed:
                clock[RISE] = abs(real(held - c.body[i, HELD_TORQUE])) / h
            c.body[i, HELD_TORQUE] = held
    clock[CHANGED] = 1.0 + changed
    return DONE


@merged
def _change_sticking(
    system: System, memory: Memory, stages: Array, s: int, t: float, from_left: bool
) -> None:
    """Let the joint of ``clock[CHANGED]`` stick or slip at t, the end of an accepted step.

    Corrects ``memory.new``, and computes its derivative ``stages[s]``; ``stages[0]`` is scratch.
    """
    c, clock, sizes = system.constants, memory.clock, system.sizes
    new, joint = memory.new, int(clock[CHANGED]) - 1
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            stages[0, 1, i, j] = stages[s, 1, i, j]
    if sticks(system, joint):
        # The accelerations differ by an amount that has increased from zero since the change.
        since = 0.5 * excess_torque(system, joint, c.body[joint, HELD_TORQUE]) / clock[RISE]
        moved = 0.0 * since
    else:
        since = new[1, joint, 0] / stages[0, 1, joint, 0]
        moved = 0.5 * since * since
    new[1, joint, 0] = 0.0
    settles = from_left  # a typed constant
    memory.counts[EVALUATIONS] += slope_at(
        system, t, from_left, new, memory.torque, stages, s, settles
    )
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            change = stages[s, 1, i, j] - stages[0, 1, i, j]
            new[0, i, j] += moved * change
            new[1, i, j] += since * change
    new[1, joint, 0] = since * stages[s, 1, joint, 0]
    memory.counts[EVALUATIONS] += slope_at(
        system, t, from_left, new, memory.torque, stages, s, settles
    )


@apart
def end_sticking(
    system: System, memory: Memory, stages: Array, s: int, t: float, from_left: bool
) -> None:
    """End an accepted step at t where a joint sticks or slips, or that was shortened for that."""
    clock = memory.clock
    if clock[CHANGED] > 0.0:
        _change_sticking(system, memory, stages, s, t, from_left)
    if clock[WHOLE] > 0.0:
        longest = clock[WHOLE]  # the motion is smooth again, at the scale of before
        if clock[CHANGED] == 0.0:
            longest = min(longest, _GROW * clock[STEP])
        clock[STEP] = max(clock[STEP], longest)
        clock[LAST_NORM] = 0.0
    clock[CHANGED] = clock[WHOLE] = clock[REFUSED] = 0.0
