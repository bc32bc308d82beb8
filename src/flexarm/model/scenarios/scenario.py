"""Description of a scenario: an arm, its motion and drive, its environment, events, the run."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field

from flexarm.base.errors import shown
from flexarm.model import drives, environment
from flexarm.model.arm.spec import ArmSpec
from flexarm.model.checks import Given, Record
from flexarm.model.hardware import LIMITS, Hardware, instrument_faults
from flexarm.model.quantities import (
    Count,
    Direction,
    Flag,
    Listed,
    Number,
    Pair,
    Positive,
    Tolerance,
    Word,
    length_of,
    plain,
)
from flexarm.model.scenarios.motions import MotionSpec, motion_faults
from flexarm.model.wording import Fault, Path, look

#: Names of other ends of a run, not permitted for events.
DURATION, FAILURE = "duration", "failure"


def event_names(events: Sequence[Any]) -> list[str]:
    """Return the names of events: the given ones, or by default event_1 and so on."""
    return [event.name or f"event_{k}" for k, event in enumerate(events, start=1)]


class _Event(Record):
    """Base of events: name, direction of the crossing, and whether the run ends."""

    name: Word | None = None
    """Name in results; by default its number, such as event_1."""
    direction: Literal["both", "rising", "falling"] = "both"
    """Direction of the zero crossings that are located."""
    terminal: Flag = False
    """Whether the event ends the run."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("name") and given.name in (DURATION, FAILURE):
            rule = f"not be {DURATION!r} or {FAILURE!r} (other ends of a run)"
            yield Fault(("name",), rule, shown(given.name))


