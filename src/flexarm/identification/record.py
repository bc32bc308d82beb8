"""Measured records: a dataset over time, its channels, and the treatment of them.

Names of single channels are those in the header of a CSV file: ``joint_angle_1``, ``tip_x``. The
path from a quantity to its record is linear: delay, filters, gaps.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_dataset, check_kind, check_mapping, check_posture
from flexarm.base.errors import InputError, Problem, nearest, public_call, raise_any, shown
from flexarm.control.contract.base import Controller, Reference, check_controller, check_reference
from flexarm.integrate.base import FloatArray
from flexarm.model import Hardware
from flexarm.model.checks import checked_arguments
from flexarm.model.hardware import CHANNEL_SIGNALS
from flexarm.model.identification import INPUTS, UNITS, Filter, RecordSettings
from flexarm.simulation.histories.piecewise import INTERPOLATIONS
from flexarm.simulation.run.channels import CHANNELS, SLIDING, Channel, unit_of_part

#: Inputs of the motors, which simulated results do not contain.
CURRENT = Channel("current", ("joint",), "A", "current of the joint motors")
VOLTAGE = Channel("voltage", ("joint",), "V", "voltage of the joint motors")
#: Readings of inertial sensors and joint accelerations, which follow from a motion and its torques.
INERTIAL = {
    "joint_acceleration": Channel(
        "joint_acceleration", ("joint",), "rad/s^2", "its second derivative"
    ),
    "acceleration": Channel("acceleration", ("sensor",), "m/s^2", "reading of the accelerometer"),
    "angular_rate": Channel("angular_rate", ("sensor",), "rad/s", "reading of the gyroscope"),
}
#: Channels of records by name: those that instruments measure, without contacts, and these inputs.
MEASURED: dict[str, Channel] = {
    name: CHANNELS[name] for name in CHANNEL_SIGNALS if "contact" not in CHANNELS[name].dims
} | {**INERTIAL, "current": CURRENT, "voltage": VOLTAGE}
#: Signs in units, and what replaces them.
_SIGNS = str.maketrans(
    {"°": "deg", "·": " ", "⋅": " ", "*": " ", "µ": "u", "μ": "u", "ε": "strain", "²": "^2"}
)
_UNIT = re.compile(r"^(.*?)(\s*)[\[(]([^\])]*)[\])]$")


class Label(NamedTuple):
    """One number of a channel at a time."""

    channel: str  # name of the channel
    #: Number of the joint, link or gauge, counted from 1, or the axis "x" or "y"; empty for a
    #: channel of one number
    part: int | str

    @property
    def text(self) -> str:
        """Name in tables: ``joint_angle_1``."""
        return f"{self.channel}_{self.part}" if self.part != "" else self.channel


def label_of(text: str) -> Label | None:
    """Return the label of a name, or None if no channel has it."""
    if text in MEASURED:
        return None if MEASURED[text].dims else Label(text, "")
    stem, _, part = text.rpartition("_")
    channel = MEASURED.get(stem)
    if channel is None or not channel.dims:
        return None
    if channel.dims == ("axis",):
        return Label(stem, part) if part in ("x", "y") else None
    return Label(stem, int(part)) if part.isdigit() and int(part) > 0 else None


def check_label(name: str, text: str) -> Label:
    """Return the label of a name; InputError if no channel has it."""
    label = label_of(text)
    if label is None:
        channel = MEASURED.get(text)
        example = "_x" if channel and channel.dims == ("axis",) else "_1"
        hint = f"Add its number or axis: {text}{example}." if channel else nearest(text, MEASURED)
        rule = "be the name of a measured channel, such as joint_angle_1, strain_2 or tip_x"
        raise InputError(Problem(name, rule, shown(text), hint))
    return label


def split_unit(header: str) -> tuple[str, str]:
    """Return name and unit of the header of a column: ``angle [deg]``, ``angle (deg)``."""
    match = _UNIT.match(header)
    # A number in brackets without a space before them is the index of a column of an array.
    if match is None or (match[3].isdigit() and not match[2]):
        return header, ""
    return match[1], match[3]


def is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def is_unit(text: str) -> bool:
    return any(text.translate(_SIGNS) in known for known in UNITS.values())


def factor_of(name: str, unit: str, *units: str) -> tuple[float, str]:
    """Return the factor from a unit to one of SI ``units``, and that one.

    InputError if it is not the unit of such a number.
    """
    unit = unit.translate(_SIGNS)
    for si in units:
        if unit in UNITS[si]:
            return UNITS[si][unit], si
    known = ", ".join(text for si in units for text in UNITS[si])
    raise InputError(Problem(name, f"be a unit of its channel ({known})", shown(unit)))


def units_of(channel: Channel) -> tuple[str, ...]:
    """Return the SI unit of a channel, and that of joints that slide if it differs."""
    if channel.dims != ("joint",) or channel.unit not in SLIDING:
        return (channel.unit,)
    return channel.unit, SLIDING[channel.unit]


def dataset_of(
    times: np.ndarray, columns: dict[Label, np.ndarray], slides: Collection[Label] = ()
) -> xr.Dataset:
    """Return a record as a dataset over ``time``; parts that were not measured are missing.

    Columns of ``slides`` have the units of sliding joints.
    """
    variables = {}
    coordinates: dict[str, object] = {"time": ("time", times, {"units": "s", "long_name": "time"})}
    for name in dict.fromkeys(label.channel for label in columns):
        channel = MEASURED[name]
        own = sorted((label for label in columns if label.channel == name), key=str)
        own.sort(key=lambda label: label.part)
        values = np.stack([columns[label] for label in own], axis=1)
        units, sliding = units_of(channel), [label.part for label in own if label in slides]
        if len(sliding) in (0, len(own)):
            units = units[-1:] if sliding else units[:1]
        attributes = {"units": " or ".join(units), "long_name": channel.meaning}
        if len(units) > 1:
            attributes["slides"] = " ".join(map(str, sliding))
        if not channel.dims:
            variables[name] = xr.DataArray(values[:, 0], dims="time", attrs=attributes)
            continue
        dimension = channel.dims[0]
        parts = {dimension: [label.part for label in own]}
        dims = ("time", dimension)
        variables[name] = xr.DataArray(values, dims=dims, coords=parts, attrs=attributes)
    return xr.Dataset(variables).assign_coords(coordinates)


def columns_of(
    data: xr.Dataset, names: Collection[str], empty: bool = False
) -> dict[Label, np.ndarray]:
    """Return the columns (samples,) of channels of a record or of a result.

    Columns without a sample are left out, but not with ``empty``.
    """
    columns: dict[Label, np.ndarray] = {}
    for name in names:
        values = np.asarray(data[name].values, dtype=np.float64)
        if values.ndim == 1:
            columns[Label(name, "")] = values
            continue
        parts = data[name][MEASURED[name].dims[0]].values
        if MEASURED[name].dims == ("gauge",) and parts.dtype.kind not in "iu":
            parts = np.arange(1, len(parts) + 1)  # results name gauges by their places
        columns |= {
            Label(name, part): column for part, column in zip(parts.tolist(), values.T, strict=True)
        }
    return {label: c for label, c in columns.items() if empty or not np.all(np.isnan(c))}


def slides_of(data: xr.Dataset) -> set[Label]:
    """Return the columns of a record, or of a result, that have the units of sliding joints."""
    slides = set()
    for name in MEASURED.keys() & set(map(str, data)):
        _, *sliding = units_of(MEASURED[name])
        if sliding:
            parts = data[name]["joint"].values.tolist()
            attributes = data[name].attrs
            slides |= {Label(name, k) for k in parts if unit_of_part(attributes, k) in sliding}
    return slides


def place_of(arm: Arm, label: Label) -> int:
    """Return the index of a label in the last axis of its channel; InputError if there is none."""
    dims = MEASURED[label.channel].dims
    if not dims:
        return 0
    if dims == ("axis",):
        return ["x", "y"].index(str(label.part))
    if dims == ("sensor",):
        return int(label.part) - 1
    known = {
        "joint": arm.joint_numbers.tolist(),
        "link": list(range(1, arm.n_links + 1)),
        "gauge": list(range(1, len(arm.gauges) + 1)),
    }[dims[0]]
    if label.part not in known:
        numbers = ", ".join(map(str, known)) or "there are none"
        rule = f"names a {dims[0]} that the arm does not have ({numbers})"
        raise InputError(Problem(label.text, rule))
    return int(known.index(label.part))


class Path:
    """Treatment of one channel of a record, the same for measured and simulated values.

    Delay and filters with ``recorded`` act on simulated values only, because the record contains
    them. Then gaps of the record (not ``valid``) are filled by straight lines in both, so that the
    remaining filters have the same effect on both.
    """

    def __init__(
        self, times: FloatArray, valid: NDArray[np.bool_], delay: float, filters: Sequence[Filter]
    ) -> None:
        self._times, self._valid, self._delay = times, valid, delay
        self._rate = (times.size - 1) / (times[-1] - times[0])
        self._recorded = [item for item in filters if item.recorded]
        self._applied = [item for item in filters if not item.recorded]

    def measured(self, values: FloatArray) -> FloatArray:
        """Return the values (samples,) of a record after the filters that it does not contain."""
        return self._after(values[:, None])[:, 0]

    def simulated(self, values: FloatArray, late: float = 0.0) -> FloatArray:
        """Return simulated values (samples, runs) as the record would contain them.

        ``late`` is a delay (s) in addition to that of the record.
        """
        return self._after(self._through(self._late(values, late), self._recorded))

    def _late(self, values: FloatArray, late: float) -> FloatArray:
        delay = self._delay + late
        if delay == 0.0:
            return values
        from scipy.interpolate import CubicSpline

        before = np.maximum(self._times - delay, self._times[0])
        return np.asarray(CubicSpline(self._times, values)(before))

    def _after(self, values: FloatArray) -> FloatArray:
        if not self._applied:
            return values
        if not self._valid.all():
            from scipy.interpolate import make_interp_spline

            known = self._times[self._valid]
            line = make_interp_spline(known, values[self._valid], k=1)
            values = np.asarray(line(np.clip(self._times, known[0], known[-1])))
        return self._through(values, self._applied)

    def _through(self, values: FloatArray, filters: Sequence[Filter]) -> FloatArray:
        for item in filters:
            values = _filtered(item, values, self._rate)
        return values


def _filtered(item: Filter, values: FloatArray, rate: float) -> FloatArray:
    if item.kind == "gain":
        assert item.factor is not None
        return item.factor * values
    if item.kind == "remove_mean":
        return np.asarray(values - values.mean(axis=0))
    from scipy.signal import lfilter, lfilter_zi

    numerator, denominator = coefficients(item, rate)
    start = lfilter_zi(numerator, denominator)[:, None] * values[0]
    return np.asarray(lfilter(numerator, denominator, values, axis=0, zi=start)[0])


def without_phase(values: FloatArray, cutoff: float, rate: float, order: int) -> FloatArray:
    """Filter values (samples,) by Butterworth's low-pass of ``order`` forwards and backwards."""
    from scipy.signal import butter, sosfiltfilt

    sections = butter(order, cutoff, fs=rate, output="sos")
    return np.asarray(sosfiltfilt(sections, values, padlen=min(15, values.size - 1)))


