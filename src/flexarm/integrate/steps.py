"""What the steppers share: sums of stages, the error of a step, the next step, stops, samples.

Step sizes follow a digital filter instead of the last error alone (Soderlind, ACM Transactions on
Mathematical Software 29 (2003) 1-26). Where stability and not accuracy limits an explicit method,
the error jumps with the step, and a controller without memory refuses every third step.
"""

from __future__ import annotations

import math

from flexarm.integrate.base import System, Tolerance
from flexarm.kernels.cache import inner, merged
from flexarm.kernels.columns import FREE, JOINT_UW, W2
from flexarm.kernels.layout import ArmConstants, Array, Sizes

DONE, PAUSED, STEP_UNDERFLOW, NOT_FINITE, INERTIA_LOST, NOT_CONVERGED = 0, 1, 2, 3, 4, 5
NOT_FOLLOWED, DIVERGED = 8, 9
#: Safety and limits of the step controller; Hairer, Norsett and Wanner I, section II.4.
_SAFETY, _SHRINK, _GROW = 0.9, 0.2, 5.0
#: Soderlind's filter H211b: how much the last two errors and the last change of the step weigh.
_FILTER = 4.0
#: An error this far below what is allowed says no more than that the step may grow at once.
_TINY = 1e-12
#: A step shorter than this part of the clock's reading no longer moves it reliably.
_SMALLEST = 1e-14

#: Places in the array ``clock``: time and next step, s; 1.0 where the last step was refused; error
#: over the allowed and length of the last step that stood, zero if there is none; how often a step
#: was shortened to meet or leave a joint stop.
TIME, STEP, REFUSED, LAST_NORM, LAST_STEP, IMPACTS = 0, 1, 2, 3, 4, 5
CLOCK_PLACES = 6

#: Places in the array ``span`` of a method of fixed steps: start and end of the present span
#: between two stops, s; length of its equal steps, s; how many they are, and how many are done.
START, END, LENGTH, COUNT, PLACE = 0, 1, 2, 3, 4
SPAN_PLACES = 5

#: Steps shorter than this part of a radian of the fastest mode are cut ones: nothing moves in them.
SHORT = 1e-3
#: No explicit step turns the fastest mode by more radians than this, which is beyond all limits of
#: stability. While an arm only turns, without bending, any step would pass the error control; but
#: the polynomial between its ends multiplies the rounding of the modes by high powers of the step.
LONGEST = 7.0
#: A mode that turns by more radians than this in a step is not resolved by it.
RESOLVED = 1.6


#: No step that turns a joint by more than half a turn (rad) samples its motion, and no link bends
#: by more than this many times the reach of the arm.
_MOST_TURNED, _ABSURD = math.pi, 100.0


@merged
def refuse_step(tolerance: Tolerance, clock: Array, h: float, norm: float, order: int) -> int:
    """Shorten the step after an error above what is allowed; not ``DONE`` where none is left."""
    shrink = _SHRINK
    if math.isfinite(norm):
        shrink = max(_SHRINK, _SAFETY * norm ** (-1.0 / order))
    clock[REFUSED] = 1.0
    clock[STEP] = h * shrink
    if clock[STEP] < _SMALLEST * max(abs(clock[TIME]), tolerance.fastest**-1):
        return STEP_UNDERFLOW if math.isfinite(norm) else NOT_FINITE
    return DONE


@merged
def refuse_beyond(clock: Array, counts: Array, reached: float) -> None:
    """Repeat the step only as far as ``reached`` (s), where the forces have a corner."""
    counts[2] += 1
    clock[STEP] = reached
    clock[REFUSED] = 1.0