class JointEvent(_Event):
    """A joint passes an angle or reaches a stop; rising means an increasing angle."""

    kind: Literal["joint_angle"] = "joint_angle"
    joint: Count
    """Number of the joint, counted from 1 at the base."""
    angle: Number | None = None
    """Relative joint angle (rad)."""
    stop: Literal["lower", "upper"] | None = None
    """Limit of the joint, instead of an angle."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        yield from super()._faults(given)
        if given.absent("angle") and given.absent("stop"):
            yield Fault(("angle",), "is required if there is no stop")
        elif not given.absent("angle") and not given.absent("stop"):
            yield Fault(("angle",), "cannot be combined with stop")


class TipEvent(_Event):
    """The tip crosses a straight line; rising means along the normal."""

    kind: Literal["tip_line"] = "tip_line"
    point: Pair
    """Any point of the line [x, y], world frame (m)."""
    normal: Direction
    """Normal of the line [x, y], of any length."""


EventSpec = Annotated[JointEvent | TipEvent, Field(discriminator="kind")]


def event_faults(given: Given, turning: Sequence[int]) -> Iterator[Fault]:
    """Yield the faults of events: names that repeat, joints that are not ``turning``, stops."""
    if not given.has("events"):
        return
    names: list[str] = []
    for i, event in enumerate(given.events):
        name = event.name or f"event_{i + 1}"
        if name in names:
            rule = f"repeats {name!r}, the name of events[{names.index(name)}]"
            yield Fault(("events", i, "name"), rule)
        names.append(name)
        if event.kind != "joint_angle":
            continue
        if given.has("arm") and event.joint not in turning:
            known = ", ".join(map(str, turning)) or "there are none"
            rule = f"be the number of a joint that is not fixed ({known})"
            yield Fault(("events", i, "joint"), rule, shown(event.joint))
        elif event.stop and given.has("arm") and given.arm.joints[event.joint - 1].limits is None:
            rule = f"is not supported: joint {event.joint} has no limits"
            yield Fault(("events", i, "stop"), rule)


class _PrescribedJoint(Record):
    """Base of prescribed joints: the number of the joint."""

    joint: Count
    """Number of the joint, counted from 1 at the base."""


class HeldJoint(_PrescribedJoint):
    """A joint that is locked at its initial angle."""

    kind: Literal["hold"] = "hold"


class FollowingJoint(_PrescribedJoint):
    """A joint that follows its part of the motion of the scenario."""

    kind: Literal["motion"] = "motion"


class TabulatedJoint(_PrescribedJoint):
    """A joint that follows a cubic spline through tabulated angles."""

    kind: Literal["table"] = "table"
    times: Listed[Number]
    """Increasing times (s)."""
    angles: Listed[Number]
    """Relative joint angle at each time (rad)."""
    ends: Literal["rest", "free"] = "rest"
    """rest: the joint is at rest before and after the table; free: the table covers the whole
    run."""

    _columns: ClassVar[tuple[str, ...]] = ("times", "angles")

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if length_of(given.raw("times")) == 1:
            yield Fault(("times",), "have at least two values", "1")
        else:
            yield from environment.table_faults(given, "angles", jumps=False)


PrescribedJoint = Annotated[
    HeldJoint | FollowingJoint | TabulatedJoint, Field(discriminator="kind")
]


def prescribed_faults(given: Given, turning: Sequence[int]) -> Iterator[Fault]:
    """Yield the faults between prescribed joints and a scenario, whose joints are ``turning``."""
    if not given.has("prescribed") or not given.prescribed:
        return
    kind = look(given.raw("drive"), "kind")
    if isinstance(kind, str) and kind in drives.CONTROLLED:
        yield Fault(("prescribed",), f"cannot be combined with drive {kind}")
    seen: dict[int, int] = {}
    for i, joint in enumerate(given.prescribed):
        place = ("prescribed", i, "joint")
        if turning and joint.joint not in turning:
            rule = f"be the number of a joint that is not fixed ({', '.join(map(str, turning))})"
            yield Fault(place, rule, shown(joint.joint))
        if joint.joint in seen:
            rule = f"repeats joint {joint.joint}, which is in prescribed[{seen[joint.joint]}]"
            yield Fault(place, rule)
        seen.setdefault(joint.joint, i)
        if joint.kind == "motion" and given.absent("motion"):
            yield Fault(("motion",), f"is required for prescribed[{i}]")
        if joint.kind == "table" and joint.ends == "free" and given.has("run"):
            yield from _coverage_faults(i, joint.times, given.run.duration)


def _coverage_faults(i: int, times: tuple[float, ...], duration: float) -> Iterator[Fault]:
    margin = 1e-9 * (times[-1] - times[0])
    if times[0] > margin or times[-1] < duration - margin:
        rule = f"cover the run from 0 to {duration:.9g} with 'ends: free'"
        value = f"{times[0]:.9g} to {times[-1]:.9g}"
        hint = "With 'ends: rest' the joint is at rest before and after the table."
        yield Fault(("prescribed", i, "times"), rule, value, hint)


MOST_SAMPLES = 10**7
#: Default rate (Hz), and the samples that a run has by default if it is very short or very long.
RATE, _FEWEST_SAMPLES, _DEFAULT_SAMPLES = 1000.0, 100, 10**6
Stations = Annotated[int, Field(strict=True, ge=0, le=1000), BeforeValidator(plain)]


def sample_fault(duration: float, rate: float) -> Fault | None:
    """Return a fault if a rate (Hz) gives too many samples in a duration (s), else None."""
    samples = duration * rate
    if samples <= MOST_SAMPLES:
        return None
    rule = f"be at most {MOST_SAMPLES / duration:.6g} for a duration of {duration:.6g}"
    return Fault(("rate",), rule, shown(rate), f"A result has at most {MOST_SAMPLES:.0e} samples.")


def recording_rate(rate: float | None, duration: float) -> float:
    """Return a rate (Hz) of samples, by default 1000 Hz or one that suits a duration (s)."""
    if rate is not None:
        return rate
    least, most = _FEWEST_SAMPLES / duration, _DEFAULT_SAMPLES / duration
    if least <= RATE <= most:
        return RATE
    # Of 1, 2 and 5 times powers of ten, the least above the limit, or the largest below it.
    decade = 10.0 ** math.floor(math.log10(least if least > RATE else most))
    # Of a decade that rounding has increased, the rate below is that of the one before.
    rates = [factor * decade for factor in (0.5, 1.0, 2.0, 5.0, 10.0)]
    if least > RATE:
        return min(each for each in rates if each >= least)
    return max(each for each in rates if each <= most)


class InitialState(Record):
    """Initial state of the arm; by default at the start of the motion."""

    joint_angle: Listed[Number] | None = None
    """Relative joint angles (rad). Of an arm with closures, those near which its loops close."""
    joint_rate: Listed[Number] | None = None
    """Relative joint rates (rad/s); zero by default. With closures, joints whose rate is zero move
    as the others require."""
    base_position: tuple[Number, Number, Number] | None = None
    """Position x, y and angle of a base that moves (m; m; rad), zero for those that are not free;
    zero by default."""
    base_velocity: tuple[Number, Number, Number] | None = None
    """Rates of x, y and angle of a base that moves (m/s; m/s; rad/s); zero by default."""
    equilibrium: Flag = False
    """Whether the run starts in the equilibrium with locked joints; otherwise the links start
    straight, or bent as at the start of a flexible reference."""
    balance: Flag = False
    """Whether the torque of that equilibrium is added to the drive."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if not given.has("equilibrium"):
            return
        for name in ("joint_rate", "base_position", "base_velocity"):
            if given.equilibrium and not given.absent(name):
                yield Fault((name,), "cannot be combined with equilibrium")
        if given.has("balance") and given.balance and not given.equilibrium:
            yield Fault(("equilibrium",), "must be true with balance")


