"""Guided identification, from inspected records to unseen ones: ``flexarm.commission``."""

from __future__ import annotations

import sys
import time
from collections.abc import Container, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flexarm.arm.arm import Arm
from flexarm.base.errors import (
    FlexarmError,
    InputError,
    Problem,
    SimulationError,
    public_call,
    without_warnings,
)
from flexarm.identification import fitting
from flexarm.identification.assessment import fits_by_channel
from flexarm.identification.data_sheet import (
    Parameters,
    driven_joints,
    of_drives,
    of_links,
    of_masses,
)
from flexarm.identification.findings import alike_masses, findings_of
from flexarm.identification.frequency.records import measured_modes
from flexarm.identification.identify import (
    PreparedIdentification,
    identified,
    prepared_fit,
)
from flexarm.identification.inspection import inspected
from flexarm.identification.missing import (
    Effect,
    can_join,
    effect_name,
    information_of,
    joined,
    missing_effects,
    sliding_joints,
    smoothing_rates,
    without,
)
from flexarm.identification.record import (
    FEWEST,
    MeasuredRecord,
    Records,
    check_inputs,
    check_records,
    check_some_records,
    with_columns,
)
from flexarm.identification.result import LAST_PART, Identification, stage_rows
from flexarm.identification.runs import COARSE, RecordRun
from flexarm.identification.space import (
    Case,
    Space,
    check_free,
    of_records,
    start_angles,
    with_joint,
    without_error,
)
from flexarm.identification.statistics import covariance_of, fit_percent
from flexarm.integrate import Integrator
from flexarm.integrate.base import FloatArray
from flexarm.linear import modes
from flexarm.model import Contact, Motors
from flexarm.model.identification import FreeParameter, RecordSettings
from flexarm.model.paths import with_number
from flexarm.model.quantities import Flag
from flexarm.simulation.run.progress import PATIENCE_FOR_LINES
from flexarm.simulation.run.settings import DEFAULTS, MethodSettings, replaced

#: Part of each record that is fitted; the rest of it judges the stages.
_FITTED = 0.7
#: Most evaluations of the fit of a stage.
_EVALUATIONS = 40
#: Least decrease of the RMS, as a fraction, that keeps a stage, and fit (%) that leaves nothing.
_GAIN, _PERFECT = 0.01, 99.9
#: Most rounds in which effects that residuals show join the model.
_ROUNDS = 3
#: Deviations from which an effect is needed.
_NEEDED = 2.0
#: Least change of the outputs by a large change of a parameter, in first guesses of the noise.
_NO_EFFECT = 1e-6
#: Distance of a start from bounds, as a fraction of their distance or the size of a parameter.
_INSIDE = 0.03
#: Factor on rigidities by modes. Band of measured modes relative to the frequency of the model,
#: least fit (%) of them, largest deviation of the frequency, and least frequency that vibrates.
_RIGIDITY, _BAND, _CLEAR, _SHARP, _STILL = (0.3, 1.2), (0.5, 1.15), 60.0, 0.05, 1e-4
#: Signal above noise: bins of a smoothed spectrum, power, and width beyond the last such frequency.
_BINS, _ABOVE, _WIDER = 5, 10.0, 1.2


