"""Reading of measured records from tables: channel map, units, gaps and resampling."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.base.arguments import check_path
from flexarm.base.errors import (
    FlexarmWarning,
    InputError,
    Problem,
    nearest,
    public_call,
    raise_any,
    warn_caller,
)
from flexarm.control.contract.base import Controller, Reference
from flexarm.identification import record
from flexarm.identification.tables import Table, attributes_of, read_table
from flexarm.integrate.base import FloatArray
from flexarm.model import Hardware
from flexarm.model.checks import checked_arguments
from flexarm.model.identification import INPUTS, Column, RecordFile, RecordSettings
from flexarm.model.scenarios.scenario import MOST_SAMPLES

#: Interval, in typical ones, from which samples are missing, and from which those of an input are:
#: an input must not have gaps, and a late stamp moves it little.
_GAP, _GAP_OF_INPUT = 1.5, 3.5
#: Largest angle (two turns) and strain without a unit, their SI units, and other ones.
_LARGEST = {"angle": 4.0 * np.pi, "strain": 0.1}
_UNITS_OF = {"angle": ("rad", "deg"), "strain": ("1", "um/m")}
#: Step of an angle (rad) from sample to sample, besides whole turns, that no joint makes.
_TURN = 0.5 * np.pi
#: Rounding of times, in their intervals, that matters: a hundredth shifts a sample by as much.
_COARSE = 0.01
#: Names of the column of the time, in small letters and without the structures that contain it.
_TIMES = ("time", "t", "timestamp", "tout")
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
    masks: Mapping[str, Sequence[tuple[float, float]]] | None = None,
    encoding: str = "utf-8",
    skip: int = 0,
    controller: Controller | None = None,
    reference: Reference | None = None,
    hardware: Hardware | None = None,
    **settings: Any,
) -> record.MeasuredRecord:
    """Read a record of measurements from a .csv, .txt, .dat, .mat, .nc or .parquet file.

    Args:
        path: of the file. MAT files may have version 5 or 7.3; Parquet requires the extra
            ``identify``.
        channels: columns by channel: ``{"joint_angle_1": "encoder", "tip_x": {"column": "x",
            "unit": "mm", "gain": 1.02, "offset": 0.0}}``. A number after the name of a channel is
            that of the joint, link, gauge or sensor, from 1. Columns of arrays are ``name[0]`` and
            so on, fields of structures ``name.field``, those of a list of structures, such as the
            signals of a Simulink scope, ``name[0].field``; those of a text file without a header
            ``column[0]``. By default, all columns whose names are channels. A unit in brackets
            after the name of a column applies: positions and forces of sliding joints are
            columns of ``joint_angle`` and ``torque`` in m and N. ``{"column": "bridge", "file":
            "strain.csv", "shift": 0.2}`` is a column of another file in the same folder, with its
            own times, to which 0.2 s are added; the record has the times of ``path`` at which all
            files have samples.
        time: column of the time, by default "time", "t", "tout" or "timestamp", of numbers or of
            dates and times of ISO 8601; or ``sample_time``, s.
        time_unit: "s", "ms" or "us"; by default that in brackets after the name, or s.
        rate: Hz; samples between those of the file are interpolated linearly. A lower rate than
            that of the file is preceded by a low-pass filter without phase shift.
        start, end: part of the file to read, in its own time, s; wrong times outside do not matter.
        masks: parts to leave out by channel, in the same time: ``{"strain_1": [(1.2, 1.5)]}``.
        encoding, skip: of a text file: its encoding, and the number of lines before its header. By
            default UTF-16 and Latin-1 are recognised, and the header is the line of names before
            the first row of numbers. Lines that begin with # are comments. A line of units may
            follow the header.
        controller, reference, hardware, settings: as in ``MeasuredRecord``.

    Returns:
        A record that starts at time 0. Where the file has no samples for more than one and a half
        intervals, the samples of the record are NaN; those of an input are interpolated over up to
        three and a half intervals. Joint angles that jump by whole turns are unwrapped, unless
        their unit is one of length.

    Raises:
        InputError: if the file cannot be read, a column is missing, a unit does not fit, or the
            times do not increase, or angles or strains without a unit are too large for SI units;
            all problems are listed.

    Warns:
        FlexarmWarning: if a column contains text, an angle is unwrapped, or the times are rounded
            so coarsely that equal intervals replace them.
    """
    file = check_path("path", path)
    given: dict[str, Any] = {"time": time, "time_unit": time_unit, "sample_time": sample_time}
    given |= {"rate": rate, "start": start, "end": end, "channels": channels, "masks": masks}
    fields = {name: value for name, value in given.items() if value is not None} | settings
    fields |= {"file": file.name, "encoding": encoding, "skip": skip}
    description = checked_arguments(RecordFile, **fields)
    return record_of_file(description, file.parent, controller, reference, hardware)


class _Source(NamedTuple):
    """Content of a file."""

    table: Table
    names: dict[str, str]  # headers of the columns by name without unit
    times: FloatArray  # s
    stated: bool  # whether their unit is
    dated: bool  # whether they are from dates


class _Samples(NamedTuple):
    """Samples of a channel, and their times (s), each (samples,)."""

    times: FloatArray
    values: FloatArray


def record_of_file(
    description: RecordFile,
    folder: Path,
    controller: Controller | None = None,
    reference: Reference | None = None,
    hardware: Hardware | None = None,
) -> record.MeasuredRecord:
    """Read the record of a description, whose files are in a folder."""
    sources: dict[str, _Source] = {}
    origin: Any = None
    for name in (description.file, *(c.file for c in description.channels.values())):
        if name is None or name in sources:
            continue
        table = read_table(folder / name, description.encoding, description.skip)
        names = {record.split_unit(header)[0]: header for header in table}
        times, stated = _times(description, table, names)
        dated = times.dtype.kind == "M"
        if dated:  # all dates are counted from the first one
            origin = times[~np.isnat(times)][0] if origin is None else origin
            elapsed = (times - origin) / np.timedelta64(1, "s")
            times = np.where(np.isnat(times), np.nan, elapsed)
        sources[name] = _Source(table, names, times, stated, dated)
    _check_clocks(description, sources)
    samples, slides = _columns(description, sources)
    columns = {label: values for label, (_, values) in samples.items()}
    for text in unwrap(columns, slides):
        warn_caller(text, FlexarmWarning)
    samples = {label: _Samples(samples[label].times, c) for label, c in columns.items()}
    times, columns = _uniform(description, sources[description.file].times, samples)
    fields = {name: getattr(description, name) for name in RecordSettings.model_fields}
    chosen = RecordSettings(**fields)
    attributes = attributes_of(folder / description.file)
    data = record.dataset_of(times, columns, slides).assign_attrs(attributes)
    if not all(source.stated for source in sources.values()):
        data["time"].attrs["assumed"] = 1
    return record.MeasuredRecord(
        data, chosen, controller=controller, reference=reference, hardware=hardware
    )


#: Ratio of the spans of two files from which on their times have different units.
_OTHER_UNIT = 50.0


def _check_clocks(description: RecordFile, sources: Mapping[str, _Source]) -> None:
    """Raise unless the files of a record have one clock, apart from shifts."""
    if len(sources) == 1:
        return
    if description.sample_time is not None:
        hint = "Give each file a column of times."
        raise InputError(Problem("sample_time", "cannot be the times of several files", hint=hint))
    main = sources[description.file]
    for name, source in sources.items():
        shifted = all(c.shift for c in description.channels.values() if c.file == name)
        if source.dated != main.dated and not shifted:
            rule = f"{name!r} and {description.file!r} must both have dates, or neither"
            raise InputError(Problem("time", rule, hint="Give the shift of each column."))
        spans = [float(np.ptp(x.times[np.isfinite(x.times)])) for x in (source, main)]
        if max(spans) > _OTHER_UNIT * min(spans) and not (source.stated and main.stated):
            rule = f"{name!r} lasts {spans[0]:.4g} s and {description.file!r} {spans[1]:.4g} s"
            hint = "Write units into the names of the columns of times, such as t [ms]."
            raise InputError(Problem("time", rule, hint=hint))


def _columns(
    description: RecordFile, sources: Mapping[str, _Source]
) -> tuple[dict[record.Label, _Samples], set[record.Label]]:
    """Return the measured columns in SI units, and those with units of sliding joints.

    None of them is without numbers.
    """
    columns: dict[record.Label, _Samples] = {}
    slides: set[record.Label] = set()
    problems: list[Problem] = []
    main = sources[description.file]
    chosen = description.channels or {
        name: Column(column=name) for name in main.names if record.label_of(name)
    }
    if not chosen:
        hint = f"Columns: {', '.join(list(main.table)[:20])}."
        raise InputError(Problem("channels", "is required: no column is a channel", hint=hint))
    for text, column in chosen.items():
        place, source = f"channels.{text}", sources[column.file or description.file]
        try:
            label = record.check_label("channels", text)
            header = _header(place, column.column, source.table, source.names)
            unit = column.unit or record.split_unit(header)[1]
            si, *sliding = record.units_of(record.MEASURED[label.channel])
            factor, si = record.factor_of(place, unit, si, *sliding) if unit else (1.0, si)
            if si in sliding:
                slides.add(label)
            values = column.gain * source.table[header].astype(np.float64) + column.offset
            times = source.times + column.shift
            if values.size == times.size:
                for masked in _masks_of(description, label):
                    values[_within(times, masked, _interval(times))] = np.nan
            if not unit:
                _check_size(place, label, values)
        except InputError as error:
            problems += error.problems
            continue
        if not np.isfinite(values).any():
            problems.append(Problem(place, f"names the column {header!r}, which has no numbers"))
        if values.size != source.times.size:
            rule = f"have {source.times.size} samples as the time"
            problems.append(Problem(place, rule, str(values.size)))
        columns[label] = _Samples(times, factor * values)
    raise_any(problems)
    return columns, slides


def _check_size(place: str, label: record.Label, values: FloatArray) -> None:
    """Raise if values without a unit are too large for one of SI."""
    kind = "strain" if label.channel == "strain" else "angle" if "angle" in label.channel else ""
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    if kind and largest > _LARGEST[kind]:
        si, other = _UNITS_OF[kind]
        rule = f"has no unit, and its values reach {largest:.4g}, too large for {si!r}"
        slides = ", or 'm' of a sliding joint" if label.channel == "joint_angle" else ""
        hint = f"Give a unit, such as {other!r}, or {si!r}{slides}."
        raise InputError(Problem(place, rule, hint=hint))


def unwrap(
    columns: dict[record.Label, FloatArray], slides: Collection[record.Label] = ()
) -> list[str]:
    """Remove the jumps of a whole turn of joint angles, not of ``slides``; return notices."""
    notices = []
    for label, column in columns.items():
        good = np.isfinite(column)
        steps = np.abs(np.diff(column[good]))
        jumps = np.abs(steps - 2.0 * np.pi) < _TURN
        turns = label.channel == "joint_angle" and label not in slides
        if not turns or not jumps.any() or np.any(steps[~jumps] > _TURN):
            continue
        columns[label] = np.where(good, 0.0, np.nan)
        columns[label][good] = np.unwrap(column[good])
        count = int(jumps.sum())
        notices.append(f"{label.text} jumps by a whole turn {count} times; it is unwrapped.")
    return notices


def _header(place: str, name: str, table: Table, names: Mapping[str, str]) -> str:
    if name in table:
        return name
    if name in names:
        return names[name]
    hint = nearest(name, names) or f"Columns: {', '.join(list(table)[:20])}."
    raise InputError(Problem(place, f"names the column {name!r}, which is missing", hint=hint))


def _times(
    description: RecordFile, table: Table, names: Mapping[str, str]
) -> tuple[NDArray[Any], bool]:
    """Return the times (samples,) of a file, s or dates, and whether their unit is stated."""
    if description.sample_time is not None:
        length = max(column.size for column in table.values())
        return description.sample_time * np.arange(length, dtype=np.float64), True
    likely = [name for name in names if name.rpartition(".")[2].lower() in _TIMES]
    name = description.time or (likely[0] if likely else None)
    if name is None:
        hint = f"Columns: {', '.join(list(table)[:20])}."
        raise InputError(Problem("time", "or sample_time is required", hint=hint))
    header = _header("time", name, table, names)
    times = table[header]
    if times.dtype.kind == "M":
        return times, True
    unit = description.time_unit or record.split_unit(header)[1]
    return times * (record.factor_of("time", unit, "s")[0] if unit else 1.0), bool(unit)


def _increasing(times: FloatArray) -> FloatArray:
    """Return times without their rounding; InputError if they do not increase."""
    missing = np.flatnonzero(~np.isfinite(times))
    if missing.size:
        hint = "Omit lines before the header with skip, and lines of text after the samples."
        raise InputError(Problem("time", f"has no number in sample {missing[0] + 1}", hint=hint))
    # Equal intervals replace those that a file has rounded; the ends are rounded, too.
    samples = np.arange(times.size)
    interval = float(np.polyfit(samples, times - times[0], 1)[0]) if times.size > 1 else 0.0
    uniform = np.asarray(times.mean() + interval * (samples - samples.mean()))
    digit = _last_digit(times)
    error = float(np.abs(times - uniform).max())
    if 1e-6 * interval < error <= digit and digit > _COARSE * interval > 0.0:
        warn_caller(
            f"the times are rounded to {digit:g} s; equal intervals of {interval:.6g} s replace "
            "them. Give sample_time instead of a column of the time.",
            FlexarmWarning,
        )
        return uniform
    wrong = np.flatnonzero(~(np.diff(times) > 0.0))
    if wrong.size:
        k = int(wrong[0]) + 1
        rule = f"must increase from sample to sample, but sample {k + 1} is at {times[k]:.9g} s"
        hint = "Remove repeated samples, or split the file."
        if times[k] == times[k - 1] and digit > _COARSE * interval:
            hint = f"The times are rounded to {digit:g} s. Give sample_time instead, or split gaps."
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


def _part(description: RecordFile, times: FloatArray) -> slice:
    """Return the samples between start and end; stamps outside may be wrong."""
    first = -np.inf if description.start is None else description.start
    last = np.inf if description.end is None else description.end
    steps = np.abs(np.diff(times[np.isfinite(times)]))
    margin = 1e-3 * float(np.median(steps)) if steps.size else 0.0  # of rounded times
    # Without a start or an end, stamps that are no numbers are errors of the caller's part.
    outside = (times < first - margin) | (times > last + margin)
    outside |= np.isnan(times) & np.isfinite(last - first)
    edges = np.concatenate([[-1], np.flatnonzero(outside), [times.size]])
    longest = int(np.argmax(np.diff(edges)))
    return slice(int(edges[longest]) + 1, int(edges[longest + 1]))


def _uniform(
    description: RecordFile, clock: FloatArray, samples: Mapping[record.Label, _Samples]
) -> tuple[FloatArray, dict[record.Label, FloatArray]]:
    """Return uniform times from 0, at the rate of the clock, and the columns at them."""
    parts: dict[bytes, tuple[slice, FloatArray]] = {}  # of each file, by its times
    for stamps in (clock, *(times for times, _ in samples.values())):
        if stamps.tobytes() not in parts:
            inside = _part(description, stamps)
            enough = inside.stop - inside.start > 1
            increasing = _increasing(stamps[inside]) if enough else stamps[:0]
            if increasing.size < record.FEWEST:
                rule = f"has fewer than {record.FEWEST} samples between start and end"
                raise InputError(Problem("the record", rule))
            parts[stamps.tobytes()] = inside, increasing
    times = parts[clock.tobytes()][1]
    typical = _interval(times)
    # Other files may begin later and end sooner.
    begin = max(increasing[0] for _, increasing in parts.values())
    end = min(increasing[-1] for _, increasing in parts.values())
    begin = times[np.searchsorted(times, begin - 1e-6 * typical)] if begin <= end else end
    rate = description.rate or _rounded(1.0 / typical)
    count = (end - begin) * rate * (1 + 1e-9) + 1e-6 + 1.0
    if not record.FEWEST <= count <= MOST_SAMPLES:
        rule = f"have {record.FEWEST} to {MOST_SAMPLES:.0e} samples"
        hint = "Files of one record have times in common." if len(parts) > 1 else ""
        raise InputError(Problem("the record", rule, f"{count:.3g} at {rate:g} Hz", hint))
    grid = begin + np.arange(int(count)) / rate
    resampled = {}
    for label, (stamps, column) in samples.items():
        inside, times = parts[stamps.tobytes()]
        resampled[label] = _resampled(label, times, column[inside], grid, rate)
    for text, masks in description.masks.items():
        if not any(text in (label.channel, label.text) for label in resampled):
            rule = f"names a channel that is not read ({', '.join(x.text for x in resampled)})"
            raise InputError(Problem(f"masks: {text}", rule))
        for masked in masks:
            if not _within(grid, masked, typical).any():
                rule = f"be within the record, {grid[0]:.6g} to {grid[-1]:.6g} s"
                raise InputError(Problem(f"masks: {text}", rule, str(tuple(masked))))
    for label, masked in ((x, masked) for x in resampled for masked in _masks_of(description, x)):
        resampled[label][_within(grid, masked, typical)] = np.nan
    return grid - begin, resampled


def _masks_of(description: RecordFile, label: record.Label) -> list[Sequence[float]]:
    """Return the times (s) between which a channel is left out."""
    names = label.channel, label.text
    return [masked for name in names for masked in description.masks.get(name, ())]


def _within(times: FloatArray, masked: Sequence[float], typical: float) -> NDArray[np.bool_]:
    """Return which times are in a mask, whose ends belong to it in spite of rounding."""
    first, last = masked
    inside = (times >= first - 1e-6 * typical) & (times <= last + 1e-6 * typical)
    return np.asarray(inside)


def _interval(times: FloatArray) -> float:
    """Return the typical interval of increasing times, without their jitter and gaps."""
    steps = np.diff(times)
    counts = np.rint(steps / np.median(steps))
    return float((times[-1] - times[0]) / max(counts.sum(), 1.0))


def _resampled(
    label: record.Label, times: FloatArray, values: FloatArray, grid: FloatArray, rate: float
) -> FloatArray:
    """Return the samples of a channel at the times of a grid."""
    typical = _interval(times)
    if rate * typical < 1.0 / _GAP:
        # Content above 0.4 times the rate would be aliased.
        good = np.isfinite(values)
        uniform = np.linspace(times[0], times[-1], times.size)
        filled = np.interp(uniform, times[good], values[good])
        rate_of_record = (times.size - 1) / (times[-1] - times[0])
        smooth = record.without_phase(filled, _ANTI_ALIAS * rate, rate_of_record, 4)
        values = np.where(good, np.interp(times, uniform, smooth), np.nan)
    gap = _GAP_OF_INPUT if label.channel in INPUTS else _GAP
    return _interpolated(grid, times, values, typical, gap)


def _rounded(rate: float) -> float:
    """Return a rate without the rounding of the times in a file."""
    if not np.isfinite(rate):
        return rate
    nearest_whole = round(rate)
    return float(nearest_whole) if abs(rate - nearest_whole) < 1e-3 * rate else rate


def _interpolated(
    grid: FloatArray, times: FloatArray, values: FloatArray, typical: float, gap: float
) -> FloatArray:
    """Interpolate linearly between samples; NaN in gaps of more than ``gap`` intervals."""
    good = np.isfinite(values)
    known = times[good]
    if known.size < 2:
        return np.full(grid.size, np.nan)
    ends = known[0] - 1e-6 * typical, known[-1] + 1e-6 * typical
    result = np.interp(grid, known, values[good])
    result[(grid < ends[0]) | (grid > ends[1])] = np.nan
    after = np.clip(np.searchsorted(known, grid - 1e-9 * typical), 1, known.size - 1)
    wide = known[after] - known[after - 1] > gap * typical
    near = np.minimum(np.abs(grid - known[after]), np.abs(grid - known[after - 1]))
    result[wide & (near > 1e-6 * typical)] = np.nan
    return result