def coefficients(item: Filter, rate: float) -> tuple[FloatArray, FloatArray]:
    """Return numerator and denominator of a low-pass or high-pass filter sampled at a rate (Hz)."""
    from scipy.signal import bilinear

    assert item.cutoff is not None
    w = 2.0 * np.pi * item.cutoff
    if item.order == 1:
        denominator = [1.0 / w, 1.0]
        numerator = [1.0] if item.kind == "low_pass" else [1.0 / w, 0.0]
    else:
        denominator = [1.0 / w**2, 2.0 * item.damping / w, 1.0]
        numerator = [1.0] if item.kind == "low_pass" else [1.0 / w**2, 0.0, 0.0]
    sampled: tuple[FloatArray, FloatArray] = bilinear(numerator, denominator, rate)
    return sampled


#: Fewest samples of a record.
FEWEST = 4
#: Largest deviation of an interval from the mean one in a uniform record, as a fraction of it.
_UNEVEN = 1e-3
_MISSING = "is required, because the record contains no torque, current or voltage"


@dataclass(frozen=True, eq=False)
class MeasuredRecord:
    """A record of measurements, and how the arm is simulated to be compared with it.

    Args:
        data: dataset over a uniform ``time`` (s) with channels of results, such as
            ``joint_angle`` (time, joint), in SI units; NaN where samples are missing. A result of
            ``simulate`` is accepted. The channel ``current`` (time, joint), A, is an input only.
        settings: a ``RecordSettings``, or keyword arguments with its fields: ``input``,
            ``interpolation``, ``prescribed``, ``prescribed_cutoff``, ``outputs``, ``noise``,
            ``delays``, ``filters``, ``sensors``, ``initial``, ``initial_angle``.
        controller: drives the joints along ``reference`` instead of an input of the record.
        reference: motion for the controller.
        hardware: instruments and motors between controller and arm.

    Raises:
        InputError: if the time is not uniform, a channel is unknown or missing, or an input has
            gaps; all problems are listed.
    """

    data: xr.Dataset
    settings: RecordSettings = field(default_factory=RecordSettings)
    controller: Controller | None = None
    reference: Reference | None = None
    hardware: Hardware | None = None

    @public_call
    def __init__(
        self,
        data: xr.Dataset,
        settings: RecordSettings | None = None,
        *,
        controller: Controller | None = None,
        reference: Reference | None = None,
        hardware: Hardware | None = None,
        **fields: Any,
    ) -> None:
        check_dataset("data", data, ("time",), "a dataset with a channel over time")
        if settings is None:
            settings = checked_arguments(RecordSettings, **fields)
        elif fields:
            raise InputError(Problem("settings", f"cannot be combined with {next(iter(fields))}"))
        check_kind("settings", settings, RecordSettings)
        if controller is not None:
            check_controller("controller", controller)
        if reference is not None:
            check_reference(reference)
        values = (data, settings, controller, reference, hardware)
        for name, value in zip(self.__dataclass_fields__, values, strict=True):
            object.__setattr__(self, name, value)
        if settings.initial_angle is not None:
            check_posture("initial_angle", settings.initial_angle, len(settings.initial_angle))
        problems = [*_time_problems(self.times), *self._problems()]
        raise_any(problems)

    @property
    def times(self) -> FloatArray:
        """Times (samples,) of the samples, s."""
        return np.asarray(self.data["time"].values, dtype=np.float64)

    @property
    def rate(self) -> float:
        """Samples per second, Hz."""
        times = self.times
        return float((times.size - 1) / (times[-1] - times[0]))

    @property
    def duration(self) -> float:
        """Time from the first to the last sample, s."""
        return float(self.times[-1] - self.times[0])

    @property
    def input(self) -> str:
        """Channel that drives the joints: "torque", "current", "voltage" or "none"."""
        if self.controller is not None:
            return "none"
        if self.settings.input is not None:
            return self.settings.input
        return next((name for name in INPUTS if name in self.data), "none")

    @property
    def driven(self) -> bool:
        """Whether an input, a controller or prescribed joints move the arm."""
        controlled = self.controller is not None or bool(self.settings.prescribed)
        return controlled or self.input != "none"

    @property
    def interpolation(self) -> str:
        """Interpolation of the input between its samples: "cubic", "linear" or "hold"."""
        if self.settings.interpolation is not None:
            return self.settings.interpolation
        given = self.data.attrs.get("torque_interpolation")
        if isinstance(given, str) and given in INTERPOLATIONS:
            return given
        return "hold" if "controller" in self.data.attrs else "cubic"

    @property
    def coarse(self) -> str:
        """Why the samples of the input do not contain its steps; empty if they do."""
        step = self.data.attrs.get("sample_time")
        if self.input == "none" or self.interpolation != "hold" or not isinstance(step, float):
            return ""
        if self.rate * step > 1.0 - _UNEVEN:
            return ""
        return (
            f"the rate of {self.rate:g} Hz is lower than that of its controller, {1.0 / step:g} Hz,"
            " so that the record does not contain every step of the torque."
        )

    @property
    def inputs(self) -> dict[Label, FloatArray]:
        """Columns (samples,) of the input."""
        return {} if self.input == "none" else columns_of(self.data, [self.input])

    @property
    def outputs(self) -> dict[Label, FloatArray]:
        """Columns (samples,) that are compared, with NaN where samples are missing."""
        chosen = self.settings.outputs
        if chosen is None:
            known = [name for name in MEASURED if name in self.data]
            chosen = [name for name in known if name not in (self.input, "current", "voltage")]
        columns = columns_of(self.data, chosen)
        followed = {Label(name, j) for name in _FOLLOWED for j in self.settings.prescribed}
        return {label: column for label, column in columns.items() if label not in followed}

    def _problems(self) -> list[Problem]:
        settings, present = self.settings, [name for name in MEASURED if name in self.data]
        problems = []
        for name in _OF_OPEN_LOOPS if self.controller is not None else ():
            if getattr(settings, name) != RecordSettings.model_fields[name].default:
                rule = "is not supported with a controller"
                hint = "It starts at rest at the start of its reference, and drives all joints."
                problems.append(Problem(name, rule, hint=hint))
        named = {
            "outputs": settings.outputs or (),
            **{name: getattr(settings, name) for name in ("noise", "delays", "filters")},
        }
        for argument, names in named.items():
            for name in names:
                if name not in present:
                    rule = f"names a channel that is not in the record ({', '.join(present)})"
                    hint = nearest(name, present)
                    problems.append(Problem(f"{argument}: {name}", rule, hint=hint))
        inertial = {name: columns_of(self.data, [name]) for name in INERTIAL if name in present}
        if inertial and self.controller is not None:
            rule = "is not supported with a controller"
            hint = "Give the torque of the record as the input."
            problems.append(Problem(next(iter(inertial)), rule, hint=hint))
        for label in (item for columns in inertial.values() for item in columns):
            if MEASURED[label.channel].dims == ("sensor",) and int(label.part) > len(
                settings.sensors
            ):
                rule = f"is {label.text}, but the record has {len(settings.sensors)} sensors"
                hint = "For example sensors=[fa.InertialSensor(link=1)]."
                problems.append(Problem("data", rule, hint=hint))
        if self.input != "none" and self.input not in self.data:
            problems.append(Problem("input", f"is {self.input}, which is not in the record"))
            return problems
        if not problems and not self.outputs:
            rule = "has no channel to compare besides the input"
            problems.append(Problem("data", rule, hint=f"Channels: {', '.join(present) or '-'}."))
        needed = {label.text: column for label, column in self.inputs.items()}
        angles = columns_of(self.data, ["joint_angle"]) if "joint_angle" in self.data else {}
        for joint in settings.prescribed:
            label = Label("joint_angle", joint)
            if label not in angles:
                rule = f"names joint {joint}, whose angle is not in the record"
                problems.append(Problem("prescribed", rule))
                continue
            needed[label.text] = angles[label]
        return problems + [
            gap for name, column in needed.items() for gap in _gap_problems(name, column, self)
        ]