@public_call
def commission(
    arm: Arm,
    records: Records,
    *,
    validation: Records = (),
    free: Sequence[str | FreeParameter] = (),
    motors: Motors | None = None,
    contacts: Sequence[Contact] = (),
    integrator: str | Integrator = "auto",
    step: float | None = None,
    rtol: float = 1e-5,
    atol: float | None = None,
    progress: Flag | None = None,
) -> Identification:
    """Identify an arm from measured records in the order in which experts work.

    1. Samples that dead, stuck or saturated sensors did not measure are left out, angles unwrapped.
    2. The arm of the data sheet predicts the last 30 % of each record, which no stage fits.
    3. Stages: rigidity from the lowest measured mode; links and gauges, with joints that follow
       their measured angles; drives; all together. After each of them, effects that its residuals
       show join the model: smoothed friction, offsets, gains and delays of the records. A
       stage that does not predict the last parts better is taken back.
    4. The last fit has standard deviations and unseen records, as `identify`.

    Args:
        arm: with the values of the data sheet. Bounds are relative to them: rigidities 0.3 to 1.2,
            distances of gauges 0.7 to 1.3, masses 0.9 to 1.1, inertias and stiffnesses of drives
            0.3 to 3; masses, gauges and inertias have priors. A number that is zero stays zero,
            except damping of joints.
        records: as for `identify`.
        validation: unseen records. The last fit then uses the whole records; without them, it is
            validated by the last parts.
        free: further parameters, and other bounds and priors, for the stage of all parameters.
        motors, contacts: as in `identify`.
        integrator, step, rtol, atol: of the runs of the last fit, as in ``simulate``.
        progress: True prints each stage; None does so on a terminal, elsewhere after 10 s.

    Returns:
        The result of the last fit, with ``findings`` on records and arm, and ``stages``. The
        starts of its parameters are the values of the data sheet.

    Raises:
        InputError: as `identify`.
        SimulationError: if the arm of the data sheet cannot be simulated.

    Warns:
        IdentifiabilityWarning, ConvergenceWarning, AccuracyWarning: as `identify`, for the last
            fit.
    """
    fitted, unseen = check_some_records(records), check_records("validation", validation)
    check_inputs(fitted | unseen)
    checked = {name: inspected(name, record) for name, record in (fitted | unseen).items()}
    findings = [sentence for _, sentences in checked.values() for sentence in sentences]
    fitted, unseen = ({name: checked[name][0] for name in each} for each in (fitted, unseen))
    options = {"integrator": integrator, "step": step, "rtol": rtol, "atol": atol}
    run = replaced(DEFAULTS, **options)
    common = motors, "linear", "output_error", None, contacts, run, None
    parameters = check_free(free, least=0)
    prepared_fit(arm, fitted, parameters, unseen, *common)  # raises errors before the stages
    rough = {**options, "rtol": max(rtol, COARSE), "contacts": contacts}
    work = _Commissioning(arm, fitted, motors, {k: v for k, v in rough.items() if v}, progress)
    with without_warnings():
        work.go_through(parameters)
        work.drop_needless({parameter.path for parameter in parameters})
        case, every = work.case, list(work.free.values())
        fitted, held = fitted if unseen else work.parts, unseen or work.last_parts()
        start = case.motors, *common[1:], case.errors, Arm(case.spec)
        prepared = prepared_fit(arm, fitted, every, held, *start)
    result = identified(prepared, 1, np.random.default_rng(0), "linear", 200)
    paths = result.parameters["parameter"].values.tolist()
    starts = np.array([work.sheet.get(path, without_error(path)) for path in paths], dtype=float)
    table = result.parameters.assign(start=("parameter", starts))
    delays = [each for record in fitted.values() for each in record.settings.delays.items()]
    stated = {channel for channel, delay in delays if delay}
    named = findings_of(table, stated, sliding_joints(arm.spec))
    findings += [*named, *alike_masses(table, work.free)]
    return replace(result, parameters=table, stages=work.stages(), findings=tuple(findings))


class _Fitted(NamedTuple):
    """Result of a fit of one stage."""

    problem: fitting.FitProblem
    fit: fitting.Fit
    case: Case  # the arm, motors and errors of records
    free: Parameters


#: RMS and fit (%) of each channel of each record.
_Score = dict[tuple[str, str], tuple[float, float]]


class _Row(NamedTuple):
    """Stage in the table of stages."""

    name: str
    before: _Score
    after: _Score
    kept: bool
    seconds: float