def _base_faults(free: Sequence[str], initial: InitialState) -> Iterator[Fault]:
    """Yield the faults of coordinates of the base that are given but not free to move."""
    for key in ("base_position", "base_velocity"):
        for name, value in zip(("x", "y", "angle"), getattr(initial, key) or (), strict=False):
            if value and name not in free:
                rule = f"have {name} = 0, because arm.base.free does not contain {name!r}"
                yield Fault(("initial", key), rule, shown(value))


class RunSpec(Record):
    """Duration, recording and integrator of a run."""

    duration: Positive
    """Simulated time (s)."""
    rate: Positive | None = None
    """Samples recorded per second (Hz); by default 1000, and a round number of more or fewer for a
    run that would have less than 100 samples or more than a million."""
    stations: Stations = 0
    """Number of sections of each link at which section forces are recorded."""
    integrator: Word = "auto"
    """Name of the integrator."""
    accuracy: Positive | None = None
    """Largest error of the tip that the integration may cause (m), instead of tolerances."""
    rtol: Tolerance | None = None
    """Relative tolerance."""
    atol: Positive | None = None
    """Absolute tolerance at the tip (m); by default rtol / 100 of the reach."""
    step: Positive | None = None
    """Step of a fixed-step method (s)."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("duration", "rate") and given.rate is not None:
            fault = sample_fault(given.duration, given.rate)
            if fault is not None:
                yield fault
        if given.has("stations") and given.stations == 1:
            yield Fault(("stations",), "be 0, or at least 2 (root and tip)", "1")
        if given.has("duration", "step") and given.step > given.duration:
            rule = f"be at most {given.duration:.9g} (the duration of the run)"
            yield Fault(("step",), rule, shown(given.step))
        if given.has("accuracy"):
            for name in ("rtol", "atol", "step"):
                if not given.absent(name):
                    yield Fault(("accuracy",), f"cannot be combined with {name}")


class Scenario(Record):
    """One run of an arm."""

    arm: ArmSpec
    """The arm."""
    motion: MotionSpec | None = None
    """The reference motion."""
    drive: drives.Drive = drives.NoDrive()
    """Source of the joint torques."""
    hardware: Hardware | None = None
    """Instruments and motors between the controller and the arm."""
    prescribed: Listed[PrescribedJoint] = ()
    """Joints with a prescribed motion."""
    loads: Listed[environment.Load] = ()
    """Forces and moments that act on the links."""
    base_acceleration: environment.BaseAcceleration | None = None
    """Acceleration of the base [x, y] (m/s^2), or a table of it."""
    events: Listed[EventSpec] = ()
    """Events to locate, which are recorded or end the run."""
    contacts: Listed[environment.Contact] = ()
    """Contacts of points of the arm with surfaces."""
    changes: Listed[environment.Change] = ()
    """Numbers of the simulated arm that change during the run."""
    initial: InitialState = InitialState()
    """Initial state of the arm."""
    run: RunSpec
    """Settings of the run."""

    _hints: ClassVar[dict[str, str]] = {
        "arm": "In Python, load_arm_spec reads a file.",
        "run": "It says how long to simulate, for example `run: {duration: 2}`.",
    }

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        kind = look(given.raw("drive"), "kind")
        kind = kind if isinstance(kind, str) else None
        if kind in _FOLLOWING and given.absent("motion"):
            yield Fault(("motion",), f"is required for drive {kind}")
        turning = _turning(given.raw("arm"))
        joints = len(turning)
        for path, values in _values_per_joint(given):
            length = length_of(values)
            if joints and length not in (None, joints):
                yield Fault(path, f"have length {joints}, one value for each joint", str(length))
        if given.has("hardware") and kind not in drives.CONTROLLED:
            yield Fault(("hardware",), "requires a controller as drive")
        if given.has("hardware", "arm"):
            contacts = not given.has("contacts") or bool(given.contacts)
            yield from instrument_faults(given.arm, given.hardware, contacts)
        if given.has("arm", "loads"):
            yield from environment.off_the_arm(given.arm, given.loads)
        yield from environment.contact_faults(given)
        yield from motion_faults(given)
        yield from prescribed_faults(given, turning)
        yield from event_faults(given, turning)
        if given.has("arm", "changes", "events"):
            yield from environment.file_change_faults(
                given.arm, given.changes, event_names(given.events)
            )
        if given.has("drive") and drives.in_volts(given.drive):
            if given.has("arm"):
                for k, joint in enumerate(given.arm.joints):
                    if not joint.fixed and joint.winding is None:
                        rule = f"voltage is not supported without arm.joints[{k}].winding"
                        yield Fault(("drive", "quantity"), rule)
            if given.has("changes"):
                yield from environment.motor_change_faults(given.changes)
        if given.has("arm", "initial"):
            yield from _base_faults(given.arm.base.free, given.initial)
        if given.has("initial", "drive") and given.initial.balance and drives.balances(given.drive):
            rule = "cannot be combined with a drive that compensates gravity"
            yield Fault(("initial", "balance"), rule)


_FOLLOWING = (*drives.FEEDFORWARD_DRIVES, *drives.CONTROLLED)
"""Drives that follow a motion."""


def _turning(arm: object) -> list[int]:
    """Return the numbers of the joints that turn, from a description that may be invalid."""
    joints = plain(look(arm, "joints"))
    joints = joints if isinstance(joints, list | tuple) else ()
    fixed = {number for number, joint in enumerate(joints, 1) if look(joint, "fixed") is True}
    links = length_of(look(arm, "links")) or 0
    return [number for number in range(1, links + 1) if number not in fixed]


def _values_per_joint(given: Given) -> Iterator[tuple[Path, Any]]:
    """Yield the values that need one entry per joint of the arm, with their paths."""
    # These are raw values, because only lengths are compared here and the entries may be invalid.
    motion, drive, initial = (given.raw(name) for name in ("motion", "drive", "initial"))
    place: Path = ("motion",)
    if look(motion, "kind") == "pressed":
        motion, place = look(motion, "path"), ("motion", "path")
    if look(motion, "kind") == "joint":
        yield (*place, "start"), look(motion, "start")
        yield (*place, "end"), look(motion, "end")
    if look(drive, "kind") == "torque":
        rows = plain(look(drive, "values"))
        # Rows of equal length have the same problem, so only the first of them is checked.
        seen: set[int | None] = set()
        for i, row in enumerate(rows if isinstance(rows, list | tuple) else ()):
            if length_of(row) not in seen:
                yield ("drive", "values", i), row
            seen.add(length_of(row))
    place = ("drive",)
    while drive is not None:  # a controller may contain another one
        kind = look(drive, "kind")
        record = drives.CONTROLLED.get(kind) if isinstance(kind, str) else None
        for name in record.per_joint if record else ():
            yield (*place, name), look(drive, name)
        drive, place = look(drive, "inner"), (*place, "inner")
    motors = look(given.raw("hardware"), "motors")
    for name in LIMITS:
        yield ("hardware", "motors", name), look(motors, name)
    yield ("initial", "joint_angle"), look(initial, "joint_angle")
    yield ("initial", "joint_rate"), look(initial, "joint_rate")
