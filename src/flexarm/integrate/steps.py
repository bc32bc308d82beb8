"""Common functions of the steppers: error norm, step control, stops, spans.

Step sizes follow a digital filter instead of the last error alone (Soderlind, ACM Transactions on
Mathematical Software 29 (2003) 1-26). If stability and not accuracy limits an explicit method, the
error varies strongly with the step, and a controller without memory rejects every third step.
"""

from __future__ import annotations

import math
from typing import Any

from flexarm.integrate.base import System, Tolerance
from flexarm.integrate.joint_stops import step_to_stop
from flexarm.integrate.memory import (
    AHEAD,
    COUNT,
    END,
    LAST_NORM,
    LAST_STEP,
    LENGTH,
    NORM,
    PLACE,
    REFUSED,
    REJECTED,
    RESUMED,
    START,
    STEP,
    TIME,
    Memory,
)
from flexarm.integrate.nearness import passed_through, step_allowed, step_to_contact
from flexarm.integrate.status import (
    CONTACT_UNSEEN,
    DIVERGED,
    DONE,
    NOT_FINITE,
    PAUSED,
    PRESSED_THROUGH,
    STEP_UNDERFLOW,
)
from flexarm.kernels.columns import FREE, JOINT_INERTIA
from flexarm.kernels.compilation.cache import apart, inner, merged
from flexarm.kernels.compilation.numbers import real
from flexarm.kernels.layout import Array, Contacts, Sizes

#: Safety and limits of the step controller; Hairer, Norsett and Wanner I, section II.4.
_SAFETY, _SHRINK, _GROW = 0.9, 0.2, 5.0
#: Parameter b of Soderlind's filter H211b: the exponents of the last two errors and of the last
#: step ratio are divided by it.
_FILTER = 4.0
#: Smallest error norm in the controller, far below the range that determines the step.
_TINY = 1e-12
#: Smallest step relative to the current time: a shorter one no longer advances it reliably.
_SMALLEST = 1e-14
#: A step that would end this close before a stop, relative to its length, is extended to the stop.
_NEARLY = 1.000001

#: Largest phase change (rad) of the fastest mode in an explicit step, beyond all stability limits.
#: While an arm turns without bending, any step would pass the error control, but the polynomial
#: between its ends multiplies the rounding errors of the modes by high powers of the step.
LONGEST = 7.0

#: Limits of a plausible fixed step: rotation of a joint (rad), because samples of a faster motion
#: are useless, and deflection of a link relative to the reach of the arm.
_MOST_TURNED, _ABSURD = math.pi, 100.0


# Stops and spans ---------------------------------------------------------------------------------


@merged
def next_stop(stops: Array, t: float, until: float) -> float:
    """Return the next time that a step must not cross."""
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
def step_landing(stops: Array, t: float, h: float, until: float) -> tuple[float, float, bool]:
    """Return the end of a step of about h, its length, and whether it ends at a stop."""
    stop = next_stop(stops, t, until)
    lands = t + h * _NEARLY >= stop
    t_new = t + h
    if lands:
        t_new = stop
        h = stop - t
    return t_new, h, lands


@merged
def begin_span(stops: Array, t: float, until: float, step: float, clock: Array) -> None:
    """Divide the time from t to the next stop into equal steps, none longer than ``step``."""
    clock[START] = t
    clock[END] = next_stop(stops, t, until)
    clock[COUNT] = max(1.0, math.ceil((clock[END] - t) / step * (1.0 - 1e-9)))
    clock[LENGTH] = (clock[END] - t) / clock[COUNT]
    clock[PLACE] = 0.0


@merged
def step_of_span(clock: Array) -> tuple[float, bool]:
    """Return the end (s) of the next step of the span, and whether it ends the span."""
    lands = clock[PLACE] + 1.0 >= clock[COUNT]
    t_new = clock[START] + (clock[PLACE] + 1.0) * clock[LENGTH]
    if lands:
        t_new = clock[END]
    return t_new, lands


# States ------------------------------------------------------------------------------------------


@merged
def _scale(sizes: Sizes, tolerance: Tolerance, state: Array, new: Array, level: int, i: int) -> Any:
    """Return the largest modal value of a body at both ends of a step, in metres at the tip."""
    largest: Any = 0.0
    for j in range(len(sizes.modes)):
        size = max(abs(state[level, i, 1 + j]), abs(new[level, i, 1 + j]))
        largest = max(largest, size / tolerance.unit[level, i, 1 + j])
    return largest


