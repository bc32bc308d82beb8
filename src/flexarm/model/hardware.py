"""Description of the instruments and motors between a controller and an arm; sensors of points."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, cast, get_args

from pydantic import BeforeValidator, Field

from flexarm.base.arguments import check_numbers
from flexarm.base.errors import ModelError, Problem, public_call, shown
from flexarm.model.arm.mechanism import place_faults
from flexarm.model.arm.spec import ArmSpec
from flexarm.model.checks import Given, Record
from flexarm.model.quantities import (
    NO_LIMIT,
    Count,
    Identifier,
    Limit,
    Limits,
    Listed,
    NonNegative,
    Number,
    OneOrMany,
    Positive,
    Word,
    must,
    plain,
)
from flexarm.model.wording import Fault

PointSignal = Literal["position", "velocity", "acceleration"]
POINT_SIGNALS: tuple[str, ...] = get_args(PointSignal)
_UNITS = ("m", "m/s", "m/s^2")


class Sensor(Record, kw_only=False):
    """A point of a link whose motion is an output with two components.

    Position and velocity are relative to the base joint; the acceleration is absolute and includes
    that of the base.
    """

    kind: PointSignal
    """Position (m), velocity (m/s) or acceleration (m/s^2) of the point."""
    link: Count
    """Number of the link, counted from 1 at the base."""
    station: NonNegative | None = None
    """Distance from the root of the link (m); by default its tip."""
    frame: Literal["world", "link"] = "world"
    """World: x and y. Link: the reading of an accelerometer on the link, along and across the root
    tangent of its segment, gravity included."""
    name: Word | None = None
    """Name of the outputs; by default composed of kind, link and station."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("kind"):
            yield from frame_faults(given, given.kind)

    @property
    def columns(self) -> slice:
        """Columns of ``kernels.observation.point_motion`` with the components of the output."""
        first = 6 if self.frame == "link" else 2 * POINT_SIGNALS.index(self.kind)
        return slice(first, first + 2)

    def labels(self) -> list[str]:
        """Return the names of the two outputs."""
        # The station is in mm, because python-control does not permit dots in names.
        place = "tip" if self.station is None else f"{1e3 * self.station:.0f}mm"
        stem = self.name or f"{self.kind}[{self.link}@{place}]"
        axes = ("x", "y") if self.frame == "world" else ("along", "across")
        return [f"{stem}[{axis}]" for axis in axes]

    @property
    def unit(self) -> str:
        """Unit of both outputs."""
        return _UNITS[POINT_SIGNALS.index(self.kind)]


class InertialSensor(Record, kw_only=False):
    """An accelerometer with one axis, or a gyroscope, whose readings a record contains.

    It turns with the section of the link that carries it. An accelerometer reads the acceleration
    minus gravity along its axis: at rest, with the axis upwards, +9.81 m/s^2.
    """

    link: Count
    """Number of the link, counted from 1 at the base."""
    station: NonNegative | None = None
    """Distance from the root of the link (m); by default its tip. At the joint it is 0."""
    angle: Number = 0.0
    """Angle of the axis from the tangent of the link at the station, counterclockwise (rad)."""


def frame_faults(given: Given, kind: str) -> Iterator[Fault]:
    """Yield a fault if the frame of a sensor is not that of its kind."""
    if given.has("frame") and given.frame == "link" and kind != "acceleration":
        yield Fault(("frame",), "be world, except for accelerations", "link")


