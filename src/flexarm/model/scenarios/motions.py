"""Motions of a scenario: the tip along a path, joints between postures, pressing on a surface."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

from pydantic import BeforeValidator, Field, Tag

from flexarm.model.checks import Given, Record
from flexarm.model.drives import FEEDFORWARD_DRIVES
from flexarm.model.drives.base import OF_JOINTS
from flexarm.model.environment import TimeTable, table_faults
from flexarm.model.quantities import (
    Count,
    Direction,
    Finite,
    Listed,
    NonNegative,
    Number,
    OneOrMany,
    Pair,
    Positive,
    either,
    must,
    plain,
)
from flexarm.model.wording import Fault, look

Ratio = Annotated[Finite, Field(ge=0, lt=1), BeforeValidator(plain)]
Part = Annotated[Finite, Field(gt=0, lt=1), BeforeValidator(plain)]
_Width = Annotated[Finite, Field(gt=0, le=1), BeforeValidator(plain)]


_Joint = Literal["locked", "free"]
_JointOrGains = Annotated[
    Annotated[_Joint, Tag("<word>")] | Annotated[Pair, Tag("<list>")],
    either("<list>", list | tuple, "<word>"),
]
_Joints = Annotated[
    Annotated[_Joint, Tag("<word>")] | Annotated[Listed[_JointOrGains], Tag("<list>")],
    either("<list>", list | tuple, "<word>"),
]


class ShapingSpec(Record):
    """Input shaping: a sum of delayed copies of the motion whose vibrations cancel.

    The shaped motion takes longer.
    """

    method: Literal["zv", "zvd", "zvdd", "ei", "si"] = "zvd"
    """zv cancels vibration at the design frequencies, zvd also reduces it near them, zvdd in a
    wider range, ei limits it to the tolerance over a wider range, si in the range insensitivity."""
    modes: OneOrMany[Count] = 1
    """Number of lowest modes, or a list of their numbers, from 1."""
    joints: _Joints = "locked"
    """Joints during the vibration: locked, free, or for each joint locked, free or the gains of the
    controller [N m/rad, N m s/rad]."""
    frequency_hz: OneOrMany[Positive] | None = None
    """One or more frequencies, instead of those of the arm's modes along the motion (Hz)."""
    damping_ratio: OneOrMany[Ratio] | None = None
    """One number, or one for each mode; by default that of the modes, or 0 with frequencies."""
    tolerance: Part = 0.05
    """For ei: residual vibration at the design frequency, relative to that of a single impulse; for
    si: largest one in the range."""
    insensitivity: _Width = 0.5
    """For si: width of the range of frequencies, relative to the design frequency."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        for name in ("modes", "frequency_hz", "damping_ratio"):
            if given.has(name) and given.raw(name) == ():
                yield Fault((name,), "is empty")
        if given.absent("frequency_hz"):
            return
        for name, usual in (("modes", 1), ("joints", "locked")):
            if given.has(name) and getattr(given, name) != usual:
                yield Fault((name,), "cannot be combined with frequency_hz")


class SmoothingSpec(Record):
    """Smoothing: the average of each joint angle over a window of the past.

    The smoothed motion takes longer by the window.
    """

    duration: Positive
    """Length of the window (s)."""
    window: Literal["raised_cosine", "moving_average"] = "raised_cosine"
    """Shape of the window."""


Profile = Literal["quintic", "trapezoidal"]


Points = Annotated[Listed[Pair], must("have at least two points", lambda points: len(points) > 1)]


class _Timing(Record):
    """Base of motions: duration, timing law and start; the arm is at rest before and after."""

    duration: Positive
    """Time from start to end (s)."""
    profile: Profile = "quintic"
    """Timing law along the path."""
    start_time: NonNegative = 0.0
    """Start time of the motion (s)."""
    shaping: ShapingSpec | None = None
    """Input shaping against residual vibration."""
    smoothing: SmoothingSpec | None = None
    """Moving average over time, after the shaping."""


class _TipTiming(_Timing):
    """Base of motions of the tip, with the posture."""

    elbow: Literal["up", "down"] = "up"
    """Posture: elbow to the left (up) or to the right (down) of the line from the base to the
    tip."""


class LineMotionSpec(_TipTiming):
    """Motion of the rigid arm's tip along a straight line."""

    kind: Literal["line"] = "line"
    start: Pair
    """Tip at the start [x, y], world frame (m)."""
    end: Pair
    """Tip at the end [x, y], world frame (m)."""


