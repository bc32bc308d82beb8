"""Environment of an arm: loads, acceleration of its base, changes during a run, contacts.

Between the times of a table the values are linear, before and after it they are constant. Changes
are payloads that are picked up, rigidity that fades, friction. Surfaces of contacts are fixed in
the axes of the base.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag
from pydantic.json_schema import SkipJsonSchema

from flexarm.base.errors import InputError, ModelError, Problem, public_call, shown
from flexarm.model.arm.mechanism import place_faults
from flexarm.model.arm.spec import ArmSpec
from flexarm.model.checks import Given, Record
from flexarm.model.paths import number_at, with_number, with_numbers
from flexarm.model.quantities import (
    Count,
    Finite,
    Listed,
    NonNegative,
    Number,
    Pair,
    Positive,
    Word,
    either,
    length_of,
    plain,
)
from flexarm.model.surfaces import Surface
from flexarm.model.wording import Fault, path_of


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
        yield from table_faults(given)


def table_faults(given: Given, name: str = "values", jumps: bool = True) -> Iterator[Fault]:
    """Yield the faults of a table over time, in which two equal times may be a jump."""
    times, values = length_of(given.raw("times")), length_of(given.raw(name))
    if times == 0:
        yield Fault(("times",), "is empty")
    elif times is not None and values is not None and values != times:
        yield Fault((name,), f"have length {times}, one value for each time", str(values))
    known = given.times if given.has("times") else ()
    for k, (before, time) in enumerate(pairwise(known), start=1):
        rule = ""
        if time < before or (time == before and not jumps):
            rule = f"be {'at least' if jumps else 'greater than'} {before:.9g} (the previous time)"
        elif k > 1 and time == known[k - 2]:  # a third equal time would be ambiguous
            rule = "occur at most twice"
        if rule:
            yield Fault(("times", k), rule, shown(time))
            return


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


BaseAcceleration = Annotated[
    Annotated[Pair, Tag("<pair>")] | Annotated[AccelerationTable, Tag("<table>")],
    either("<table>", dict | AccelerationTable, "<pair>"),
]


def place_faults_of(arm: ArmSpec, load: Load) -> Iterator[Fault]:
    """Yield the faults of a load that is not on an arm."""
    if load.spread is None:
        return place_faults(arm.links, load.link, load.station)
    return place_faults(arm.links, load.link, load.spread[1], ("link", "spread"))


def off_the_arm(arm: ArmSpec, loads: Sequence[Load]) -> Iterator[Fault]:
    """Yield the faults of ``loads`` that are not on an arm."""
    for i, load in enumerate(loads):
        if callable(load.factor):
            rule, hint = "be a table in a scenario", "Only simulate(loads=...) accepts a function."
            yield Fault(("loads", i, "factor"), rule, "a function", hint)
        for fault in place_faults_of(arm, load):
            yield fault.inside("loads", i)


#: Path of the only number with a velocity of its own before it belongs to the arm.
PAYLOAD_MASS = "payload.mass"


class ValueTable(TimeTable):
    """A number as a function of time, tabulated."""

    values: Listed[Number]
    """The number at each time."""


def _course(value: Any) -> str:
    if callable(value) and not isinstance(value, type):
        return "<function>"
    return "<table>" if isinstance(plain(value), dict | ValueTable) else "<number>"


if TYPE_CHECKING:
    Course = float | ValueTable | Callable[[float], float] | tuple[Any, Any]
    TimeOrEvent = float | str
else:
    Course = Annotated[
        Annotated[Number, Tag("<number>")]
        | Annotated[ValueTable, Tag("<table>")]
        | Annotated[SkipJsonSchema[Callable[[float], float]], Tag("<function>")],
        Discriminator(_course),
    ]
    TimeOrEvent = Annotated[
        Annotated[NonNegative, Tag("<time>")] | Annotated[Word, Tag("<event>")],
        either("<event>", str, "<time>"),
    ]


class Change(Record, kw_only=False):
    """A number of the simulated arm that changes during a run.

    In Python, ``to`` and ``factor`` may also be functions of time in s, or two lists ``(times,
    values)``. Times of functions and tables count from ``at``. With a drive in volts (``quantity:
    voltage``) the winding and the gear ratio of a joint cannot change.
    """

    path: Word
    """Path of the number, such as payload.mass or links[0].flexural_rigidity."""
    at: TimeOrEvent = 0.0
    """Time of the change (s), at most the duration of the run, or the name of an event: its first
    occurrence."""
    to: Course | None = None
    """The new number, or a table of it."""
    factor: Course | None = None
    """Factor of the number at the start of the run, instead of a new number; or a table of it."""
    velocity: Pair = (0.0, 0.0)
    """Velocity [x, y] of a mass before it is added to the payload, world frame (m/s)."""
    interval: Positive = 0.01
    """Length of the intervals in which a number that follows a table or a function is constant
    (s)."""

    _written: ClassVar[tuple[str, ...]] = ("path",)

    @property
    def course(self) -> Any:
        """The number, table or function, of the new number or of its factor."""
        return self.factor if self.to is None else self.to

    @classmethod
    def _from_python(cls, arguments: dict[str, Any]) -> dict[str, Any]:
        tables = {
            name: {"times": arguments[name][0], "values": arguments[name][1]}
            for name in ("to", "factor")
            if is_table(arguments.get(name))
        }
        return {**arguments, **tables}

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.omitted("to") and given.omitted("factor"):
            yield Fault(("to",), "is required without factor")
        elif not (given.omitted("to") or given.omitted("factor")):
            yield Fault(("to",), "cannot be combined with factor")
        moving = given.has("velocity") and any(given.velocity)
        if moving and given.has("path") and given.path != PAYLOAD_MASS:
            yield Fault(("velocity",), f"requires the path {PAYLOAD_MASS}")


def original_number(arm: ArmSpec, change: Change) -> float:
    """Return the number of an arm that a change is about; InputError if it cannot change."""
    number = number_at("path", arm, change.path)
    if change.path.endswith((".length", ".hub_radius", ".station", ".distance")):
        rule = "be a number that may change during a run"
        raise InputError(Problem("path", rule, shown(change.path)))
    return number


def numbers_of(change: Change, original: float) -> list[float]:
    """Return the numbers of a change without a function: one, or those of its table."""
    course = change.course
    given = course.values if isinstance(course, ValueTable) else [course]
    return [value if change.factor is None else value * original for value in given]


def change_faults(
    arm: ArmSpec, changes: Sequence[Change], events: Sequence[str]
) -> Iterator[Fault]:
    """Yield the faults of changes that do not fit an arm, or refer to no event of ``events``."""
    for k, change in enumerate(changes):
        if isinstance(change.at, str) and change.at not in events:
            known = ", ".join(map(repr, events)) or "there are none"
            yield Fault(
                ("changes", k, "at"), f"be the name of an event ({known})", shown(change.at)
            )
        try:
            original = original_number(arm, change)
            course = "to" if change.factor is None else "factor"
            for number in [] if callable(change.course) else set(numbers_of(change, original)):
                check_possible(arm, changes, change.path, number)
        except InputError as error:
            problem = error.problems[0]
            own = problem.name == "path"
            place = ("changes", k, "path" if own else course)
            rule = problem.rule if own else f"is not possible: {problem}"
            yield Fault(place, rule, problem.value if own else "", problem.hint)


def check_possible(arm: ArmSpec, changes: Sequence[Change], path: str, number: float) -> None:
    """Raise if a number is possible neither alone nor with the last ones of other changes."""
    try:
        with_number(arm, path, number)
    except InputError as error:
        others = {
            one.path: numbers_of(one, original_number(arm, one))[-1]
            for one in changes
            if one.path != path and not callable(one.course)
        }
        try:
            with_numbers(arm, {**others, path: number})
        except InputError:
            raise error from None


def motor_change_faults(changes: Sequence[Change]) -> Iterator[Fault]:
    """Yield the faults of changes with a drive in volts: those of a winding or a gear ratio."""
    for k, change in enumerate(changes):
        if path_of(change.path)[2:3] in (("winding",), ("gear_ratio",)):
            rule = "cannot be combined with a drive with quantity: voltage"
            hint = "Voltages are converted to torques before the run."
            yield Fault(("changes", k, "path"), rule, hint=hint)


def file_change_faults(
    arm: ArmSpec, changes: Sequence[Change], events: Sequence[str]
) -> Iterator[Fault]:
    """Yield the faults of the changes of a file, which has no functions."""
    yield from change_faults(arm, changes, events)
    for k, change in enumerate(changes):
        if callable(change.course):
            course = "to" if change.factor is None else "factor"
            rule, hint = "be a number or a table in a file", "Only Python accepts a function."
            yield Fault(("changes", k, course), rule, "a function", hint)


Exponent = Annotated[Finite, Field(ge=1, le=5), BeforeValidator(plain)]


class Contact(Record, kw_only=False):
    """Contact of a point on the axis of the arm with a surface.

    At a penetration depth d the surface pushes the point back along its normal with
    ``stiffness * d**exponent * (1 + damping * rate of d)`` and never pulls (Hunt and Crossley
    1975). Friction acts against the sliding motion with ``friction`` times the normal force; theory
    page "contact". A damping of 3/2 (1 - e) / (e v) gives a coefficient of restitution e at an
    impact speed v; the error of the rebound speed is less than 0.003 v down to e = 0.7, and
    0.013 v down to e = 0.5.
    """

    surface: Surface
    """Surface of the contact."""
    stiffness: Positive
    """Force per depth (N/m); with exponent, per depth to that power, N/m^exponent."""
    link: Count | None = None
    """Number of the link, counted from 1 at the base; by default the last one."""
    station: NonNegative | None = None
    """Distance from the root of the link (m); by default its tip."""
    exponent: Exponent = 1.0
    """Exponent of the depth: 1 for a spring, 1.5 for a sphere on a plane."""
    damping: NonNegative = 0.0
    """Relative increase of the force per speed of penetration (s/m)."""
    friction: NonNegative = 0.0
    """Coefficient of Coulomb friction."""
    friction_speed: Positive = 1e-3
    """Sliding speed below which the friction force decreases to zero (m/s). Choose it far below the
    sliding speeds of your task: it is not derived from the arm, so that derivatives by numbers of
    the arm do not change it."""

    _hints: ClassVar[dict[str, str]] = {
        "surface": "A surface is a Wall, a RoundWall or a SurfaceTable.",
    }


def contact_faults(given: Given) -> Iterator[Fault]:
    """Yield the contacts of a scenario that are not on its arm."""
    if not given.has("arm", "contacts"):
        return
    for i, contact in enumerate(given.contacts):
        link = len(given.arm.links) if contact.link is None else contact.link
        for fault in place_faults(given.arm.links, link, contact.station):
            yield fault.inside("contacts", i)
