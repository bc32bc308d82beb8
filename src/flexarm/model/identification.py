"""Description of an identification: measured records, free parameters, and the whole study."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from flexarm.base.errors import shown
from flexarm.base.writing.places import AnyPath
from flexarm.model.arm.spec import ArmSpec
from flexarm.model.checks import Given, Record
from flexarm.model.file_format.files import _located
from flexarm.model.file_format.yaml_text import Document
from flexarm.model.hardware import InertialSensor, Motors, Seed
from flexarm.model.quantities import (
    Count,
    Flag,
    Listed,
    Mapped,
    Named,
    NonNegative,
    Number,
    OneOrMany,
    Pair,
    Positive,
    Word,
    plain,
)
from flexarm.model.wording import Fault, Path


def _by_key(key: str) -> Callable[[Any], Any]:
    """Return a function that converts text to the mapping of the key for which it stands."""
    return lambda value: {key: value} if isinstance(value, str) else value


class FreeParameter(Record, kw_only=False):
    """A number of an arm or of its motors that is estimated from measured records.

    ``prior`` and ``prior_deviation`` describe what is known before the measurement, as a normal
    distribution; they count as one more measurement.
    """

    path: Word
    """Path of the number, such as links[0].flexural_rigidity or payload.mass; or of an error of the
    records: offsets.strain_1, gains.torque_1, delays.strain_1, delays.torque. What they contain is
    gain * truth(t - delay) + offset, besides the delays of their settings. Inputs act later than in
    the record by their delay, and earlier if it is negative."""
    lower: Number | None = None
    """Lower bound; by default 0 if the number cannot be negative."""
    upper: Number | None = None
    """Upper bound; none by default."""
    prior: Number | None = None
    """Expected value; by default that of the arm."""
    prior_deviation: Positive | None = None
    """Standard deviation of the expected value; no prior by default."""
    per_record: Flag = False
    """Whether each record has its own value; shared by default."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("lower", "upper") and given.upper <= given.lower:
            yield Fault(("upper",), f"be greater than lower ({given.lower:g})", shown(given.upper))
        if not given.absent("prior") and given.absent("prior_deviation"):
            yield Fault(("prior_deviation",), "is required with prior")


Order = Annotated[int, Field(strict=True, ge=1, le=2)]


