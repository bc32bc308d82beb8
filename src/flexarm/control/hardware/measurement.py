"""Readings at one sample time, and instruments with resolution, noise, bias, range and delay."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from flexarm.base.errors import InputError, Problem, shown
from flexarm.model import Instrument, InstrumentFault
from flexarm.model.wording import nearest

FloatArray = NDArray[np.float64]


class Measurement(Mapping[str, FloatArray]):
    """Readings by name, as ``measurement.joint_angle`` or ``measurement["joint_angle"]``.

    Without ``hardware`` the readings are ``joint_angle`` (joints,) rad and ``joint_rate`` (joints,)
    rad/s, relative, and ``strain`` (gauges,). With it, they are those of its instruments.
    """

    _values: dict[str, FloatArray]

    def __init__(self, **values: FloatArray) -> None:
        # Readings are also stored as attributes, because attribute access is ten times as fast as
        # ``__getattr__``. A reading does not replace a method of the same name.
        mine = vars(self)
        mine.update(values)
        if not _METHODS.isdisjoint(values):
            for name in _METHODS.intersection(values):
                del mine[name]
        mine["_values"] = values

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"a measurement cannot be changed: {name}")

    def __getitem__(self, name: str) -> FloatArray:
        try:
            return self._values[name]
        except KeyError:
            raise _NotMeasured(name, self._values) from None

    def __contains__(self, name: object) -> bool:
        return name in self._values

    def get(self, name: str, default: Any = None) -> Any:
        """Return a reading, or ``default`` if it is not measured."""
        return self._values.get(name, default) if isinstance(name, str) else default

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __reduce__(self) -> tuple[object, ...]:
        return partial(Measurement, **self._values), ()

    def __getattr__(self, name: str) -> FloatArray:
        if name.startswith("_"):  # copy and pickle look these up before there are values
            raise AttributeError(name)
        try:
            return self._values[name]
        except KeyError:
            raise AttributeError(_not_measured(name, self._values)) from None

    def __repr__(self) -> str:
        return f"Measurement({', '.join(f'{k}={v}' for k, v in self._values.items())})"


def readings_by_name(measured: Sequence[Measurement]) -> dict[str, FloatArray]:
    """Return readings of samples by name, each (samples, ...)."""
    names = measured[0] if measured else ()
    return {name: np.array([item[name] for item in measured]) for name in names}


#: Attribute names that readings do not replace.
_METHODS = frozenset(dir(Measurement)) | {"_values"}


class _NotMeasured(KeyError):
    """Error for a name that is not measured; its message is composed only when it is shown."""

    def __str__(self) -> str:
        name, values = self.args
        return _not_measured(name, values)


def _not_measured(name: str, values: Mapping[str, FloatArray]) -> str:
    hint = nearest(name, values) or _hint(name)
    return f"no instrument measures {name!r}; available readings: {', '.join(values)}. {hint}"


def _hint(name: str) -> str:
    """Return a hint on how to measure a name."""
    if name == "contact_force":
        return "Pass contacts= to simulate; with hardware=, also add an Instrument of this signal."
    if name == "contact_gap":
        return "Pass contacts= to simulate, and hardware= with an Instrument of this signal."
    return "Pass hardware= with an Instrument of this signal or name to simulate."


#: Numbers of each run that `NoiseOfRuns` draws at once.
_AHEAD = 64
#: Tolerance for whole multiples of the sample time, because decimal fractions are rounded.
_GRID = 1e-9


def stride_and_delay(instrument: Instrument, tick: float) -> tuple[int, int]:
    """Return the stride of the frames and the delay of the readings, in samples."""
    every = (instrument.sample_time or tick) / tick
    if abs(every - round(every)) > _GRID * every:
        rule = f"be a multiple of the controller's sample time ({tick:g} s)"
        name = f"sample_time of {instrument.label!r}"
        raise InputError(Problem(name, rule, shown(instrument.sample_time)))
    return round(every), math.ceil(instrument.delay / tick - _GRID)


def filter_of(cutoff: float, frame: float) -> tuple[float, float]:
    """Return the coefficients of the previous rate and of the change in a filtered difference.

    Tustin's rule for ``s / (1 + s / (2 pi cutoff))``, ``cutoff`` in Hz, over ``frame`` (s).
    """
    lag = 1.0 / (2.0 * math.pi * cutoff)
    return (2.0 * lag - frame) / (2.0 * lag + frame), 2.0 / (2.0 * lag + frame)


class Noise(Protocol):
    """Source of noise, such as a ``numpy.random.Generator``."""

    def normal(self, loc: float, scale: float, size: tuple[int, ...]) -> FloatArray:
        """Return normally distributed numbers of shape ``size``."""


class _Given:
    """Noise that was drawn before."""

    def __init__(self, noise: Any) -> None:
        self._noise = noise

    def normal(self, loc: float, scale: float, size: tuple[int, ...]) -> Any:
        """Return the noise."""
        return self._noise


class NoiseOfRuns:
    """Noise of several runs, each with the numbers of its own generator."""

    def __init__(self, generators: Sequence[np.random.Generator]) -> None:
        self._generators = generators
        self._ahead: FloatArray = np.zeros((0, 0))
        self._next = 0

    def normal(self, loc: float, scale: float, size: tuple[int, ...]) -> FloatArray:
        """Return numbers of shape ``size``, (runs, k), with the same arguments at every call."""
        if self._next == len(self._ahead):
            shape = _AHEAD, *size[1:]
            drawn = [one.normal(loc, scale, shape) for one in self._generators]
            self._ahead, self._next = np.stack(drawn, axis=1), 0
        self._next += 1
        found: FloatArray = self._ahead[self._next - 1]
        return found


class Readings:
    """State of an instrument during a run: frames, delays and the filtered difference.

    The values, of shape (k,), may be those of several runs, (runs, k).

    Attributes:
        labels: of the readings. signal: that of the instrument.
        exact: whether the reading is the value at each sample time, so that no state is needed.
        limited: whether readings have a limit.
    """

    def __init__(self, instrument: Instrument, tick: float, generator: Noise) -> None:
        self._instrument, self._tick = instrument, tick
        self.labels, self.signal = instrument.labels, instrument.signal
        self._generator = generator
        self._every, self._late = stride_and_delay(instrument, tick)
        self._frames: deque[tuple[int, FloatArray, FloatArray | None]] = deque()
        self._known: tuple[FloatArray, FloatArray | None] | None = None
        self._last: FloatArray | None = None
        self._frozen: FloatArray | None = None  # the previous reading, which a fault may keep
        self._rate: FloatArray | None = None
        cutoff = instrument.rate_cutoff
        immediate = self._every == 1 and self._late == 0 and cutoff is None
        errors = instrument.bias, instrument.noise, instrument.resolution, instrument.faults
        self.limited = instrument.limit < math.inf
        self.exact = immediate and not any(errors) and not self.limited
        self._frames_taken = 0
        self._next = 0  # number of the next sample
        self._at_limit: Any = 0.0  # frames of each number, all and in a row
        self._in_a_row: Any = 0.0
        self._longest: Any = 0.0
        if cutoff is not None:
            self._forget, self._per_change = filter_of(cutoff, self._every * tick)

    @property
    def steps_alike(self) -> bool:
        """Whether all samples have the same operations, after the first ``late`` ones."""
        return self._every == 1 and not self._instrument.faults

    @property
    def late(self) -> int:
        """Delay of the readings, in samples."""
        return self._late

    def noise(self, samples: int, size: int) -> FloatArray:
        """Return the noise (samples, size) of the next frames; no columns without noise."""
        deviation = self._instrument.noise
        shape = samples, size if deviation else 0
        return np.asarray(self._generator.normal(0.0, deviation, shape))

    def numbers(self) -> dict[str, Any]:
        """Return the state between samples by name, if it does not change its size."""
        state = {"_last": self._last, "_rate": self._rate}
        for i, (_, *frame) in enumerate(self._frames):
            state |= {f"value {i}": frame[0], f"rate {i}": frame[1]}
        if self.limited:
            state |= {name: getattr(self, name) for name in ("_at_limit", "_in_a_row", "_longest")}
        return {name: value for name, value in state.items() if value is not None}

    def set_numbers(self, k: int, numbers: Mapping[str, Any], noise: Any = None) -> None:
        """Set the state before sample k, and the noise of its frame."""
        for name in numbers.keys() & vars(self).keys():
            setattr(self, name, numbers[name])
        frames = ((numbers[f"value {i}"], numbers.get(f"rate {i}")) for i in range(self._late))
        self._frames = deque((k + i, *frame) for i, frame in enumerate(frames))
        self._frames_taken += k - self._next
        self._next = k
        if noise is not None:
            self._generator = _Given(noise)

    def wants(self, k: int) -> bool:
        """Return whether sample k is a frame of the instrument."""
        return k % self._every == 0

    def take(self, k: int, value: FloatArray) -> None:
        """Take the frame at sample k."""
        self._next = k + 1
        acting = [one for one in self._instrument.faults if one.acts(k * self._tick)]
        if acting:
            value = faulty(value, acting, k * self._tick)
        read = self._read(value)
        for fault in acting:
            if fault.kind == "frozen" and self._frozen is not None:
                read[..., _channel(fault)] = self._frozen[..., _channel(fault)]
        self._frozen = read
        rate = self._difference(read)
        if self._known is None:
            self._known = read, rate
        self._frames.append((k + self._late, read, rate))

    def write_available(self, k: int, values: dict[str, FloatArray]) -> None:
        """Write copies of the readings that are available at sample k into ``values``."""
        while self._frames and self._frames[0][0] <= k:
            self._known = self._frames.popleft()[1:]
        assert self._known is not None
        for label, value in zip(self.labels, self._known, strict=False):
            assert value is not None
            values[label] = value.copy()

    def _read(self, value: FloatArray) -> FloatArray:
        it = self._instrument
        read = value + it.bias
        if it.noise > 0.0:
            read = read + self._generator.normal(0.0, it.noise, read.shape)
        if it.resolution > 0.0:
            read = it.resolution * np.round(read / it.resolution)
        if not self.limited:
            return read
        beyond = np.abs(read) >= it.limit
        self._frames_taken += 1
        self._at_limit = self._at_limit + beyond
        self._in_a_row = (self._in_a_row + 1.0) * beyond
        self._longest = np.maximum(self._longest, self._in_a_row)
        return np.clip(read, -it.limit, it.limit)

    def saturation(self) -> tuple[FloatArray, FloatArray]:
        """Return the share of the frames at the limit, and the longest time there (s).

        Of the number with the largest ones, () or (runs,).
        """
        share = np.atleast_1d(self._at_limit) / max(self._frames_taken, 1)
        longest = np.atleast_1d(self._longest) * (self._every * self._tick)
        return share.max(axis=-1), longest.max(axis=-1)

    def _difference(self, read: FloatArray) -> FloatArray | None:
        if self._instrument.rate_cutoff is None:
            return None
        if self._last is None or self._rate is None:
            self._rate = np.zeros_like(read)  # the first frame gives no difference
        else:
            self._rate = self._forget * self._rate + self._per_change * (read - self._last)
        self._last = read
        return self._rate


def faulty(value: FloatArray, faults: Sequence[InstrumentFault], t: float) -> FloatArray:
    """Return a value (k,) or (runs, k) with the faults that act at time t (s)."""
    found = value.copy()
    for fault in faults:
        at = _channel(fault)
        match fault.kind, fault.size:
            case "bias", float(size):
                found[..., at] += size
            case "drift", float(size):
                found[..., at] += size * (t - fault.start)
            case "gain", float(size):
                found[..., at] *= size
    return found


def _channel(fault: InstrumentFault) -> slice:
    """Return the columns of the readings that a fault changes."""
    if fault.channel is None:
        return slice(None)
    return slice(fault.channel - 1, fault.channel)
