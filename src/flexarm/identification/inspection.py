"""Faults of instruments that a record shows without a model: dead and stuck sensors, limits."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from flexarm.identification.reading import unwrap
from flexarm.identification.record import (
    MEASURED,
    Label,
    MeasuredRecord,
    columns_of,
    slides_of,
    with_columns,
)
from flexarm.integrate.base import FloatArray

#: Least length of a constant part, in samples and in typical lengths, and of one at a limit.
_CONSTANT, _LONGER, _LIMITED = 10, 20.0, 3
#: Least number of samples at a limit.
_SAMPLES = 5
#: Distance of a spike from its neighbours, in typical ones and as a fraction of the range.
_FAR, _PART = 20.0, 0.5
#: Change of a signal that moves the arm, as a fraction of its range.
_MOVES = 0.01


def inspected(name: str, record: MeasuredRecord) -> tuple[MeasuredRecord, list[str]]:
    """Return a record without samples that its instruments did not measure, and sentences."""
    columns = columns_of(record.data, [key for key in MEASURED if key in record.data])
    sentences = unwrap(columns, slides_of(record.data))
    changes = map(_begins, (record.inputs, record.outputs))
    start = next((first for first in changes if first is not None), 0)
    for label in record.outputs:
        columns[label], texts = _without_faults(label, columns[label], record.times, start)
        sentences += texts
    checked = with_columns(record, columns, record.settings)
    return checked, [f"{name}: {sentence}" for sentence in sentences]


def _begins(columns: Mapping[Label, FloatArray]) -> int | None:
    """Return the first sample at which a signal has changed; None if none changes."""
    parts = [c for c in columns.values() if np.isfinite(c).any()]
    moved = [np.abs(c - c[np.isfinite(c)][0]) > _MOVES * np.ptp(c[np.isfinite(c)]) for c in parts]
    acting = np.flatnonzero(np.any(moved, axis=0)) if moved else np.zeros(0, dtype=int)
    return int(acting[0]) if acting.size else None


def _without_faults(
    label: Label, values: FloatArray, times: FloatArray, start: int
) -> tuple[FloatArray, list[str]]:
    """Return the values (samples,) with NaN for faults, and sentences; motion begins at start."""
    text, good = label.text, np.isfinite(values)
    if np.ptp(values[good]) == 0.0:
        reason = "the sensor is dead or not connected, or nothing moves it"
        return np.full(values.size, np.nan), [f"{text} does not change: {reason}. It is left out."]
    sentences = []
    if not good.all():
        share = 100.0 * np.mean(~good)
        sentences.append(f"{text} lacks {np.sum(~good)} samples ({share:.2g} %).")
    bad = np.zeros(values.size, dtype=bool)
    # A joint may stick or rest at a stop, and a smooth motion is at its largest value only once.
    first, last = _constant_parts(values) if "joint" not in label.channel else _NONE
    length, typical = last - first, float(np.median(last - first)) if first.size else 1.0
    limits = np.isin(values[first], (values[good].max(), values[good].min()))
    limited = limits & (length >= _LIMITED * typical) & (typical < _LIMITED)
    long = last - np.maximum(first, start) >= max(_CONSTANT, _LONGER * typical)
    for k in np.flatnonzero(long & ~(limited & (first > 0))):
        bad[first[k] : last[k]] = True
        value = f"{values[first[k]]:.3g}" if values[first[k]] else "zero"
        since, end = times[first[k]] - times[0], times[min(last[k], times.size - 1)] - times[0]
        span = f"from {since:.3g} to {end:.3g} s" if first[k] else f"until {end:.3g} s"
        sentences.append(f"{text} reads {value} {span}: the sensor is not connected or hangs.")
    at_limit = np.zeros_like(bad)
    for k in np.flatnonzero(limited & (first > 0)):
        at_limit[first[k] : last[k]] = True
    if at_limit.sum() >= _SAMPLES:
        bad |= at_limit
        largest = np.abs(values[at_limit]).max()
        sentences.append(f"{text} is saturated at {largest:.3g} in {at_limit.sum()} samples.")
    spikes = _spikes(values)
    if spikes.any():
        bad |= spikes
        sentences.append(f"{text} has {spikes.sum()} spikes.")
    if bad.any():
        sentences[-1] += f" Samples of {text} that are left out: {bad.sum()}."
    return np.where(bad, np.nan, values), sentences


_NONE = np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)


def _constant_parts(values: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the first sample of each part with equal values, and the one after its last."""
    edges = np.flatnonzero(np.diff(values, prepend=np.nan) != 0.0)
    return edges, np.append(edges[1:], values.size)


def _spikes(values: FloatArray) -> NDArray[np.bool_]:
    """Return which samples (samples,) are far from the median of their neighbours."""
    from scipy.ndimage import median_filter

    good = np.isfinite(values)
    places = np.arange(values.size)
    filled = np.interp(places, places[good], values[good])
    away = np.abs(filled - median_filter(filled, 5, mode="nearest"))
    spikes = away > max(_FAR * 1.4826 * np.median(away), _PART * np.ptp(values[good]))
    return np.asarray(spikes & good)