@merged
def accept_step(clock: Array, h: float, norm: float, order: int, lands: bool) -> None:
    """Choose the step that follows one of length h that stood; ``lands``: cut to meet a stop."""
    error = max(norm, _TINY) * _SAFETY ** (-order)
    if clock[LAST_NORM] > 0.0 and clock[REFUSED] == 0.0:
        previous = max(clock[LAST_NORM], _TINY) * _SAFETY ** (-order)
        grow = (error * previous) ** (-1.0 / (_FILTER * order))
        grow *= (h / clock[LAST_STEP]) ** (-1.0 / _FILTER)
    else:
        grow = error ** (-1.0 / order)
    grow = min(_GROW, max(_SHRINK, grow))
    if clock[REFUSED] > 0.0:  # do not grow at once after a refusal
        grow = min(1.0, grow)
    clock[REFUSED] = 0.0
    if lands and grow >= 1.0 and h * grow <= clock[STEP]:
        return  # the step was cut: it says nothing about the one that was to be
    clock[LAST_NORM] = max(norm, _TINY)
    clock[LAST_STEP] = h
    clock[STEP] = h * grow


@inner
def combine(
    sizes: Sizes, state: Array, stages: Array, weights: Array, row: int, count: int, h: float,
    out: Array,
) -> None:  # fmt: skip
    """out = state + h * sum over stages of weights[row]."""
    for level in range(2):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                total = 0.0
                for k in range(count):
                    total += weights[row, k] * stages[k, level, i, j]
                out[level, i, j] = state[level, i, j] + h * total


@merged
def _scale(system: System, tolerance: Tolerance, state: Array, level: int, i: int) -> float:
    """Largest modal value of a body, in metres at the tip."""
    largest: float = 0.0
    for j in range(len(system.sizes.modes)):
        size = abs(state[level, i, 1 + j]) / tolerance.unit[level, i, 1 + j]
        largest = max(largest, size)
    return largest


@merged
def error_norm(
    system: System,
    tolerance: Tolerance,
    state: Array,
    new: Array,
    stages: Array,
    error: Array,
    error_low: Array,
    h: float,
) -> float:
    """Largest error of a step over what is allowed: at most one if the step may be accepted."""
    count = error.shape[0]
    worst: float = 0.0
    worst_low: float = 0.0
    for level in range(2):
        for i in range(len(system.sizes.bodies)):
            modal = max(
                _scale(system, tolerance, state, level, i), _scale(system, tolerance, new, level, i)
            )
            for j in range(1 + len(system.sizes.modes)):
                unit = tolerance.unit[level, i, j]
                size = modal
                if j == 0:
                    size = max(abs(state[level, i, 0]), abs(new[level, i, 0])) / unit
                allowed = unit * (tolerance.absolute + tolerance.relative * size)
                high = 0.0
                low = 0.0
                for k in range(count):
                    high += error[k] * stages[k, level, i, j]
                    low += error_low[k] * stages[k, level, i, j]
                worst = max(worst, abs(h * high) / allowed)
                worst_low = max(worst_low, abs(h * low) / allowed)
                if not (math.isfinite(high) and math.isfinite(new[level, i, j])):
                    return math.inf
    if worst == 0.0:
        return 0.0
    # As a ratio: the square of a vanishing error would underflow to 0 / 0.
    return worst / math.sqrt(1.0 + 0.01 * (worst_low / worst) ** 2)


@inner
def followed(sizes: Sizes, tolerance: Tolerance, new: Array, h: float) -> int:
    """Judge the end (2, n, 1 + m) of a fixed step of length h: not ``DONE`` if it cannot be right.

    A fixed step has no error estimate, so without this a run that diverges goes on to overflow.
    """
    furthest = _ABSURD / tolerance.unit[0, 0, 0]
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            if not (math.isfinite(new[0, i, j]) and math.isfinite(new[1, i, j])):
                return NOT_FINITE
            if j > 0 and abs(new[0, i, j]) > furthest * tolerance.unit[0, i, j]:
                return DIVERGED
        if h * abs(new[1, i, 0]) > _MOST_TURNED:
            return DIVERGED
    return DONE


@merged
def inertia_left(system: System) -> bool:
    """Whether every free joint felt a positive inertia when the dynamics was evaluated last."""
    lowest = 1.0
    for i in range(len(system.sizes.bodies)):
        if system.constants.body[i, FREE] != 0.0:
            lowest = min(lowest, system.work.body[i, JOINT_UW])
    return lowest > 0.0