def with_columns(
    record: MeasuredRecord, columns: Mapping[Label, FloatArray], settings: RecordSettings
) -> MeasuredRecord:
    """Return a record with other values of its columns (samples,), and other settings."""
    every = columns_of(record.data, [name for name in MEASURED if name in record.data], empty=True)
    slides = slides_of(record.data)
    data = dataset_of(record.data["time"].values, every | dict(columns), slides)
    data = data.assign_attrs(record.data.attrs)
    data["time"].attrs |= record.data["time"].attrs
    return replace(record, data=data, settings=settings)


def treated(
    record: MeasuredRecord, input_delay: bool = False
) -> tuple[list[Path], FloatArray, NDArray[np.bool_]]:
    """Return paths of the outputs, their values (samples, outputs) after them, and validity.

    With ``input_delay``, the delay of the input is that of the outputs.
    """
    outputs, settings = record.outputs, record.settings
    columns = np.stack(list(outputs.values()), axis=1)
    valid, times = np.isfinite(columns), record.times - record.times[0]
    more = settings.delays.get(record.input, 0.0) if input_delay else 0.0
    paths = [
        Path(
            times,
            valid[:, k],
            settings.delays.get(label.channel, 0.0) + more,
            settings.filters.get(label.channel, ()),
        )
        for k, label in enumerate(outputs)
    ]
    filled = np.where(valid, columns, 0.0)
    measured = [path.measured(filled[:, k]) for k, path in enumerate(paths)]
    return paths, np.stack(measured, axis=1), valid