class Filter(Record, kw_only=False):
    """One filter of a measured channel; the simulated channel passes through the same filter.

    Filters of first order are ``1 / (1 + s / w)`` and ``(s / w) / (1 + s / w)``, those of second
    order ``w^2 / (s^2 + 2 d w s + w^2)`` and ``s^2 / (s^2 + 2 d w s + w^2)``, with ``w = 2 pi
    cutoff`` and ``d = damping``. They are discretised by Tustin's rule and start in the steady
    state of the first sample.
    """

    kind: Literal["low_pass", "high_pass", "remove_mean", "gain"]
    """low_pass, high_pass, remove_mean or gain."""
    cutoff: Positive | None = None
    """Cutoff frequency of low_pass and high_pass (Hz)."""
    order: Order = 1
    """Order of low_pass and high_pass, 1 or 2."""
    damping: Positive = 0.7071067811865476
    """Damping ratio of a filter of second order."""
    factor: Number | None = None
    """Factor of gain."""
    recorded: Flag = False
    """Whether the record contains the effect of the filter already, so that only the simulated
    channel is filtered."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if not given.has("kind"):
            return
        passes = given.kind in ("low_pass", "high_pass")
        if passes and given.absent("cutoff"):
            yield Fault(("cutoff",), f"is required for {given.kind}")
        if given.kind == "gain" and given.absent("factor"):
            yield Fault(("factor",), "is required for gain")
        for name, fits in (("cutoff", passes), ("factor", given.kind == "gain")):
            if not fits and not given.absent(name):
                yield Fault((name,), f"is not supported for {given.kind}", shown(given.raw(name)))


#: Channels that drive the joints.
INPUTS = ("torque", "current", "voltage")
#: Factors to SI units, by the SI unit of the channel.
UNITS: dict[str, dict[str, float]] = {
    "rad": {"rad": 1.0, "mrad": 1e-3, "deg": 0.017453292519943295, "rev": 6.283185307179586},
    "rad/s": {
        "rad/s": 1.0,
        "deg/s": 0.017453292519943295,
        "rpm": 0.10471975511965977,
        "rev/s": 6.283185307179586,
    },
    "rad/s^2": {"rad/s^2": 1.0, "deg/s^2": 0.017453292519943295},
    "m/s^2": {"m/s^2": 1.0, "mm/s^2": 1e-3, "g": 9.80665, "mg": 9.80665e-3},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "m/s": {"m/s": 1.0, "mm/s": 1e-3},
    "N m": {"N m": 1.0, "Nm": 1.0, "N.m": 1.0, "mN m": 1e-3, "mNm": 1e-3},
    "N": {"N": 1.0, "mN": 1e-3, "kN": 1e3},
    "A": {"A": 1.0, "mA": 1e-3},
    "V": {"V": 1.0, "mV": 1e-3},
    "1": {"1": 1.0, "m/m": 1.0, "mm/m": 1e-3, "%": 1e-2, "um/m": 1e-6, "ustrain": 1e-6},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
}


class Column(Record, kw_only=False):
    """A column of a file of measurements; its values become ``gain * value + offset``."""

    column: Word
    """Name of the column."""
    unit: Word | None = None
    """Unit of the values; by default that in brackets after the name, or SI."""
    gain: Number = 1.0
    """Factor, applied before the unit."""
    offset: Number = 0.0
    """Constant added after the factor."""
    file: Word | None = None
    """Another file that contains the column, with its own times; relative as that of the record."""
    shift: Number = 0.0
    """Time that is added to those of the column (s): the clocks of two files may differ."""


#: A list of filters, or a single one.
Filters = Annotated[
    Listed[Filter],
    BeforeValidator(lambda value: [value] if isinstance(value, dict | Filter) else value),
]


class RecordSettings(Record):
    """Treatment of a measured record: its inputs, outputs, delays, filters and initial state."""

    input: Literal["torque", "current", "voltage", "none"] | None = None
    """Channel that drives the joints; by default torque, current or voltage, the first that the
    record contains. If nothing drives them, give none."""
    interpolation: Literal["cubic", "linear", "hold"] | None = None
    """Interpolation of the input between its samples; by default that of the run for a result of
    simulate (hold in a closed loop), and cubic otherwise."""
    prescribed: Listed[Count] = ()
    """Joints, counted from 1, that follow their measured angles exactly, whatever torque that
    requires."""
    prescribed_cutoff: Positive | None = None
    """Cutoff frequency of a low-pass filter without phase shift for the prescribed angles (Hz);
    none by default."""
    outputs: Listed[Word] | None = None
    """Channels that are compared; by default all that are not inputs."""
    noise: Mapped[Positive] = Field(default={}, validate_default=True)
    """Standard deviation of the noise by channel, in SI units; by default it is estimated."""
    delays: Mapped[Number] = Field(default={}, validate_default=True)
    """Delay by channel (s): from a command to its torque, or from a motion to its reading. That of
    an input is negative if it acts before the record shows it."""
    filters: Mapped[Filters] = Field(default={}, validate_default=True)
    """Filters by channel, in their order."""
    sensors: Listed[InertialSensor] = ()
    """Accelerometers and gyroscopes: acceleration_1 and angular_rate_1 are readings of the first. A
    torque that jumps at a sample acts on them after it."""
    initial: Literal["rest", "equilibrium", "estimate"] = "rest"
    """Initial state: straight links at rest, the equilibrium with locked joints, or estimated from
    the record."""
    initial_angle: Listed[Number] | None = None
    """Joint angles at the start (rad); by default those of the first sample, or 0."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("delays"):
            for channel, delay in given.delays.items():
                if channel not in INPUTS and delay < 0.0:
                    yield Fault(("delays", channel), "be at least 0", shown(delay))


