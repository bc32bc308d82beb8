"""Sensors of the motion of a point of a link."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, get_args

from flexarm.model.checks import Given, Record
from flexarm.model.quantities import Count, NonNegative, Word
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


def frame_faults(given: Given, kind: str) -> Iterator[Fault]:
    """Yield a fault if the frame of a sensor is not that of its kind."""
    if given.has("frame") and given.frame == "link" and kind != "acceleration":
        yield Fault(("frame",), "be world, except for accelerations", "link")
