"""Weighted least squares over several records: residuals, derivatives, weights, starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexarm.base.errors import InputError
from flexarm.identification.runs import RecordRun, output_derivatives
from flexarm.identification.space import Space
from flexarm.integrate.base import FloatArray

#: Rounds in which the noise of channels is estimated anew, and the change that ends them.
_ROUNDS, _SETTLED = 6, 0.03
#: First guess of the noise of a channel, and its lowest value, as fractions of its signal.
_GUESS, _LEAST = 0.1, 1e-7
#: Relative changes of the sum of squares or of the parameters that end the fit.
COARSE, _FINE = 1e-3, 1e-6

#: Change of outputs, relative to them, by that of a parameter by its scale: from it on, the
#: derivative is that of unstable steps.
_WILD = 1e4
#: First step of a search, in scales of the parameters.
_FIRST = 0.3
#: Most fits for one end of a profile, evaluations of each, and how often these are repeated.
_PROFILED, _EACH, _AGAIN = 10, 8, 3
#: Tolerance of the root of the rise, root below which the cost is flat, and deviation of the prior
#: that holds a parameter, relative to its change.
_NEAR, _FLAT, _NARROW = 0.05, 0.2, 1e-3
#: Most and fewest samples of the beginning of each record that is fitted first.
_BEGINNING = 1000, 200
#: Called with the evaluation's number, the sum of squares, and runs and outputs of all records.
Watch = Callable[[int, float, Sequence[RecordRun], Sequence[FloatArray]], None]


class FitProblem:
    """Residuals of all records and of priors, as functions of scaled changes of the parameters.

    ``noise`` is the standard deviation of each channel by its label, SI units; it is given, by the
    records or as ``known``, for those in ``fixed``. ``failure`` is that of the last failed run.
    """

    def __init__(
        self,
        space: Space,
        runs: Sequence[RecordRun],
        watch: Watch | None,
        known: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        self.space, self.runs, self._watch = space, runs, watch
        self.noise: dict[str, float] = {}
        self._signals: dict[str, float] = {}  # largest magnitudes
        self.fixed: set[str] = set(known)
        self.failure = ""
        self.evaluations = 0
        self._last: tuple[FloatArray, list[FloatArray], bool] | None = None
        self._kept: tuple[bytes, list[FloatArray]] | None = None
        for run in runs:
            given = run.record.settings.noise
            for k, label in enumerate(run.labels):
                good = run.measured[run.valid[:, k], k]
                deviation = float(np.std(good)) or 1.0
                size = float(np.max(np.abs(good)))
                self._signals[label.text] = max(size, self._signals.get(label.text, 0.0))
                if label.channel in given:
                    self.noise[label.text] = given[label.channel]
                    self.fixed.add(label.text)
                else:
                    guess = _GUESS * deviation
                    self.noise[label.text] = max(guess, self.noise.get(label.text, 0.0))
        self.noise |= {text: value for text, value in known.items() if text in self.noise}
        self._guess = dict(self.noise)
        self.set_priors()

    def set_priors(self) -> None:
        """Compare the parameters that have priors with them."""
        slots = enumerate(self.space.slots)
        self._priors = [k for k, slot in slots if np.isfinite(slot.prior_deviation)]

    def beginning(self) -> FitProblem | None:
        """Return the problem of the beginnings of all records; None if they are short."""
        try:
            runs = [run.beginning(*_BEGINNING) for run in self.runs]
        except InputError:  # a channel has no samples there
            return None
        short = [run for run in runs if run is not None]
        return FitProblem(self.space, short, self._watch) if len(short) == len(runs) else None

    def prepare(self, vector: FloatArray) -> None:
        """Return to the first guess of the noise, before a fit that starts at ``vector``."""
        self.noise = dict(self._guess)

    def restore(self, fit: Fit) -> None:
        """Return to the noise of a fit."""
        self.noise = dict(fit.noise)

    def vector(self, scaled: FloatArray) -> FloatArray:
        """Return parameters from scaled changes, inside their bounds in spite of rounding."""
        lower, upper = self.space.bounds
        return np.clip(self.space.start + self.space.scale * scaled, lower, upper)

    def scaled(self, vector: FloatArray) -> FloatArray:
        """Return the scaled changes of parameters."""
        return (vector - self.space.start) / self.space.scale

    def outputs(self, vector: FloatArray) -> list[FloatArray] | None:
        """Return the outputs of all records, kept, or None if a run fails."""
        if self._kept is not None and self._kept[0] == vector.tobytes():
            return self._kept[1]
        simulated = []
        for k, run in enumerate(self.runs):
            try:
                case = self.space.case(k, vector)
            except InputError as error:
                self.failure = f"{run.name}: {error}"
                return None
            (outputs,) = run.simulate([case])
            if isinstance(outputs, str) or not np.all(np.isfinite(outputs)):
                self.failure = f"{run.name}: {outputs}"
                return None
            simulated.append(outputs)
        self._kept = vector.tobytes(), simulated
        return simulated

    def residuals(self, scaled: FloatArray) -> FloatArray:
        """Return the weighted residuals; infinite if a run fails, so that the step is rejected."""
        vector = self.vector(scaled)
        outputs = self.outputs(vector)
        if outputs is None:
            size = sum(int(run.valid.sum()) for run in self.runs) + len(self._priors)
            return np.full(size, np.inf)
        values = self.weighted(vector, outputs)
        self.evaluations += 1
        if self._watch is not None:
            self._watch(self.evaluations, float(values @ values), self.runs, outputs)
        return values

    def weighted(self, vector: FloatArray, outputs: Sequence[FloatArray]) -> FloatArray:
        """Return the residuals of samples and priors, divided by their standard deviations."""
        parts = [
            self.whitened(k, run.measured - simulated)[run.valid]
            for k, (run, simulated) in enumerate(zip(self.runs, outputs, strict=True))
        ]
        slots = [self.space.slots[k] for k in self._priors]
        priors = [
            (s.prior - vector[k]) / s.prior_deviation
            for k, s in zip(self._priors, slots, strict=True)
        ]
        return np.concatenate([*parts, np.array(priors)])

    def jacobian(self, scaled: FloatArray) -> FloatArray:
        """Return the derivatives of ``residuals``, (residuals, parameters)."""
        return self.rows(scaled) * self.space.scale

    def rows(self, scaled: FloatArray) -> FloatArray:
        """Return the derivatives of the residuals per unit of each parameter."""
        vector = self.vector(scaled)
        derivatives = self.derivatives(vector, searching=True)
        blocks = []
        for k, (run, slope) in enumerate(zip(self.runs, derivatives, strict=True)):
            block = np.zeros((int(run.valid.sum()), vector.size))
            block[:, self.space.acting_on(k)] = self.whitened(k, -slope)[run.valid]
            blocks.append(block)
        priors = np.zeros((len(self._priors), vector.size))
        for row, k in enumerate(self._priors):
            priors[row, k] = -1.0 / self.space.slots[k].prior_deviation
        return np.concatenate([*blocks, priors])

    def derivatives(self, vector: FloatArray, searching: bool = False) -> list[FloatArray]:
        """Return the derivatives (samples, channels, acting parameters) of each record, kept.

        ``searching``: those of coarse runs do, which err by 1e-5 of their size if they are stable.
        """
        last = self._last
        if last and np.array_equal(last[0], vector) and (searching or not last[2]):
            return last[1]
        every, searched = [], False
        for k, run in enumerate(self.runs):
            places = self.space.acting_on(k)
            taken = run.coarse() if searching else run
            coarse = taken is not run
            slopes = output_derivatives(taken, self.space, k, vector, places)
            if coarse and self._wild(run, slopes, places):
                slopes, coarse = output_derivatives(run, self.space, k, vector, places), False
            if isinstance(slopes, str):
                raise FitFailure(f"{run.name}: {slopes}")
            every.append(slopes)
            searched |= coarse
        self._last = vector, every, searched
        return every

    def _wild(self, run: RecordRun, slopes: FloatArray | str, places: NDArray[np.intp]) -> bool:
        """Return whether derivatives failed, or grew as those of unstable steps do."""
        if isinstance(slopes, str):
            return True
        sizes = np.array([self._signals[label.text] or np.inf for label in run.labels])
        with np.errstate(all="ignore"):
            changes = np.abs(slopes) * self.space.scale[places] / sizes[:, None]
        return not np.all(changes < _WILD)

    def whitened(self, record: int, values: FloatArray) -> FloatArray:
        """Return values (samples, channels) or (samples, channels, n) in standard deviations."""
        run = self.runs[record]
        weights = np.array([self.noise[label.text] for label in run.labels])
        return np.asarray(values / weights.reshape(-1, *(1,) * (values.ndim - 2)))

    def tune(
        self, vector: FloatArray, outputs: list[FloatArray], robust: bool
    ) -> tuple[list[FloatArray], float]:
        """Estimate the noise; return the outputs with it, and its largest relative change."""
        old = self.noise
        least = {text: max(_LEAST * size, 1e-300) for text, size in self._signals.items()}
        self.noise = {
            text: old[text] if text in self.fixed else max(size, least[text])
            for text, size in self.rms_of(outputs, robust).items()
        }
        return outputs, max((abs(self.noise[t] / old[t] - 1.0) for t in old), default=0.0)

    def cost(self, vector: FloatArray, outputs: Sequence[FloatArray]) -> float:
        """Return minus the logarithm of the likelihood without constants."""
        values = self.weighted(vector, outputs)
        cost = 0.5 * float(values @ values)
        for run in self.runs:
            for k, label in enumerate(run.labels):
                cost += float(run.valid[:, k].sum() * np.log(self.noise[label.text]))
        return cost

    def fit(self, vector: FloatArray, outputs: list[FloatArray], converged: bool) -> Fit:
        """Return a fit with the present noise."""
        cost = self.cost(vector, outputs)
        return Fit(vector, cost, outputs, dict(self.noise), self.evaluations, converged)

    def rms_of(self, outputs: Sequence[FloatArray], robust: bool = False) -> dict[str, float]:
        """Return the RMS of each channel's residuals, or ``robust`` 1.4826 times their median."""
        residuals: dict[str, list[FloatArray]] = {}
        for run, simulated in zip(self.runs, outputs, strict=True):
            for k, label in enumerate(run.labels):
                own = (run.measured - simulated)[run.valid[:, k], k]
                residuals.setdefault(label.text, []).append(own)
        every = {text: np.concatenate(parts) for text, parts in residuals.items()}
        return {
            text: float(1.4826 * np.median(np.abs(e)) if robust else np.sqrt(np.mean(e**2)))
            for text, e in every.items()
        }


