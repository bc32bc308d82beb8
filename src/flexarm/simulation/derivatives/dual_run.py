"""A run in dual numbers: its numbers, its steps in eight directions, and its channels."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm.actions import Environment
from flexarm.arm.arm import Arm
from flexarm.arm.observe import Observed, named_channels, with_energies
from flexarm.arm.stations import place_gauges
from flexarm.integrate.base import FloatArray, Progress, Status, System
from flexarm.kernels.compilation.cache import Entry
from flexarm.kernels.compilation.duals import DualArray, Duals
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.kernels.layout import ArmConstants, Array, Workspace, new_workspace, run_time_sizes
from flexarm.kernels.observation.observables import POSE_COLUMNS, observe_many, poses_many
from flexarm.kernels.observation.shapes import gauge_strains
from flexarm.simulation.run.stepping import Run

#: Steps in one compiled call, after which Ctrl-C is noticed.
_STEPS = 4096
#: Samples whose poses are computed together, which bounds the scratch memory of long runs.
_CHUNK = 1024
#: Fields of ``Loads`` that depend on the arm.
_PLACED = "weight", "lever", "rows", "slopes", "shortening"
#: Channels that are not linear in the states and the observed quantities.
_NONLINEAR = {
    *("link_tip_deflection", "link_tip_slope", "link_tip_deflection_rate", "link_tip_slope_rate")
}


class ArmInputs(NamedTuple):
    """Numbers that depend on the parameters of an arm, or their derivatives by one of them.

    The arrays before the gauges are those of ``ArmConstants``, the next five those of ``Loads``,
    the last three those of ``Contacts``; shapes as there.
    """

    arm: Array
    body: Array
    mode: Array
    centrifugal: Array
    shortening: Array
    closure: Array
    ends: Array
    knots: Array
    gauges: Array  # (gauges, m) strain per modal coordinate
    load_weight: Array
    load_lever: Array
    load_rows: Array
    load_slopes: Array
    load_shortening: Array
    point_rows: Array
    point_shortening: Array
    point_law: Array

    @property
    def constants(self) -> ArmConstants:
        """The constants of the arm."""
        return ArmConstants(*self[: len(ArmConstants._fields)])


class Inputs(NamedTuple):
    """All numbers of a run that parameters change, or their derivatives by one parameter."""

    arm: ArmInputs
    state: Array  # (2, n, 1 + m) at the start
    torque: Array  # (pieces, 4, n) coefficients of the drive
    load_value: Array  # (loads, 3)


def arm_inputs(arm: Arm, environment: Environment) -> ArmInputs:
    """Return the numbers of an arm with loads and contacts."""
    placed = Environment(environment.loads, None, environment.contacts).placed(arm)
    contacts = placed.contacts
    numbers: list[Array] = [*arm.assembly.constants, place_gauges(arm, arm.gauges)[0]]
    numbers += [getattr(placed, name) for name in _PLACED]
    numbers += [contacts.rows, contacts.shortening, contacts.law]
    return ArmInputs(*numbers)


def inputs_of_run(run: Run, environment: Environment) -> Inputs:
    """Return the numbers of a run that has been simulated."""
    assert run.history is not None
    system = run.system(run.history)
    drive = system.drive
    own = arm_inputs(run.arm, environment)
    # The run may have prescribed joints, and its contacts know the mobility of the arm.
    own = own._replace(**system.constants._asdict(), point_law=drive.loads.contacts.law)
    return Inputs(own, run.samples[0].copy(), drive.coefficients, drive.amplitude)


def no_change(inputs: Inputs) -> Inputs:
    """Return derivatives of zero, which must not be modified."""
    return Inputs(
        ArmInputs(*(_zeros(array) for array in inputs.arm)),
        *(_zeros(array) for array in inputs[1:]),
    )


def _zeros(array: Array) -> Array:
    return np.broadcast_to(np.float64(0.0), array.shape)


class DualRun(NamedTuple):
    """Samples of a run and the numbers of its arm, as dual numbers."""

    samples: DualArray  # (samples, 2, n, 1 + m)
    constants: ArmConstants
    gauges: DualArray  # (gauges, m)
    steps: int
    events: DualArray = None  # (events, 2, n, 1 + m)


class DualStepper:
    """Repetition of a run that has been simulated, with derivatives in up to eight directions.

    The steps are chosen by the values alone, so that they are those of the run.
    """

    def __init__(self, run: Run, inputs: Inputs, by: Sequence[Inputs]) -> None:
        assert run.history is not None
        numbers = dual_inputs(inputs, by)
        self._run, self._gauges = run, numbers.arm.gauges
        self.system = dual_system(run.system(run.history), numbers)
        step = run.progress.step if run.default_step is not None else 0.0
        self.progress = self._progress(0.0, numbers.state, step)
        self._samples: DualArray = Duals.zeros(len(run.sample_times), *numbers.state.shape)
        events = run.watch.log.found if run.watch is not None else []
        self._waiting = [event.time for event in events]
        self._events: list[DualArray] = []

    def _progress(self, time: float, state: DualArray, step: float) -> Progress:
        entry = Entry(self._run.integrator.stepper)
        return Progress(time, state, step, entry=entry)

    def advance(self, until: float) -> None:
        """Advance to a time (s), and compute the states at the events up to it."""
        seen = bool(self._waiting) and self._waiting[0] <= until
        start = (self.progress.time, self.progress.state.copy()) if seen else None
        self._carry(self.progress, until, self._run.sample_times, self._samples)
        while start is not None and self._waiting and self._waiting[0] <= until:
            self._events.append(self._at_event(self._waiting.pop(0), *start))

    def _carry(
        self, progress: Progress, until: float, times: FloatArray, samples: DualArray
    ) -> None:
        run, status = self._run, Status.PAUSED
        while status == Status.PAUSED:
            now = self.system, run.tolerance, progress, until
            status = run.integrator.advance(*now, times, samples, _STEPS)
        if status != Status.DONE:
            raise run.failure(status)

    def _at_event(self, time: float, since: float, start: DualArray) -> DualArray:
        """Return the state at an event, from the last sample or ``start``, as ``simulate`` does."""
        # Unlike in the search of the run, the step is that after the interval, not before it: the
        # samples of the interval are needed to know where to begin. The derivatives of the state
        # at a given time depend on it only within the tolerance of the steps.
        place = int(np.searchsorted(self._run.sample_times, time)) - 1
        begin, state = since, start.copy()
        if place >= 0 and self._run.sample_times[place] >= since:
            begin = float(self._run.sample_times[place])
            state = Duals(self._samples.array[place].copy())
        progress = self._progress(begin, state, self.progress.step)
        self._carry(progress, time, np.zeros(0), Duals.zeros(0, *state.shape))
        return progress.state

    def result(self) -> DualRun:
        """Return the samples, and the states at the events."""
        found = [event.array for event in self._events]
        events = np.array(found).reshape(len(found), *self._samples.array.shape[1:])
        log = None if self._run.watch is None else self._run.watch.log
        if log is not None and log.ended_by is not None:
            self._samples.array[-1] = events[-1]
        return self.at(self._samples)._replace(events=Duals(events))

    def at(self, states: DualArray) -> DualRun:
        """Return states (k, 2, n, 1 + m) as samples of the run."""
        return DualRun(states, self.system.constants, self._gauges, self.progress.steps)


def run_in_duals(run: Run, inputs: Inputs, by: Sequence[Inputs]) -> DualRun:
    """Repeat a run without a controller; see `DualStepper`."""
    stepper = DualStepper(run, inputs, by)
    stepper.advance(run.duration)
    return stepper.result()


def dual_inputs(inputs: Inputs, by: Sequence[Inputs]) -> Inputs:
    """Return the numbers of a run as dual numbers."""
    arm = zip(inputs.arm, *(one.arm for one in by), strict=True)
    rest = zip(inputs[1:], *(one[1:] for one in by), strict=True)
    return Inputs(ArmInputs(*_joined(arm)), *_joined(rest))


def _joined(columns: Any) -> Iterator[Any]:
    for value, *slopes in columns:
        yield Duals.of(value, np.stack(slopes))


def dual_system(system: System, numbers: Inputs) -> System:
    """Return a system with dual numbers; integers and step control keep their type."""
    drive, own = system.drive, numbers.arm
    work: Any = {
        name: Duals.zeros(*array.shape)
        for name, array in new_workspace(system.constants)._asdict().items()
    }
    fields: Any = own._asdict()
    points = {name: fields[f"point_{name}"] for name in ("rows", "shortening", "law")}
    seen = drive.loads.contacts.seen.copy()
    contacts = drive.loads.contacts._replace(**points, seen=seen)
    placed = {name: fields[f"load_{name}"] for name in _PLACED}
    value, base = numbers.load_value.copy(), drive.loads.base_acceleration.copy()
    loads = drive.loads._replace(**placed, value=value, base_acceleration=base, contacts=contacts)
    moved: Any = drive._replace(
        breaks=drive.breaks.copy(),  # a closed loop writes them
        coefficients=numbers.torque,
        loads=loads,
        amplitude=numbers.load_value,
    )
    return System(run_time_sizes(system.constants), own.constants, moved, Workspace(**work))


def channel_derivatives(
    arm: Arm, run: DualRun, count: int, names: Collection[str]
) -> list[dict[str, FloatArray]]:
    """Return the derivatives of channels (samples, ...) in each of ``count`` directions."""
    samples = run.samples.array
    parts: list[list[dict[str, FloatArray]]] = [[] for _ in range(count)]
    for first in range(0, len(samples), _CHUNK):
        states = Duals(samples[first : first + _CHUNK])
        observed = _observed(arm, run, states, with_energies(names))
        for place, found in enumerate(parts):
            found.append(_in_direction(arm, [states, *observed], place, names))
    return [
        {name: np.concatenate([part[name] for part in found]) for name in names} for found in parts
    ]


def _in_direction(
    arm: Arm, quantities: Sequence[DualArray | None], place: int, names: Collection[str]
) -> dict[str, FloatArray]:
    """Return the derivatives of channels in one direction."""

    def channels(form: Callable[[Duals, Any], Any], chosen: set[str]) -> dict[str, FloatArray]:
        if not chosen:
            return {}
        parts: list[Any] = [
            None if part is None else form(part, part.array[..., 1 + place]) for part in quantities
        ]
        return named_channels(arm, parts[0], Observed(*parts[1:]), chosen)

    linear = channels(lambda duals, slopes: slopes, set(names) - _NONLINEAR)
    other = channels(
        lambda duals, slopes: duals.value + 1j * STEP * slopes, _NONLINEAR.intersection(names)
    )
    return linear | {name: array.imag / STEP for name, array in other.items()}


def _observed(
    arm: Arm, run: DualRun, states: DualArray, energies: bool
) -> tuple[DualArray, DualArray, DualArray, DualArray | None]:
    """Return poses, tips, energies and strains of states (samples, 2, n, 1 + m)."""
    count, sizes = states.shape[0], arm.assembly.sizes
    poses: DualArray = Duals.zeros(count, arm.assembly.bodies, POSE_COLUMNS)
    tips: DualArray = Duals.zeros(count, 6)
    energy: DualArray = Duals.zeros(count, 3)
    if energies:
        observe_many(sizes, run.constants, states, poses, tips, energy)
    else:
        poses_many(sizes, run.constants, states, poses, tips)
    strains: DualArray = None
    if arm.gauges:
        strains = Duals.zeros(count, len(arm.gauges))
        bodies = place_gauges(arm, arm.gauges)[1]
        gauge_strains(sizes, states, bodies, run.gauges, strains)
    return poses, tips, energy, strains
