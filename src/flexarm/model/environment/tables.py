"""Values tabulated over time, with linear interpolation, constant before and after the table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, ClassVar

from flexarm.base.errors import shown
from flexarm.model.checks import Given, Record
from flexarm.model.quantities import Listed, Number, Pair, length_of
from flexarm.model.wording import Fault


def is_table(value: Any) -> bool:
    """Return whether a value has the form of a table: a pair whose first item is a list."""
    if not isinstance(value, tuple | list) or len(value) != 2:
        return False
    return isinstance(value[0], tuple | list) or getattr(value[0], "ndim", 0) > 0


class TimeTable(Record):
    """Base of tables over time, which have ``values``."""

    times: Listed[Number]
    """Increasing times (s); two equal times are a jump."""

    _columns: ClassVar[tuple[str, ...]] = ("times", "values")

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        times, values = length_of(given.raw("times")), length_of(given.raw("values"))
        if times == 0:
            yield Fault(("times",), "is empty")
        elif times is not None and values is not None and values != times:
            yield Fault(("values",), f"have length {times}, one value for each time", str(values))
        fault = cls._order_fault(given.times) if given.has("times") else None
        if fault is not None:
            k, rule = fault
            yield Fault(("times", k), rule, shown(given.times[k]))

    @staticmethod
    def _order_fault(times: Sequence[float]) -> tuple[int, str] | None:
        """Return the index of the first time out of order and the rule; None if there is none.

        Times ascend. Two equal times are a jump; a third equal time would be ambiguous.
        """
        for k in range(1, len(times)):
            if times[k] < times[k - 1]:
                return k, f"be at least {times[k - 1]:.9g} (the previous time)"
            if k > 1 and times[k] == times[k - 2]:
                return k, "occur at most twice"
        return None


class FactorTable(TimeTable):
    """Factor of a load as a function of time, tabulated."""

    values: Listed[Number]
    """Factor at each time."""


class AccelerationTable(TimeTable):
    """Acceleration of the base as a function of time, tabulated."""

    values: Listed[Pair]
    """The acceleration [x, y] at each time (m/s^2)."""