@merged
def error_sizes(
    sizes: Sizes, tolerance: Tolerance, state: Array, new: Array, stages: Array, error: Array,
    h: Any,
) -> Any:  # fmt: skip
    """Return the largest errors of a step over the allowed error, by two estimates.

    The third number is zero if the new point and the errors are finite, otherwise NaN. For the
    other arguments see ``error_norm``; they may be packs.
    """
    worst: Any = 0.0
    worst_low: Any = 0.0
    check: Any = 0.0
    for level in range(2):
        for i in range(len(sizes.bodies)):
            modal = _scale(sizes, tolerance, state, new, level, i)
            for j in range(1 + len(sizes.modes)):
                unit = tolerance.unit[level, i, j]
                size = modal
                if j == 0:
                    size = max(abs(state[level, i, 0]), abs(new[level, i, 0])) / unit
                # One division: it costs as much as ten products.
                share = h / (unit * (tolerance.absolute + tolerance.relative * size))
                high = 0.0
                low = 0.0
                for k in range(error.shape[1]):
                    high += error[0, k] * stages[k, level, i, j]
                    low += error[1, k] * stages[k, level, i, j]
                worst = max(worst, abs(share * high))
                worst_low = max(worst_low, abs(share * low))
                check += 0.0 * high + 0.0 * new[level, i, j]
    return worst, worst_low, check


@merged
def norm_of(worst: float, worst_low: float, check: float) -> float:
    """Return the norm of a step from the numbers of ``error_sizes``."""
    if not math.isfinite(check):
        return math.inf
    if worst == 0.0:
        return 0.0
    # Use a ratio, because the square of a very small error would underflow to 0 / 0.
    return worst / math.sqrt(1.0 + 0.01 * (worst_low / worst) ** 2)


@apart
def error_norm(
    sizes: Sizes, tolerance: Tolerance, state: Array, new: Array, stages: Array, error: Array,
    h: float,
) -> float:  # fmt: skip
    """Return the largest error of a step over the allowed error; the step is accepted up to 1.

    ``error`` (2, stages): weights of the error estimate and of a less accurate one.
    """
    worst, worst_low, check = error_sizes(sizes, tolerance, state, new, stages, error, h)
    norm: float = norm_of(real(worst), real(worst_low), real(check))
    return norm


@merged
def inertia_left(system: System) -> bool:
    """Return whether the articulated inertia of every free joint was positive at the last pass."""
    lowest = 1.0
    for i in range(len(system.sizes.bodies)):
        if system.constants.body[i, FREE] != 0.0:
            lowest = min(lowest, system.work.body[i, JOINT_INERTIA])
    return lowest > 0.0


@merged
def _furthest(sizes: Sizes, tolerance: Tolerance) -> Any:
    """Return the largest plausible displacement of the tip of a tree, in lengths of the scale."""
    furthest: Any = 0.0 * tolerance.unit[0, 0, 0]
    slides = 1.0  # whether all joints slide; the scale is then the reach
    for i in range(len(sizes.bodies)):
        if sizes.joints[i, 1] == 0:
            furthest = max(furthest, _ABSURD / tolerance.unit[0, i, 0])
            slides = 0.0
    return furthest + slides * _ABSURD


@inner
def motion_sizes(sizes: Sizes, tolerance: Tolerance, new: Array, h: Any) -> Any:
    """Return the largest motion of a fixed step of length h over the plausible one.

    The second number is zero if the new point (2, n, 1 + m) is finite, otherwise NaN. The arguments
    may be packs.
    """
    furthest = _ABSURD / tolerance.unit[0, 0, 0]
    if len(sizes.tree) > 0:
        furthest = _furthest(sizes, tolerance)
    largest: Any = 0.0
    check: Any = 0.0
    for i in range(len(sizes.bodies)):
        most = _MOST_TURNED
        if len(sizes.tree) > 0 and sizes.joints[i, 1] > 0:
            most = furthest * tolerance.unit[0, i, 0]
        largest = max(largest, h * abs(new[1, i, 0]) / most)
        for j in range(1 + len(sizes.modes)):
            check += 0.0 * new[0, i, j] + 0.0 * new[1, i, j]
            if j > 0:
                largest = max(largest, abs(new[0, i, j]) / (furthest * tolerance.unit[0, i, j]))
    return largest, check


@inner
def followed(sizes: Sizes, tolerance: Tolerance, new: Array, h: float) -> int:
    """Check the end (2, n, 1 + m) of a fixed step of length h; not ``DONE`` if it is implausible.

    A fixed step has no error estimate, so without this check a diverging run would overflow.
    """
    largest, check = motion_sizes(sizes, tolerance, new, h)
    if not math.isfinite(real(check)):
        return NOT_FINITE
    return DIVERGED if real(largest) > 1.0 else DONE


