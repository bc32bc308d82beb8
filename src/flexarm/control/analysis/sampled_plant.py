"""Sampled model of a linear arm with its motors and instruments."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexarm.base.errors import InputError, Problem
from flexarm.control.design.linear_design import held
from flexarm.control.hardware.instruments import filter_of, stride_and_delay
from flexarm.control.hardware.measurement import FloatArray
from flexarm.model import Instrument, Motors

#: Largest number of states, and largest period (samples) after which all instruments repeat.
_MOST_STATES, _MOST_SAMPLES = 1000, 300

#: Tolerance for delays of whole samples, because decimal fractions are rounded.
_GRID = 1e-9


class Reading(NamedTuple):
    """Instrument and its reading of the linear model without errors: C x + D (acting torque).

    ``components`` are the ends of the names of its components; empty if unused.
    """

    instrument: Instrument
    C: FloatArray
    D: FloatArray
    components: tuple[str, ...] = ()


class SampledPlant(NamedTuple):
    """Sampled linear system X+ = A X + B u, y = C X, with u the torque of the controller.

    The state X consists of the states of the arm, the motors and the instruments. A and C are
    periodic sequences of matrices; they have one entry unless an instrument has its own sample
    time. ``outputs`` are the names of the components of y.
    """

    A: list[FloatArray]
    B: FloatArray
    C: list[FloatArray]
    sample_time: float
    outputs: tuple[str, ...] = ()


def sampled_plant(
    A: FloatArray,
    B: FloatArray,
    readings: Sequence[Reading],
    motors: Motors | None,
    sample_time: float,
) -> SampledPlant:
    """Sample a linear arm x' = A x + B (acting torque) exactly, with its hardware.

    The model includes delays, the motors' lag, and the frames and filtered rates of instruments. It
    excludes nonlinear effects (limits, resolution) and noise.

    Raises:
        InputError: if the period of the frames is too long, or delays require too many states.
    """
    motors = motors or Motors()
    m, lag = B.shape[1], motors.time_constant
    if lag > 0.0:  # the acting torque is a state that follows the requested one
        rows = np.hstack([np.zeros((m, len(A))), -np.eye(m) / lag])
        A, B = np.vstack([np.hstack([A, B]), rows]), np.vstack([np.zeros_like(B), np.eye(m) / lag])
    late, part = _delay(motors.delay, sample_time)
    before, push_before = held(A, B, part * sample_time)
    after, push_after = held(A, B, (1.0 - part) * sample_time)
    past = late + 1  # torques requested before this sample
    slots = [_slots(reading, sample_time) for reading in readings]
    n = len(A)
    starts = n + m * past + np.cumsum([0, *(count * width for count, width in slots)])
    size = int(starts[-1])
    period = math.lcm(*(stride_and_delay(item.instrument, sample_time)[0] for item in readings))
    if size > _MOST_STATES or period > _MOST_SAMPLES:
        rule = f"repeat within {_MOST_SAMPLES} samples and have at most {_MOST_STATES} states"
        value = f"{period} samples and {size} states"
        hint = "Use sample times with a smaller common multiple, or shorter delays."
        raise InputError(Problem("the sampled plant", rule, value, hint))
    # Entry j selects the torque requested j samples ago. That of the current sample is the input.
    commands = [np.zeros((m, size)), *(_places(m, n + m * j, size) for j in range(past))]
    step, push = np.zeros((size, size)), np.zeros((size, m))
    step[:n, :n] = after @ before
    step[:n] += after @ push_before @ commands[late + 1] + push_after @ commands[late]
    if late == 0:
        push[:n] = push_after
    push[n : n + m] = np.eye(m)
    for j in range(1, past):
        step[n + m * j : n + m * (j + 1)] = commands[j]
    acting = _places(m, n - m, size) if lag > 0.0 else commands[late + 1]
    steps, outputs = [], []
    for k in range(period):
        now, shown = step.copy(), []
        for reading, start, (count, width) in zip(readings, starts, slots, strict=False):
            exact = reading.D @ acting
            exact[:, : reading.C.shape[1]] += reading.C
            shown.append(_read(reading, exact, now, int(start), count, width, k, sample_time))
        steps.append(now)
        outputs.append(np.vstack(shown) if shown else np.zeros((0, size)))
    names = tuple(
        label + end
        for reading in readings
        for label in reading.instrument.labels
        for end in reading.components
    )
    return SampledPlant(steps, push, outputs, sample_time, names)


def _delay(delay: float, sample_time: float) -> tuple[int, float]:
    """Return the whole samples of a delay, and the remaining fraction of a sample."""
    late = math.floor(delay / sample_time + _GRID)
    part = delay / sample_time - late
    return late, part if part > _GRID else 0.0


def _places(count: int, start: int, size: int) -> FloatArray:
    """Return rows that select ``count`` numbers of a state of length ``size``."""
    return np.eye(size)[start : start + count]


def _slots(reading: Reading, sample_time: float) -> tuple[int, int]:
    """Return the number of earlier frames that an instrument stores, and the size of each."""
    every, late = stride_and_delay(reading.instrument, sample_time)
    filtered = reading.instrument.rate_cutoff is not None
    count = max(late, 1) if filtered or every > 1 else late
    return count, len(reading.C) * (1 + filtered)


def _read(
    reading: Reading,
    exact: FloatArray,
    step: FloatArray,
    start: int,
    count: int,
    width: int,
    tick: int,
    sample_time: float,
) -> FloatArray:
    """Return the rows of a reading over the state; write its memory into ``step``."""
    every, late = stride_and_delay(reading.instrument, sample_time)
    p, size = len(exact), exact.shape[1]
    if tick % every:  # without a new frame, the last one remains
        frame = _places(width, start, size)
    elif reading.instrument.rate_cutoff is None:
        frame = exact
    else:
        forget, per_change = filter_of(reading.instrument.rate_cutoff, every * sample_time)
        last, rate = _places(p, start, size), _places(p, start + p, size)
        frame = np.vstack([exact, forget * rate + per_change * (exact - last)])
    if count:
        step[start : start + width] = frame
        for j in range(1, count):
            step[start + j * width : start + (j + 1) * width] = _places(
                width, start + (j - 1) * width, size
            )
    return frame if late == 0 else _places(width, start + (late - 1) * width, size)