class _Commissioning:
    """State of the stages: the arm, motors and errors of records that predict best."""

    def __init__(
        self,
        arm: Arm,
        records: Mapping[str, MeasuredRecord],
        motors: Motors | None,
        options: Mapping[str, Any],
        progress: bool | None,
    ) -> None:
        self._arm, self._records, self._options, self._progress = arm, records, options, progress
        self.case = Case(arm.spec, motors, np.zeros(arm.dof), np.zeros(arm.dof))
        self.parts = {name: _first_part(record) for name, record in records.items()}
        self.free: Parameters = {}
        self.sheet: dict[str, float] = {}
        self._initial: dict[str, float] = {}  # estimates of initial states, by name
        self._rows: list[_Row] = []
        #: The last fit that was kept, unless joints followed their angles in it
        self._last: _Fitted | None = None

    def go_through(self, more: Sequence[FreeParameter]) -> None:
        """Go through all stages; ``more`` are free parameters besides those of the data sheet."""
        for name, record in self._records.items():
            for part, samples in zip(("first 70", "last 30"), _compared(record, ""), strict=True):
                if not any(np.isfinite(c).any() for c in samples):
                    rule = f"has no valid sample to compare in its {part} %"
                    raise InputError(Problem(f"records[{name!r}]", rule, hint=_CUT))
        spec, motors = self.case.spec, self.case.motors
        outputs = {label for record in self._records.values() for label in record.outputs}
        fixed = set.intersection(*(set(r.settings.prescribed) for r in self._records.values()))
        links, drives = of_links(spec, outputs), of_drives(spec, motors, fixed)
        every = {**links, **drives, **of_masses(spec), **{p.path: p for p in more}}
        links = {path: every[path] for path in links}
        drives = {path: every[path] for path in {**drives, **of_masses(spec)}}
        space = Space(self._arm, motors, list(every.values()), dict(self.parts))
        for word in ("path", "name"):  # a number of each record has names of its own
            self.sheet |= {getattr(slot, word): slot.start for slot in space.slots}
        started = time.process_time()
        score = self._score(self.case)
        if not score:
            raise SimulationError(0.0, "the arm of the data sheet cannot be simulated")
        self._add("data sheet", score, score, True, started)
        self._smooth_friction()
        self._use_modes([path for path in links if path.endswith(("rigidity", "modulus"))])
        following = all(_can_follow(self._arm, record) for record in self._records.values())
        self._stage("links", links, following)
        self._stage("drives", drives)
        self._stage("together", {**self.free, **every})

    def last_parts(self) -> dict[str, MeasuredRecord]:
        """Return the records that judge the stages, by their names in results."""
        return {f"{n}{LAST_PART}": self._held(r, False) for n, r in self._records.items()}

    def _held(self, record: MeasuredRecord, following: bool) -> MeasuredRecord:
        """Return a record whose first part is not compared; its joints may be prescribed."""
        known = np.arange(record.times.size) >= _length(record)
        settings = record.settings
        if record.controller is None and settings.initial_angle is None:
            settings = settings.replace(initial_angle=start_angles(self._arm, record).tolist())
        if following:
            settings = _following(self._arm, record, settings)
        record = with_columns(record, {}, settings)
        columns = {label: np.where(known, c, np.nan) for label, c in record.outputs.items()}
        return with_columns(record, columns, settings)

    def _runs(self, records: Mapping[str, MeasuredRecord]) -> list[RecordRun]:
        return [RecordRun(name, r, self._arm, self._options) for name, r in records.items()]

    def _score(self, case: Case, following: bool = False) -> _Score:
        """Return RMS and fit on the parts that are not fitted; empty if a run fails."""
        records = {name: self._held(r, following) for name, r in self._records.items()}
        space = Space(Arm(case.spec), case.motors, [], records, case.errors)
        problem = fitting.FitProblem(space, self._runs(records), None)
        start = [self._initial.get(slot.name, 0.0) for slot in space.slots]
        outputs, score = problem.outputs(np.array(start)), _Score()
        for run, simulated in zip(problem.runs, outputs or (), strict=False):
            for k, label in enumerate(run.labels):
                good = run.valid[:, k]
                measured, predicted = run.measured[good, k], simulated[good, k]
                rms = float(np.sqrt(np.mean((measured - predicted) ** 2)))
                score[run.name, label.text] = rms, fit_percent(measured, predicted)
        return score

    def _fitted(self, case: Case, free: Parameters, following: bool) -> _Fitted:
        """Fit parameters, those without effect left out, from a case; FlexarmError if it fails."""
        records = dict(self.parts)
        if following:
            for name, record in records.items():
                settings = _following(self._arm, record, record.settings)
                records[name] = with_columns(record, {}, settings)
        space = Space(Arm(case.spec), case.motors, list(free.values()), records, case.errors)
        problem = fitting.FitProblem(space, self._runs(records), None)
        try:
            effect = np.zeros(len(space.slots))
            for k, slopes in enumerate(problem.derivatives(space.start)):
                squares = np.sum(problem.whitened(k, slopes) ** 2, axis=(0, 1))
                effect[space.acting_on(k)] += squares
            small = np.sqrt(effect) * space.scale < _NO_EFFECT
            idle = {slot.path for slot, tiny in zip(space.slots, small, strict=True) if tiny}
            if idle & free.keys():
                rest = {path: p for path, p in free.items() if path not in idle}
                return self._fitted(case, rest, following)
            # The search creeps along bounds at which it starts.
            low, high = space.bounds
            margin = _INSIDE * np.minimum(high - low, space.scale)
            start = np.clip(space.start, low + margin, high - margin)
            fit = fitting.fit_from(problem, start, "linear", _EVALUATIONS, fitting.COARSE)
        except fitting.FitFailure as error:
            raise SimulationError(0.0, str(error)) from None
        return _Fitted(problem, fit, space.case(None, fit.vector), free)

    def _stage(self, name: str, free: Parameters, following: bool = False) -> None:
        """Fit parameters, then again with effects that the residuals show."""
        fitted, _ = self._tried(name, self.case, free, following)
        for _ in range(_ROUNDS):
            effects = self._effects(fitted) if fitted else []
            if fitted is None or not effects:
                return
            best = self._with_effects(fitted, effects, following)
            if best is None and len(effects) > 1:
                best = self._with_effects(fitted, effects[:1], following)
            if best is None:
                return
            fitted = best

    def _with_effects(
        self, fitted: _Fitted, effects: Sequence[Effect], following: bool
    ) -> _Fitted | None:
        """Fit a model with effects; None if it does not predict better."""
        words = ", ".join(effect_name(effect.path, short=True) for effect in effects)
        case, paths = joined(fitted.case, effects, self._smoothing(fitted.case))
        more = {path: FreeParameter(path) for path in paths}
        trial, kept = self._tried(f"+ {words}", case, {**fitted.free, **more}, following)
        return trial if kept else None

    def drop_needless(self, stated: Container[str]) -> None:
        """Leave out effects, but the ``stated`` ones, that the data do not require."""
        while self._last is not None:
            try:
                needs = self._needs(self._last)
            except fitting.FitFailure:
                return
            rest = {path: size for path, size in needs.items() if path not in stated}
            path = min(rest, key=lambda path: rest[path], default="")
            if not path or rest[path] > _NEEDED:
                return
            # The rate below which friction is smooth stays as it was fitted.
            dropped = {
                path,
                *(path.replace("static", f"{r}_rate") for r in ("stribeck", "smoothing")),
            }
            free = {key: value for key, value in self.free.items() if key not in dropped}
            words = f"without {effect_name(path, short=True)}"
            if not self._tried(words, without(self.case, path), free, least=-_GAIN)[1]:
                return
            self.free = free

    def _needs(self, fitted: _Fitted) -> dict[str, float]:
        """Return by how many deviations errors of records and Stribeck friction differ from none.

        FitFailure if a run fails.
        """
        columns, priors, _ = information_of(fitted.problem, fitted.fit)
        covariance, vector = covariance_of(columns, priors), fitted.fit.vector
        places = {slot.path: k for k, slot in enumerate(fitted.problem.space.slots)}
        needs = {}
        for path, k in places.items():
            axis, none = np.eye(vector.size)[k], without_error(path)
            if path.endswith("friction.static"):
                coulomb = path.replace("static", "coulomb")
                if coulomb not in places:
                    continue
                axis, none = axis - np.eye(vector.size)[places[coulomb]], 0.0
            elif not of_records(path):
                continue
            used = np.flatnonzero(axis)  # others may have infinite variances
            with np.errstate(invalid="ignore"):
                deviation = np.sqrt(axis[used] @ covariance[np.ix_(used, used)] @ axis[used])
            needs[path] = float(np.nan_to_num(abs(axis @ vector - none) / deviation))
        return needs

    def _tried(
        self,
        name: str,
        case: Case,
        free: Parameters,
        following: bool = False,
        least: float = _GAIN,
    ) -> tuple[_Fitted | None, bool]:
        """Fit parameters from a case, and keep the result if it predicts better by ``least``."""
        started, before = time.process_time(), self._score(self.case, following)
        try:
            fitted = self._fitted(case, free, following)
        except FlexarmError:
            return None, False
        slots = zip(fitted.problem.space.slots, fitted.fit.vector.tolist(), strict=True)
        initial = self._initial
        self._initial = {slot.name: value for slot, value in slots if slot.initial}
        kept = self._judged(name, fitted.case, before, started, following, least)
        if kept:
            self.free |= fitted.free
            self._last = None if following else fitted
        else:
            self._initial = initial
        return fitted, kept

    def _judged(
        self,
        name: str,
        case: Case,
        before: _Score,
        started: float,
        following: bool = False,
        least: float = _GAIN,
    ) -> bool:
        """Keep a case if the RMS on the parts that are not fitted decrease by ``least``."""
        after = self._score(case, following)
        ratios = [np.log(max(after[key][0], 1e-300) / max(before[key][0], 1e-300)) for key in after]
        kept = bool(ratios) and float(np.mean(ratios)) < np.log(1.0 - least)
        if kept:
            self.case = case
        self._add(name, before, after, kept, started)
        return kept

    def _add(self, name: str, before: _Score, after: _Score, kept: bool, started: float) -> None:
        self._rows.append(_Row(name, before, after, kept, time.process_time() - started))
        long = sum(row.seconds for row in self._rows) > PATIENCE_FOR_LINES
        if self._progress or (self._progress is None and (long or sys.stderr.isatty())):
            print("  ".join(stage_rows(self.stages())[-1]), file=sys.stderr, flush=True)

    def stages(self) -> xr.Dataset:
        """Return the table of the stages."""
        channels = list(dict.fromkeys(c for row in self._rows for _, c in row.before))
        fits = np.full((2, len(self._rows), len(channels)), np.nan)
        for k, row in enumerate(self._rows):
            for which, score in enumerate((row.before, row.after)):
                for (_, channel), (_, fit) in score.items():
                    place = which, k, channels.index(channel)
                    fits[place] = np.fmin(fits[place], fit)
        unit = {"units": "%", "long_name": "fit on parts that no stage fits"}
        dims = ("stage", "channel")
        return xr.Dataset(
            {
                "before": (dims, fits[0], unit),
                "after": (dims, fits[1], unit),
                "kept": ("stage", [row.kept for row in self._rows]),
                "seconds": ("stage", [row.seconds for row in self._rows], {"units": "s"}),
            },
            {"stage": [row.name for row in self._rows], "channel": channels},
        )

    def _effects(self, fitted: _Fitted) -> list[Effect]:
        """Return the effects that residuals show and that parameters can describe."""
        problem, fit = fitted.problem, fitted.fit
        if min(fits_by_channel(problem.runs, fit.outputs).values()) > _PERFECT:
            return []
        try:
            columns, priors, _ = information_of(problem, fit)
        except fitting.FitFailure:
            return []
        # The distance of a gauge is an error of its gain, and free in another stage.
        gauges = any(path.endswith(".distance") for path in self.sheet)
        return [
            effect
            for effect in missing_effects(problem, fit, columns, priors)
            if not (gauges and effect.path.startswith("gains.strain"))
            and can_join(fitted.case.spec, effect.path)
        ]

    def _smoothing(self, case: Case) -> FloatArray:
        """Return the rates (joints,) below which friction is smooth, rad/s."""
        return smoothing_rates(self._runs(self.parts), case)

    def _smooth_friction(self) -> None:
        """Replace sticking of joints by smooth friction, which has derivatives."""
        spec = self.case.spec
        holding = [
            k for k in driven_joints(spec) if (f := spec.joints[k].friction) is not None and f.holds
        ]
        for k in holding:
            friction = spec.joints[k].friction
            assert friction is not None
            rate = self._smoothing(self.case)[driven_joints(spec).index(k)]
            if rate > 0.0:  # a joint that does not move has no friction in motion
                spec = with_joint(
                    spec, k, spec.joints[k].replace(friction=friction.replace(smoothing_rate=rate))
                )
        self.case = self.case._replace(spec=spec)

    def _use_modes(self, rigidities: Sequence[str]) -> None:
        """Scale the rigidities by the lowest mode of the records, if these show it clearly."""
        started, spec = time.process_time(), self.case.spec
        try:
            first = next(iter(self._records.values()))
            posture = start_angles(self._arm, first)
            model = modes(self._arm, posture, "free").frequency_hz
            hertz = float(model[model > _STILL * model.max()][0])
            band = [factor * hertz for factor in _BAND]
            measured = measured_modes(dict(self.parts), 1, band=band)
        except (FlexarmError, IndexError):
            return
        sharp = measured.frequency_deviation[0] < _SHARP * measured.frequency_hz[0]
        if not (sharp and measured.fit.min() > _CLEAR):
            return
        factor = float(np.clip((measured.frequency_hz[0] / hertz) ** 2, *_RIGIDITY))
        for path in rigidities:
            spec = with_number(spec, path, factor * self.sheet[path])
        case = self.case._replace(spec=spec)
        self._judged(
            f"mode at {measured.frequency_hz[0]:.3g} Hz", case, self._score(self.case), started
        )


