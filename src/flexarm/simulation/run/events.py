"""Events of a run: user-defined functions and built-in joint, tip and contact events."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.actions import place_contacts
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import check_joint
from flexarm.arm.observe import contact_values, tips_of
from flexarm.base.arguments import check_direction, check_kind, check_list_of, check_number
from flexarm.base.errors import InputError, Problem, check_array, public_call, shown
from flexarm.integrate.base import FloatArray
from flexarm.kernels.forces.contact import GAP
from flexarm.kernels.layout import Contacts
from flexarm.model import Contact, EventSpec, JointEvent
from flexarm.model.scenarios.scenario import DURATION, FAILURE, event_names

#: Function of t (s), q (dof,) and qd (dof,) that returns a number.
EventFunction = Callable[[Any, Any, Any], Any]
#: Names of the stops of a joint, for the angle of an event.
STOPS = ("lower", "upper")


@dataclass(frozen=True, eq=False)
class Event:
    """Function of the state whose zero crossings are located during a run.

    Args:
        function: function of time t (s), coordinates q (dof,) and rates qd (dof,) of the simulated
            arm that returns one finite number. With an attribute ``vectorized = True`` it is
            called with many samples at once: (k,), (k, dof), (k, dof) to (k,).
        name: name in results; by default "event_1" and so on, by position in the list.
        direction: 1 for crossings from below zero, -1 for those from above, 0 for both.
        terminal: whether the event ends the run.

    Raises:
        InputError: if ``function`` is not callable, ``name`` is empty or reserved for other ends
            of a run ("duration", "failure"), ``direction`` is not -1, 0 or 1, or ``terminal`` is
            not a bool.
    """

    function: EventFunction
    name: str | None = None
    direction: int = 0
    terminal: bool = False

    @public_call
    def __post_init__(self) -> None:
        problems = []
        if not callable(self.function):
            rule = "be a function of t, q and qd"
            problems.append(Problem("function", rule, shown(self.function)))
        if self.name is not None and not (isinstance(self.name, str) and self.name):
            problems.append(Problem("name", "be a nonempty text", shown(self.name)))
        elif self.name in (DURATION, FAILURE):
            rule = f"not be {DURATION!r} or {FAILURE!r} (other ends of a run)"
            problems.append(Problem("name", rule, shown(self.name)))
        if type(self.direction) is not int or self.direction not in (-1, 0, 1):
            problems.append(Problem("direction", "be -1, 0 or 1", shown(self.direction)))
        if not isinstance(self.terminal, bool):
            problems.append(Problem("terminal", "be True or False", shown(self.terminal)))
        if problems:
            raise InputError(*problems)


@public_call
def joint_event(
    arm: Arm,
    joint: int,
    angle: float | str,
    *,
    name: str | None = None,
    direction: int = 0,
    terminal: bool = False,
) -> Event:
    """Create an event at which a joint passes an angle; its function is the difference in rad.

    Args:
        arm: the simulated arm.
        joint: number of the joint, equal to the number of the link that starts there.
        angle: rad, or "lower" or "upper" for the joint's stop on that side.
        name, direction, terminal: as for ``Event``; direction 1 is an increasing angle.

    Raises:
        InputError: if the arm has no such joint, the joint has no limits but a stop is requested,
            or the angle is neither a number nor the name of a stop.
    """
    index = check_joint(check_kind("arm", arm, Arm), "joint", joint)
    if isinstance(angle, str):
        limits = arm.spec.joints[joint - 1].limits
        if angle not in STOPS:
            raise InputError(Problem("angle", "be a number, 'lower' or 'upper'", shown(angle)))
        if limits is None:
            hint = "Give the joint limits, or the angle itself."
            rule = f"be a number (joint {joint} has no limits)"
            raise InputError(Problem("angle", rule, shown(angle), hint))
        value = float(getattr(limits, angle))
    else:
        value = check_number("angle", angle)
    place = int(arm.joint_index[index])
    stop = (joint - 1, angle) if isinstance(angle, str) else None
    return Event(_JointAngle(arm, place, value, stop), name, direction, terminal)


@public_call
def tip_event(
    arm: Arm,
    point: ArrayLike,
    normal: ArrayLike,
    *,
    name: str | None = None,
    direction: int = 0,
    terminal: bool = False,
) -> Event:
    """Create an event at which the tip crosses a line; its function is the distance in m.

    Args:
        arm: the simulated arm.
        point: (x, y) of any point of the line, m, world axes.
        normal: (x, y) perpendicular to the line, of any length; the distance increases along it.
        name, direction, terminal: as for ``Event``; direction 1 is a tip moving along the normal.

    Raises:
        InputError: if ``point`` or ``normal`` is not a pair of numbers, or the normal is zero.
    """
    arm = check_kind("arm", arm, Arm)
    place = check_array("point", point, (2,))
    across = check_direction("normal", normal)
    return Event(_TipDistance(arm, place, across), name, direction, terminal)


@public_call
def contact_event(
    arm: Arm,
    contact: Contact,
    *,
    name: str | None = None,
    direction: int = -1,
    terminal: bool = False,
) -> Event:
    """Create an event at which a contact closes or opens; its function is the gap in m.

    Args:
        arm: the simulated arm.
        contact: the contact, as passed to ``simulate``. Its forces act only if it is passed there.
        name, direction, terminal: as for ``Event``; the gap is negative in contact, so -1 is
            closing, 1 opening and 0 both.

    Raises:
        InputError: if ``contact`` is not a contact or its point is not on the arm.
    """
    arm = check_kind("arm", arm, Arm)
    placed = place_contacts(arm, [check_kind("contact", contact, Contact)])
    return Event(_Gap(arm, placed, contact), name, direction, terminal)


def events_of(specs: Sequence[EventSpec], arm: Arm) -> list[Event]:
    """Create the events of a scenario for ``arm``."""
    return [_event(spec, arm) for spec in specs]


def _event(spec: EventSpec, arm: Arm) -> Event:
    common: dict[str, Any] = {"name": spec.name, "terminal": spec.terminal}
    common["direction"] = {"both": 0, "rising": 1, "falling": -1}[spec.direction]
    if isinstance(spec, JointEvent):
        angle = spec.stop if spec.angle is None else spec.angle
        assert angle is not None  # the model requires one of the two
        return joint_event(arm, spec.joint, angle, **common)
    return tip_event(arm, spec.point, spec.normal, **common)


@dataclass(frozen=True, eq=False)
class _JointAngle:
    """Joint angle relative to a given angle, for many samples."""

    vectorized: ClassVar[bool] = True

    arm: Arm
    place: int  # in q
    angle: float
    stop: tuple[int, str] | None = None  # joint, from 0, and side of the stop with this angle

    def __call__(self, t: FloatArray, q: FloatArray, qd: FloatArray) -> FloatArray:
        return np.asarray(q[..., self.place] - self.angle)


@dataclass(frozen=True, eq=False)
class _TipDistance:
    """Distance of the tip from a line, for many samples."""

    vectorized: ClassVar[bool] = True

    arm: Arm
    point: FloatArray
    normal: FloatArray  # of unit length

    def __call__(self, t: FloatArray, q: FloatArray, qd: FloatArray) -> FloatArray:
        tips = tips_of(self.arm, self.arm.padded(np.stack([q, qd], axis=1)))
        return np.asarray((tips[:, :2] - self.point) @ self.normal)


@dataclass(frozen=True, eq=False)
class _Gap:
    """Gap of a contact, for many samples."""

    vectorized: ClassVar[bool] = True

    arm: Arm
    placed: Contacts
    contact: Contact

    def __call__(self, t: FloatArray, q: FloatArray, qd: FloatArray) -> FloatArray:
        states = self.arm.padded(np.stack([q, qd], axis=1))
        return contact_values(self.arm, self.placed, states)[:, 0, GAP]


def function_for(function: object, arm: Arm) -> EventFunction | None:
    """Return a function that depends on the arm, a built-in one, for another arm; or None."""
    if isinstance(function, _JointAngle) and function.stop is not None:
        joint, side = function.stop
        angle = getattr(arm.spec.joints[joint].limits, side)
        return replace(function, arm=arm, angle=angle)
    if isinstance(function, _TipDistance):
        return replace(function, arm=arm)
    if isinstance(function, _Gap):
        return replace(function, arm=arm, placed=place_contacts(arm, [function.contact]))
    return None


@dataclass(eq=False)
class Found:
    """Occurrence of an event."""

    place: int  # in the list of events
    time: float  # s
    state: FloatArray  # (2, n, 1 + m)
    direction: int  # 1 from below zero, -1 from above


@dataclass(eq=False)
class EventLog:
    """Events of a run, their names and their occurrences in order of time.

    ``triggers`` are the names of events at whose next occurrence the arm changes.
    """

    events: list[Event]
    names: list[str]
    found: list[Found] = field(default_factory=list)
    triggers: set[str] = field(default_factory=set)

    @property
    def ended_by(self) -> str | None:
        """Name of the event that ended the run, or None."""
        if self.found and self.events[self.found[-1].place].terminal:
            return self.names[self.found[-1].place]
        return None


def event_log(arm: Arm, events: Sequence[Event]) -> EventLog | None:
    """Validate the events of a run of ``arm``; return their log, or None without events.

    Raises:
        InputError: if ``events`` is not a list of events, two have the same name, or one was
            created for a different arm.
    """
    events = check_list_of("events", events, Event)
    names = event_names(events)
    problems = []
    for k, event in enumerate(events):
        if names[k] in names[:k]:
            problems.append(Problem(f"events[{k}]", f"repeats the name {names[k]!r}"))
        made_for = getattr(event.function, "arm", arm)
        if made_for is not arm and getattr(made_for, "spec", arm.spec) != arm.spec:
            hint = "With a plant, create the events for the plant."
            problems.append(Problem(f"events[{k}]", "was created for another arm", hint=hint))
    if problems:
        raise InputError(*problems)
    return EventLog(list(events), names) if events else None


def event_variables(arm: Arm, log: EventLog) -> dict[str, Any]:
    """Return the variables over ``event``: time, name, direction, coordinates and rates."""
    found = log.found
    states = np.array([arm.unpadded(one.state) for one in found]).reshape(len(found), 2, arm.dof)
    names = np.array([log.names[one.place] for one in found], dtype=None if found else "U1")
    times = np.array([one.time for one in found])
    directions = np.array([one.direction for one in found], dtype=np.int64)
    axes = ("event", "coordinate")
    modal = "rad or m kg^0.5"
    return {
        "event_time": ("event", times, {"units": "s", "long_name": "time of the event"}),
        "event_name": ("event", names, {"long_name": "name of the event"}),
        "event_direction": (
            "event",
            directions,
            {"units": "1", "long_name": "1 where the function rises through zero, -1 falls"},
        ),
        "event_q": (axes, states[:, 0], {"units": modal, "long_name": "coordinates at the event"}),
        "event_qd": (
            axes,
            states[:, 1],
            {"units": "rad/s or m kg^0.5/s", "long_name": "rates of the coordinates at the event"},
        ),
    }
