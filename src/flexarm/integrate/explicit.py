"""Compiled stepping of explicit Runge-Kutta methods, with fixed or controlled steps.

=============  =============================================================================
symbol         meaning
=============  =============================================================================
``clock``      (3,) time t and next step h, s; 1.0 where the last step was refused
``counts``     (4,) samples filled, steps, rejected steps, evaluations of the dynamics
``stages``     (r, 2, n, 1 + m) derivatives; stage s belongs to the new point
``weights``    (1, r) scratch for dense output
=============  =============================================================================
"""

from __future__ import annotations

import math

import numpy as np

from flexarm.integrate.base import System, Tolerance
from flexarm.integrate.torque import rates_of, slope_at
from flexarm.kernels.cache import compiled, merged
from flexarm.kernels.layout import Array, Sizes

_DONE, _PAUSED, _STEP_UNDERFLOW, _NOT_FINITE, _INERTIA_LOST = 0, 1, 2, 3, 4
#: Safety and limits of the step controller; Hairer, Norsett and Wanner I, section II.4.
_SAFETY, _SHRINK, _GROW = 0.9, 0.2, 5.0
#: A step shorter than this part of the clock's reading no longer moves it reliably.
_SMALLEST = 1e-14


@compiled
def _combine(
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
def _error_norm(
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


@merged
def _all_finite(system: System, state: Array) -> bool:
    for level in range(2):
        for i in range(len(system.sizes.bodies)):
            for j in range(1 + len(system.sizes.modes)):
                if not math.isfinite(state[level, i, j]):
                    return False
    return True


@merged
def _inertia_left(system: System) -> bool:
    """Whether every free joint felt a positive inertia when the dynamics was evaluated last."""
    lowest = 1.0
    for i in range(len(system.sizes.bodies)):
        if system.constants.free[i] != 0.0:
            lowest = min(lowest, system.work.joint[i, 2])
    return lowest > 0.0


@merged
def _next_stop(stops: Array, t: float, until: float) -> float:
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
def _dense_weights(dense: Array, theta: float, weights: Array) -> None:
    """Weights (1, r) of the stages at t + theta h."""
    for k in range(dense.shape[0]):
        weight = 0.0
        for p in range(dense.shape[1]):
            weight = (weight + dense[k, dense.shape[1] - 1 - p]) * theta
        weights[0, k] = weight


@compiled
def advance_explicit(
    system: System,
    tolerance: Tolerance,
    A: Array,
    c: Array,
    error: Array,
    error_low: Array,
    dense: Array,
    order: int,
    adaptive: bool,
    state: Array,
    new: Array,
    torque: Array,
    stages: Array,
    weights: Array,
    clock: Array,
    counts: Array,
    until: float,
    sample_times: Array,
    samples: Array,
    max_steps: int,
) -> int:
    """Step from ``clock[0]`` to ``until``; see ``base.Integrator`` for the rules kept."""
    # Typed constants: literals would make the compiler build a copy of each callee for each value.
    zero = int(np.int64(0))
    from_left = bool(np.bool_(True))
    from_right = bool(np.bool_(False))
    s = error.shape[0] - 1
    error_needs_new = error[s] != 0.0
    t = clock[0]
    while counts[0] < sample_times.shape[0] and sample_times[counts[0]] <= t:
        _combine(system.sizes, state, stages, dense, zero, zero, 0.0, samples[counts[0]])
        counts[0] += 1
    if t >= until:
        return _DONE
    slope_at(system, t, from_right, state, torque, stages, zero)
    counts[3] += 1
    exponent = 1.0 / order
    for _ in range(max_steps):
        stop = _next_stop(system.drive.stops, t, until)
        h = clock[1]
        lands = t + h * 1.000001 >= stop
        t_new = t + h
        if lands:
            t_new = stop
            h = stop - t
        for k in range(1, s):
            _combine(system.sizes, state, stages, A, k, k, h, new)
            rates_of(system, t + c[k] * h, c[k] == 1.0, new, torque, stages, k)
        _combine(system.sizes, state, stages, A, s, s, h, new)
        counts[3] += s - 1
        if error_needs_new or not adaptive:
            rates_of(system, t_new, from_left, new, torque, stages, s)
            counts[3] += 1
        grow = 1.0
        if adaptive:
            norm = _error_norm(system, tolerance, state, new, stages, error, error_low, h)
            if not norm <= 1.0:
                counts[2] += 1
                clock[2] = 1.0
                shrink = _SHRINK
                if math.isfinite(norm):
                    shrink = max(_SHRINK, _SAFETY * norm ** (-exponent))
                clock[1] = h * shrink
                if clock[1] < _SMALLEST * max(abs(t), tolerance.fastest**-1):
                    return _STEP_UNDERFLOW if math.isfinite(norm) else _NOT_FINITE
                continue
            grow = _GROW if norm == 0.0 else min(_GROW, _SAFETY * norm ** (-exponent))
            grow = max(_SHRINK, grow)
            if clock[2] > 0.0:  # do not grow at once after a refusal
                grow = min(1.0, grow)
            clock[2] = 0.0
        elif not _all_finite(system, new):
            return _NOT_FINITE
        if adaptive and not error_needs_new:
            rates_of(system, t_new, from_left, new, torque, stages, s)
            counts[3] += 1

        # The last evaluation was at the new point: do not step past a singular mass matrix.
        if not _inertia_left(system):
            return _INERTIA_LOST

        # The step stands: samples inside it, then on.
        extra = False
        while counts[0] < sample_times.shape[0] and sample_times[counts[0]] <= t_new:
            asked = sample_times[counts[0]]
            if asked == t_new:
                _combine(system.sizes, new, stages, dense, zero, zero, 0.0, samples[counts[0]])
            else:
                if not extra:
                    for k in range(s + 1, dense.shape[0]):
                        out = samples[counts[0]]
                        _combine(system.sizes, state, stages, A, k, k, h, out)
                        slope_at(system, t + c[k] * h, from_left, out, torque, stages, k)
                        counts[3] += 1
                    extra = True
                _dense_weights(dense, (asked - t) / h, weights)
                rows = dense.shape[0]
                _combine(system.sizes, state, stages, weights, zero, rows, h, samples[counts[0]])
            counts[0] += 1
        for level in range(2):
            for i in range(len(system.sizes.bodies)):
                for j in range(1 + len(system.sizes.modes)):
                    state[level, i, j] = new[level, i, j]
                    stages[0, level, i, j] = stages[s, level, i, j]
        t = t_new
        clock[0] = t
        counts[1] += 1
        if adaptive and (not lands or grow < 1.0 or h * grow > clock[1]):
            clock[1] = h * grow
        if t >= until:
            return _DONE
        if lands and t_new < until:  # the torque may jump here: the slope is that from the left
            slope_at(system, t, from_right, state, torque, stages, zero)
            counts[3] += 1
    return _PAUSED
