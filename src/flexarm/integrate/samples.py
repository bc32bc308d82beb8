"""Samples of a run, inside a step and at its ends.

=============  =============================================================================
symbol         meaning
=============  =============================================================================
``x``          position inside a step, 0 at its start and 1 at its end
``q, v, a``    coordinate, rate and acceleration; 0 at the start of the step, 1 at its end
``ends``       (s + 1, 2, n, 1 + m) slopes: the first at the start of the step, the last at
               its end
=============  =============================================================================
"""

from __future__ import annotations

from flexarm.integrate.base import System, Tolerance
from flexarm.integrate.memory import BETWEEN, EVALUATIONS, SAMPLES, STEPS, TIME, Memory
from flexarm.kernels.compilation.cache import apart, inner, merged
from flexarm.kernels.layout import Array, Sizes

#: Steps shorter than this fraction of a radian of the fastest mode are truncated steps, in which
#: the motion is negligible; in steps longer than this angle, implicit methods lose vibrations.
SHORT, _LONG = 1e-3, 10.0
#: Largest value of x^2 (1 - x)^3, and effect of this term over the allowed error of a step above
#: which it belongs to a vibration: that of a load which the step resolves is about that error.
_FIFTH, _VIBRATES = 0.0346, 10.0
#: Ratio of the terms of a vibration above which that of the rate belongs to it, too. A load has
#: the inverse ratio, and a vibration half the angle by which it turns in the step.
_LARGER = 4.0


@inner
def copy_state(sizes: Sizes, source: Array, target: Array) -> None:
    """Copy the coordinates and rates (2, n, 1 + m) of a state."""
    for level in range(2):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                target[level, i, j] = source[level, i, j]


@merged
def samples_at(sizes: Sizes, memory: Memory, state: Array, t: float) -> None:
    """Fill the samples at time t, and earlier ones that are not filled yet, with a state."""
    counts = memory.counts
    while (
        counts[SAMPLES] < memory.sample_times.shape[0] and memory.sample_times[counts[SAMPLES]] <= t
    ):
        copy_state(sizes, state, memory.samples[counts[SAMPLES]])
        counts[SAMPLES] += 1


@merged
def sample_before(memory: Memory, t: float) -> int:
    """Return the index of the next sample if it is before time t, and count it, else -1."""
    k: int = memory.counts[SAMPLES]
    if k < memory.sample_times.shape[0] and memory.sample_times[k] < t:
        memory.counts[SAMPLES] = k + 1
        return k
    return -1


@merged
def begin_call(sizes: Sizes, memory: Memory) -> float:
    """Fill the samples at the start of a call of a stepper; return its time (s)."""
    t: float = memory.clock[TIME]
    samples_at(sizes, memory, memory.state, t)
    return t


@merged
def count_first(memory: Memory) -> None:
    """Count the evaluation at the start of a call, unless the last call paused there.

    A run then has the same count however often it pauses, which depends on the computer.
    """
    if memory.clock[BETWEEN] == 0.0:
        memory.counts[EVALUATIONS] += 1
    memory.clock[BETWEEN] = 0.0


@merged
def end_step(sizes: Sizes, memory: Memory, new: Array, t_new: float) -> None:
    """Store ``new`` (2, n, 1 + m), the end of an accepted step, as the state at ``t_new``."""
    samples_at(sizes, memory, new, t_new)
    for level in range(2):
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                memory.state[level, i, j] = new[level, i, j]
    memory.clock[TIME] = t_new
    memory.counts[STEPS] += 1


@merged
def dense_weights(dense: Array, theta: float, weights: Array) -> None:
    """Compute the weights (1, r) of the stages at t + theta h."""
    for k in range(dense.shape[0]):
        weight = 0.0
        for p in range(dense.shape[1]):
            weight = (weight + dense[k, dense.shape[1] - 1 - p]) * theta
        weights[0, k] = weight