#: Settings that have no effect on a run with a controller.
_OF_OPEN_LOOPS = ("input", "prescribed", "initial", "initial_angle")
#: Channels of a prescribed joint, which agree by construction.
_FOLLOWED = ("joint_angle", "joint_rate", "joint_acceleration")


Records = (
    MeasuredRecord
    | xr.Dataset
    | Sequence[MeasuredRecord | xr.Dataset]
    | Mapping[str, MeasuredRecord | xr.Dataset]
)


def check_records(name: str, given: Any) -> dict[str, MeasuredRecord]:
    """Return records by name, from a record, a dataset over time, or a list or dictionary."""
    if isinstance(given, MeasuredRecord | xr.Dataset):
        given = [given]
    if isinstance(given, list | tuple):
        word = "record" if name == "records" else name
        given = {f"{word} {k}": item for k, item in enumerate(given, start=1)}
    check_mapping(name, given, "records by name, a list of them, or a record")
    records = {}
    for key, item in given.items():
        if isinstance(item, xr.Dataset):
            item = MeasuredRecord(item)
        what = "a MeasuredRecord, or a dataset over time"
        records[str(key)] = check_kind(f"{name}[{key!r}]", item, MeasuredRecord, what)
    return records


def check_some_records(given: Any) -> dict[str, MeasuredRecord]:
    """Return the argument ``records``, which must not be empty."""
    records = check_records("records", given)
    if not records:
        raise InputError(Problem("records", "must not be empty"))
    return records


