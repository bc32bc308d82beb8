"""Event location: find sign changes between samples, then integrate again to the crossing.

Between two samples of a run the arm is integrated again from the earlier one, with the method and
the tolerances of the run, to the times that a root finder requests. This works with every
integrator, and an event is as accurate as the run.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, SimulationError, check_array
from flexarm.integrate.base import FloatArray, Integrator, Progress, Status, System, Tolerance
from flexarm.simulation.run.events import Event, EventLog, Found

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
    """Search for events in the samples of a run as they are computed, with a log of the results.

    Attributes:
        arm: the simulated arm.
        integrator, tolerance: method and tolerances of the run, for locating a crossing.
        log: the requested events, and those found.
    """

    arm: Arm
    integrator: Integrator
    tolerance: Tolerance
    log: EventLog
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
        """Continue the search after a jump of the state; log and return the events in it.

        An event that ends the run is the last one.

        Args:
            before: (2, n, 1 + m), the state before the jump.
        """
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

        Raises:
            SimulationError: if an event function raises or does not return one finite number.
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
        points = _Points(self._last, times, states, values)
        for k in points.crossings():
            ended = self._between(system, step, points[k], points[k + 1])
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
            status = self.integrator.advance(
                system, self.tolerance, progress, until, no_times, no_samples, _STEPS_A_CALL
            )
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


class _Points:
    """Samples of a search as points, preceded by the last point of the search before."""

    def __init__(
        self, last: _Point | None, times: FloatArray, states: FloatArray, values: FloatArray
    ) -> None:
        self._before = [] if last is None else [last]
        self._times, self._states, self._values = times, states, values

    def __getitem__(self, k: int) -> _Point:
        if k < len(self._before):
            return self._before[k]
        k -= len(self._before)
        return _Point(float(self._times[k]), self._states[k], self._values[k])

    def crossings(self) -> list[int]:
        """Return the indices of the points after which a value changes its sign."""
        values = np.vstack([*(point.values for point in self._before), self._values])
        crossed = np.any(_crossed(values[:-1], values[1:]), axis=1)
        return [int(k) for k in np.flatnonzero(crossed)]


def _crossed(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return whether values reached or crossed zero; a value that starts at zero does not count."""
    crossed: FloatArray = (before != 0.0) & (np.sign(before) * np.sign(after) <= 0.0)
    return crossed


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