@merged
def coordinate_between(
    x: float, h: float, q0: float, v0: float, a0: float, q1: float, v1: float, a1: float
) -> float:
    """Return the coordinate at x (0 to 1) of a step, by quintic Hermite interpolation."""
    v = h * v0
    a = 0.5 * h * h * a0
    # Residuals at the new point of value, slope and half the curvature.
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
    """Return the rate at x (0 to 1) of a step, by cubic Hermite interpolation or a quartic.

    With ``fine``, the quartic has the integral q1 - q0. It divides by h, so it is not suitable for
    very short steps.
    """
    rise = v1 - v0
    c2 = 3.0 * rise - h * (2.0 * a0 + a1)
    c3 = h * (a0 + a1) - 2.0 * rise
    rate = v0 + x * (h * a0 + x * (c2 + x * c3))
    if fine:
        missing = (q1 - q0) / h - 0.5 * (v0 + v1) - h * (a0 - a1) / 12.0
        rate += 30.0 * missing * x * x * (1.0 - x) * (1.0 - x)
    return rate


@apart
def between_ends(
    sizes: Sizes, tolerance: Tolerance, damps: bool, state: Array, new: Array, ends: Array,
    x: float, h: float, sample: Array,
) -> None:  # fmt: skip
    """Sample at x (0 to 1) of a step from the values and the first and last slopes of ``ends``.

    Modes that the step does not resolve follow the load, and their accelerations at both ends
    belong to it: without them, rates between ends of order 5 err up to 100 times as much, and
    kinetic energies up to 10,000 times. Vibrations at the start of a long step that the method
    ``damps`` are gone at its end. Their accelerations would move the samples by up to 10,000 times
    their amplitude, and their rates by 100 times. Then the polynomial leaves out its term
    x^2 (1 - x)^3, which matches the acceleration at the start, and also x (1 - x)^3, which matches
    the rate, if that is far smaller.
    """
    s = ends.shape[0] - 1
    fine = h * tolerance.fastest > SHORT
    loses = damps and h * tolerance.fastest > _LONG
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            q0 = state[0, i, j]
            v0 = state[1, i, j]
            a0 = ends[0, 1, i, j]
            q1 = new[0, i, j]
            v1 = new[1, i, j]
            a1 = ends[s, 1, i, j]
            sample[0, i, j] = coordinate_between(x, h, q0, v0, a0, q1, v1, a1)
            sample[1, i, j] = rate_between(x, h, q0, v0, a0, q1, v1, a1, fine)
            if loses:
                fifth = 6.0 * (q0 - q1) + h * (3.0 * (v0 + v1) + 0.5 * h * (a0 - a1))
                size = max(abs(q0), abs(q1))
                allowed = tolerance.absolute * tolerance.unit[0, i, j] + tolerance.relative * size
                if _FIFTH * abs(fifth) > _VIBRATES * allowed:
                    y = 1.0 - x
                    sample[0, i, j] -= fifth * x * x * y * y * y
                    sample[1, i, j] -= fifth * x * y * y * (2.0 * y - 3.0 * x) / h
                    fourth = 3.0 * (q0 - q1) + h * (v0 + 2.0 * v1 - 0.5 * h * a1)
                    if abs(fifth) > _LARGER * abs(fourth):
                        sample[0, i, j] -= fourth * x * y * y * y
                        sample[1, i, j] -= fourth * y * y * (y - 3.0 * x) / h


@merged
def samples_between(
    system: System, tolerance: Tolerance, memory: Memory, ends: Array, t: float, h: float,
    t_new: float, damps: bool,
) -> None:  # fmt: skip
    """Fill the samples inside a step of length h from t to ``t_new`` by ``between_ends``."""
    k = sample_before(memory, t_new)
    while k >= 0:
        between_ends(
            system.sizes, tolerance, damps, memory.state, memory.new, ends,
            (memory.sample_times[k] - t) / h, h, memory.samples[k],
        )  # fmt: skip
        k = sample_before(memory, t_new)
