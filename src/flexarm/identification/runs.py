"""Simulation of records: inputs, initial state, and the outputs as the record contains them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.closed import assembled
from flexarm.base.errors import (
    FlexarmError,
    FlexarmWarning,
    InputError,
    Problem,
    SimulationError,
    warn_caller,
    without_warnings,
)
from flexarm.identification.record import (
    INERTIAL,
    Label,
    MeasuredRecord,
    columns_of,
    place_of,
    treated,
    without_phase,
)
from flexarm.identification.space import (
    Case,
    Space,
    initial_argument,
    leading_joints,
    of_records,
    start_angles,
)
from flexarm.integrate.base import FloatArray
from flexarm.linear import equilibrium, modes
from flexarm.model.arm.mechanism import place_faults
from flexarm.simulation.batch.run import simulate_batch
from flexarm.simulation.calls.inertial import inertial_channels
from flexarm.simulation.calls.preparation import integrator_of
from flexarm.simulation.calls.run import simulate
from flexarm.simulation.derivatives.sensitivities import sensitivities
from flexarm.simulation.histories.loads import PrescribedAngle
from flexarm.simulation.histories.piecewise import PiecewiseCubic, delayed, sampled_torque

#: Phase (rad) of the slowest vibration from sample to sample above which a record misses it.
_UNRESOLVED = np.pi
#: The same above which times without a unit are not those of a bench record.
_ASTRAY = 10.0 * np.pi
#: Evaluations of the dynamics times coordinates of a fit, about ten seconds; and runs of a fit for
#: each free number.
_LONG, _RUNS = 3e7, 10.0
#: Relative tolerances of coarse runs and of those whose differences are taken. At 1e-4, joints that
#: turn freely err by more than the noise of an encoder, and faults are taken for others.
COARSE, _TIGHT = 1e-5, 1e-7


class RecordRun:
    """Simulations of an arm that reproduce one record.

    The arm is that before estimation; a controller uses it as its model. ``labels`` are the
    compared channels, ``measured`` (samples, channels) their filtered values, which have no meaning
    where samples are not ``valid``.
    """

    def __init__(
        self, name: str, record: MeasuredRecord, arm: Arm, options: Mapping[str, Any]
    ) -> None:
        self.name, self.record, self._arm, self._options = name, record, arm, dict(options)
        self.labels = list(record.outputs)
        self._check(arm)
        self.times = times = record.times - record.times[0]
        self._paths, self.measured, self.valid = treated(record)
        self._places = [place_of(arm, label) for label in self.labels]
        constants = [path.simulated(np.ones((times.size, 1))) for path in self._paths]
        self._constant = np.concatenate(constants, axis=1)  # an offset of one as recorded
        compared = list(dict.fromkeys(label.channel for label in self.labels))
        self._inertial = not INERTIAL.keys().isdisjoint(compared)
        #: Channels of simulations that the outputs require.
        self.channels = [name for name in compared if name not in INERTIAL]
        self.channels += ["q", "qd"] * self._inertial
        #: Inputs (samples, joints), in their unit.
        self.samples = np.zeros((times.size, arm.n_joints))
        for label, column in record.inputs.items():
            self.samples[:, place_of(arm, label)] = column
        self.joint_numbers = arm.joint_numbers.tolist()
        #: Index of each joint in the arm, whose fixed joints have no number.
        self.joint_places = [k for k, joint in enumerate(arm.spec.joints) if not joint.fixed]
        self._drive = self._history(self.samples)
        self._prescribed = self._prescribed_joints()
        self._angles, self._held = start_angles(arm, record), leading_joints(arm, record)
        #: Steps of central differences by path, in scales of the parameters
        self.steps: dict[str, float] = {}

    def _check(self, arm: Arm) -> None:
        problems: list[Problem] = []
        for label in [*self.labels, *self.record.inputs]:
            try:
                place_of(arm, label)
            except InputError as error:
                problems += error.problems
        for sensor in self.record.settings.sensors:
            faults = place_faults(arm.spec.links, sensor.link, sensor.station)
            problems += [fault.inside("sensors").problem() for fault in faults]
        windings = [joint.winding is not None for joint in arm.spec.joints if not joint.fixed]
        if self.record.input == "voltage" and not all(windings):
            problems.append(Problem("input", "is voltage, but not every joint has a winding"))
        if self.record.input == "current" and any(windings):
            hint = "A winding is that of a motor driven by a voltage."
            problems.append(Problem("input", "is current, but a joint has a winding", hint=hint))
        angle = self.record.settings.initial_angle
        if angle is not None and len(angle) != arm.n_joints:
            rule = f"have one angle for each of the {arm.n_joints} joints"
            problems.append(Problem("initial_angle", rule, str(len(angle))))
        if problems:
            raise InputError(*(replace(p, where=self.name) for p in problems))

    @property
    def differentiable(self) -> bool:
        """Whether ``sensitivities`` supports the run, its start and its outputs."""
        settled = self.record.settings.initial == "equilibrium"
        return not (settled or self._inertial or "torque" in self.channels)

    @property
    def rtol(self) -> float:
        """Relative tolerance of the runs."""
        return self._options.get("rtol") or _TIGHT

    @property
    def proportional(self) -> bool:
        """Whether a strain is proportional to its gauge's distance: no controller reads it."""
        return self.record.controller is None

    def arguments(self, case: Case) -> dict[str, Any]:
        """Return the arguments of ``simulate``, besides the arm."""
        record = self.record
        common = {**self._options, "rate": record.rate, "duration": record.duration}
        if record.controller is not None:
            loop = {name: getattr(record, name) for name in ("controller", "reference", "hardware")}
            return common | loop
        q, qd = self.state(Arm(case.spec), case)
        state = {"initial": q, "initial_rate": qd, "prescribed": self._prescribed or None}
        return common | state | {"torque": self._torque(case)}

    def beginning(self, most: int, least: int) -> RecordRun | None:
        """Return the run of the first quarter of a record, of at most some samples.

        None if it has fewer than ``least``, or the record has a controller.
        """
        record, samples = self.record, min(most, self.times.size // 4)
        if samples < least or record.controller is not None:
            return None
        data = record.data.isel(time=slice(0, samples))
        part = MeasuredRecord(data, record.settings)
        return type(self)(self.name, part, self._arm, self._options)

    def coarse(self) -> RecordRun:
        """Return the run with larger tolerances, whose errors are far below those of readings."""
        return self._with_rtol(max(self._options.get("rtol") or 0.0, COARSE))

    def fine(self) -> RecordRun:
        """Return the run with tolerances at which differences of two runs mean something."""
        return self._with_rtol(min(self.rtol, _TIGHT))

    def _with_rtol(self, rtol: float) -> RecordRun:
        fixed = self._options.get("step") is not None or self._options.get("integrator") == "rk4"
        if fixed or rtol == self._options.get("rtol"):
            return self
        run = copy(self)
        run._options = {**self._options, "rtol": rtol}
        return run

    def _history(self, samples: FloatArray, late: float = 0.0) -> PiecewiseCubic:
        """Return inputs (samples, joints) over time, after their delay and ``late`` (s)."""
        record = self.record
        history = sampled_torque(
            samples, record.rate, record.duration, samples.shape[1], record.interpolation
        )
        delay = record.settings.delays.get(record.input, 0.0) + late
        return delayed(history, delay) if delay else history

    def _true_input(self, case: Case) -> PiecewiseCubic:
        """Return the input over time without the errors of the record."""
        if not case.errors:
            return self._drive
        samples, late = self.samples.copy(), case.errors.get(f"delays.{self.record.input}", 0.0)
        for label in self.record.inputs:
            place = place_of(self._arm, label)
            samples[:, place] -= case.errors.get(f"offsets.{label.text}", 0.0)
            samples[:, place] /= max(case.errors.get(f"gains.{label.text}", 1.0), 1e-300)
        return self._history(samples, late)

    def disturbed(self, case: Case, signals: Sequence[FloatArray]) -> list[FloatArray | str]:
        """Return the outputs of a case with signals (samples, joints) added to the input."""
        late = case.errors.get(f"delays.{self.record.input}", 0.0)
        drives = [self._history(self.samples + signal, late) for signal in signals]
        with without_warnings():
            return self._open_loop([case] * len(signals), drives)

    def rates(self, case: Case) -> FloatArray | str:
        """Return the joint rates (samples, joints) of a case, or the reason of its failure."""
        try:
            with without_warnings():
                result = simulate(Arm(case.spec), progress=False, **self.arguments(case))
        except FlexarmError as error:
            return str(error)
        return np.asarray(result["joint_rate"].values)

    def simulate(self, cases: Sequence[Case]) -> list[FloatArray | str]:
        """Return the outputs (samples, channels) of each case, or the reason of its failure."""
        with without_warnings():  # the final arm is what users are warned of
            if self.record.controller is not None:
                return [self._controlled(case) for case in cases]
            return self._open_loop(cases)

    def _controlled(self, case: Case) -> FloatArray | str:
        try:
            plant = Arm(case.spec)
        except InputError as error:
            return str(error)
        try:
            result = simulate(self._arm, plant=plant, progress=False, **self.arguments(case))
        except SimulationError as error:
            return str(error)
        return self._outputs({name: result[name].values for name in self.channels}, case)

    def _open_loop(
        self, cases: Sequence[Case], drives: Sequence[PiecewiseCubic] | None = None
    ) -> list[FloatArray | str]:
        runs: dict[int, tuple[Arm, FloatArray, FloatArray]] = {}  # those with a start, by case
        outputs: list[FloatArray | str] = [""] * len(cases)
        for k, case in enumerate(cases):
            try:
                arm = Arm(case.spec)
                runs[k] = arm, *self.state(arm, case)
            except FlexarmError as error:
                outputs[k] = str(error)
        if not runs:
            return outputs
        torques = {k: self._torque(cases[k], drives[k] if drives else None) for k in runs}
        common: dict[str, Any] = {"rate": self.record.rate, "prescribed": self._prescribed or None}
        common |= {"progress": False, **self._options}
        rows: list[tuple[str, dict[str, FloatArray]]] = []
        try:
            if len(runs) == 1:  # without the seven empty lanes of a batch
                ((k, (arm, q, qd)),) = runs.items()
                state: dict[str, Any] = {"initial": q, "initial_rate": qd, "torque": torques[k]}
                result = simulate(arm, self.record.duration, **state, **common)
                rows = [("", {name: result[name].values for name in self.channels})]
            else:
                arms, *starts = zip(*runs.values(), strict=True)
                state = dict(zip(("initial", "initial_rate"), map(np.array, starts), strict=True))
                state |= {"torque": list(torques.values()), "channels": self.channels}
                batch = simulate_batch(list(arms), self.record.duration, **state, **common)
                values = {name: batch[name].values for name in self.channels}
                for row, failure in enumerate(batch["failure"].values.tolist()):
                    rows.append((failure, {name: value[row] for name, value in values.items()}))
        except SimulationError as error:
            rows = [(str(error), {})] * len(runs)
        for (k, (arm, *_)), (failure, channels) in zip(runs.items(), rows, strict=True):
            if self._inertial and not failure:
                arguments = {**self.arguments(cases[k]), "torque": torques[k]}
                motion = channels["q"], channels["qd"]
                sensors = self.record.settings.sensors
                channels |= inertial_channels(arm, sensors, *motion, **arguments)
            outputs[k] = failure or self._outputs(channels, cases[k])
        return outputs

    def _outputs(self, channels: Mapping[str, FloatArray], case: Case) -> FloatArray:
        """Return simulated channels as the record contains them, (samples, channels)."""
        values = {name: values[..., None] for name, values in channels.items()}
        return self.changes(values, case)[..., 0] + self._reading_offsets(case)

    def _reading_offsets(self, case: Case) -> FloatArray:
        """Return the offsets of readings as the record contains them, (samples, channels)."""
        offsets = [case.errors.get(f"offsets.{label.text}", 0.0) for label in self.labels]
        return np.array(offsets) * self._constant

    def reading_errors(self, case: Case, outputs: FloatArray) -> dict[str, FloatArray]:
        """Return the changes of the outputs (samples, channels) by errors of readings, by path."""
        changes, clean = {}, outputs - self._reading_offsets(case)
        for k, label in enumerate(self.labels):
            axis = np.eye(len(self.labels))[k]
            changes[f"offsets.{label.text}"] = self._constant * axis
            gain = case.errors.get(f"gains.{label.text}", 1.0) or 1e-300
            changes[f"gains.{label.text}"] = clean / gain * axis
            late = -np.gradient(clean[:, k : k + 1], axis=0) * self.record.rate
            changes[f"delays.{label.text}"] = late * axis
        return changes

    def changes(self, channels: Mapping[str, FloatArray], case: Case) -> FloatArray:
        """Return the outputs (samples, channels, n) for channels (samples, ..., n)."""
        # The way from a channel to an output is linear: n derivatives of the channels give those of
        # the outputs.
        columns = []
        for label, place, path in zip(self.labels, self._places, self._paths, strict=True):
            values = channels[label.channel]
            values = values.reshape(len(self.times), -1, values.shape[-1])[:, place]
            gain, late = (case.errors.get(f"{kind}.{label.text}") for kind in ("gains", "delays"))
            columns.append(path.simulated(values, late or 0.0) * (1.0 if gain is None else gain))
        return np.stack(columns, axis=1)

    def gauge_number(self, link: int, gauge: int) -> int:
        """Return the number, from 1, of a gauge that is given by indices in the arm."""
        before = [len(one.gauges) for one in self._arm.spec.links[:link]]
        return sum(before) + gauge + 1

    def state(self, arm: Arm, case: Case) -> tuple[FloatArray, FloatArray]:
        """Return the initial coordinates and rates (dof,)."""
        angles = self._angles + case.q[arm.joint_index]
        settled = self.record.settings.initial == "equilibrium"
        if arm.closure_rows and settled:  # measured angles close the loops nearly
            angles = assembled(arm, arm.rest(angles), held=self._held).q[arm.joint_index]
        if settled:
            return equilibrium(arm, angles, contacts=self._options.get("contacts", ())).q, case.qd
        bent = case.q.copy()
        bent[arm.joint_index] = angles
        if not arm.closure_rows:
            return bent, case.qd
        return assembled(arm, bent, case.qd, held=self._held)[:2]

    def _torque(self, case: Case, drive: PiecewiseCubic | None = None) -> PiecewiseCubic:
        drive = drive or self._true_input(case)
        if self.record.input == "voltage":
            constant = Arm(case.spec).motor_torque(np.ones(self._arm.n_joints))
        elif self.record.input == "current":
            assert case.motors is not None
            constant = np.broadcast_to(np.asarray(case.motors.torque_constant), self._arm.n_joints)
        else:
            return drive
        return replace(drive, coefficients=drive.coefficients * constant)

    def _prescribed_joints(self) -> dict[int, PrescribedAngle]:
        record, settings = self.record, self.record.settings
        if not settings.prescribed:
            return {}
        measured = columns_of(record.data, ["joint_angle"])
        delay = settings.delays.get("joint_angle", 0.0)
        histories = {}
        for joint in settings.prescribed:
            angles = measured[Label("joint_angle", joint)]
            if settings.prescribed_cutoff is not None:
                # The filter is of fourth order without phase shift.
                cutoff = settings.prescribed_cutoff
                if cutoff >= 0.5 * record.rate:
                    rule = f"be less than half the rate ({0.5 * record.rate:g} Hz)"
                    raise InputError(Problem("prescribed_cutoff", rule, f"{cutoff:g}"))
                angles = without_phase(angles, cutoff, record.rate, 2)
            angles = np.interp(self.times + delay, self.times, angles)
            histories[joint] = PrescribedAngle.table(self.times, angles, "free")
        return histories


def warn_of_work(runs: Sequence[RecordRun], space: Space) -> None:
    """Warn of records that take long and whose samples are too far apart to contain a vibration.

    InputError if the unit of their times is not stated.
    """
    for k, run in enumerate(runs):
        case = space.case(k, space.start)
        arm = Arm(case.spec)
        with without_warnings():  # the fit does not use this model
            place = run.state(arm, case)[0] if arm.closure_rows else None
            frequency = modes(arm, q=place).frequency_hz
        frequency = frequency[frequency > 0.0]
        if not frequency.size:
            continue
        phase = 2.0 * np.pi * float(frequency[0]) / run.record.rate
        if phase <= _UNRESOLVED:
            continue
        try:
            work = integrator_of(arm, **run.arguments(case)).work
        except InputError:  # a hopeless run
            work = np.inf
        work *= _RUNS * (1 + len(space.slots))
        assumed = "assumed" in run.record.data["time"].attrs
        if work * arm.dof > _LONG or (assumed and phase > _ASTRAY):
            text = (
                f"{run.name}: lasts {run.record.duration:.6g} s with a sample every "
                f"{1.0 / run.record.rate:.3g} s, in which the slowest vibration of the arm turns "
                f"by {phase:.2g} rad, and a fit would take about {work:.0e} evaluations of the "
                "dynamics. Times are in seconds; these may be milliseconds"
            )
            if assumed:
                hint = 'Give time_unit="ms", or "s" if they are right.'
                raise InputError(Problem("time", text, hint=hint))
            warn_caller(text, FlexarmWarning)


#: First step of central differences and its limits, as fractions of the scale of a parameter, the
#: ratio to the best step below which it is wrong, and how often it is corrected.
_STEP, _LEAST, _MOST, _NEAR, _ATTEMPTS = 1e-3, 1e-6, 0.1, 0.1, 3
#: Fewest numbers by which ``sensitivities`` is faster than differences in a closed loop.
_FEWEST_IN_LOOP = 3
#: Numbers that determine the torque of a current or voltage.
_OF_MOTORS = re.compile(r"motors\.|joints\[\d+\]\.(winding|gear_ratio)")
#: Numbers of the arm that only outputs depend on.
_OF_OUTPUTS = re.compile(r"links\[\d+\]\.gauges\[")
_DISTANCE = re.compile(r"links\[(\d+)\]\.gauges\[(\d+)\]\.distance")
_REFUSED = re.compile(r"parameters\[(\d+)\]")


def output_derivatives(
    run: RecordRun, space: Space, record: int, vector: FloatArray, places: NDArray[np.intp]
) -> FloatArray | str:
    """Return derivatives (samples, channels, places), or the reason why the run fails.

    They are those of ``sensitivities`` where it supports the run and the number, else central
    differences. ``record`` is its index in ``space``; ``places`` are indices in ``vector``.
    """
    derivatives = np.zeros((run.times.size, len(run.labels), len(places)))
    paths = [space.slots[place].path for place in places]
    try:
        exact = _by_duals(run, space.case(record, vector), paths, derivatives)
    except FlexarmError as error:
        return str(error)
    others = [k for k in range(len(places)) if k not in exact]
    if not others:
        return derivatives
    # At coarse tolerances, the difference by a delay of the torque has twice its size.
    return _by_differences(run.fine(), space, record, vector, places, others, derivatives)


def _exact_places(run: RecordRun, paths: Sequence[str]) -> list[int]:
    """Return the indices of the paths by which ``sensitivities`` may differentiate."""
    few = run.record.controller is not None and len(paths) < _FEWEST_IN_LOOP
    if few or not run.differentiable:
        return []
    driven = run.record.input in ("current", "voltage")
    return [
        k
        for k, path in enumerate(paths)
        if not (driven and _OF_MOTORS.match(path))
        and not _OF_OUTPUTS.match(path)
        and not of_records(path)
    ]


def _by_duals(
    run: RecordRun, case: Case, paths: Sequence[str], derivatives: FloatArray
) -> list[int]:
    """Fill the derivatives that ``sensitivities`` supports; return their indices in ``paths``."""
    exact = _exact_places(run, paths)
    while exact:
        try:
            with without_warnings():
                # Without a second run: derivatives better than the runs are not needed.
                dual = sensitivities(
                    Arm(case.spec),
                    parameters=[initial_argument(paths[k]) or paths[k] for k in exact],
                    error_estimate=False,
                    progress=False,
                    channels=run.channels,
                    **run.arguments(case),
                )
        except InputError as error:
            refused = [_REFUSED.match(problem.name) for problem in error.problems]
            wrong = {int(match[1]) for match in refused if match}
            if not wrong:
                if run.record.controller is None:
                    raise
                return []  # a loop that is not differentiable, such as one that rounds
            exact = [k for j, k in enumerate(exact) if j not in wrong]
            continue
        channels = {name: np.moveaxis(dual[name].values, 0, -1) for name in run.channels}
        derivatives[..., exact] = run.changes(channels, case)
        return exact
    return []


def _by_differences(
    run: RecordRun,
    space: Space,
    record: int,
    vector: FloatArray,
    places: NDArray[np.intp],
    chosen: Sequence[int],
    derivatives: FloatArray,
) -> FloatArray | str:
    """Fill the derivatives by central differences, or return why the run at ``vector`` fails."""
    case = space.case(record, vector)
    errors = run.reading_errors(case, run.measured)  # their paths
    paths = {k: space.slots[places[k]].path for k in chosen}
    columns = {k: _column_of(run, path) for k, path in paths.items() if vector[places[k]] != 0.0}
    moving = [k for k in chosen if columns.get(k) is None and paths[k] not in errors]
    center: FloatArray | str = ""
    for _ in range(_ATTEMPTS):
        steps = [(k, run.steps.get(paths[k], _STEP)) for k in moving]
        center = _move(run, space, record, vector, places, steps, derivatives)
        if isinstance(center, str):
            return center
        moving = [
            k
            for k in moving
            if _resized(run, paths[k], derivatives[..., k] * space.scale[places[k]], center)
        ]
        if not moving:
            break
    assert isinstance(center, np.ndarray)
    errors = run.reading_errors(case, center)
    for k in chosen:
        column, value = columns.get(k), vector[places[k]]
        if paths[k] in errors:
            derivatives[..., k] = errors[paths[k]]
        elif column is not None:
            # A strain without its offset is proportional to the distance of its gauge.
            clean = errors[f"gains.{run.labels[column].text}"][:, column]
            gain = case.errors.get(f"gains.{run.labels[column].text}", 1.0)
            derivatives[:, column, k] = gain * clean / value
    return derivatives


def _move(
    run: RecordRun,
    space: Space,
    record: int,
    vector: FloatArray,
    places: NDArray[np.intp],
    steps: Sequence[tuple[int, float]],
    derivatives: FloatArray,
) -> FloatArray | str:
    """Fill the derivatives by steps (in scales); return the outputs, or why their run fails."""
    # They are one-sided at a bound, or where one of both runs fails, and zero where both fail, so
    # that no step goes in that direction.
    lower, upper = space.bounds
    cases: list[Case] = [space.case(record, vector)]
    changes: list[tuple[int, float]] = []
    for k, step in steps:
        place = places[k]
        for sign in (1.0, -1.0):
            moved = vector.copy()
            moved[place] += sign * step * space.scale[place]
            moved[place] = min(max(moved[place], lower[place]), upper[place])
            change = moved[place] - vector[place]
            if change == 0.0:
                continue
            try:
                cases.append(space.case(record, moved))
            except InputError:  # a limit of several numbers together
                continue
            changes.append((k, change))
    center, *others = run.simulate(cases)
    if isinstance(center, str):
        return center
    for k, _ in steps:
        ends = [
            (change, outputs)
            for (j, change), outputs in zip(changes, others, strict=True)
            if j == k and not isinstance(outputs, str)
        ]
        if len(ends) == 1:
            ends.append((0.0, center))
        if ends:
            (high, after), (low, before) = ends
            derivatives[..., k] = (after - before) / (high - low)
    return center


def _resized(run: RecordRun, path: str, slope: FloatArray, outputs: FloatArray) -> bool:
    """Correct the step of a number by the change of the outputs per scale; whether it was wrong."""
    # The error of a central difference grows with the square of the change that its step makes,
    # that of the runs falls with it: both are small if the change is the third root of the latter.
    measured = np.where(run.valid, run.measured, outputs)
    sizes = np.maximum(outputs.std(axis=0), measured.std(axis=0))
    changes = np.sqrt(np.mean(slope**2, axis=0))[sizes > 0.0] / sizes[sizes > 0.0]
    change = float(changes.max(initial=0.0))
    step = float(np.cbrt(run.rtol)) / change if change > 0.0 else np.inf
    step = min(max(step, _LEAST), _MOST)
    if _NEAR < run.steps.get(path, _STEP) / step < 1.0 / _NEAR:
        return False
    run.steps[path] = step
    return True


def _column_of(run: RecordRun, path: str) -> int | None:
    """Return the index of the output that is proportional to the number at a path, or None."""
    match = _DISTANCE.fullmatch(path)
    if match is None or not run.proportional:
        return None
    text = f"strain_{run.gauge_number(int(match[1]), int(match[2]))}"
    return next((k for k, label in enumerate(run.labels) if label.text == text), None)
