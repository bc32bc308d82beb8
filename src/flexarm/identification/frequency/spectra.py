"""Spectra of records: averages over segments, and the part of instruments in a response.

Bendat and Piersol, *Random Data*, 4th ed., 2010, chapters 6, 7 and 9; Pintelon and Schoukens,
*System Identification: A Frequency Domain Approach*, 2nd ed., 2012, chapters 2 and 3; for segments
that overlap Harris, Proceedings of the IEEE 66 (1978) 51.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.base.errors import AccuracyWarning, InputError, Problem, shown, warn_caller
from flexarm.identification.filtering import coefficients
from flexarm.identification.labels import Label
from flexarm.identification.record import MeasuredRecord
from flexarm.integrate.base import FloatArray

ComplexArray = NDArray[np.complex128]
#: Distance of a period from a whole number of samples, in samples.
_WHOLE = 1e-3
#: Change of inputs from period to period, as a fraction of their size, that noise may cause.
_REPEATED = 0.3
#: Correlation of neighbouring segments that overlap by half, with Hann's window.
_OVERLAP = 1.0 / 6.0
#: Segments of a record by default, without their overlap, and the fewest samples of one.
_SEGMENTS, _FEWEST = 8, 8


class Spectra(NamedTuple):
    """Averaged spectra of inputs and outputs, the inputs first.

    Attributes:
        frequency_hz: (F,).
        matrix: (F, n, n) averages of Z Z^H of the transforms Z (n,), squared SI units.
        averages: number of independent averages.
    """

    frequency_hz: FloatArray
    matrix: ComplexArray
    averages: float


def periodic_spectra(record: MeasuredRecord, period: float, start: float) -> Spectra:
    """Return the spectra of whole periods (s) of a record from a time (s) on.

    A linear drift from period to period, as of an arm that turns slowly, is removed.

    Raises:
        InputError: if a period is not a whole number of samples, or the record is too short.
    """
    from scipy.signal import csd

    rate, values = record.rate, _signals(record)
    size = round(period * rate)
    if size < _FEWEST or abs(period * rate - size) > _WHOLE:
        rule = f"be at least {_FEWEST} samples, and a whole number of them, at {rate:g} Hz"
        hint = "read_record(path, rate=...) resamples a record."
        raise InputError(Problem("period", rule, f"{period * rate:.6g}", hint))
    first = int(np.ceil(start * rate - _WHOLE))
    count = (values.shape[1] - first) // size
    if count < 1:
        rule = f"leave a whole period in the record of {record.duration:g} s"
        raise InputError(Problem("start", rule, f"{start:g}"))
    values = values[:, first : first + count * size]
    if count > 1:
        ends = values[:, -size:].mean(axis=1) - values[:, :size].mean(axis=1)
        slope = ends / ((count - 1) * size)
        values = values - slope[:, None] * np.arange(count * size)
        _warn_of_other_period(values[: len(record.inputs)], count, period)
    frequency, found = csd(
        values[:, None],
        values[None],
        fs=rate,
        window="boxcar",
        nperseg=size,
        noverlap=0,
        detrend=False,
        scaling="spectrum",
    )
    return Spectra(frequency, np.moveaxis(found, -1, 0).transpose(0, 2, 1), float(count))


def _warn_of_other_period(inputs: FloatArray, count: int, period: float) -> None:
    """Warn if inputs (inputs, samples) differ from one of ``count`` periods to the next.

    Warns:
        AccuracyWarning: if they differ by more than a noisy measurement of them.
    """
    parts = inputs.reshape(len(inputs), count, -1)
    middle = parts.mean(axis=(1, 2), keepdims=True)
    changed = np.linalg.norm(np.diff(parts, axis=1)) / np.sqrt(2.0 * (count - 1))
    size = np.linalg.norm(parts - middle) / np.sqrt(count)
    if changed > _REPEATED * size:
        text = f"the inputs do not repeat after the period of {period:g} s: they change by "
        text += f"{100.0 * changed / size:.0f} % of their size from one to the next. "
        warn_caller(text + "Give the period of the torque, or segment.", AccuracyWarning)


def segment_spectra(record: MeasuredRecord, segment: float | None, start: float) -> Spectra:
    """Return the spectra of segments (s) that overlap by half, with Hann's window (Welch).

    Raises:
        InputError: if a segment is longer than the record from ``start`` on, or too short.
    """
    from scipy.signal import csd

    rate = record.rate
    values = _signals(record)[:, int(np.ceil(start * rate - _WHOLE)) :]
    length = values.shape[1]
    if length < _FEWEST:
        rule = f"leave at least {_FEWEST} samples in the record of {record.duration:g} s"
        raise InputError(Problem("start", rule, f"{start:g}"))
    size = length // _SEGMENTS if segment is None else round(segment * rate)
    if not _FEWEST <= size <= length:
        rule = f"have {_FEWEST} to {length} samples"
        raise InputError(Problem("segment", rule, shown(size)))
    frequency, found = csd(
        values[:, None],
        values[None],
        fs=rate,
        window="hann",
        nperseg=size,
        noverlap=size // 2,
        detrend="linear",
        scaling="spectrum",
    )
    count = (length - size // 2) // (size - size // 2)
    averages = count / (1.0 + 2.0 * _OVERLAP**2 * (1.0 - 1.0 / count))
    return Spectra(frequency, np.moveaxis(found, -1, 0).transpose(0, 2, 1), averages)


def _signals(record: MeasuredRecord) -> FloatArray:
    """Return the inputs and outputs (n, samples) of a record.

    Raises:
        InputError: if samples are missing.
    """
    columns = {**record.inputs, **record.outputs}
    missing = [label.text for label, column in columns.items() if np.isnan(column).any()]
    if missing:
        hint = "read_record(path, start=..., end=...) reads the part between gaps."
        raise InputError(*(Problem(name, "has missing samples", hint=hint) for name in missing))
    return np.stack(list(columns.values()))


def instrument_response(record: MeasuredRecord, label: Label, hertz: FloatArray) -> ComplexArray:
    """Return the response (F,) of the path between a quantity and its samples in the record.

    That of an input is the response of its interpolation: a zero-order hold delays a sine by half
    a sample. Delays and filters with ``recorded`` are included. Other filters are not, because the
    samples have not passed through them.
    """
    from scipy.signal import freqz

    settings, rate = record.settings, record.rate
    found = np.exp(-2j * np.pi * hertz * settings.delays.get(label.channel, 0.0))
    if label in record.inputs:
        hold = np.sinc(hertz / rate)
        if record.interpolation == "hold":
            found = found * hold * np.exp(-1j * np.pi * hertz / rate)
        elif record.interpolation == "linear":
            found = found * hold**2
    for item in settings.filters.get(label.channel, ()):
        if not item.recorded or item.kind == "remove_mean":
            continue
        if item.kind == "gain":
            assert item.factor is not None
            found = found * item.factor
            continue
        found = found * freqz(*coefficients(item, rate), worN=hertz, fs=rate)[1]
    return np.asarray(found)
