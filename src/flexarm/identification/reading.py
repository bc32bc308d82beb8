"""Reading of measured records: channel map, units, gaps and resampling."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from flexarm.base.arguments import check_path
from flexarm.base.errors import (
    FlexarmWarning,
    InputError,
    Problem,
    nearest,
    public_call,
    warn_caller,
)
from flexarm.control.contract.base import Controller, Reference
from flexarm.identification.filtering import without_phase
from flexarm.identification.labels import (
    MEASURED,
    Label,
    check_label,
    dataset_of,
    factor_of,
    label_of,
    split_unit,
)
from flexarm.identification.record import FEWEST, MeasuredRecord
from flexarm.identification.tables import Table, attributes_of, read_table
from flexarm.integrate.base import FloatArray
from flexarm.model import Hardware
from flexarm.model.checks import checked_arguments
from flexarm.model.identification.records import Column, RecordFile, RecordSettings
from flexarm.model.scenarios.scenario import MOST_SAMPLES

#: Interval, in typical ones, from which samples are missing.
_GAP = 1.5
#: Rounding of times, in their intervals, that matters: a hundredth shifts a sample by as much.
_COARSE = 0.01
#: Names of the column of the time.
_TIMES = ("time", "t", "Time", "TIME")
#: Cutoff of the filter before a record is reduced to a lower rate, as a fraction of that rate.
_ANTI_ALIAS = 0.4


@public_call
def read_record(
    path: str | PathLike[str],
    channels: Mapping[str, str | Column | Mapping[str, Any]] | None = None,
    *,
    time: str | None = None,
    time_unit: str | None = None,
    sample_time: float | None = None,
    rate: float | None = None,
    start: float | None = None,
    end: float | None = None,
    encoding: str = "utf-8",
    skip: int = 0,
    controller: Controller | None = None,
    reference: Reference | None = None,
    hardware: Hardware | None = None,
    **settings: Any,
) -> MeasuredRecord:
    """Read a record of measurements from a .csv, .mat, .nc or .parquet file.

    Args:
        path: of the file. MAT files may have version 5 or 7.3; Parquet requires the extra
            ``identify``.
        channels: columns by channel: ``{"joint_angle_1": "encoder", "tip_x": {"column": "x",
            "unit": "mm", "gain": 1.02, "offset": 0.0}}``. A number after the name of a channel is
            that of the joint, link or gauge, from 1. Columns of arrays are ``name[0]`` and so on,
            fields of structures ``name.field``. By default, all columns whose names are channels.
            A unit in brackets after the name of a column applies.
        time: column of the time, by default "time" or "t", of numbers or of dates and times of
            ISO 8601; or ``sample_time``, s.
        time_unit: "s", "ms" or "us"; by default that in brackets after the name, or s.
        rate: Hz; samples between those of the file are interpolated linearly. A lower rate than
            that of the file is preceded by a low-pass filter without phase shift.
        start, end: part of the file to read, in its own time, s.
        encoding, skip: of a .csv or .txt file: its encoding, and the number of lines before its
            header. Lines that begin with # are comments. A line of units may follow the header.
        controller, reference, hardware, settings: as in ``MeasuredRecord``.

    Returns:
        A record that starts at time 0. Where the file has no samples for more than one and a half
        intervals, the samples of the record are NaN.

    Raises:
        InputError: if the file cannot be read, a column is missing, a unit does not fit, or the
            times do not increase; all problems are listed.

    Warns:
        FlexarmWarning: if a column contains text, or the times are rounded so coarsely that equal
            intervals replace them.
    """
    file = check_path("path", path)
    given = {"time": time, "time_unit": time_unit, "sample_time": sample_time, "rate": rate}
    given |= {"start": start, "end": end}
    own = {name: value for name, value in given.items() if value is not None}
    fields: dict[str, Any] = {
        "file": file.name,
        "channels": {} if channels is None else channels,
        "encoding": encoding,
        "skip": skip,
        **own,
        **settings,
    }
    description = checked_arguments(RecordFile, **fields)
    return record_of_file(description, file, controller, reference, hardware)


def record_of_file(
    description: RecordFile,
    file: Path,
    controller: Controller | None = None,
    reference: Reference | None = None,
    hardware: Hardware | None = None,
) -> MeasuredRecord:
    """Read the record of a description from a file; the path in the description is not used.

    Raises:
        InputError: as ``read_record``.
    """
    table = read_table(file, description.encoding, description.skip)
    names = {split_unit(header)[0]: header for header in table}
    columns = _columns(description, table, names)
    times = _times(description, table, names)
    times, columns = _uniform(description, times, columns)
    fields = {name: getattr(description, name) for name in RecordSettings.model_fields}
    chosen = RecordSettings(**fields)
    data = dataset_of(times, columns).assign_attrs(attributes_of(file))
    return MeasuredRecord(
        data, chosen, controller=controller, reference=reference, hardware=hardware
    )


def _columns(
    description: RecordFile, table: Table, names: Mapping[str, str]
) -> dict[Label, FloatArray]:
    """Return the measured columns in SI units; none of them is without numbers."""
    columns: dict[Label, FloatArray] = {}
    problems: list[Problem] = []
    chosen = description.channels or {name: Column(column=name) for name in names if label_of(name)}
    if not chosen:
        hint = f"Columns: {', '.join(list(table)[:20])}."
        raise InputError(Problem("channels", "is required: no column is a channel", hint=hint))
    for text, column in chosen.items():
        place = f"channels.{text}"
        try:
            label = check_label("channels", text)
            header = _header(place, column.column, table, names)
            unit = column.unit or split_unit(header)[1]
            si = MEASURED[label.channel].unit
            factor = factor_of(place, unit, si) if unit else 1.0
        except InputError as error:
            problems += error.problems
            continue
        if not np.isfinite(table[header]).any():
            problems.append(Problem(place, f"names the column {header!r}, which has no numbers"))
        columns[label] = factor * (column.gain * table[header] + column.offset)
    if problems:
        raise InputError(*problems)
    return columns


def _header(place: str, name: str, table: Table, names: Mapping[str, str]) -> str:
    if name in table:
        return name
    if name in names:
        return names[name]
    hint = nearest(name, names) or f"Columns: {', '.join(list(table)[:20])}."
    raise InputError(Problem(place, f"names the column {name!r}, which is missing", hint=hint))


def _times(description: RecordFile, table: Table, names: Mapping[str, str]) -> FloatArray:
    """Return the times (samples,) of the file, s."""
    if description.sample_time is not None:
        length = max(column.size for column in table.values())
        return description.sample_time * np.arange(length, dtype=np.float64)
    name = description.time or next((name for name in _TIMES if name in names), None)
    if name is None:
        hint = f"Columns: {', '.join(list(table)[:20])}."
        raise InputError(Problem("time", "or sample_time is required", hint=hint))
    header = _header("time", name, table, names)
    unit = description.time_unit or split_unit(header)[1]
    times = table[header] * (factor_of("time", unit, "s") if unit else 1.0)
    missing = np.flatnonzero(~np.isfinite(times))
    if missing.size:
        hint = "Omit lines before the header with skip, and lines of text after the samples."
        raise InputError(Problem("time", f"has no number in sample {missing[0] + 1}", hint=hint))
    return _increasing(times)


def _increasing(times: FloatArray) -> FloatArray:
    """Return times that increase; equal intervals replace those that a file has rounded.

    Raises:
        InputError: if the times do not increase, even without their rounding.
    """
    uniform = np.linspace(times[0], times[-1], times.size)
    interval = (times[-1] - times[0]) / max(times.size - 1, 1)
    unit = _last_digit(times)
    error = float(np.abs(times - uniform).max())
    if 1e-6 * interval < error <= unit and unit > _COARSE * interval > 0.0:
        warn_caller(
            f"the times are rounded to {unit:g} s; equal intervals of {interval:.6g} s replace "
            "them. Give sample_time instead of a column of the time.",
            FlexarmWarning,
        )
        return uniform
    wrong = np.flatnonzero(~(np.diff(times) > 0.0))
    if wrong.size:
        k = int(wrong[0]) + 1
        rule = f"must increase from sample to sample, but sample {k + 1} is at {times[k]:.9g} s"
        hint = "Remove repeated samples, or split the file."
        if times[k] == times[k - 1] and unit > _COARSE * interval:
            hint = f"The times are rounded to {unit:g} s. Give sample_time instead, or split gaps."
        raise InputError(Problem("time", rule, hint=hint))
    return times


def _last_digit(times: FloatArray) -> float:
    """Return the decimal unit (s) of which all times are multiples; zero below a nanosecond."""
    for digits in range(10):
        counts = times * 10.0**digits
        # A decimal number of a file is within a few roundings of the product.
        if np.all(np.abs(counts - np.rint(counts)) <= 1e-9 + 4e-16 * np.abs(counts)):
            return float(10.0**-digits)
    return 0.0


def _uniform(
    description: RecordFile, times: FloatArray, columns: dict[Label, FloatArray]
) -> tuple[FloatArray, dict[Label, FloatArray]]:
    """Return uniform times from 0 and the columns at them.

    Raises:
        InputError: if a column has another length than the time, or too few samples remain.
    """
    for label, column in columns.items():
        if column.size != times.size:
            rule = f"have {times.size} samples as the time"
            raise InputError(Problem(f"channels.{label.text}", rule, str(column.size)))
    first = -np.inf if description.start is None else description.start
    last = np.inf if description.end is None else description.end
    margin = 1e-9 * float(np.ptp(times))  # of rounded times
    inside = (times >= first - margin) & (times <= last + margin)
    times = times[inside]
    if times.size < FEWEST:
        rule = f"has fewer than {FEWEST} samples between start and end"
        raise InputError(Problem("the record", rule))
    typical = float(np.median(np.diff(times)))
    rate = description.rate or _rounded(1.0 / typical)
    samples = (times[-1] - times[0]) * rate * (1 + 1e-9) + 1e-6 + 1.0
    if not FEWEST <= samples <= MOST_SAMPLES:
        rule = f"have {FEWEST} to {MOST_SAMPLES:.0e} samples"
        raise InputError(Problem("the record", rule, f"{samples:.3g} at {rate:g} Hz"))
    count = int(samples)
    grid = times[0] + np.arange(count) / rate
    found = {}
    for label, column in columns.items():
        values = column[inside]
        if rate * typical < 1.0 / _GAP:
            values = _without_fast(values, times, rate)
        found[label] = _interpolated(grid, times, values, typical)
    return grid - times[0], found


def _rounded(rate: float) -> float:
    """Return a rate without the rounding of the times in a file."""
    if not np.isfinite(rate):
        return rate
    nearest_whole = round(rate)
    return float(nearest_whole) if abs(rate - nearest_whole) < 1e-3 * rate else rate


def _without_fast(values: FloatArray, times: FloatArray, rate: float) -> FloatArray:
    """Return values without content above 0.4 times a rate (Hz), which would be aliased."""
    good = np.isfinite(values)
    uniform = np.linspace(times[0], times[-1], times.size)
    filled = np.interp(uniform, times[good], values[good])
    given = (times.size - 1) / (times[-1] - times[0])
    smooth = without_phase(filled, _ANTI_ALIAS * rate, given, 4)
    return np.where(good, np.interp(times, uniform, smooth), np.nan)


def _interpolated(
    grid: FloatArray, times: FloatArray, values: FloatArray, typical: float
) -> FloatArray:
    """Interpolate linearly between samples; NaN in gaps."""
    good = np.isfinite(values)
    known = times[good]
    if known.size < 2:
        return np.full(grid.size, np.nan)
    ends = known[0] - 1e-6 * typical, known[-1] + 1e-6 * typical
    result = np.interp(grid, known, values[good])
    result[(grid < ends[0]) | (grid > ends[1])] = np.nan
    after = np.clip(np.searchsorted(known, grid - 1e-9 * typical), 1, known.size - 1)
    wide = known[after] - known[after - 1] > _GAP * typical
    near = np.minimum(np.abs(grid - known[after]), np.abs(grid - known[after - 1]))
    result[wide & (near > 1e-6 * typical)] = np.nan
    return result