class FitFailure(Exception):
    """The runs of a fit fail at its start, or at all neighbours of a vector."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Result of one start."""

    vector: FloatArray  # (parameters,) estimates
    #: Minus the logarithm of the likelihood without constants: comparable between starts
    cost: float
    outputs: list[FloatArray]  # of each record
    noise: dict[str, float]  # standard deviation by channel
    evaluations: int  # number of runs of all records, without those for derivatives
    #: Whether the fit ended at a minimum, before the limit of iterations, with noise that no longer
    #: changes
    converged: bool
    torque_noise: FloatArray | None = None  # (joints,) of prediction errors, N m, or None
    gains: tuple[Any, ...] = ()  # of the filters of prediction errors, one for each record


def fit_from(
    problem: FitProblem,
    start: FloatArray,
    loss: str,
    iterations: int,
    precision: float = _FINE,
) -> Fit:
    """Fit from a vector of parameters, with the noise of the channels estimated in between."""
    scaled, robust = problem.scaled(start), loss != "linear"
    problem.evaluations = 0
    problem.prepare(problem.vector(scaled))
    outputs = problem.outputs(problem.vector(scaled))
    if outputs is None:
        raise FitFailure(problem.failure)
    # A beginning costs less, and vibrations that are only a little too fast or too slow are still
    # in phase there, so that it has fewer wrong minima.
    early, left = problem.beginning(), iterations
    if early is not None:
        first, _, used = _minimum(early, scaled, loss, max(1, left // 2), COARSE)
        left = max(1, left - used)
        first_outputs = problem.outputs(problem.vector(first))
        if first_outputs is not None:
            scaled = first
            outputs, _ = problem.tune(problem.vector(first), first_outputs, robust)
    free = problem.noise.keys() - problem.fixed
    converged, change = True, 0.0
    for attempt in range(_ROUNDS):
        rough = COARSE if free and attempt == 0 else precision
        scaled, converged, used = _minimum(problem, scaled, loss, left, rough)
        left -= used
        vector = problem.vector(scaled)
        outputs, change = problem.tune(vector, problem.outputs(vector) or outputs, robust)
        if change < _SETTLED or left < 1:
            break
    return problem.fit(problem.vector(scaled), outputs, converged and change < _SETTLED)


def _minimum(
    problem: FitProblem, scaled: FloatArray, loss: str, iterations: int, precision: float
) -> tuple[FloatArray, bool, int]:
    """Return the changes with the smallest residuals, whether the search converged, evaluations."""
    # The reflective trust-region method of SciPy shortens a step whose residuals are infinite. It
    # cannot go on from a vector without derivatives, so the search ends at the vector before.
    # FitFailure if the start has no derivatives.
    from scipy.optimize import least_squares

    lower, upper = (problem.scaled(bound) for bound in problem.space.bounds)
    accepted: list[FloatArray] = []
    if not scaled.size:
        return scaled, True, 1
    # The method takes the size of the start for that of its first step.
    shift = _FIRST - scaled

    def jacobian(place: FloatArray) -> FloatArray:
        rows = problem.jacobian(place - shift)
        accepted.append(place - shift)
        return rows

    try:
        # The method requires a start strictly between the bounds.
        room = np.where(np.isfinite(upper - lower), upper - lower, 1.0)
        margin = 1e-6 * np.minimum(room, 1.0)
        solution = least_squares(
            lambda place: problem.residuals(place - shift),
            np.clip(scaled, lower + margin, upper - margin) + shift,
            jac=jacobian,
            bounds=(lower + shift, upper + shift),
            method="trf",
            x_scale="jac",
            loss=loss,
            ftol=precision,
            xtol=precision,
            gtol=1e-12,
            max_nfev=iterations,
        )
    except FitFailure:
        if not accepted:
            raise
        return accepted[-1], False, iterations
    return solution.x - shift, solution.status > 0, int(solution.nfev)


def other_fits(
    problem: FitProblem, best: Fit, direction: FloatArray, loss: str, iterations: int
) -> list[Fit]:
    """Return coarse fits that start on both sides of a fit, but full ones if they are better.

    ``direction`` (parameters,) is the change of the parameters to one side.
    """
    fits = []
    lower, upper = problem.space.bounds
    for sign in (-1.0, 1.0):
        problem.restore(best)
        start = problem.scaled(np.clip(best.vector + sign * direction, lower, upper))
        try:
            scaled, converged, _ = _minimum(problem, start, loss, iterations, COARSE)
            vector = problem.vector(scaled)
            outputs = problem.outputs(vector)
            if outputs is None:
                continue
            fit = problem.fit(vector, outputs, converged)
            better = fit.cost < best.cost - 1.0  # by more than the precision of both
            fits.append(fit_from(problem, vector, loss, iterations) if better else fit)
        except FitFailure:
            continue
    return fits


def profile_end(
    problem: FitProblem, best: Fit, place: int, change: FloatArray, rise: float
) -> float:
    """Return the value of a parameter at which the best fit of all others costs ``rise`` more.

    Its bound, or an infinite value, if the cost does not rise so much; NaN if the fits beyond the
    last good one fail. ``change`` (parameters,) is the first one to try, for all parameters; its
    sign gives the side. A search that does not converge ends at the outer end of its bracket.
    """
    value, step = best.vector[place], change[place]
    bound = problem.space.bounds[int(step > 0.0)][place]
    start = best.vector
    # Distance and root of the rise, which is nearly proportional to it: those below 1, and above.
    inside, outside = (0.0, 0.0), (np.inf, np.inf)
    for _ in range(_PROFILED):
        target = value + step
        beyond = not min(value, bound) <= target <= max(value, bound)
        target = bound if beyond else target
        moved = start + change * ((target - start[place]) / change[place])
        fit = _pinned(problem, moved, place, _NARROW * abs(change[place]))
        root = np.inf if fit is None else np.sqrt(max(fit.cost - best.cost, 0.0) / rise)
        if root <= 1.0 and beyond:
            return float(bound)
        distance = abs(target - value)
        if root <= 1.0:
            assert fit is not None
            inside, start = (distance, root), fit.vector
        else:
            outside = distance, root
        if abs(root - 1.0) < _NEAR:
            return float(target)
        if np.isinf(outside[0]):
            distance *= min(max(1.0 / max(root, 1e-9), 1.5), 4.0)
        elif np.isinf(outside[1]) or inside[1] < _FLAT:
            distance = 0.5 * (inside[0] + outside[0])
        else:
            share = (1.0 - inside[1]) / (outside[1] - inside[1])
            distance = inside[0] + share * (outside[0] - inside[0])
        step = np.copysign(distance, step)
    if np.isinf(outside[1]) and np.isfinite(outside[0]):
        return float("nan")
    return float(value + np.copysign(outside[0], step))


def _pinned(problem: FitProblem, start: FloatArray, place: int, width: float) -> Fit | None:
    """Return the fit of all parameters but one from a start; None if it fails."""
    # The parameter has a narrow prior in place of its own one. The cost contains the latter.
    slots = list(problem.space.slots)
    slots[place] = replace(slots[place], prior=start[place], prior_deviation=width)
    pinned = copy(problem)
    pinned.space = copy(problem.space)
    pinned.space.slots = slots
    pinned.set_priors()
    scaled, converged = pinned.scaled(start), False
    try:
        for _ in range(_AGAIN):  # an unfinished fit costs too much, and the end would be too near
            if not converged:
                scaled, converged, _ = _minimum(pinned, scaled, "linear", _EACH, _FINE)
    except FitFailure:
        return None
    vector = problem.vector(scaled)
    outputs = problem.outputs(vector)
    return None if outputs is None else problem.fit(vector, outputs, converged)
