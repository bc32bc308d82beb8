"""Changes of the simulated arm during a run: payloads picked up, rigidity that fades, friction."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from pydantic import Discriminator, Tag
from pydantic.json_schema import SkipJsonSchema

from flexarm.base.errors import InputError, Problem, shown
from flexarm.model.arm.spec import ArmSpec
from flexarm.model.checks import Given, Record
from flexarm.model.environment.loads import TimeTable, is_table
from flexarm.model.paths import number_at, with_number, with_numbers
from flexarm.model.quantities import Listed, NonNegative, Number, Pair, Positive, Word, plain
from flexarm.model.wording import Fault, path_of

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
        Discriminator(lambda value: "<event>" if isinstance(value, str) else "<time>"),
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
    found = number_at("path", arm, change.path)
    if change.path.endswith((".length", ".hub_radius", ".station", ".distance")):
        rule = "be a number that may change during a run"
        raise InputError(Problem("path", rule, shown(change.path)))
    return found


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