def check_inputs(records: Mapping[str, MeasuredRecord]) -> None:
    """Raise if nothing drives the joints of a record that does not state this."""
    problems = [
        Problem("input", _MISSING, hint='Give "none" if nothing drives the joints.', where=name)
        for name, record in records.items()
        if not record.driven and record.settings.input is None
    ]
    raise_any(problems)


def _time_problems(times: FloatArray) -> list[Problem]:
    if times.ndim != 1 or times.size < FEWEST or not np.all(np.isfinite(times)):
        return [Problem("time", f"have at least {FEWEST} finite samples", shown(times.size))]
    steps = np.diff(times)
    mean = (times[-1] - times[0]) / (times.size - 1)
    worst = int(np.argmax(np.abs(steps - mean)))
    if not abs(steps[worst] - mean) <= _UNEVEN * mean:
        rule = f"be uniform, with intervals of {mean:.6g} s"
        hint = "read_record(path, rate=...) resamples a record."
        text = f"{steps[worst]:.6g} s at t = {times[worst]:.6g} s"
        return [Problem("time", rule, text, hint)]
    return []


def _gap_problems(name: str, column: FloatArray, record: MeasuredRecord) -> list[Problem]:
    missing = np.flatnonzero(np.isnan(column))
    if not missing.size:
        return []
    first = record.times[missing[0]]
    rule = f"is an input and has {missing.size} missing samples, the first at t = {first:.6g} s"
    hint = "Split the record there: read_record(path, start=..., end=..., initial='estimate')."
    return [Problem(name, rule, hint=hint)]
