"""Assessment of a fit, and of planned experiments: deviations, directions without effect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_kind
from flexarm.base.errors import InputError, Problem, SimulationError, public_call
from flexarm.base.notebook import html_table
from flexarm.identification.fitting import (
    Fit,
    FitFailure,
    FitProblem,
    profile_end,
)
from flexarm.identification.missing import HALF, Completed, completed, information_of
from flexarm.identification.record import (
    MEASURED,
    MeasuredRecord,
    Records,
    check_inputs,
    check_some_records,
)
from flexarm.identification.result import aligned, number_of
from flexarm.identification.runs import RecordRun, output_derivatives
from flexarm.identification.space import Case, Slot, Space, check_free, in_words
from flexarm.identification.statistics import (
    UNDETERMINED,
    covariance_of,
    fit_percent,
    independence,
    information,
    inverse_root,
    own_information,
    undetermined,
    whiteness,
)
from flexarm.integrate import Integrator
from flexarm.integrate.base import FloatArray
from flexarm.model import Motors
from flexarm.model.identification import FreeParameter

#: Distance from a bound at which an estimate counts as being at it, as a fraction of its scale.
_AT_BOUND = 1e-4
#: Increase of RMS up to which another arm fits equally well, the relative change of a parameter by
#: which an arm is another one, and the most parameters that are named.
_EQUAL, _OTHER, _MOST = 0.02, 0.2, 3
#: Fit (%) from which a channel is perfect.
_PERFECT = 99.9
#: Largest relative change of a parameter at a further start.
_FAR = 0.7
#: Most intervals by profiles.
_MOST_PROFILED = 6
_MEASURES = {
    "fit": ("%", "fit, 100 is perfect"),
    "rms": ("", "RMS of the residuals, SI units"),
    "whiteness": ("1", "probability of such correlations among white residuals"),
    "independence": ("1", "probability of such correlations with the inputs by chance"),
}


class Assessment(NamedTuple):
    """Estimates of a fit, and sentences about them."""

    parameters: xr.Dataset
    initial: xr.Dataset
    undetermined: tuple[str, ...]
    missing: tuple[str, ...]  # effects that the model lacks
    weak: tuple[int, ...] = ()  # places of parameters that the data do not determine


def assessed(
    problem: FitProblem, fit: Fit, loss: str = "linear", effects: bool = True
) -> Assessment:
    """Return the assessment of a fit, with tests of ``effects`` that the model lacks."""
    slots, size = problem.space.slots, np.abs(fit.vector)
    columns, priors, physical = information_of(problem, fit)
    # Residuals of a search that goes on, or below the accuracy of the runs, show nothing.
    rough = fit.converged and min(fits_by_channel(problem.runs, fit.outputs).values()) < _PERFECT
    whole = Completed([], fit.vector, covariance_of(columns, priors))
    if effects and rough:
        whole = completed(problem, fit, columns, priors, loss)
    # The change by effects counts as a standard deviation.
    change = whole.vector - fit.vector
    covariance = whole.covariance + np.outer(change, change)
    # An estimate of zero has no size.
    size = np.where(size > _AT_BOUND * problem.space.scale, size, problem.space.scale)
    # A change by effects is an error of the model, which says nothing about the data.
    without = covariance_of(columns, np.where(physical, 0.0, priors))
    block = np.ix_(physical, physical)
    lost = undetermined(without[block], size[physical])
    named = [([slots[k] for k in np.flatnonzero(physical)[places]], d) for places, d in lost]
    alone = [(places[0], deviation) for places, deviation in named if len(places) == 1]
    sentences = [_sentence_of_each(alone)] if alone else []
    sentences += [_sentence(places, d) for places, d in named if len(places) > 1]
    weak = sorted({int(np.flatnonzero(physical)[k]) for places, _ in lost for k in places})
    missing = [effect.sentence for effect in whole.effects]
    # The limit of the sentences on data holds for all deviations of the table.
    share = np.sqrt(np.maximum(np.diag(covariance), 0.0)) / size
    uncertain = [k for k in np.flatnonzero(physical & (share > UNDETERMINED)) if k not in weak]
    if missing and uncertain:
        words = [f"{_words(slots[k])} ({_share(share[k])})" for k in uncertain]
        missing.append(f"With the effects, the data leave uncertain the {_listed(words)}.")
    return Assessment(
        _table(problem, fit, covariance, whole.vector, np.flatnonzero(physical)),
        _table(problem, fit, covariance, whole.vector, np.flatnonzero(~physical)),
        tuple(sentences),
        tuple(missing),
        tuple(weak),
    )


def profiled(problem: FitProblem, fit: Fit, assessment: Assessment) -> xr.Dataset:
    """Return the table of parameters, with intervals of weak ones by the profile likelihood.

    A parameter is fixed at values on both sides of its estimate, and all others are fitted, until
    the cost rises by that of a 95 % interval, times the square of the stated deviation over that
    from the derivatives (Raue et al., Bioinformatics 25 (2009) 1923).
    """
    problem.restore(fit)
    columns, priors, physical = information_of(problem, fit)
    curvature = information(columns) + np.diag(priors)
    acting = np.flatnonzero(np.diag(curvature) > 0.0)
    root = inverse_root(curvature[np.ix_(acting, acting)])
    table = assessment.parameters.copy(deep=True)
    rows = np.flatnonzero(physical).tolist()
    # The interval of a rate over which friction fades tells less than its many fits cost.
    slots = problem.space.slots
    weak = [k for k in assessment.weak if k in acting and not slots[k].path.endswith("_rate")]
    for place in weak[:_MOST_PROFILED]:
        row = rows.index(place)
        column = root @ root[acting.tolist().index(place)]
        deviation = float(np.sqrt(column[acting == place][0]))
        stated = float(table["standard_deviation"][row])
        widened = stated / deviation if np.isfinite(stated) else 1.0
        direction = np.zeros(fit.vector.size)
        direction[acting] = column / deviation**2
        first = min(HALF * stated, max(abs(fit.vector[place]), problem.space.scale[place]))
        for name, sign in (("interval_start", -1.0), ("interval_end", 1.0)):
            if table["lower" if sign < 0.0 else "upper"][row] == fit.vector[place]:
                continue
            change = sign * first * direction
            rise = 0.5 * (HALF * widened) ** 2
            end = profile_end(problem, fit, place, change, rise)
            table[name][row] = table[name][row] if np.isnan(end) else end
    return table


def estimate_errors(
    run: RecordRun, arm: Arm, shared: Case, free: Sequence[FreeParameter], parameters: xr.Dataset
) -> FloatArray | None:
    """Return changes (samples, channels, k) of a record's outputs by errors of the estimates.

    They are independent, of one standard deviation each. None if they cannot be computed.
    """
    common = [parameter for parameter in free if not parameter.per_record]
    table = parameters.sel(parameter=[p.path for p in common], other=[p.path for p in common])
    deviation = table["standard_deviation"].values
    kept = np.flatnonzero(np.isfinite(deviation))
    if not kept.size:
        return None
    space = Space(arm, shared.motors, common, {run.name: run.record}, shared.errors)
    slopes = output_derivatives(run, space, 0, space.start, kept)
    if isinstance(slopes, str):
        return None
    sizes = deviation[kept]
    values, vectors = np.linalg.eigh(table["correlation"].values[np.ix_(kept, kept)])
    root = sizes[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(slopes @ root)


def _table(
    problem: FitProblem,
    fit: Fit,
    covariance: FloatArray,
    with_effects: FloatArray,
    places: np.ndarray,
) -> xr.Dataset:
    slots = [problem.space.slots[k] for k in places]
    block = covariance[np.ix_(places, places)]
    deviation = np.sqrt(np.maximum(np.diag(block), 0.0))
    safe = np.where((deviation > 0.0) & np.isfinite(deviation), deviation, 1.0)
    related = np.where(np.isfinite(block), block / np.outer(safe, safe), 1.0)
    values, fitted = fit.vector[places], not np.array_equal(with_effects, fit.vector)
    lower, upper = (bound[places] for bound in problem.space.bounds)
    near = _AT_BOUND * problem.space.scale[places]
    ends = [np.clip(values + sign * HALF * deviation, lower, upper) for sign in (-1.0, 1.0)]
    columns = {
        "estimate": values,
        "standard_deviation": deviation,
        "interval_start": ends[0],
        "interval_end": ends[1],
        "start": np.array([slot.start for slot in slots]),
        "lower": lower,
        "upper": upper,
        "with_effects": with_effects[places] if fitted else np.full(len(places), np.nan),
        "at_bound": (values - lower < near) | (upper - values < near),
    }
    names = [slot.name for slot in slots]
    correlation = xr.DataArray(related, dims=("parameter", "other"))
    table = xr.Dataset({name: ("parameter", column) for name, column in columns.items()})
    return table.assign(correlation=correlation).assign_coords(parameter=names, other=names)


def weakest_direction(problem: FitProblem, parameters: xr.Dataset) -> FloatArray:
    """Return a large change (parameters,) in the direction that the data determine least."""
    physical = [k for k, slot in enumerate(problem.space.slots) if not slot.initial]
    deviation, size = (parameters[key].values for key in ("standard_deviation", "estimate"))
    size = np.where(size == 0.0, problem.space.scale[physical], np.abs(size))
    share = np.where(np.isfinite(deviation), deviation / size, 0.0)
    _, vectors = np.linalg.eigh(parameters["correlation"].values * np.outer(share, share))
    direction = np.zeros(problem.space.scale.size)
    direction[physical] = _FAR * size * vectors[:, -1] / np.abs(vectors[:, -1]).max()
    return direction


def alternatives_of(problem: FitProblem, best: Fit, fits: Sequence[Fit | None]) -> list[str]:
    """Return sentences on other arms whose channels all fit almost as well as the best one."""
    rms = problem.rms_of(best.outputs)
    sentences = []
    for fit in fits:
        if fit is None or fit is best:
            continue
        present = problem.rms_of(fit.outputs)
        ratios = [present[t] / v if v else np.inf for t, v in rms.items() if v or present[t]]
        worse = max(ratios, default=1.0) - 1.0
        size = np.maximum(np.abs(best.vector), _AT_BOUND * problem.space.scale)
        changes = np.abs(fit.vector - best.vector) / size
        order = [k for k in np.argsort(-changes) if not problem.space.slots[k].initial]
        named = [k for k in order if changes[k] > _OTHER][:_MOST]
        if worse < _EQUAL and named:
            values = _listed(
                [
                    f"{_words(problem.space.slots[k])} {fit.vector[k]:.3g} instead of "
                    f"{best.vector[k]:.3g}"
                    for k in named
                ]
            )
            excess = 100.0 * max(worse, 0.0)
            sentences.append(
                f"Another arm fits almost equally well: {values}; no RMS is larger by more than "
                f"{excess:.1g} %."
            )
    return sentences


def _sentence_of_each(deviations: Sequence[tuple[Slot, float]]) -> str:
    """Say which single parameters the data do not determine; equal deviations are named once."""
    names: dict[str, list[str]] = {}
    for slot, deviation in deviations:
        names.setdefault(_share(deviation), []).append(_words(slot))
    sentences = []
    for share, own in names.items():
        ending = "its standard deviation is" if len(own) == 1 else "their standard deviations are"
        sentences.append(f"The data do not determine the {_listed(own)}: {ending} {share}.")
    return " ".join(sentences)


def _sentence(slots: Sequence[Slot], deviation: float) -> str:
    """Say which parameters the data do not distinguish."""
    return (
        f"The data do not distinguish the {_listed([_words(slot) for slot in slots])}: a joint "
        f"change of them has a standard deviation of {_share(deviation)}. Fix one of them, or give "
        "it a prior."
    )


def _words(slot: Slot) -> str:
    return in_words(slot.path) + slot.name.removeprefix(slot.path)


def _share(deviation: float) -> str:
    return f"{100.0 * deviation:.0f} %" if deviation < 10.0 else "more than 1000 %"


def _listed(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def fits_of(
    runs: Sequence[RecordRun],
    outputs: Sequence[FloatArray],
    errors: Sequence[FloatArray | None] = (),
) -> xr.Dataset:
    """Return fit, RMS and tests of the residuals (record, channel).

    ``errors`` (samples, channels, k) of each record are those of ``estimate_errors``.
    """
    channels = list(dict.fromkeys(label.text for run in runs for label in run.labels))
    shape = len(runs), len(channels)
    values = {name: np.full(shape, np.nan) for name in _MEASURES}
    for row, (run, simulated) in enumerate(zip(runs, outputs, strict=True)):
        for c, label in enumerate(run.labels):
            good, place = run.valid[:, c], (row, channels.index(label.text))
            residuals = np.where(good, run.measured[:, c] - simulated[:, c], 0.0)
            values["fit"][place] = fit_percent(run.measured[good, c], simulated[good, c])
            values["rms"][place] = np.sqrt(np.mean(residuals[good] ** 2))
            values["whiteness"][place] = whiteness(residuals, good)
            inputs = run.record.inputs.values()
            moved = errors[row] if errors else None
            moved = None if moved is None else moved[:, c]
            driven = [independence(residuals, good, x, errors=moved) for x in inputs]
            tested = [probability for probability in driven if np.isfinite(probability)]
            if tested:  # the smallest of several probabilities (Bonferroni)
                values["independence"][place] = min(1.0, len(tested) * min(tested))
    labels = {name: {"units": unit, "long_name": text} for name, (unit, text) in _MEASURES.items()}
    variables = {name: (("record", "channel"), values[name], labels[name]) for name in _MEASURES}
    return xr.Dataset(variables, {"record": [run.name for run in runs], "channel": channels})


def fits_by_channel(runs: Sequence[RecordRun], outputs: Sequence[FloatArray]) -> dict[str, float]:
    """Return the smallest fit (percent) of each channel in all records."""
    fits: dict[str, float] = {}
    for run, simulated in zip(runs, outputs, strict=True):
        for c, label in enumerate(run.labels):
            good = run.valid[:, c]
            fit = fit_percent(run.measured[good, c], simulated[good, c])
            fits[label.text] = min(fit, fits.get(label.text, np.inf))
    return fits


def histories_of(runs: Sequence[RecordRun], outputs: Sequence[FloatArray]) -> dict[str, xr.Dataset]:
    """Return measured and simulated channels and the inputs of each record over time."""
    histories = {}
    for run, simulated in zip(runs, outputs, strict=True):
        dims = ("time", "channel")
        measured = np.where(run.valid, run.measured, np.nan)
        units = [MEASURED[label.channel].unit for label in run.labels]
        given = run.record.inputs
        inputs = np.stack(list(given.values()), axis=1) if given else np.zeros((run.times.size, 0))
        histories[run.name] = xr.Dataset(
            {
                "measured": (dims, measured),
                "simulated": (dims, simulated),
                "driven": (("time", "input"), inputs),
            },
            {
                "time": ("time", run.times, {"units": "s", "long_name": "time"}),
                "channel": [label.text for label in run.labels],
                "unit": ("channel", units),
                "input": [label.text for label in given],
            },
        )
    return histories


_HEADS = ("parameter", "value", "std. deviation", "%")


@dataclass(frozen=True, eq=False)
class Identifiability:
    """Identifiability of parameters by planned experiments.

    Attributes:
        parameters: dataset over ``parameter`` as in `Identification`: ``estimate`` (the value of
            the arm), ``standard_deviation`` (predicted), ``correlation`` and others; infinite for
            a parameter without effect.
        undetermined: sentences about parameters, or combinations of them, that the data will not
            determine; empty if all will be determined.
        information: (parameters, parameters) Fisher information of the parameters without
            priors, relative to their values: one over the squared relative deviation for a single
            one. The initial states that are estimated with them are eliminated.
    """

    parameters: xr.Dataset
    undetermined: tuple[str, ...]
    information: FloatArray

    @property
    def log_determinant(self) -> float:
        """Natural logarithm of the determinant of the information; a D-optimal one is largest.

        -inf if a combination of parameters has no effect. Half its increase is the logarithm of
        the factor by which the volume of the region of confidence shrinks.
        """
        sign, value = np.linalg.slogdet(self.information)
        return float(value) if sign > 0.0 else -np.inf

    @public_call
    def __getitem__(self, path: str) -> float:
        """Return the predicted standard deviation of a parameter by its path.

        Raises:
            InputError: if no parameter has this path.
        """
        return number_of(self.parameters, path, "standard_deviation")

    def rows(self) -> list[tuple[str, str, str, str]]:
        """Return the table of parameters: path, value, predicted deviation, also in percent."""
        table = []
        for name in self.parameters["parameter"].values.tolist():
            one = self.parameters.sel(parameter=name)
            value, deviation = float(one["estimate"]), float(one["standard_deviation"])
            share = f"{100.0 * deviation / abs(value):.3g}" if value else ""
            table.append((name, f"{value:.5g}", f"{deviation:.3g}", share))
        return table

    def __str__(self) -> str:
        return "\n\n".join([aligned([_HEADS, *self.rows()]), *self.undetermined])

    def __repr__(self) -> str:
        count, lost = self.parameters.sizes["parameter"], len(self.undetermined)
        return f"<flexarm.Identifiability: {count} parameters, {lost} combinations undetermined>"

    def _repr_html_(self) -> str:
        return html_table(repr(self).strip("<>"), _HEADS, self.rows())


@public_call
def identifiability(
    arm: Arm,
    records: Records,
    free: Sequence[str | FreeParameter],
    *,
    motors: Motors | None = None,
    integrator: str | Integrator = "auto",
    step: float | None = None,
    rtol: float = 1e-7,
    atol: float | None = None,
) -> Identifiability:
    """Predict the standard deviations that ``identify`` will report for planned experiments.

    Only the inputs, times, channels, filters and initial states of the records count, and their
    ``noise``, which is required for every compared channel; the values of the channels do not.
    Results of ``simulate`` are such records: ``fa.MeasuredRecord(result, outputs=["joint_angle"],
    noise={"joint_angle": 1e-4})``.

    Args:
        arm: with the expected values of the parameters, at which the derivatives are taken.
        records, free, motors: as for ``identify``.
        integrator, step, rtol, atol: of all runs, as in ``simulate``.

    Returns:
        Predicted standard deviations, and combinations of parameters that the records will not
        determine. They hold for white noise and small deviations (Cramer and Rao's bound, which
        least squares reach with many samples).

    Raises:
        InputError: if the noise of a channel is missing, a record does not fit the arm, or a path
            is not one of a number; all problems are listed.
        SimulationError: if a record cannot be simulated.

    Ljung, *System Identification*, 2nd ed., 1999, section 7.4.
    """
    if motors is not None:
        check_kind("motors", motors, Motors)
    given = check_some_records(records)
    check_inputs(given)
    options: dict[str, Any] = {"integrator": integrator, "rtol": rtol, "atol": atol}
    options |= {} if step is None else {"step": step}
    return predicted(arm, given, check_free(free), motors, options)


def predicted(
    arm: Arm,
    records: dict[str, MeasuredRecord],
    free: Sequence[FreeParameter],
    motors: Motors | None,
    options: dict[str, Any],
) -> Identifiability:
    """Return the identifiability of parameters by records, from arguments that are checked."""
    missing: dict[str, list[str]] = {}
    for name, record in records.items():
        channels = dict.fromkeys(label.channel for label in record.outputs)
        lacking = [channel for channel in channels if channel not in record.settings.noise]
        if lacking:
            missing.setdefault(", ".join(lacking), []).append(name)
    if missing:
        rule = "requires the standard deviation of"
        places = {text: f"noise of {', '.join(names)}" for text, names in missing.items()}
        raise InputError(*(Problem(place, f"{rule} {text}") for text, place in places.items()))
    space = Space(arm, motors, free, records)
    runs = [RecordRun(name, record, arm, options) for name, record in records.items()]
    problem = FitProblem(space, runs, None)
    # Without residuals the noise is white by assumption.
    outputs = [run.measured for run in runs]
    fit = Fit(space.start, 0.0, outputs, problem.noise, 0, True)
    try:
        assessment = assessed(problem, fit, effects=False)
        columns, priors, physical = information_of(problem, fit)
    except FitFailure as error:
        raise SimulationError(0.0, str(error)) from None
    information = own_information(columns, priors, space.scale, physical)
    return Identifiability(assessment.parameters, assessment.undetermined, information)