@merged
def next_stop(stops: Array, t: float, until: float) -> float:
    """Next time that a step must not cross."""
    low = 0
    high = stops.shape[0]
    while low < high:
        middle = (low + high) // 2
        if stops[middle] <= t:
            low = middle + 1
        else:
            high = middle
    if low < stops.shape[0] and stops[low] < until:
        until = stops[low]
    return until


@merged
def begin_span(stops: Array, t: float, until: float, step: float, span: Array) -> None:
    """Cut the time from t to the next stop into equal steps, none longer than ``step``."""
    span[START] = t
    span[END] = next_stop(stops, t, until)
    span[COUNT] = max(1.0, math.ceil((span[END] - t) / step * (1.0 - 1e-9)))
    span[LENGTH] = (span[END] - t) / span[COUNT]
    span[PLACE] = 0.0


@merged
def dense_weights(dense: Array, theta: float, weights: Array) -> None:
    """Weights (1, r) of the stages at t + theta h."""
    for k in range(dense.shape[0]):
        weight = 0.0
        for p in range(dense.shape[1]):
            weight = (weight + dense[k, dense.shape[1] - 1 - p]) * theta
        weights[0, k] = weight


@merged
def coordinate_between(
    x: float, h: float, q0: float, v0: float, a0: float, q1: float, v1: float, a1: float
) -> float:
    """Coordinate at x (0 to 1) of a step: quintic Hermite."""
    v = h * v0
    a = 0.5 * h * h * a0
    # What is missing at the new point, of value, slope and half the curvature.
    e0 = q1 - q0 - v - a
    e1 = h * v1 - v - 2.0 * a
    e2 = 0.5 * h * h * a1 - a
    c3 = 10.0 * e0 - 4.0 * e1 + e2
    c4 = -15.0 * e0 + 7.0 * e1 - 2.0 * e2
    c5 = 6.0 * e0 - 3.0 * e1 + e2
    return q0 + x * (v + x * (a + x * (c3 + x * (c4 + x * c5))))


@merged
def rate_between(
    x: float, h: float, q0: float, v0: float, a0: float, q1: float, v1: float, a1: float,
    fine: bool,
) -> float:  # fmt: skip
    """Rate at x (0 to 1) of a step: cubic Hermite, or with ``fine`` the quartic that also adds up.

    The quartic covers the distance from q0 to q1; it divides by h, so not for very short steps.
    """
    rise = v1 - v0
    c2 = 3.0 * rise - h * (2.0 * a0 + a1)
    c3 = h * (a0 + a1) - 2.0 * rise
    rate = v0 + x * (h * a0 + x * (c2 + x * c3))
    if fine:
        missing = (q1 - q0) / h - 0.5 * (v0 + v1) - h * (a0 - a1) / 12.0
        rate += 30.0 * missing * x * x * (1.0 - x) * (1.0 - x)
    return rate


@inner
def between_ends(
    sizes: Sizes, constants: ArmConstants, tolerance: Tolerance, state: Array, new: Array,
    stages: Array, x: float, h: float, sample: Array,
) -> None:  # fmt: skip
    """Sample at x (0 to 1) of a step from the values and the first and last slopes of ``stages``.

    A mode that the step does not resolve has accelerations that mean nothing inside it: cubic.
    """
    s = stages.shape[0] - 1
    fine = h * tolerance.fastest > SHORT
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            q0 = state[0, i, j]
            v0 = state[1, i, j]
            a0 = stages[0, 1, i, j]
            q1 = new[0, i, j]
            v1 = new[1, i, j]
            a1 = stages[s, 1, i, j]
            stiff = False
            if j > 0:
                stiff = h * h * constants.mode[i, j - 1, W2] > RESOLVED * RESOLVED
            if stiff:
                sample[0, i, j] = rate_between(x, h, 0.0, q0, v0, 0.0, q1, v1, False)
                sample[1, i, j] = v0 + x * (v1 - v0)
            else:
                sample[0, i, j] = coordinate_between(x, h, q0, v0, a0, q1, v1, a1)
                sample[1, i, j] = rate_between(x, h, q0, v0, a0, q1, v1, a1, fine)
