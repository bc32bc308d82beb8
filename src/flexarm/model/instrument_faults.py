"""Faults of instruments during a run: an offset, a drift, a wrong gain, a frozen reading."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from flexarm.base.arguments import check_number
from flexarm.base.errors import public_call, shown
from flexarm.model.checks import Given, Record
from flexarm.model.quantities import Count, NonNegative, Number
from flexarm.model.wording import Fault


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
    def acts(self, t: float) -> bool:
        """Return whether the fault acts at time t (s).

        Raises:
            InputError: if the time is not a number.
        """
        t = check_number("t", t)
        return self.start <= t and (self.end is None or t < self.end)