_CUT = "Cut the record where its sensors work."


def _length(record: MeasuredRecord) -> int:
    """Return the number of samples that are fitted."""
    return max(FEWEST, int(_FITTED * record.times.size))


def _first_part(record: MeasuredRecord) -> MeasuredRecord:
    return replace(record, data=record.data.isel(time=slice(0, _length(record))))


def _can_follow(arm: Arm, record: MeasuredRecord) -> bool:
    """Return whether joints can follow their measured angles while other channels are compared."""
    angles = {label for label in record.outputs if label.channel == "joint_angle"}
    return (
        len(angles) == arm.n_joints
        and not (arm.closure_rows or record.controller or record.settings.prescribed)
        and all(any(np.isfinite(c).any() for c in part) for part in _compared(record, "joint"))
        and all(np.isfinite(record.outputs[label]).all() for label in angles)
    )


def _compared(record: MeasuredRecord, without: str) -> list[list[FloatArray]]:
    """Return the samples of the fitted and of the last part, ``without`` channels of this word."""
    kept = [c for label, c in record.outputs.items() if not without or without not in label.channel]
    return [[c[: _length(record)] for c in kept], [c[_length(record) :] for c in kept]]


def _following(arm: Arm, record: MeasuredRecord, settings: RecordSettings) -> RecordSettings:
    """Return settings with joints that follow their angles, without the noise of these."""
    cutoffs = [
        _cutoff(column, record.rate)
        for label, column in record.outputs.items()
        if label.channel == "joint_angle"
    ]
    known = None if None in cutoffs else max(c for c in cutoffs if c is not None)
    joints = [int(number) for number in arm.joint_numbers]
    outputs = settings.outputs and [n for n in settings.outputs if n != "joint_angle"]
    return settings.replace(prescribed=joints, prescribed_cutoff=known, outputs=outputs)


