"""External actions on an arm: loads, and acceleration of the base."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Discriminator, Tag
from pydantic.json_schema import SkipJsonSchema

from flexarm.base.errors import ModelError, Problem, public_call, shown
from flexarm.model.arm.spec import ArmSpec, place_faults
from flexarm.model.checks import Given, Record
from flexarm.model.environment.tables import AccelerationTable, FactorTable, is_table
from flexarm.model.quantities import Count, NonNegative, Number, Pair, plain
from flexarm.model.wording import Fault


def _is_function(value: Any) -> bool:
    return callable(value) and not isinstance(value, type)


def _table_or_function(value: Any) -> str:
    return "<function>" if _is_function(value) else "<table>"


if TYPE_CHECKING:
    Factor = FactorTable | Callable[[float], float] | tuple[Any, Any]
else:
    Factor = Annotated[
        Annotated[FactorTable, Tag("<table>")]
        | Annotated[SkipJsonSchema[Callable[[float], float]], Tag("<function>")],
        Discriminator(_table_or_function),
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
