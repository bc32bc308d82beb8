"""Estimation of parameters of an arm from measured records: ``flexarm.identify``."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Unpack

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm, described_arm
from flexarm.base import arguments
from flexarm.base.errors import (
    AccuracyWarning,
    ConvergenceWarning,
    IdentifiabilityWarning,
    InputError,
    Problem,
    SimulationError,
    public_call,
    raise_any,
    shown,
    warn_caller,
)
from flexarm.cases.scenario.file_errors import problems_at
from flexarm.identification import fitting
from flexarm.identification.assessment import (
    Assessment,
    alternatives_of,
    assessed,
    estimate_errors,
    fits_by_channel,
    fits_of,
    histories_of,
    profiled,
    weakest_direction,
)
from flexarm.identification.prediction import PredictedRun, PredictionProblem
from flexarm.identification.reading import record_of_file
from flexarm.identification.record import (
    MeasuredRecord,
    Records,
    check_inputs,
    check_records,
    check_some_records,
)
from flexarm.identification.result import Identification, related
from flexarm.identification.runs import RecordRun, warn_of_work
from flexarm.identification.space import Case, Space, check_free, of_records, random_start
from flexarm.identification.statistics import warn_of_fits
from flexarm.integrate.base import FloatArray
from flexarm.linear.statics.gaps import refuse_bristles
from flexarm.model import Contact, Motors
from flexarm.model.arm.spec import UNDRIVEN, serial_only
from flexarm.model.file_format.yaml_text import Document
from flexarm.model.identification import FreeParameter, locate_identification
from flexarm.model.quantities import Count, Flag
from flexarm.model.wording import path_of
from flexarm.simulation.run.settings import (
    MethodSettings,
    RunSettings,
    settings_of,
    with_keywords,
)

#: Losses of residuals, from SciPy.
LOSSES = ("linear", "soft_l1", "huber", "cauchy")
#: Errors that are fitted.
METHODS = ("output_error", "prediction_error")

#: Fit (%) below which units or signs are probably wrong.
_POOR = 5.0
#: Ratio of an estimate and its start above which one of them is probably in another unit.
_FAR = 1e3
#: Relative difference of rates that counts as none.
_SAME_RATE = 1e-6


@public_call
@with_keywords(MethodSettings)
def identify(
    arm: Arm,
    records: Records,
    free: Sequence[str | FreeParameter],
    *,
    validation: Records = (),
    motors: Motors | None = None,
    starts: Count | None = None,
    seed: int = 0,
    loss: str = "linear",
    method: str = "output_error",
    torque_noise: ArrayLike | None = None,
    iterations: Count = 200,
    contacts: Sequence[Contact] = (),
    progress: Flag | None = None,
    settings: RunSettings | None = None,
    **keywords: Unpack[MethodSettings],
) -> Identification:
    """Estimate parameters of an arm from measured records by weighted least squares.

    The arm is simulated with the inputs of each record, and the parameters are changed until the
    simulated channels, after the delays and filters of the record, fit the measured ones. Each
    channel is divided by the standard deviation of its noise, which is estimated with the
    parameters if the record does not give it (maximum likelihood for white noise). A vector whose
    run fails is a rejected step.

    Args:
        arm: with the values from which the estimation starts.
        records: a record, a list, or a dictionary by name: ``MeasuredRecord`` objects, or datasets
            such as results of ``simulate``, with torques as inputs. The torque of a result of a
            closed loop is a zero-order hold; record it at least at the rate of the controller.
        free: paths of numbers of the arm, such as ``"links[0].flexural_rigidity"``,
            ``"joints[1].damping"`` or ``"motors.torque_constant"``, or ``FreeParameter`` objects
            with bounds and priors.
        validation: records that are predicted with the estimates. Their initial states, and values
            of parameters with ``per_record``, are estimated from themselves.
        motors: for records with currents as inputs: ``torque_constant`` is used.
        starts: number of starts, the first at the arm, the others at random within the bounds, or
            around the values of the arm. The result is that with the largest likelihood. By default
            one, and two more if it has converged, but the data do not determine a parameter or
            estimates correlate by more than 0.8: on both sides of the result in the direction that
            the data determine least.
        seed: of the random starts.
        loss: "linear", or a loss that is robust to outliers: "soft_l1", "huber" or "cauchy".
        method: "output_error" fits the simulated channels. "prediction_error" fits the predictions
            of an extended Kalman filter, each from the samples before: disturbance torques, which
            make a simulation drift off, bias the estimates less. It supports the channels
            "joint_angle", "joint_rate" and "strain", in records of one rate.
        torque_noise: of prediction errors, as in `ExtendedKalmanFilter`: standard deviation of a
            random torque error in each sample (N m), one for all joints or one for each. It is
            estimated by default; 0 gives output error.
        iterations: most evaluations of the residuals of a fit from one start: those of the
            beginnings of long records, which are fitted first, and of all rounds in which the noise
            is estimated anew. Intervals of parameters that the data do not determine are computed
            after the fit: by up to ten short fits for each end, of at most six parameters.
        contacts: of all runs, as in ``simulate``. Prediction errors do not support them.
        integrator, step, rtol, atol, settings: of all runs, as in ``simulate``.
        progress: True prints the fit of each channel after each evaluation; None does so on a
            terminal.

    Returns:
        Estimates with standard deviations and correlations, combinations that the data do not
        determine, fit and tests of residuals, and the arm with the estimates. A standard deviation
        is the larger one of two: from the derivatives, with the correlation of residuals over time,
        and from eight blocks of the records. If the residuals show effects that the model lacks
        (friction, backlash, offsets, delays, gains), a coarse fit of at most 12 evaluations with
        each of up to three follows: the table has its estimates, ``with_effects``, and the standard
        deviations contain the change to them. Effects are not looked for with prediction errors,
        without convergence, or if all channels fit above 99.9 %; and they may be misnamed.

    Raises:
        InputError: if a record does not fit the arm, or a path is not one of a number; all
            problems are listed.
        SimulationError: if the arm cannot be simulated at any start.

    Warns:
        IdentifiabilityWarning: if the data do not determine parameters or combinations of them, or
            another arm fits almost equally well.
        ConvergenceWarning: if the fit has not converged.
        FlexarmWarning: if the times of a record are probably not in seconds; those of a file whose
            unit is not stated raise `InputError`.
        AccuracyWarning: if the rate of a result of a closed loop is lower than that of its
            controller, so that the estimates may be biased; if the residuals show an effect that
            the model lacks; if a channel has a fit below 5 %; or if an estimate differs from its
            start by a factor of 1000.
    """
    random = np.random.default_rng(arguments.check_count("seed", seed, 0, 2**63 - 1))
    run, watch = settings_of(settings, keywords, identify), _watch(progress)
    prepared = prepared_fit(
        arm, records, free, validation, motors, loss, method, torque_noise, contacts, run, watch
    )
    return identified(prepared, starts, random, loss, iterations)


def identified(
    prepared: Prepared,
    starts: int | None,
    random: np.random.Generator,
    loss: str,
    iterations: int,
) -> Identification:
    """Return the result of a fit, with the warnings of ``identify``."""
    problem, others, parameters = prepared
    space, runs = problem.space, problem.runs
    tried = _fits(problem, 1 if starts is None else starts, random, loss, iterations)
    best, assessment = _best(problem, tried, loss)
    doubtful = assessment.undetermined or related(assessment.parameters)
    if starts is None and best.converged and doubtful:
        direction = weakest_direction(problem, assessment.parameters)
        tried += fitting.other_fits(problem, best, direction, loss, iterations)
        if min(tried, key=_cost_of) is not best:
            best, assessment = _best(problem, tried, loss)
    shared = space.case(None, best.vector)
    estimated = Arm(shared.spec)
    table = assessment.parameters
    simulated = best.converged and loss == LOSSES[0] and not isinstance(runs[0], PredictedRun)
    if simulated and assessment.weak:
        table = profiled(problem, best, assessment)
    predicted = [_predicted(run, estimated, shared, parameters, best, iterations) for run in others]
    errors = [
        None
        if isinstance(run, PredictedRun)
        else estimate_errors(run, estimated, shared, parameters, table)
        for run in others
    ]
    fit = fits_of(runs, best.outputs)
    result = Identification(
        arm=estimated,
        arms={run.name: Arm(space.case(k, best.vector).spec) for k, run in enumerate(runs)},
        motors=shared.motors,
        parameters=table,
        initial=assessment.initial,
        undetermined=assessment.undetermined,
        fit=fit,
        validation=fits_of(others, predicted, errors),
        histories={**histories_of(runs, best.outputs), **histories_of(others, predicted)},
        noise=best.noise,
        torque_noise=best.torque_noise,
        starts=tuple(np.nan if fit is None else fit.cost for fit in tried),
        missing=assessment.missing,
        alternatives=tuple(alternatives_of(problem, best, tried)),
        method="prediction_error" if isinstance(runs[0], PredictedRun) else METHODS[0],
        converged=best.converged,
    )
    doubts = [*result.undetermined, *result.alternatives]
    if doubts:
        warn_caller(" ".join(doubts), IdentifiabilityWarning)
    if result.missing:
        warn_caller(" ".join(result.missing), AccuracyWarning)
    if not result.converged:
        warn_caller(result.remarks[0], ConvergenceWarning)
    _warn_of_poor_fits(fit, runs)
    _warn_of_far_estimates(result.parameters)
    return result


#: What ``identify`` fits: the problem, the runs of records that are predicted, and the parameters.
Prepared = tuple[fitting.FitProblem, list[RecordRun], list[FreeParameter]]


def prepared_fit(
    arm: Arm,
    records: Records,
    free: Sequence[str | FreeParameter],
    validation: Records,
    motors: Motors | None,
    loss: str,
    method: str,
    torque_noise: ArrayLike | None,
    contacts: Sequence[Contact],
    settings: RunSettings,
    watch: fitting.Watch | None,
    errors: Mapping[str, float] = MappingProxyType({}),
    start: Arm | None = None,
) -> Prepared:
    """Check the arguments of ``identify``, except those of the search.

    The fit starts at ``errors`` of the records and the arm ``start``, by default ``arm``.
    """
    if motors is not None:
        arguments.check_kind("motors", motors, Motors)
    arguments.check_choice("loss", loss, LOSSES)
    disturbed = _check_method(method, torque_noise, loss, arm)
    touching = arguments.check_list_of("contacts", contacts, Contact)
    if touching and method == "prediction_error":
        rule = "is not supported with contacts"
        raise InputError(Problem("method", rule, hint='Use method="output_error".'))
    fitted = check_some_records(records)
    held_out = check_records("validation", validation)
    for name in held_out:
        if name in fitted:
            raise InputError(Problem("validation", f"repeats the name of the record {name!r}"))
    every = fitted | held_out
    check_inputs(every)
    for name, record in every.items():
        if record.input == "current" and (motors is None or motors.torque_constant is None):
            rule = f"with a torque_constant are required for the currents of {name!r}"
            raise InputError(Problem("motors", rule))
    for name, record in every.items():
        if record.coarse:
            warn_caller(f"{name}: {record.coarse}", AccuracyWarning)
    parameters = check_free(free, least=0)
    wrong = [p.path for p in parameters if of_records(p.path)]
    if wrong and method == "prediction_error":
        rule = f"is not supported with {wrong[0]}"
        raise InputError(Problem("method", rule, hint='Use method="output_error".'))
    options = {name: getattr(settings, name) for name in MethodSettings.__annotations__}
    options |= {"contacts": touching} if touching else {}
    space = Space(start or arm, motors, parameters, fitted, errors)
    kind = PredictedRun if method == "prediction_error" else RecordRun
    runs = [kind(name, record, arm, options) for name, record in every.items()]
    if method == "prediction_error":
        _check_rates(runs)
    warn_of_work(runs, space)
    problem = _problem(space, runs[: len(fitted)], watch, {}, disturbed)
    return problem, runs[len(fitted) :], parameters


def _warn_of_far_estimates(parameters: xr.Dataset) -> None:
    """Warn of estimates far from their start: of another unit, or from times of another one.

    Those that the data do not determine are anywhere.
    """
    start, estimate = parameters["start"].values, parameters["estimate"].values
    known = (start > 0.0) & (parameters["standard_deviation"].values < np.abs(estimate))
    ratio = np.divide(estimate, start, out=np.ones_like(start), where=known)
    far = np.flatnonzero((ratio > _FAR) | ((ratio > 0.0) & (ratio < 1.0 / _FAR)))
    if far.size:
        names = parameters["parameter"].values
        listed = ", ".join(f"{names[k]} {ratio[k]:.1e} times its start" for k in far)
        hint = (
            "Check units, and that times are in seconds: milliseconds multiply an inertia by 1e6."
        )
        warn_caller(f"the estimates are far from the arm: {listed}. {hint}", AccuracyWarning)


def _warn_of_poor_fits(fit: xr.Dataset, runs: Sequence[RecordRun]) -> None:
    named = fit["fit"].to_series().items()
    fits = {f"{channel} of {record}": percent for (record, channel), percent in named}
    hint = "Check units, signs, times and the numbers that are not free."
    still = [run.name for run in runs if not run.record.driven]
    if still:
        hint = f"No torque, current or voltage drives {', '.join(still)}. {hint}"
    warn_of_fits(fits, _POOR, "the fitted arm hardly reproduces", hint)


def _problem(
    space: Space,
    runs: Sequence[RecordRun],
    watch: fitting.Watch | None,
    known: Mapping[str, float],
    torque_noise: FloatArray | None,
) -> fitting.FitProblem:
    """Return the problem of the method: that of its runs."""
    predicted = [run for run in runs if isinstance(run, PredictedRun)]
    if predicted:
        return PredictionProblem(space, predicted, watch, known, torque_noise)
    return fitting.FitProblem(space, runs, watch, known)


def _check_method(method: str, torque_noise: Any, loss: str, arm: Arm) -> FloatArray | None:
    """Return the torque noise (joints,), or None if it is estimated or not used."""
    arguments.check_choice("method", method, METHODS)
    if method == "output_error":
        if torque_noise is not None:
            raise InputError(Problem("torque_noise", "requires method='prediction_error'"))
        return None
    hint = "The filter has no state for their deflection."
    refuse_bristles(arm, "method", repr(method), hint)
    serial_only(arm.spec, "prediction_error", UNDRIVEN)
    if loss != "linear":
        raise InputError(Problem("loss", f"{loss} cannot be combined with prediction_error"))
    if torque_noise is None:
        return None
    deviations = arguments.check_each("torque_noise", torque_noise, arm.n_joints)
    if np.any(deviations < 0.0):
        raise InputError(Problem("torque_noise", "not be negative", shown(torque_noise)))
    return np.broadcast_to(deviations, arm.n_joints).copy()


def _check_rates(runs: Sequence[RecordRun]) -> None:
    first = runs[0]
    rule = f"be that of {first.name}, {first.record.rate:g} Hz, with prediction_error"
    hint = "read_record(path, rate=...) resamples a record."
    problems = [
        Problem("rate", rule, f"{run.record.rate:g}", hint, where=run.name)
        for run in runs
        if abs(run.record.rate / first.record.rate - 1.0) > _SAME_RATE
    ]
    raise_any(problems)


def _fits(
    problem: fitting.FitProblem, count: int, random: np.random.Generator, loss: str, iterations: int
) -> list[fitting.Fit | None]:
    """Return the fits of all starts, None for those that failed."""
    fits: list[fitting.Fit | None] = []
    for k in range(count):
        start = problem.space.start if k == 0 else random_start(problem.space, random)
        try:
            fits.append(fitting.fit_from(problem, start, loss, iterations))
        except fitting.FitFailure as error:
            problem.failure = str(error)
            fits.append(None)
    if not any(fits):
        raise SimulationError(0.0, f"no start of the fit can be simulated. {problem.failure}")
    return fits


def _cost_of(fit: fitting.Fit | None) -> float:
    return np.inf if fit is None else fit.cost


def _best(
    problem: fitting.FitProblem, fits: Sequence[fitting.Fit | None], loss: str
) -> tuple[fitting.Fit, Assessment]:
    """Return the fit with the largest likelihood, and its assessment."""
    best = min(fits, key=_cost_of)
    assert best is not None
    problem.restore(best)
    return best, assessed(problem, best, loss)


def _predicted(
    run: RecordRun,
    arm: Arm,
    shared: Case,
    free: Sequence[FreeParameter],
    best: fitting.Fit,
    iterations: int,
) -> FloatArray:
    """Return the outputs of a record that was not fitted."""
    own = [parameter for parameter in free if parameter.per_record]
    space = Space(arm, shared.motors, own, {run.name: run.record}, shared.errors)
    problem = _problem(space, [run], None, best.noise, best.torque_noise)
    try:
        if space.slots:
            return fitting.fit_from(problem, space.start, "linear", iterations).outputs[0]
        problem.prepare(space.start)
        outputs = problem.outputs(space.start)
    except fitting.FitFailure as error:
        raise SimulationError(0.0, str(error)) from None
    if outputs is None:
        raise SimulationError(0.0, problem.failure)
    return outputs[0]


def _watch(progress: bool | None) -> fitting.Watch | None:
    """Return a function that prints the fit of each channel, or None."""
    if progress is False or (progress is None and not sys.stderr.isatty()):
        return None

    def show(evaluation: int, squares: float, runs: Any, outputs: Sequence[FloatArray]) -> None:
        fits = fits_by_channel(runs, outputs)
        text = ", ".join(f"{name} {value:.1f} %" for name, value in fits.items())
        print(f"evaluation {evaluation}: {squares:.6g}; fit {text}", file=sys.stderr, flush=True)

    return show


class PreparedIdentification:
    """Identification of a file, with its records read; errors are listed with their lines."""

    def __init__(self, source: Path | Document, folder: Path) -> None:
        self.study, self._where = locate_identification(source)
        self.arm = described_arm(self.study.arm)
        self._folder = folder
        self.records = self._read("records")
        self.validation = self._read("validation")

    def _read(self, key: str) -> dict[str, MeasuredRecord]:
        measured = {}
        for name, description in getattr(self.study, key).items():
            with problems_at(self._where, f"{key}.{name}", {"path": "file", "the record": ""}):
                measured[name] = record_of_file(description, self._folder)
        return measured

    def check(self) -> None:
        """Raise the errors of ``identify`` before its fit."""
        with self.errors():
            fit, data = self.study.fit, (self.records, list(self.study.free), self.validation)
            keywords = {name: getattr(fit, name) for name in MethodSettings.__annotations__}
            errors = fit.loss, fit.method, fit.torque_noise
            run = settings_of(None, keywords, identify)
            prepared_fit(self.arm, *data, self.study.motors, *errors, (), run, None)

    def run(self, progress: bool | None = None) -> Identification:
        """Estimate the parameters, with the errors of ``identify``."""
        keywords: dict[str, Any] = {"motors": self.study.motors, **dict(self.study.fit)}
        keywords |= {"validation": self.validation, "progress": progress}
        with self.errors():
            return identify(self.arm, self.records, list(self.study.free), **keywords)

    @contextmanager
    def errors(self) -> Iterator[None]:
        """Raise errors with their key and their line if their place is a record."""
        try:
            yield
        except InputError as error:
            problems = list(error.problems)
            for k, problem in enumerate(problems):
                for key in ("records", "validation"):
                    if problem.where in getattr(self.study, key):
                        name = f"{key}.{problem.where}.{problem.name}"
                        where = self._where(path_of(name))
                        problems[k] = replace(problem, name=name, where=where)
            raise InputError(*problems) from None
