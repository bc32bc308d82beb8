"""Changes of the simulated arm during a run: their times, and the arm and its state after each.

The coordinates do not change, because positions have no time to. The rates follow from the mass
matrices before and after, M and M+; theory page "arms that change", (V.1) to (V.4).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import IntArray
from flexarm.base.arguments import check_list_of, check_number
from flexarm.base.errors import InputError, Problem, raise_any, shown
from flexarm.base.user_functions import call
from flexarm.integrate.base import FloatArray
from flexarm.model import ArmSpec, Change
from flexarm.model.environment import (
    PAYLOAD_MASS,
    ValueTable,
    change_faults,
    check_possible,
    original_number,
)
from flexarm.model.paths import number_at, with_number, with_numbers

if TYPE_CHECKING:
    from flexarm.simulation.run.events import EventLog

#: Eigenvalues of the change of the mass matrix below this fraction of the matrix are rounding.
_ROUNDING = 1e-12
#: Relative difference of two mode shapes that is rounding.
_SAME_SHAPE = 1e-9
#: Largest number of intervals of one change, each of which takes an arm of its own.
_MOST_INTERVALS = 10**5
_Item = TypeVar("_Item")
#: Largest number of changed arms of a run whose loop is analysed.
_MOST_ANALYSED = 8
#: Relative difference of two times that is rounding: they are one instant.
ROUNDING = 1e-12


class ChangedState(NamedTuple):
    """State after a change, and the change of the arm's mechanical energy."""

    state: FloatArray  # (2, n, 1 + m)
    energy: float  # J, after minus before


def check_same_coordinates(path: str, before: Arm, after: Arm) -> None:
    """Raise if two arms do not have the same coordinates."""
    rule = "be a number that may change during a run"
    sizes = [(arm.dof, arm.assembly.bodies, arm.assembly.has_bristles) for arm in (before, after)]
    if sizes[0] != sizes[1]:
        hint = "The change adds or removes coordinates, bristles or an eccentric payload."
        raise InputError(Problem("changes", rule, repr(path), hint))
    straight = np.zeros(before.dof)
    if not np.allclose(before.closure_gaps(straight), after.closure_gaps(straight), rtol=1e-12):
        hint = "It opens the loops of the mechanism; a joint that slides can move a point."
        raise InputError(Problem("changes", rule, repr(path), hint))
    for one, other in zip(before.assembly.pieces, after.assembly.pieces, strict=True):
        old, new = one.shapes.basis, other.shapes.basis
        if np.abs(new - old).max(initial=0.0) > _SAME_SHAPE * np.abs(old).max(initial=0.0):
            hint = f"It changes the mode shapes of link {one.link + 1}."
            raise InputError(Problem("changes", rule, repr(path), hint))


def after_change(
    before: Arm,
    remaining: Arm,
    after: Arm,
    state: FloatArray,
    free: IntArray,
    impulse: FloatArray | float,
) -> ChangedState:
    """Return the state of an arm after its parameters have changed at one instant.

    Inertia that is removed takes its momentum with it, (V.2). The momentum of the remaining arm
    and that of added mass are those of the arm afterwards: M+ qd+ = M qd + impulse, (V.1).
    """
    q, qd = before.unpadded(state)
    M, M_after = remaining.mass_matrix(q), after.mass_matrix(q)
    rates = qd.copy()
    if _difference(M, M_after).any():
        missing = M @ qd + impulse - M_after @ qd
        rates[free] += _jump(after, q, qd, M_after, missing, free)
    energy = after.energy(q, rates).total - before.energy(q, qd).total
    changed = after.padded(np.stack([q, rates]))
    if after.assembly.has_bristles:  # their deflection remains, in proportion to ``root``
        old, new = (arm.assembly.constants.bristles[:, 1] for arm in (before, after))
        changed[1, :, -1] = state[1, :, -1] * new / np.where(old > 0.0, old, 1.0)
        # Half the square is the energy of the bristles.
        energy += 0.5 * float(np.sum(changed[1, :, -1] ** 2 - state[1, :, -1] ** 2))
    return ChangedState(changed, energy)


