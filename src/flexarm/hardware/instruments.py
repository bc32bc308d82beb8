"""Instruments with resolution, noise, bias, range, sample time and delay."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from flexarm.errors import InputError, Problem, check_array, shown
from flexarm.linear.signals import CHANNEL_OUTPUTS, Sensor
from flexarm.model.wording import nearest

FloatArray = NDArray[np.float64]

#: Channels that an instrument can read.
SIGNALS = tuple(CHANNEL_OUTPUTS)
#: Tolerance for whole multiples of the sample time, because decimal fractions are rounded.
_GRID = 1e-9


@dataclass(frozen=True)
class Instrument:
    """One sensor, or one for each joint, link or gauge, with its errors.

    The reading of a value is ``clip(round_to(value + bias + noise, resolution), +-limit)``, taken
    at the frames of the instrument and available ``delay`` later. Until the first frame is
    available, the measurement has the reading of the initial state.

    Args:
        signal: a channel of results ("joint_angle", "strain", "tip", "torque", ...), or a `Sensor`
            for the position, velocity or acceleration of a point of a link.
        name: name of the reading in the measurement; None for the name of the signal.
        resolution: step that readings are rounded to, in the unit of the signal; 0 for none.
        noise: standard deviation of a white, normal error, drawn independently for each frame.
        bias: constant error.
        limit: largest magnitude of a reading.
        delay: s from a frame to the instant at which the controller receives it.
        sample_time: s between frames, a multiple of the controller's sample time; None for the
            sample time of the controller.
        rate_cutoff: Hz, cutoff of a filtered difference of the readings, which adds their rate to
            the measurement (Tustin's rule for ``s / (1 + s / (2 pi rate_cutoff))``); None for no
            rate.
        rate_name: name of that rate in the measurement; None for "joint_rate" for a joint angle,
            and for the name followed by "_rate" otherwise.

    Raises:
        InputError: if the signal is unknown, a name is not an identifier, ``limit``,
            ``sample_time`` or ``rate_cutoff`` is not positive, or another number is not finite or,
            except for ``bias``, negative.
    """

    signal: str | Sensor
    name: str | None = None
    resolution: float = 0.0
    noise: float = 0.0
    bias: float = 0.0
    limit: float = math.inf
    delay: float = 0.0
    sample_time: float | None = None
    rate_cutoff: float | None = None
    rate_name: str | None = None

    def __post_init__(self) -> None:
        problems = []
        word = isinstance(self.signal, str) and self.signal in SIGNALS
        if not word and not isinstance(self.signal, Sensor):
            rule = "be a Sensor or one of " + ", ".join(map(repr, SIGNALS))
            hint = nearest(self.signal, SIGNALS)
            problems.append(Problem("Instrument", "signal", rule, shown(self.signal), hint))
        for name in ("name", "rate_name"):
            given = getattr(self, name)
            if given is not None and not (isinstance(given, str) and given.isidentifier()):
                rule = "be a word of letters, digits and underscores"
                problems.append(Problem("Instrument", name, rule, shown(given)))
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in ("signal", "name", "rate_name") or value is None:
                continue
            if field.name == "limit" and isinstance(value, float) and value == math.inf:
                continue
            number = float(check_array("Instrument", field.name, value, ()))
            if field.name in ("limit", "sample_time", "rate_cutoff") and number <= 0.0:
                problems.append(
                    Problem("Instrument", field.name, "be greater than 0", shown(value))
                )
            elif field.name != "bias" and number < 0.0:
                problems.append(Problem("Instrument", field.name, "be at least 0", shown(value)))
        if problems:
            raise InputError(*problems)

    @property
    def label(self) -> str:
        """Name of the reading in the measurement."""
        if self.name is not None:
            return self.name
        if isinstance(self.signal, Sensor):
            return self.signal.name or self.signal.kind
        return self.signal

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the readings in the measurement: the value, and its rate if it is read."""
        if self.rate_cutoff is None:
            return (self.label,)
        rate = "joint_rate" if self.label == "joint_angle" else f"{self.label}_rate"
        return self.label, self.rate_name or rate


def ticks_of(instrument: Instrument, tick: float) -> tuple[int, int]:
    """Return the stride of the frames and the delay of the readings, in samples.

    Raises:
        InputError: if the frames are not at sample times, ``tick`` (s) apart.
    """
    every = (instrument.sample_time or tick) / tick
    if abs(every - round(every)) > _GRID * every:
        rule = f"be a multiple of the controller's sample time, {tick:g} s"
        name = f"sample_time of {instrument.label!r}"
        raise InputError(Problem("Instrument", name, rule, shown(instrument.sample_time)))
    return round(every), math.ceil(instrument.delay / tick - _GRID)


def filter_of(cutoff: float, frame: float) -> tuple[float, float]:
    """Return the coefficients of the previous rate and of the change in a filtered difference.

    Tustin's rule for ``s / (1 + s / (2 pi cutoff))``, ``cutoff`` in Hz, over ``frame`` (s).
    """
    lag = 1.0 / (2.0 * math.pi * cutoff)
    return (2.0 * lag - frame) / (2.0 * lag + frame), 2.0 / (2.0 * lag + frame)


class Readings:
    """State of an instrument during a run: frames, delays and the filtered difference."""

    def __init__(self, instrument: Instrument, tick: float, generator: np.random.Generator) -> None:
        self._instrument = instrument
        self._generator = generator
        self._every, self._late = ticks_of(instrument, tick)
        self._frames: deque[tuple[int, FloatArray, FloatArray | None]] = deque()
        self._known: tuple[FloatArray, FloatArray | None] | None = None
        self._last: FloatArray | None = None
        self._rate: FloatArray | None = None
        cutoff = instrument.rate_cutoff
        if cutoff is not None:
            self._forget, self._per_change = filter_of(cutoff, self._every * tick)

    def wants(self, k: int) -> bool:
        """Return whether sample k is a frame of the instrument."""
        return k % self._every == 0

    def take(self, k: int, value: FloatArray) -> None:
        """Take the frame at sample k."""
        read = self._read(value)
        rate = self._difference(read)
        if self._known is None:
            self._known = read, rate
        self._frames.append((k + self._late, read, rate))

    def tell(self, k: int, values: dict[str, FloatArray]) -> None:
        """Write copies of the readings that are available at sample k into ``values``."""
        while self._frames and self._frames[0][0] <= k:
            self._known = self._frames.popleft()[1:]
        assert self._known is not None
        for label, value in zip(self._instrument.labels, self._known, strict=False):
            assert value is not None
            values[label] = value.copy()

    def _read(self, value: FloatArray) -> FloatArray:
        it = self._instrument
        read = value + it.bias
        if it.noise > 0.0:
            read += self._generator.normal(0.0, it.noise, read.shape)
        if it.resolution > 0.0:
            read = it.resolution * np.round(read / it.resolution)
        return np.clip(read, -it.limit, it.limit) if it.limit < math.inf else read

    def _difference(self, read: FloatArray) -> FloatArray | None:
        if self._instrument.rate_cutoff is None:
            return None
        if self._last is None or self._rate is None:
            self._rate = np.zeros_like(read)  # the first frame gives no difference
        else:
            self._rate = self._forget * self._rate + self._per_change * (read - self._last)
        self._last = read
        return self._rate