def _cutoff(values: FloatArray, rate: float) -> float | None:
    """Return the frequency (Hz) above which values are noise; None if there is none."""
    from scipy.signal import periodogram

    hertz, power = periodogram(values, rate, window="hann", detrend="linear")
    floor = float(np.median(power[-power.size // 5 :]))
    smooth = np.convolve(power, np.ones(_BINS) / _BINS, mode="same")
    above = np.flatnonzero(smooth > _ABOVE * floor)
    cutoff = _WIDER * float(hertz[above[-1]]) if above.size else 0.0
    return cutoff if 0.0 < cutoff < 0.4 * rate else None


def commissioned(study: PreparedIdentification, progress: bool | None) -> Identification:
    """Commission the arm of a file, of whose ``fit`` only the settings of runs count."""
    given = {name: getattr(study.study.fit, name) for name in study.study.fit.model_fields_set}
    settings = {name: given[name] for name in MethodSettings.__annotations__ if name in given}
    with study.errors():
        if unused := [f"fit.{name}" for name in given if name not in settings]:
            hint = "Leave it out, or identify without --guided."
            raise InputError(*(Problem(n, "does not act with --guided", hint=hint) for n in unused))
        return commission(
            study.arm,
            study.records,
            validation=study.validation,
            free=list(study.study.free),
            motors=study.study.motors,
            progress=progress,
            **settings,
        )
