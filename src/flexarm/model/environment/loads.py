"""External actions on an arm: loads, and acceleration of the base; values tabulated over time.

Between the times of a table the values are linear, before and after it they are constant.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Discriminator, Tag
from pydantic.json_schema import SkipJsonSchema

from flexarm.base.errors import ModelError, Problem, public_call, shown
from flexarm.model.arm.spec import ArmSpec, place_faults
from flexarm.model.checks import Given, Record
from flexarm.model.quantities import Count, Listed, NonNegative, Number, Pair, length_of, plain
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


def _is_function(value: Any) -> bool:
    return callable(value) and not isinstance(value, type)


if TYPE_CHECKING:
    Factor = FactorTable | Callable[[float], float] | tuple[Any, Any]
else:
    Factor = Annotated[
        Annotated[FactorTable, Tag("<table>")]
        | Annotated[SkipJsonSchema[Callable[[float], float]], Tag("<function>")],
        Discriminator(lambda value: "<function>" if _is_function(value) else "<table>"),
    ]


class Load(Record, kw_only=False):
    """A force and a moment at a station of a link, or a distributed force on part of it.

    In Python, the factor may also be a function of time in s, or two lists ``(times, values)``.
    """

    link: Count
    """Number of the link, counted from 1 at the base."""
    force: Pair = (0.0, 0.0)
    """Force [x, y] (N); per length (N/m) with spread."""
    moment: Number = 0.0
    """Moment at the station (N m)."""
    station: NonNegative | None = None
    """Distance from the root of the link (m); by default its tip."""
    spread: Pair | None = None
    """Start and end of a distributed force, from the root of the link (m)."""
    frame: Literal["world", "link"] = "world"
    """Frame of the force: fixed (world) or rotating with the root tangent of the link (link)."""
    factor: Factor | None = None
    """Factor of the load over time; constant by default."""

    _written: ClassVar[tuple[str, ...]] = ("force", "moment")

    @property
    def value(self) -> tuple[float, float, float]:
        """Force and moment: Fx, Fy, Mz."""
        fx, fy = self.force
        return fx, fy, self.moment

    @public_call
    def scaled(self, factor: Number) -> Load:
        """Return a load whose force and moment are multiplied by a number.

        Raises:
            InputError: if the factor is not a number, or the force exceeds the largest number.
        """
        fx, fy = self.force
        return self.replace(force=(factor * fx, factor * fy), moment=factor * self.moment)

    @classmethod
    def _from_python(cls, arguments: dict[str, Any]) -> dict[str, Any]:
        factor: Any = arguments.get("factor")
        if is_table(factor):
            return {**arguments, "factor": {"times": factor[0], "values": factor[1]}}
        if factor is None or _is_function(factor) or isinstance(factor, FactorTable | dict):
            return arguments
        rule = "be a function of time or a table (times, values)"
        raise ModelError(Problem("factor", rule, shown(factor)))

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.omitted("force") and given.omitted("moment"):
            yield Fault(("force",), "is required if there is no moment")
        if given.absent("spread"):
            return
        if not given.absent("station"):
            yield Fault(("station",), "cannot be combined with spread")
        if not given.has("moment") or given.moment:
            yield Fault(("moment",), "cannot be combined with spread")
        if given.omitted("force") and not given.omitted("moment"):
            yield Fault(("force",), "is required with spread")
        if given.has("spread") and not 0.0 <= given.spread[0] < given.spread[1]:
            rule = "be two increasing distances from the root of the link"
            yield Fault(("spread",), rule, shown(list(given.spread)))


def _pair_or_table(value: Any) -> str:
    return "<table>" if isinstance(plain(value), dict | AccelerationTable) else "<pair>"


BaseAcceleration = Annotated[
    Annotated[Pair, Tag("<pair>")] | Annotated[AccelerationTable, Tag("<table>")],
    Discriminator(_pair_or_table),
]


def place_faults_of(arm: ArmSpec, load: Load) -> Iterator[Fault]:
    """Yield the faults of a load that is not on an arm."""
    if load.spread is None:
        return place_faults(arm, load.link, load.station)
    return place_faults(arm, load.link, load.spread[1], "spread")


def load_faults(given: Given) -> Iterator[Fault]:
    """Yield the faults of loads of a scenario that are not on its arm."""
    if given.has("arm", "loads"):
        yield from off_the_arm(given.arm, given.loads)


def off_the_arm(arm: ArmSpec, loads: Sequence[Load]) -> Iterator[Fault]:
    """Yield the faults of ``loads`` that are not on an arm."""
    for i, load in enumerate(loads):
        if callable(load.factor):
            rule, hint = "be a table in a scenario", "Only simulate(loads=...) accepts a function."
            yield Fault(("loads", i, "factor"), rule, "a function", hint)
        for fault in place_faults_of(arm, load):
            yield fault.inside("loads", i)