# Step control ------------------------------------------------------------------------------------


@merged
def _repeat_to(clock: Array, counts: Array, h: float, reached: float) -> int:
    """Reject a step of length h and repeat it to ``reached`` (s)."""
    counts[REJECTED] += 1
    # A longer one would be extended to the stop at the end of this one, and so on without end.
    clock[STEP] = min(reached, h / (_NEARLY * _NEARLY))
    clock[REFUSED] = 1.0
    return PAUSED


@merged
def retry_shorter(clock: Array, counts: Array, order: int, h: float, fastest: float) -> int:
    """Reject a step of length h with the error ``clock[NORM]``, and choose a shorter one.

    Returns ``PAUSED``, or the status that ends the run if the step is too short.
    """
    norm = clock[NORM]
    shrink = _SHRINK
    if math.isfinite(norm):
        shrink = max(_SHRINK, _SAFETY * norm ** (-1.0 / order))
    counts[REJECTED] += 1
    clock[STEP] = h * shrink
    clock[REFUSED] = 1.0
    clock[RESUMED] = 0.0
    if clock[STEP] < _SMALLEST * max(abs(clock[TIME]), fastest**-1):
        return STEP_UNDERFLOW if math.isfinite(norm) else NOT_FINITE
    return PAUSED


@merged
def judge_step(
    system: System, tolerance: Tolerance, memory: Memory, stages: Array, error: Array, order: int,
    h: float,
) -> int:  # fmt: skip
    """Check a step of length h to ``memory.new``, for joint stops and its error.

    Returns ``DONE`` for an accepted step, with its error in ``clock[NORM]``; ``PAUSED`` if it must
    be repeated with ``clock[STEP]``; otherwise the status that ends the run.
    """
    clock = memory.clock
    clock[AHEAD] = 0.0
    reached = step_to_stop(system, memory, h)
    if reached < h:
        return _repeat_to(clock, memory.counts, h, reached)
    norm = error_norm(system.sizes, tolerance, memory.state, memory.new, stages, error, h)
    clock[NORM] = norm
    if norm <= 1.0:
        return DONE
    return retry_shorter(clock, memory.counts, order, h, tolerance.fastest)


@merged
def judge_contacts(
    contacts: Contacts, clock: Array, counts: Array, h: float, adaptive: bool
) -> int:
    """Check that a step of length h skips no contact, after an evaluation at its end.

    Returns a code as ``judge_step`` does.
    """
    if adaptive:
        allowed = step_to_contact(contacts, clock, h)
        if allowed < h:
            return _repeat_to(clock, counts, h, allowed)
    elif step_allowed(contacts, h) < h:
        return CONTACT_UNSEEN
    if passed_through(contacts):
        return PRESSED_THROUGH
    return DONE


@merged
def _by_error(clock: Array, h: float, order: int, lands: bool) -> None:
    """Choose the step after an accepted one of length h by its error."""
    error = max(clock[NORM], _TINY) * _SAFETY ** (-order)
    if clock[LAST_NORM] > 0.0 and clock[REFUSED] == 0.0:
        previous = max(clock[LAST_NORM], _TINY) * _SAFETY ** (-order)
        grow = (error * previous) ** (-1.0 / (_FILTER * order))
        grow *= (h / clock[LAST_STEP]) ** (-1.0 / _FILTER)
    else:
        grow = error ** (-1.0 / order)
    grow = min(_GROW, max(_SHRINK, grow))
    if clock[REFUSED] > 0.0:  # do not increase the step directly after a rejection
        grow = min(1.0, grow)
    clock[REFUSED] = 0.0
    if lands and grow >= 1.0 and h * grow <= clock[STEP]:
        return  # a truncated step gives no information about the full step
    clock[LAST_NORM] = max(clock[NORM], _TINY)
    clock[LAST_STEP] = h
    clock[STEP] = h * grow


@merged
def choose_step(clock: Array, h: float, order: int, lands: bool) -> None:
    """Choose the step after an accepted one of length h; ``lands``: truncated to meet a stop.

    It ends where a spring will change, if that is near. After the change, the step before it is
    resumed.
    """
    if clock[RESUMED] > 0.0:
        clock[STEP] = clock[RESUMED]
        clock[RESUMED] = clock[REFUSED] = clock[LAST_NORM] = 0.0
    else:
        _by_error(clock, h, order, lands)
    if 0.0 < clock[AHEAD] < clock[STEP]:
        clock[RESUMED] = clock[STEP]
        clock[STEP] = clock[AHEAD]
