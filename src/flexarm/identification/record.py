"""Measured records: a dataset over time, and the treatment of its channels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from flexarm.base.arguments import check_dataset, check_kind, check_mapping, check_posture
from flexarm.base.errors import InputError, Problem, nearest, public_call, shown
from flexarm.control.contract.base import Controller, Reference, check_controller, check_reference
from flexarm.identification.labels import MEASURED, Label, columns_of
from flexarm.integrate.base import FloatArray
from flexarm.model import Hardware
from flexarm.model.checks import checked_arguments
from flexarm.model.identification.records import RecordSettings
from flexarm.simulation.histories.piecewise import INTERPOLATIONS

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
            ``delays``, ``filters``, ``initial``, ``initial_angle``.
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
        if problems:
            raise InputError(*problems)

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
        known = "torque", "current", "voltage"
        return next((name for name in known if name in self.data), "none")

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


#: Settings that have no effect on a run with a controller.
_OF_OPEN_LOOPS = ("input", "prescribed", "initial", "initial_angle")
#: Channels of a prescribed joint, which agree by construction.
_FOLLOWED = ("joint_angle", "joint_rate")


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
    if problems:
        raise InputError(*problems)


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