class InstrumentFault(Record, kw_only=False):
    """A fault of an instrument: its readings are wrong from one time to another.

    A controller and its model do not know it. Faults act in the order of their list, before noise,
    resolution and limit; a frozen reading acts last.
    """

    kind: Literal["bias", "drift", "gain", "frozen"]
    """Added error (bias), error that grows with time (drift), factor of the value (gain), or the
    reading of the last frame before the fault (frozen)."""
    size: Number | None = None
    """The error in the unit of the signal (bias), the error per second (drift) or the factor
    (gain): 0 for a lost signal, -1 for a wrong sign."""
    start: NonNegative = 0.0
    """Time at which it begins (s)."""
    end: NonNegative | None = None
    """Time at which it ends (s); by default with the run."""
    channel: Count | None = None
    """Number of the joint, link, gauge or component, counted from 1 in the order of the readings;
    by default all of the instrument."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("kind"):
            if given.kind == "frozen" and not given.absent("size"):
                yield Fault(("size",), "is not supported with kind frozen")
            elif given.kind != "frozen" and given.absent("size"):
                yield Fault(("size",), f"is required with kind {given.kind}")
        if given.has("start", "end") and given.end is not None and given.end <= given.start:
            yield Fault(("end",), f"be greater than start, {given.start:g}", shown(given.end))

    @public_call
    def acts(self, t: Number) -> bool:
        """Return whether the fault acts at time t (s).

        Raises:
            InputError: if the time is not a number.
        """
        return self.start <= t and (self.end is None or t < self.end)


ChannelSignal = Literal[
    "joint_angle",
    "joint_rate",
    "joint_twist",
    "link_angle",
    "link_rate",
    "link_tip_deflection",
    "link_tip_slope",
    "link_tip_deflection_rate",
    "link_tip_slope_rate",
    "tip",
    "tip_velocity",
    "tip_angle",
    "tip_angle_rate",
    "strain",
    "torque",
    "contact_force",
    "contact_gap",
]
if TYPE_CHECKING:
    Signal = str | Sensor
else:
    Signal = Literal[ChannelSignal, PointSignal]
#: Signals that are channels of results.
CHANNEL_SIGNALS: tuple[str, ...] = get_args(ChannelSignal)
#: Arguments of motors that may have one value per joint.
LIMITS = ("torque_limit", "torque_constant", "current_limit", "voltage_limit", "resistance")


# The attributes of a result contain no larger seed.
_STORABLE = must(f"be at most {2**63 - 1}", lambda seed: seed < 2**63)
Seed = Annotated[int, Field(strict=True, ge=0), _STORABLE, BeforeValidator(plain)]


_PLACE = ("link", "station", "frame")


class Instrument(Record, kw_only=False):
    """One sensor, or one sensor for each joint, link or gauge, with its errors.

    The reading of a value is ``clip(round_to(value + bias + noise, resolution), +-limit)``, taken
    at the frames of the instrument and available ``delay`` later. Until the first frame is
    available, the measurement has the reading of the initial state. The rate is a filtered
    difference of the readings (Tustin's rule for ``s / (1 + s / (2 pi rate_cutoff))``). In Python,
    ``signal`` may be a `Sensor`, which includes ``link``, ``station`` and ``frame``.
    """

    signal: Signal
    """Measured channel; or position, velocity or acceleration of a point."""
    link: Count | None = Field(default=None, kw_only=True)
    """Link of the point, counted from 1 at the base."""
    station: NonNegative | None = Field(default=None, kw_only=True)
    """Distance of the point from the root of the link (m); by default its tip."""
    frame: Literal["world", "link"] = Field(default="world", kw_only=True)
    """Frame of an acceleration: world, or along and across the link including gravity (link)."""
    name: Identifier | None = None
    """Name in the measurement; by default the name of the signal."""
    resolution: NonNegative = 0.0
    """Resolution of the readings, in the unit of the signal."""
    noise: NonNegative = 0.0
    """Standard deviation of white noise, drawn independently for each frame."""
    bias: Number = 0.0
    """Constant error."""
    limit: Limit = Field(default=math.inf, json_schema_extra=NO_LIMIT)
    """Largest reading, in both directions."""
    delay: NonNegative = 0.0
    """Time from a sample to its use by the controller (s)."""
    sample_time: Positive | None = None
    """Sample time (s); by default that of the controller."""
    rate_cutoff: Positive | None = None
    """Cutoff frequency of the derived rate (Hz); no rate by default."""
    rate_name: Identifier | None = None
    """Name of that rate."""
    faults: Listed[InstrumentFault] = ()
    """Faults during the run, which controllers do not know."""

    _hints: ClassVar[dict[str, str]] = {
        "signal": "For the position, velocity or acceleration of a point, Python accepts a Sensor."
    }

    @property
    def output(self) -> str | Sensor:
        """The channel that it reads, or the point as a `Sensor`."""
        if self.link is None:
            return self.signal
        kind = cast(PointSignal, self.signal)
        return Sensor(kind=kind, link=self.link, station=self.station, frame=self.frame)

    @property
    def label(self) -> str:
        """Name of the reading in the measurement."""
        return self.name or str(self.signal)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the readings in the measurement: the value, and its rate if it is read."""
        if self.rate_cutoff is None:
            return (self.label,)
        rate = "joint_rate" if self.label == "joint_angle" else f"{self.label}_rate"
        return self.label, self.rate_name or rate

    def replace(self, **changes: Any) -> Self:
        """Return a validated copy in which the named fields have other values.

        Another signal, unless it is one of a point, has no place on the arm.

        Raises:
            ModelError: if the changed record is invalid.
        """
        signal = changes.get("signal", self.signal)
        if isinstance(signal, Sensor) or (isinstance(signal, str) and signal not in POINT_SIGNALS):
            kept = {name: getattr(self, name) for name in self.model_fields_set}
            changes = {k: v for k, v in kept.items() if k not in _PLACE} | changes
            return type(self)(**changes)
        return super().replace(**changes)

    @classmethod
    def _from_python(cls, arguments: dict[str, Any]) -> dict[str, Any]:
        sensor = arguments.get("signal")
        if not isinstance(sensor, Sensor):
            return arguments
        for name in _PLACE:
            if name in arguments:
                raise ModelError(Problem(name, "cannot be combined with a Sensor as signal"))
        point = {"link": sensor.link, "station": sensor.station, "frame": sensor.frame}
        named = {"name": sensor.name} if arguments.get("name") is None else {}
        return {**arguments, **point, **named, "signal": sensor.kind}

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if not given.has("signal"):
            return
        point = given.signal in POINT_SIGNALS
        if point and given.absent("link"):
            yield Fault(("link",), f"is required for the signal {given.signal}")
        for name in () if point else ("link", "station"):
            if not given.absent(name):
                yield Fault((name,), f"is not supported for the signal {given.signal}")
        yield from frame_faults(given, given.signal)


class Motors(Record, kw_only=False):
    """Motors between the requested torque and the joints; values include the gear.

    A torque that a controller requests is delayed by ``delay``, clipped to the limits at the joint
    rates of that instant, and reached by the motors as ``1 - exp(-t / time_constant)``. The
    voltage reduces the available torque of fast motors, because ``torque_constant`` is also the
    constant of the back electromotive force (V s/rad at the joint).
    """

    torque_limit: Limits = Field(default=math.inf, json_schema_extra=NO_LIMIT)
    """Torque limit (N m), one for all joints or one for each."""
    delay: NonNegative = 0.0
    """Time from a command to the start of its torque (s)."""
    time_constant: NonNegative = 0.0
    """Lag of the current loop (s)."""
    torque_constant: OneOrMany[Positive] | None = None
    """Torque per current (N m/A)."""
    current_limit: Limits = Field(default=math.inf, json_schema_extra=NO_LIMIT)
    """Largest current (A)."""
    voltage_limit: Limits = Field(default=math.inf, json_schema_extra=NO_LIMIT)
    """Supply voltage (V)."""
    resistance: OneOrMany[Positive] | None = None
    """Resistance of the winding (ohm)."""

    @property
    def back_voltage(self) -> bool:
        """Whether the supply voltage limits the torque at a rate."""
        return _is_limited(self.voltage_limit)

    @public_call
    def allowed(self, torque: Any, rate: Any) -> Any:
        """Return a torque (joints,) clipped to the limits at joint rates (joints,)."""
        torque, rate = _of_joints("torque", torque), _of_joints("rate", rate)
        constant = self.torque_constant
        if constant is not None and self.resistance is not None:
            # The supply voltage less the back electromotive force drives the current.
            back = constant * rate
            most = constant * (self.voltage_limit - back) / self.resistance
            least = constant * -(self.voltage_limit + back) / self.resistance
            torque = torque.clip(least, most)
        zero = 0.0 * (torque == torque)  # for each joint; finite even if the torque is not
        limit = self.torque_limit + zero
        if constant is not None:
            limit = limit.clip(max=(constant + zero) * self.current_limit)
        return torque.clip(-limit, limit)

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        voltage = _is_limited(given.raw("voltage_limit"))
        limited = voltage or _is_limited(given.raw("current_limit"))
        if limited and given.absent("torque_constant"):
            yield Fault(("torque_constant",), "is required with current_limit or voltage_limit")
        if voltage and given.absent("resistance"):
            yield Fault(("resistance",), "is required with voltage_limit")


def _of_joints(name: str, value: Any) -> Any:
    """Return an array of numbers; one of a run, or of its program, is not checked, for speed."""
    if type(value).__name__ in ("ndarray", "Recorded") and value.dtype in ("float64", "complex128"):
        return value
    return check_numbers(name, value, "be numbers of shape (joints,)")


def _is_limited(limits: Any) -> bool:
    """Return whether limits of all joints, or one of them, are given, even if they are invalid."""
    given = plain(limits)
    each = given if isinstance(given, list | tuple) else [given]
    return any(limit is not None and limit != math.inf for limit in each)


class Hardware(Record, kw_only=False):
    """Instruments and motors between a controller and an arm.

    By default there are exact instruments of ``joint_angle``, ``joint_rate`` and, with gauges,
    ``strain``, and ideal motors without delay, lag or limits. The same seed gives the same run.
    """

    instruments: Listed[Instrument] | None = None
    """Instruments of the controller."""
    motors: Motors | None = None
    """Limits and delays of the torques."""
    seed: Seed = 0
    """Seed of all noise."""

    _hints: ClassVar[dict[str, str]] = {
        "motors": "For example `motors: {torque_limit: 5}`; in Python, a Motors object.",
    }

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        seen: set[str] = set()
        for k, item in enumerate(given.instruments if given.has("instruments") else ()):
            for name in item.labels:
                if name in seen:
                    rule = f"repeats {name!r}, the name of another instrument"
                    yield Fault(("instruments", k, "name"), rule)
                seen.add(name)


def instrument_faults(arm: ArmSpec, hardware: Hardware, contacts: bool) -> Iterator[Fault]:
    """Yield the faults of instruments that do not fit an arm, or a run without contacts."""
    gauges = any(link.gauges for link in arm.links)
    for k, item in enumerate(hardware.instruments or ()):
        place = ("hardware", "instruments", k)
        if item.signal == "strain" and not gauges:
            yield Fault((*place, "signal"), "is strain, but the arm has no gauges")
        if str(item.signal).startswith("contact_") and not contacts:
            yield Fault((*place, "signal"), f"is {item.signal}, but there are no contacts")
        if item.link is not None:
            for fault in place_faults(arm.links, item.link, item.station):
                yield fault.inside(*place)
    yield from channel_faults(arm, hardware)


def channel_faults(
    arm: ArmSpec, hardware: Hardware | None, contacts: float = math.inf
) -> Iterator[Fault]:
    """Yield the faults of instruments at channels that their signals do not have."""
    for k, item in enumerate((hardware and hardware.instruments) or ()):
        count = _readings(arm, str(item.signal), contacts)
        for j, one in enumerate(item.faults):
            if one.channel is not None and 0 < count < one.channel:
                place = ("hardware", "instruments", k, "faults", j, "channel")
                rule = f"be at most {count:g}, the number of readings of the instrument"
                yield Fault(place, rule, str(one.channel))


def _readings(arm: ArmSpec, signal: str, contacts: float) -> float:
    """Return the number of channels of a signal; those of each contact force are x and y."""
    if signal == "strain":
        return sum(len(link.gauges) for link in arm.links)
    if signal == "contact_gap":
        return contacts
    if signal.startswith("joint_") or signal == "torque":
        return sum(not joint.fixed for joint in arm.joints)
    if signal.startswith("link_"):
        return len(arm.links)
    return 1 if signal.startswith("tip_angle") else 2