class ViaPointMotionSpec(_TipTiming):
    """Motion of the rigid arm's tip along lines between points, with rounded corners."""

    _columns: ClassVar[tuple[str, ...]] = ("points",)
    kind: Literal["via_points"] = "via_points"
    points: Points
    """Corners of the path [[x, y], ...], world frame (m)."""
    blend: Positive | None = None
    """Distance from each corner at which the tip leaves the lines (m); by default a quarter of the
    shorter line."""


class SplineMotionSpec(_TipTiming):
    """Motion of the rigid arm's tip on a smooth curve through points."""

    _columns: ClassVar[tuple[str, ...]] = ("points",)
    kind: Literal["spline"] = "spline"
    points: Points
    """Points of the path [[x, y], ...], world frame (m); the curve is closed if the last equals the
    first."""


class CircleMotionSpec(_TipTiming):
    """Motion of the rigid arm's tip on a circle."""

    kind: Literal["circle"] = "circle"
    center: Pair
    """Centre of the circle [x, y], world frame (m)."""
    start: Pair
    """Tip at the start [x, y], world frame (m)."""
    angle: Number
    """Angle about the centre, counter-clockwise (rad); negative the other way."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("angle") and given.angle == 0.0:
            yield Fault(("angle",), "differ from 0", "0")


class JointMotionSpec(_Timing):
    """Synchronous motion of all joints between two postures."""

    kind: Literal["joint"] = "joint"
    start: Listed[Number]
    """Relative joint angles at the start (rad)."""
    end: Listed[Number]
    """Relative joint angles at the end (rad)."""
    driven: Listed[Count] | None = None
    """Numbers of the joints that move in this way; the others close the loops of the mechanism. By
    default all."""


TipMotionSpec = LineMotionSpec | ViaPointMotionSpec | SplineMotionSpec | CircleMotionSpec
PlainMotionSpec = TipMotionSpec | JointMotionSpec
PathSpec = Annotated[PlainMotionSpec, Field(discriminator="kind")]


class ForceTable(TimeTable):
    """A force as a function of time: smooth between the values, constant before and after."""

    times: Listed[Number]
    """Increasing times (s)."""
    values: Listed[NonNegative]
    """The force at each time (N)."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        yield from table_faults(given, jumps=False)


Force = Annotated[
    Annotated[NonNegative, Tag("<number>")] | Annotated[ForceTable, Tag("<table>")],
    either("<table>", dict | ForceTable, "<number>"),
]


class PressedMotionSpec(Record):
    """Motion of the bent arm's tip along a surface on which it presses.

    After the path the tip is at rest and presses on with its last force.
    """

    kind: Literal["pressed"] = "pressed"
    path: PathSpec
    """The motion of the rigid arm whose tip is the path."""
    force: Force
    """Force on the surface (N), or a table of it over time."""
    normal: Direction | None = None
    """Normal out of the surface [x, y], of any length; by default that of the first contact."""
    friction: NonNegative = 0.0
    """Coefficient of friction assumed for the bent arm."""
    interval: Positive | None = None
    """Time between the instants at which the bent arm is computed (s); by default a twentieth of
    the lowest period of the straight arm with locked joints, but 64 to 1200 intervals."""


MotionSpec = Annotated[PlainMotionSpec | PressedMotionSpec, Field(discriminator="kind")]


def motion_faults(given: Given) -> Iterator[Fault]:
    """Yield the faults between a motion that presses and the other parts of a scenario."""
    motion, drive = given.raw("motion"), given.raw("drive")
    if look(motion, "kind") != "pressed":
        return
    kind = look(drive, "kind")
    unpressed = "is not supported with a pressed motion"
    if kind in FEEDFORWARD_DRIVES:
        yield Fault(("drive", "kind"), f"{kind} {unpressed}")
    elif look(drive, "reference") is not None:
        yield Fault(("drive", "reference"), f"{unpressed}, which is a reference itself")
    place: tuple[str, ...] = ("drive",)
    while drive is not None:
        if (torque := look(drive, "feedforward")) in OF_JOINTS:
            yield Fault((*place, "feedforward"), f"{torque} {unpressed}")
        drive, place = look(drive, "inner"), (*place, "inner")
    for k, joint in enumerate(given.prescribed if given.has("prescribed") else ()):
        if joint.kind == "motion":
            yield Fault(("prescribed", k, "kind"), "motion is not supported with a pressed motion")
    if look(motion, "normal") is None and given.has("contacts"):
        if not given.contacts:
            yield Fault(("motion", "normal"), "is required if there are no contacts")
            return
        if given.contacts[0].surface.kind not in ("wall", "round"):
            rule = "is required if the first contact is neither a wall nor round"
            yield Fault(("motion", "normal"), rule)
