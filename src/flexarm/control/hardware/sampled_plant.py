"""Linear arms between the samples of a loop, with delays, lag, frames and filtered rates."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexarm.base.errors import InputError, Problem
from flexarm.base.late import linalg
from flexarm.control.hardware.measurement import FloatArray, filter_of, stride_and_delay
from flexarm.linear.models.state_space import balanced
from flexarm.model import Instrument, Motors

#: Largest number of states, and largest period (samples) after which all instruments repeat.
_MOST_STATES, _MOST_SAMPLES = 1000, 300

#: Tolerance for delays of whole samples, because decimal fractions are rounded.
_GRID = 1e-9


class Signal(NamedTuple):
    """Linear signal of an arm: value + C x + D (acting torque).

    ``components`` are the ends of the names of its components, such as ``[1]``; empty if unused.
    """

    value: FloatArray
    C: FloatArray
    D: FloatArray
    components: tuple[str, ...] = ()


#: Instrument and its signal, with the factors of its faults.
Reading = tuple[Instrument, Signal]
#: Place in the state, number of frames, and size of each, of the memory of an instrument.
Slot = tuple[int, int, int]


class SampledPlant(NamedTuple):
    """Sampled linear system X+ = A X + B u, y = C X, with u the torque of the controller.

    The state X consists of the states of the arm, the motors and the instruments, in this order. A
    and C are periodic sequences of matrices; they have one entry unless an instrument has its own
    sample time. ``outputs`` are the names of the components of y.
    """

    A: list[FloatArray]
    B: FloatArray
    C: list[FloatArray]
    sample_time: float
    outputs: tuple[str, ...] = ()
    frames: int = 0  # place of the states of the instruments, which are the last ones


def held(A: FloatArray, B: FloatArray, sample_time: float) -> tuple[FloatArray, FloatArray]:
    """Return A and B over a sample time (s), with zero-order-hold inputs; (C.22)."""
    n, m = B.shape
    if sample_time == 0.0:  # a delay of whole samples leaves nothing of a sample
        return np.eye(n), np.zeros((n, m))
    # The exponential is accurate relative to its norm, so that no unit may dominate it.
    scale = balanced(A)[1][:, None]
    pushed = B * sample_time / scale
    size = np.abs(pushed).max(axis=0)
    size = np.where(size > 0.0, size, 1.0)
    whole = np.zeros((n + m, n + m))
    whole[:n, :n], whole[:n, n:] = A * sample_time / scale * scale.T, pushed / size
    moved = linalg.expm(whole)
    return moved[:n, :n] * scale / scale.T, moved[:n, n:] * scale * size


def sampled_plant(
    A: FloatArray, B: FloatArray, readings: list[Reading], motors: Motors | None, sample_time: float
) -> SampledPlant:
    """Sample a linear arm x' = A x + B (acting torque) exactly, with its hardware.

    The model includes delays, the motors' lag, and the frames and filtered rates of instruments. It
    excludes nonlinear effects (limits, resolution) and noise.
    """
    motors = motors or Motors()
    m, lag = B.shape[1], motors.time_constant
    if lag > 0.0:  # the acting torque is a state that follows the requested one
        rows = np.hstack([np.zeros((m, len(A))), -np.eye(m) / lag])
        A, B = np.vstack([np.hstack([A, B]), rows]), np.vstack([np.zeros_like(B), np.eye(m) / lag])
    late, part = delay_in_samples(motors.delay, sample_time)
    before, push_before = held(A, B, part * sample_time)
    after, push_after = held(A, B, (1.0 - part) * sample_time)
    # Torques requested before this sample. The oldest one acts in a fraction of the sample, or on
    # readings that depend on the torque itself.
    read = lag == 0.0 and any(np.any(signal.D) for _, signal in readings)
    past = late + (part > 0.0 or read)
    slots = [_slots(reading, sample_time) for reading in readings]
    n = len(A)
    starts = n + m * past + np.cumsum([0, *(count * width for count, width in slots)])
    size = int(starts[-1])
    period = math.lcm(*(stride_and_delay(item, sample_time)[0] for item, _ in readings))
    if size > _MOST_STATES or period > _MOST_SAMPLES:
        rule = f"repeat within {_MOST_SAMPLES} samples and have at most {_MOST_STATES} states"
        value = f"{period} samples and {size} states"
        hint = "Use sample times with a smaller common multiple, or shorter delays."
        raise InputError(Problem("the sampled plant", rule, value, hint))
    # Entry j selects the torque requested j samples ago. That of the current sample is the input.
    commands = [np.zeros((m, size)), *(_places(m, n + m * j, size) for j in range(past))]
    step, push = np.zeros((size, size)), np.zeros((size, m))
    step[:n, :n] = after @ before
    step[:n] += push_after @ commands[late]
    if part > 0.0:
        step[:n] += after @ push_before @ commands[past]
    if late == 0:
        push[:n] = push_after
    if past:
        push[n : n + m] = np.eye(m)
    for j in range(1, past):
        step[n + m * j : n + m * (j + 1)] = commands[j]
    acting = _places(m, n - m, size) if lag > 0.0 else commands[past]
    steps, outputs = [], []
    for k in range(period):
        now, shown = step.copy(), []
        for reading, start, slot in zip(readings, starts.tolist(), slots, strict=False):
            signal = reading[1]
            exact = signal.D @ acting
            exact[:, : signal.C.shape[1]] += signal.C
            shown.append(_read(reading[0], exact, now, (start, *slot), k, sample_time))
        steps.append(now)
        outputs.append(np.vstack(shown) if shown else np.zeros((0, size)))
    names = tuple(
        label + end
        for item, signal in readings
        for label in item.labels
        for end in signal.components
    )
    return SampledPlant(steps, push, outputs, sample_time, names, int(starts[0]))


def delay_in_samples(delay: float, sample_time: float) -> tuple[int, float]:
    """Return the whole samples of a delay, and the remaining fraction of a sample."""
    late = math.floor(delay / sample_time + _GRID)
    part = delay / sample_time - late
    return late, part if part > _GRID else 0.0


def _places(count: int, start: int, size: int) -> FloatArray:
    """Return rows that select ``count`` numbers of a state of length ``size``."""
    return np.eye(size)[start : start + count]


def _slots(reading: Reading, sample_time: float) -> tuple[int, int]:
    """Return the number of earlier frames that an instrument stores, and the size of each."""
    every, late = stride_and_delay(reading[0], sample_time)
    filtered = reading[0].rate_cutoff is not None
    count = max(late, 1) if filtered or every > 1 else late
    return count, len(reading[1].C) * (1 + filtered)


def _read(
    item: Instrument, exact: FloatArray, step: FloatArray, slot: Slot, tick: int, sample_time: float
) -> FloatArray:
    """Return the rows of a reading over the state; write its memory into ``step``."""
    (start, count, width), (every, late) = slot, stride_and_delay(item, sample_time)
    p, size = len(exact), exact.shape[1]
    if tick % every:  # without a new frame, the last one remains
        frame = _places(width, start, size)
    elif item.rate_cutoff is None:
        frame = exact
    else:
        forget, per_change = filter_of(item.rate_cutoff, every * sample_time)
        last, rate = _places(p, start, size), _places(p, start + p, size)
        frame = np.vstack([exact, forget * rate + per_change * (exact - last)])
    if count:
        step[start : start + width] = frame
        for first in range(start, start + (count - 1) * width, width):
            step[first + width : first + 2 * width] = _places(width, first, size)
    return frame if late == 0 else _places(width, start + (late - 1) * width, size)