def _jump(
    arm: Arm, q: FloatArray, qd: FloatArray, M: FloatArray, missing: FloatArray, free: IntArray
) -> FloatArray:
    """Return the jump of the free rates by a missing momentum (dof,); loops stay closed.

    The impulses of closures are the unknowns beside the rates: J (qd + jump) = 0.
    """
    rows = arm.closure_rows
    matrix = M[np.ix_(free, free)]
    if not rows:
        return np.asarray(np.linalg.solve(matrix, missing[free]))
    J = arm.closure_jacobian(q)
    whole = np.block([[matrix, -J[:, free].T], [J[:, free], np.zeros((rows, rows))]])
    right = np.concatenate([missing[free], -J @ qd])
    return np.asarray(np.linalg.solve(whole, right)[: free.size])


def removes_inertia(path: str, before: Arm, after: Arm, state: FloatArray) -> bool:
    """Return whether a change of the number at a path removes inertia from the arm.

    It does if the mass matrix M+ - M has negative eigenvalues only, unless the number is a
    position, which moves inertia.
    """
    if ".offset" in path:
        return False
    q = before.unpadded(state)[0]
    values = _difference(before.mass_matrix(q), after.mass_matrix(q))
    return bool(values.any() and values.max() <= 0.0)


def _difference(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return the eigenvalues of the change of a mass matrix, relative to it; rounding is zero."""
    scale = 1.0 / np.sqrt(np.diag(after))
    values = np.linalg.eigvalsh((after - before) * np.outer(scale, scale))
    return np.asarray(np.where(np.abs(values) > _ROUNDING * len(values), values, 0.0))


def payload_impulse(arm: Arm, state: FloatArray, mass: float, velocity: FloatArray) -> FloatArray:
    """Return the generalised momentum (dof,) of a mass at the payload's centre of mass, (V.3)."""
    q, offset = arm.unpadded(state)[0], np.array(arm.spec.payload.offset)
    angle = arm.tip(q)[2]
    lever = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ offset
    rows = np.array([arm.tip_velocity(q, unit) for unit in np.eye(arm.dof)])
    J = rows[:, :2] + np.outer(rows[:, 2], [-lever[1], lever[0]])
    return np.asarray(mass * (J @ velocity))


class ChangedArm(NamedTuple):
    """Arm after changes during a run."""

    plant: Arm
    begin: float  # s, of its part of the run
    end: float  # s
    cause: str  # the changes, in words


@dataclass
class Happened:
    """A change that has happened."""

    change: Change
    time: float  # s, its beginning
    start: float  # the number before
    end: float  # the last number
    energy: float = 0.0  # J, its part of the change of the mechanical energy, over all its instants


@dataclass(frozen=True)
class _Course:
    """Numbers of one change over time."""

    times: FloatArray  # (k,) s from the beginning of the change, the first is 0
    numbers: FloatArray  # (k,) the number from each time on


@dataclass(eq=False)
class ArmChanges:
    """Changes of the arm during one run.

    Attributes:
        first: the arm at the start of the run.
        arm: the arm at present.
        happened: changes that have happened, in order.
        waiting: names of the events that changes still wait for.
    """

    first: Arm
    changes: Sequence[Change]
    courses: list[_Course]
    arm: Arm = field(init=False)
    happened: list[Happened] = field(init=False)
    _due: list[tuple[float, int, int]] = field(init=False)  # time, change, place in its course
    _log: dict[int, Happened] = field(init=False)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Return to the start of the run."""
        self.arm, self.happened, self._log = self.first, [], {}
        self._due = []
        for k, change in enumerate(self.changes):
            if not isinstance(change.at, str):
                self._begin(k, float(change.at))
        self.waiting = {change.at for change in self.changes if isinstance(change.at, str)}

    @property
    def times(self) -> FloatArray:
        """Known times of the changes to come, s, ascending."""
        return np.array([time for time, _, _ in self._due])

    @property
    def next_time(self) -> float:
        """Time of the next change, s; infinite if none is known."""
        return self._due[0][0] if self._due else math.inf

    def trigger(self, event: str, time: float) -> None:
        """Begin the changes that wait for an event, at a time (s)."""
        self.waiting.discard(event)
        for k, change in enumerate(self.changes):
            if change.at == event:
                self._begin(k, time)

    def _begin(self, k: int, time: float) -> None:
        course = self.courses[k]
        self._due += [(time + t, k, i) for i, t in enumerate(course.times.tolist())]
        self._due.sort()

    def due(self, time: float) -> bool:
        """Return whether a change is due at a time (s), up to rounding."""
        return self.next_time <= time * (1.0 + ROUNDING)

    def apply(self, time: float, state: FloatArray, free: IntArray) -> tuple[Arm, FloatArray]:
        """Make the changes that are due at a time (s); return the arm and its state.

        All of them share one momentum balance, which does not depend on their order. The energy of
        each is that which it adds to those before it in the list.
        """
        numbers: dict[str, tuple[int, float]] = {}  # of each path the last change counts
        while self.due(time):
            begin, k, i = self._due.pop(0)
            number = float(self.courses[k].numbers[i])
            self._note(k, begin, number)
            numbers[self.changes[k].path] = k, number
        before = remaining = self.arm
        adding: tuple[float, FloatArray] | None = None  # kg, m/s
        spent, found = 0.0, state
        while numbers:
            path, spec = _first_possible(self.arm.spec, {p: n for p, (_, n) in numbers.items()})
            k, number = numbers.pop(path)
            whole, now = self.arm, number_at("path", self.arm.spec, path)
            if number == now:
                continue
            self.arm = Arm(spec)
            check_same_coordinates(path, before, self.arm)
            if removes_inertia(path, whole, self.arm, state):
                same = remaining is whole
                remaining = self.arm if same else Arm(with_number(remaining.spec, path, number))
            if path == PAYLOAD_MASS and number > now and any(self.changes[k].velocity):
                adding = number - now, np.array(self.changes[k].velocity)
            impulse = payload_impulse(self.arm, state, *adding) if adding else 0.0
            found, energy = after_change(before, remaining, self.arm, state, free, impulse)
            self._log[k].energy += energy - spent
            spent = energy
        return self.arm, found

    def ahead(self, duration: float) -> list[ChangedArm]:
        """Return the arms that the changes of a run lead to, before the run.

        A change over many instants, such as a table, is followed at a few of them. Changes at
        events, whose time is unknown, are combined with the arm at the start and with the last arm
        of the changes at known times: those of each event, and those of all events together.
        """
        due = [(time, k, i) for time, k, i in self._due if time < duration]
        found = []
        times = [*evenly(np.unique([time for time, _, _ in due]).tolist()), duration]
        for begin, end in pairwise(times):
            past = [(k, i) for time, k, i in due if time <= begin]
            numbers = {self.changes[k].path: float(self.courses[k].numbers[i]) for k, i in past}
            arm, cause = Arm(with_numbers(self.first.spec, numbers)), f"at t = {begin:g} s"
            found.append(ChangedArm(arm, begin, end, f"after the change of the arm {cause}"))
        arms = [self.first, *(part.plant for part in found[-1:])]
        events = list(dict.fromkeys(c.at for c in self.changes if isinstance(c.at, str)))
        groups = [[name] for name in events] + [events] * (len(events) > 1)
        for names, arm in product(groups, arms):
            numbers = {
                change.path: float(course.numbers[-1])
                for change, course in zip(self.changes, self.courses, strict=True)
                if change.at in names
            }
            cause = f"after the change of the arm at {' and '.join(map(repr, names))}"
            changed = Arm(with_numbers(arm.spec, numbers))
            found.append(ChangedArm(changed, 0.0, duration, cause))
        return found

    def _note(self, k: int, time: float, number: float) -> None:
        """Log the new number of a change at a time (s)."""
        log = self._log.get(k)
        if log is None:
            now = number_at("path", self.arm.spec, self.changes[k].path)
            log = self._log[k] = Happened(self.changes[k], time, now, number)
            self.happened.append(log)
        log.end = number


def evenly(items: Sequence[_Item]) -> list[_Item]:
    """Return at most a few items, evenly chosen, with the first and the last one."""
    count = min(len(items), _MOST_ANALYSED)
    return [items[k] for k in np.linspace(0, len(items) - 1, count).round().astype(int)]


def _first_possible(spec: ArmSpec, numbers: Mapping[str, float]) -> tuple[str, ArmSpec]:
    """Return the first path whose number is possible before the others, and the changed arm."""
    first: InputError | None = None
    for path, number in numbers.items():
        try:
            return path, with_number(spec, path, number)
        except InputError as error:
            first = first or error
    assert first is not None
    raise first


def arm_changes(
    arm: Arm, changes: Sequence[Change], duration: float, log: EventLog | None
) -> ArmChanges | None:
    """Validate the changes of a run of ``arm``; return None without any."""
    changes = check_list_of("changes", changes, Change)
    if not changes:
        return None
    names = [] if log is None else log.names
    problems = [fault.problem() for fault in change_faults(arm.spec, changes, names)]
    for k, change in enumerate(changes):
        if not isinstance(change.at, str) and change.at > duration:
            rule = f"be at most {duration:g} s, the duration of the run"
            problems.append(Problem(f"changes[{k}].at", rule, shown(change.at)))
    raise_any(problems)
    courses = [_course(k, changes, arm.spec, duration) for k in range(len(changes))]
    found = ArmChanges(arm, changes, courses)
    if log is not None:
        log.triggers = set(found.waiting)
    return found


def _course(k: int, changes: Sequence[Change], spec: ArmSpec, duration: float) -> _Course:
    """Return the numbers of a change: those in the middle of its intervals."""
    change = changes[k]
    original = original_number(spec, change)
    scale = 1.0 if change.factor is None else original
    course: Any = change.course
    if isinstance(course, ValueTable):
        edges, values = _tabulated(k, change, course)
    elif callable(course):
        if not math.isfinite(duration):
            rule = "is required with changes that are functions of time"
            raise InputError(Problem("duration", rule, hint="Tables do not need it."))
        begin = 0.0 if isinstance(change.at, str) else float(change.at)
        edges = _edges(k, change, np.array([0.0, max(duration - begin, change.interval)]))
        middle = 0.5 * (edges[:-1] + edges[1:])
        name = f"changes[{k}]"
        edges = edges[:-1]
        values = np.array(
            [check_number(f"{name} at {t:g} s", call(name, course, t)) for t in middle.tolist()]
        )
    else:
        edges, values = np.zeros(1), np.array([float(course)])
    numbers = values * scale
    for number in {float(numbers.min()), float(numbers.max())}:
        check_possible(spec, changes, change.path, number)
    return _Course(edges, numbers)


def _tabulated(k: int, change: Change, table: ValueTable) -> tuple[FloatArray, FloatArray]:
    """Return the beginnings of the intervals of a table, and the values in their middle."""
    times, values = np.array(table.times, float), np.array(table.values, float)
    last = float(times[-1])
    if last <= 0.0:
        return np.zeros(1), values[-1:]
    inner = np.unique(times[(times > 0.0) & (times < last)])
    edges = _edges(k, change, np.array([0.0, *inner, last]))
    middle = 0.5 * (edges[:-1] + edges[1:])
    found = np.append(np.interp(middle, times, values), values[-1])
    kept = np.append(True, np.diff(found) != 0.0)
    return edges[kept], found[kept]


def _edges(k: int, change: Change, knots: FloatArray) -> FloatArray:
    """Divide the spans between knots (s) into equal parts, at most an interval long."""
    parts = np.maximum(np.ceil(np.diff(knots) / change.interval * (1.0 - 1e-9)), 1.0)
    if parts.sum() > _MOST_INTERVALS:
        least = float(knots[-1]) / _MOST_INTERVALS
        rule = f"be at least {least:.3g} s for a change over {float(knots[-1]):.6g} s"
        raise InputError(Problem(f"changes[{k}].interval", rule, shown(change.interval)))
    pieces = [
        np.linspace(a, b, int(n), endpoint=False)
        for a, b, n in zip(knots[:-1], knots[1:], parts, strict=True)
    ]
    return np.concatenate([*pieces, knots[-1:]])


def change_variables(changes: ArmChanges) -> dict[str, Any]:
    """Return the variables over ``change`` of a result: those that have happened, in order."""
    found = changes.happened
    paths = np.array([one.change.path for one in found], dtype=None if found else "U1")
    unit = {"units": "unit of the number"}

    def numbers(name: str) -> FloatArray:
        return np.array([getattr(one, name) for one in found], dtype=np.float64)

    time, energy = "time of the change", "change of the arm's mechanical energy at the change"
    return {
        "change_time": ("change", numbers("time"), {"units": "s", "long_name": time}),
        "change_path": ("change", paths, {"long_name": "path of the number that changes"}),
        "change_from": ("change", numbers("start"), {**unit, "long_name": "number before"}),
        "change_to": ("change", numbers("end"), {**unit, "long_name": "last number"}),
        "change_energy": ("change", numbers("energy"), {"units": "J", "long_name": energy}),
    }
