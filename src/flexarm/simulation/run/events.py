"""Events of a run, user-defined or built-in, and their search: sign changes between samples.

Between two samples of a run the arm is integrated again from the earlier one, with the method and
the tolerances of the run, to the times that a root finder requests. This works with every
integrator, and an event is as accurate as the run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.actions import place_contacts
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import check_joint
from flexarm.arm.observe import contact_values, tips_of
from flexarm.base.arguments import check_direction, check_kind, check_list_of, check_number
from flexarm.base.errors import (
    InputError,
    Problem,
    SimulationError,
    check_array,
    public_call,
    raise_any,
    shown,
)
from flexarm.integrate.base import FloatArray, Integrator, Progress, Status, System, Tolerance
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
        raise_any(problems)


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
    index = check_joint(arm, "joint", joint)
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
    placed = place_contacts(arm, [check_kind("contact", contact, Contact)])
    return Event(_Gap(arm, placed, contact), name, direction, terminal)


def events_of(specs: Sequence[EventSpec], arm: Arm) -> list[Event]:
    """Create the events of a scenario for ``arm``."""
    events = []
    for spec in specs:
        common: dict[str, Any] = {"name": spec.name, "terminal": spec.terminal}
        common["direction"] = {"both": 0, "rising": 1, "falling": -1}[spec.direction]
        if isinstance(spec, JointEvent):
            angle = spec.stop if spec.angle is None else spec.angle
            assert angle is not None  # the model requires one of the two
            events.append(joint_event(arm, spec.joint, angle, **common))
        else:
            events.append(tip_event(arm, spec.point, spec.normal, **common))
    return events


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
    """Validate the events of a run of ``arm``; return their log, or None without events."""
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
    raise_any(problems)
    return EventLog(list(events), names) if events else None


def event_variables(arm: Arm, log: EventLog) -> dict[str, Any]:
    """Return the variables over ``event``: time, name, direction, coordinates and rates."""
    found = log.found
    states = np.array([arm.unpadded(one.state) for one in found]).reshape(len(found), 2, arm.dof)
    names = np.array([log.names[one.place] for one in found], dtype=None if found else "U1")
    times = np.array([one.time for one in found])
    directions = np.array([one.direction for one in found], dtype=np.int64)
    axes = ("event", "coordinate")
    modal, modal_rates = "rad or m kg^0.5", "rad/s or m kg^0.5/s"
    rising = "1 where the function rises through zero, -1 falls"
    coordinates, rates = "coordinates at the event", "rates of the coordinates at the event"
    return {
        "event_time": ("event", times, {"units": "s", "long_name": "time of the event"}),
        "event_name": ("event", names, {"long_name": "name of the event"}),
        "event_direction": ("event", directions, {"units": "1", "long_name": rising}),
        "event_q": (axes, states[:, 0], {"units": modal, "long_name": coordinates}),
        "event_qd": (axes, states[:, 1], {"units": modal_rates, "long_name": rates}),
    }


#: Samples processed at once, which bounds the scratch memory of long runs.
_CHUNK = 4096
#: Tolerance of the event time: a fraction of the sample interval, and a multiple of rounding.
_TIME_SHARE, _ROUNDING = 1e-12, 4.0 * np.finfo(np.float64).eps
#: Maximum number of function evaluations for one event; bisection alone would need 40.
_MOST_TRIALS = 100
_STEPS_A_CALL = 1024


class _Point(NamedTuple):
    """State at one time and the values of all events there."""

    time: float
    state: FloatArray  # (2, n, 1 + m)
    values: FloatArray  # (events,)


class Mark(NamedTuple):
    """State of a search: number of processed samples, the last one, and number of events found."""

    seen: int
    last: _Point | None
    found: int


@dataclass(eq=False)
class Watch:
    """Search for events in the samples of a run as they are computed, with a log of the results."""

    arm: Arm  # the simulated arm
    integrator: Integrator  # method and tolerances of the run, for locating a crossing
    tolerance: Tolerance  # method and tolerances of the run, for locating a crossing
    log: EventLog  # the requested events, and those found
    _seen: int = 0  # samples processed
    _last: _Point | None = field(default=None, repr=False)

    def mark(self) -> Mark:
        """Return the state of the search, for ``restore``."""
        return Mark(self._seen, self._last, len(self.log.found))

    def restore(self, mark: Mark) -> None:
        """Return to an earlier state of the search and discard the events found since then."""
        self._seen, self._last = mark.seen, mark.last
        del self.log.found[mark.found :]

    def go_on(self, progress: Progress, tolerance: Tolerance) -> None:
        """Continue the search from the present state of the run."""
        self.tolerance, self._seen = tolerance, progress.sample
        self._last = self._point(progress.time, progress.state)

    def jump(self, before: FloatArray, progress: Progress, tolerance: Tolerance) -> list[Found]:
        """Continue the search after a jump of the state; log and return the events in it."""
        left = self._point(progress.time, before)
        self.go_on(progress, tolerance)
        right, found = self._last, []
        if left is None or right is None:
            return []
        for place in np.flatnonzero(_crossed(left.values, right.values)).tolist():
            direction = -int(np.sign(left.values[place]))
            if self.log.events[place].direction in (0, direction):
                found.append(Found(place, right.time, right.state, direction))
        found.sort(key=lambda one: self.log.events[one.place].terminal)
        self.log.found += found
        return found

    def _point(self, time: float, state: FloatArray) -> _Point | None:
        """Return the events at a state (2, n, 1 + m); None if a function fails there."""
        values, _ = self._values(np.array([time]), state[None])
        return _Point(time, state.copy(), values[-1]) if len(values) else None

    def look(
        self,
        system: System,
        progress: Progress,
        sample_times: FloatArray,
        samples: FloatArray,
        status: Status,
    ) -> Found | None:
        """Search the samples since the last call; return the event that stops the run, or None.

        An event stops the run if it is terminal or the arm changes there.

        Unless the integrator only paused, its last state counts as a sample, because the system
        may change from there on.
        """
        first, self._seen = self._seen, progress.sample
        for start in range(first, progress.sample, _CHUNK):
            part = slice(start, min(start + _CHUNK, progress.sample))
            ended = self._search(system, progress.step, sample_times[part], samples[part])
            if ended is not None:
                return ended
        if status == Status.PAUSED:
            return None
        now = np.array([progress.time]), progress.state[None]
        return self._search(system, progress.step, *now)

    def _search(
        self, system: System, step: float, times: FloatArray, states: FloatArray
    ) -> Found | None:
        """Search samples (k,), (k, 2, n, 1 + m) in order; skip those up to the last one."""
        if self._last is not None:
            new = times > self._last.time
            times, states = times[new], states[new]
        if not times.size:
            return None
        values, failure = self._values(times, states)
        if self._last is not None:
            times = np.append(self._last.time, times)
            states = np.concatenate([self._last.state[None], states])
            values = np.vstack([self._last.values, values])
        crossed = np.any(_crossed(values[:-1], values[1:]), axis=1)
        for k in np.flatnonzero(crossed).tolist():
            ends = (_Point(float(times[i]), states[i], values[i]) for i in (k, k + 1))
            ended = self._between(system, step, *ends)
            if ended is not None:
                return ended
        if failure is not None:
            raise failure
        self._last = _Point(float(times[-1]), states[-1].copy(), values[-1])
        return None

    def _between(self, system: System, step: float, left: _Point, right: _Point) -> Found | None:
        """Locate and log the events between two points, the earliest first."""
        found = []
        for place in np.flatnonzero(_crossed(left.values, right.values)):
            event = self.log.events[place]
            direction = -int(np.sign(left.values[place]))
            if event.direction in (0, direction):
                time, state = self._locate(system, step, int(place), left, right)
                found.append(Found(int(place), time, state, direction))
        for one in sorted(found, key=lambda one: one.time):
            self.log.found.append(one)
            stops = self.log.names[one.place] in self.log.triggers
            if stops or self.log.events[one.place].terminal:
                return one
        return None

    def _locate(
        self, system: System, step: float, place: int, left: _Point, right: _Point
    ) -> tuple[float, FloatArray]:
        """Return time and state of the crossing, at zero or just beyond it within the tolerance."""
        event = self.log.events[place]
        start, end = float(left.values[place]), float(right.values[place])
        beyond = right.time, right.state

        def value(t: float) -> float:
            nonlocal beyond
            if t <= left.time:
                return start
            if t >= right.time:
                return end
            state = self._carried(system, step, left, t)
            here = self._value(event, self.log.names[place], t, state)
            if here * start <= 0.0 and t < beyond[0]:
                beyond = t, state
            return here

        allowed = max(_TIME_SHARE * (right.time - left.time), _ROUNDING * right.time)
        if right.time - left.time > allowed:
            from scipy.optimize import brentq

            brentq(value, left.time, right.time, xtol=allowed, rtol=_ROUNDING, maxiter=_MOST_TRIALS)
        return beyond[0], beyond[1].copy()

    def _carried(self, system: System, step: float, start: _Point, until: float) -> FloatArray:
        """Integrate from a point to a time; return the state (2, n, 1 + m)."""
        progress = Progress(start.time, start.state.copy(), step)
        no_times, no_samples = np.zeros(0), np.zeros((0, *start.state.shape))
        status = Status.PAUSED
        while status == Status.PAUSED:
            target = until, no_times, no_samples, _STEPS_A_CALL
            status = self.integrator.advance(system, self.tolerance, progress, *target)
        if status != Status.DONE:
            raise SimulationError(until, f"an event was not located: {status.sentence}")
        return progress.state

    def _values(
        self, times: FloatArray, states: FloatArray
    ) -> tuple[FloatArray, SimulationError | None]:
        """Return values (samples, events) up to the first failing function call, and its error."""
        q, qd = self.arm.unpadded(states[:, 0]), self.arm.unpadded(states[:, 1])
        columns: list[FloatArray] = []
        first: SimulationError | None = None
        for event, name in zip(self.log.events, self.log.names, strict=True):
            column = _at_once(event, times, q, qd)
            if column is None:
                column, failure = self._one_by_one(event, name, times, states)
                if failure is not None and (first is None or failure.time < first.time):
                    first = failure
            columns.append(column)
        count = min(map(len, columns))
        return np.stack([column[:count] for column in columns], axis=1), first

    def _one_by_one(
        self, event: Event, name: str, times: FloatArray, states: FloatArray
    ) -> tuple[FloatArray, SimulationError | None]:
        values: list[float] = []
        for t, state in zip(times, states, strict=True):
            try:
                values.append(self._value(event, name, float(t), state))
            except SimulationError as error:
                return np.array(values), error
        return np.array(values), None

    def _value(self, event: Event, name: str, t: float, state: FloatArray) -> float:
        """Evaluate an event function at one state (2, n, 1 + m)."""
        q, qd = self.arm.unpadded(state[0]), self.arm.unpadded(state[1])
        given: object
        try:
            if getattr(event.function, "vectorized", False):
                given = np.asarray(event.function(np.array([t]), q[None], qd[None]))
                given = given[0] if given.shape == (1,) else given
            else:
                given = event.function(t, q, qd)
        except Exception as error:
            reason = f"the event {name!r} failed with {type(error).__name__}: {error}"
            raise SimulationError(t, reason, "", (q, qd)) from error
        try:
            return float(check_array("its value", given, ()))
        except InputError as error:
            placed = error.at(f"event {name!r}")
            reason = f"the event returned an unusable value: {placed}"
            raise SimulationError(t, reason, "", (q, qd)) from None


def _crossed(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return whether values reached or crossed zero; a value that starts at zero does not count."""
    return np.asarray((before != 0.0) & (np.sign(before) * np.sign(after) <= 0.0))


def _at_once(event: Event, times: FloatArray, q: FloatArray, qd: FloatArray) -> FloatArray | None:
    """Return values (k,) of a vectorized function; None if it is not vectorized or fails."""
    if not getattr(event.function, "vectorized", False):
        return None
    try:
        values = np.asarray(event.function(times, q, qd), dtype=np.float64)
    except Exception:
        return None  # single calls then find the sample at which the function fails
    if values.shape != times.shape or not np.all(np.isfinite(values)):
        return None
    return values