class RecordFile(RecordSettings):
    """A file of measurements, the channels in its columns, and their treatment."""

    file: Word
    """Path of the .csv, .txt, .dat, .mat, .nc or .parquet file, relative to this file."""
    channels: Mapped[Annotated[Column, BeforeValidator(_by_key("column"))]] = Field(
        default={}, validate_default=True
    )
    """Columns by channel, such as joint_angle_1 or tip_x; by default the columns whose names are
    channels."""
    time: Word | None = None
    """Column of the time; by default time or t."""
    time_unit: Literal["s", "ms", "us"] | None = None
    """Unit of the time; by default that in brackets after its name, or s."""
    encoding: Word = "utf-8"
    """Encoding of a text file, such as latin-1; by default UTF-16 and Latin-1 are recognised."""
    skip: Annotated[int, Field(strict=True, ge=0), BeforeValidator(plain)] = 0
    """Number of lines of a text file before its header; by default it is recognised."""
    sample_time: Positive | None = None
    """Sample time (s), instead of a column of the time."""
    rate: Positive | None = None
    """Samples per second to resample to (Hz); none by default."""
    start: Number | None = None
    """Time of the file at which the record starts (s)."""
    end: Number | None = None
    """Time of the file at which the record ends (s)."""
    masks: Mapped[Listed[Pair]] = Field(default={}, validate_default=True)
    """Parts to leave out by channel: pairs of times of the file (s), such as strain_1: [[1.2,
    1.5]]."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        yield from super()._faults(given)
        if not given.absent("time") and not given.absent("sample_time"):
            yield Fault(("sample_time",), "cannot be combined with time")
        if not given.absent("time_unit") and not given.absent("sample_time"):
            yield Fault(("time_unit",), "cannot be combined with sample_time, which is in seconds")
        for name, parts in given.masks.items() if given.has("masks") else ():
            for k, (first, last) in enumerate(parts):
                if last <= first:
                    rule = f"end after its start ({first:g})"
                    yield Fault(("masks", name, k), rule, shown(last))
        if given.has("start", "end") and given.end <= given.start:
            rule = f"be greater than start ({given.start:g})"
            yield Fault(("end",), rule, shown(given.end))


class FitSettings(Record):
    """Settings of the least-squares fit and of its runs."""

    starts: Count | None = None
    """Number of starts; all but the first are drawn at random. By default 1, and two more on both
    sides of the result if a parameter is undetermined or estimates correlate by more than 0.8."""
    seed: Seed = 0
    """Seed of the random starts."""
    loss: Literal["linear", "soft_l1", "huber", "cauchy"] = "linear"
    """Loss of a residual; all but linear are robust to outliers."""
    method: Literal["output_error", "prediction_error"] = "output_error"
    """Errors that are fitted: those of the simulated channels, or of the predictions of an extended
    Kalman filter, which disturbance torques bias less."""
    torque_noise: OneOrMany[NonNegative] | None = None
    """Standard deviation of a random torque error in each sample, one for all joints or one for
    each, for prediction_error (N m); estimated by default."""
    iterations: Count = 200
    """Most evaluations of the residuals of a fit from one start, those of the beginnings of long
    records included."""
    integrator: Word = "auto"
    """Name of the integrator."""
    step: Positive | None = None
    """Fixed step of the integrator (s)."""
    rtol: Positive = 1e-7
    """Relative tolerance of a step."""
    atol: Positive | None = None
    """Absolute tolerance at the tip (m); by default rtol / 100 of the reach."""


class IdentificationStudy(Record):
    """Estimation of parameters of an arm from measured records."""

    arm: ArmSpec
    """The arm with the values from which the estimation starts."""
    motors: Motors | None = None
    """Motors, for records with currents as inputs."""
    records: Named[RecordFile]
    """Records that are fitted, by name."""
    validation: Mapped[RecordFile] = Field(default={}, validate_default=True)
    """Records that are predicted with the estimates and not fitted, by name."""
    free: Listed[Annotated[FreeParameter, BeforeValidator(_by_key("path"))]] = ()
    """Parameters to estimate: their paths, or mappings with a path. Without any, the records score
    the arm as it is."""
    fit: FitSettings = FitSettings()
    """Settings of the fit."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("records", "validation"):
            for name in given.validation:
                if name in given.records:
                    yield Fault(("validation", name), "repeats the name of a fitted record")


def locate_identification(
    path: AnyPath | Document,
) -> tuple[IdentificationStudy, Callable[[Path], str]]:
    """Read the file of an identification; return it with a function from key path to line."""
    return _located(IdentificationStudy, path)
