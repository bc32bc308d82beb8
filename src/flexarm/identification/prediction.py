"""Fit of parameters by prediction errors, through extended Kalman filters along records.

Innovation form: Ljung, *System Identification*, 2nd ed., 1999, section 7.4. Likelihood of the
intensities of noise: Kristensen, Madsen and Jorgensen, Automatica 40 (2004) 225.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.base.errors import FlexarmError, InputError, Problem, raise_any
from flexarm.control.filters.predicted_readings import LINEAR_SIGNALS, reading_rows
from flexarm.identification.fitting import Fit, FitFailure, FitProblem, Watch
from flexarm.identification.record import MeasuredRecord, place_of
from flexarm.identification.runs import RecordRun
from flexarm.identification.space import Case, Space
from flexarm.integrate.base import FloatArray
from flexarm.linear.step_derivatives.sampled_step import SampledStep
from flexarm.model import Instrument

#: Parts of a sample in which the torque is constant, if it is not a zero-order hold.
_PARTS = 4
#: Largest product of step and fastest rate. The fastest mode is 0.8 % too slow, one of a fifth of
#: its frequency 1e-5: no mass is estimated from the fast modes, as a filter does.
_REACH = 1.0
#: Deviation of an unknown offset, in standard deviations of its channel.
_OFFSET = 10.0
#: Fraction of a sample below which a delay is a whole number of samples.
_WHOLE = 1e-6


class _Model(NamedTuple):
    """An arm along a record: steps, torques (samples - 1, parts, joints), readings and start."""

    step: SampledStep
    torques: FloatArray
    H: FloatArray
    start: FloatArray


class PredictedRun(RecordRun):
    """Predictions of each sample of a record from the samples before.

    The states are [q, qd] and the offsets of channels whose mean is removed. A delayed channel is
    compared at the time of its motion: its samples are moved by the delay. ``gains`` of the filter
    are set before ``simulate``.
    """

    #: The predicted strain contains measured strains.
    proportional = False

    def __init__(
        self, name: str, record: MeasuredRecord, arm: Arm, options: Mapping[str, Any]
    ) -> None:
        settings, problems = record.settings, []
        with_error = "is not supported with prediction_error"
        if record.controller is not None:
            hint = "Use the measured torque as the input."
            problems.append(Problem("controller", with_error, hint=hint))
        if settings.prescribed:
            problems.append(Problem("prescribed", with_error))
        names = dict.fromkeys(label.channel for label in record.outputs)
        for channel in names:
            if channel not in LINEAR_SIGNALS:
                hint = f"Choose outputs from {', '.join(LINEAR_SIGNALS)}."
                problems.append(Problem(f"outputs: {channel}", with_error, hint=hint))
            for item in settings.filters.get(channel, ()):
                if item.kind not in ("gain", "remove_mean"):
                    problems.append(Problem(f"filters: {channel}", f"{item.kind} {with_error}"))
        problems = [replace(problem, where=name) for problem in problems]
        raise_any(problems)
        super().__init__(name, record, arm, options)
        self.gains: _Gains | None = None
        settings = record.settings
        for k, label in enumerate(self.labels):
            self._move(k, settings.delays.get(label.channel, 0.0))
        filters = [settings.filters.get(label.channel, ()) for label in self.labels]
        self._factors = np.array(
            [np.prod([i.factor for i in own if i.factor is not None]) for own in filters]
        )
        centred = [any(i.kind == "remove_mean" for i in own) for own in filters]
        self._offsets = np.eye(len(self.labels))[:, centred]
        exact = self.record.interpolation == "hold" and record.input not in settings.delays
        self._parts = 1 if exact else _PARTS

    @property
    def differentiable(self) -> bool:
        """Whether ``sensitivities`` supports the run: never, because of the corrections."""
        return False

    def coarse(self) -> PredictedRun:
        """Return the run itself: a filter has no tolerances."""
        return self

    def _move(self, column: int, delay: float) -> None:
        """Move the samples of a channel to the times of their motion."""
        if delay == 0.0:
            return
        own = self.valid[:, column]
        count, shift = own.size, delay * self.record.rate
        values, valid = np.zeros(count), np.zeros(count, bool)
        whole = round(shift)
        if abs(shift - whole) < _WHOLE:
            kept = max(count - whole, 0)
            values[:kept], valid[:kept] = self.measured[whole:, column], own[whole:]
        else:
            from scipy.interpolate import CubicSpline

            later = np.arange(count) + shift
            edges = np.flatnonzero(np.diff(own, prepend=False, append=False))
            for first, end in edges.reshape(-1, 2):  # between gaps
                inside = (later >= first) & (later <= end - 1)
                if np.any(inside):
                    places = np.arange(first, end)
                    spline = CubicSpline(places, self.measured[first:end, column])
                    values[inside], valid[inside] = spline(later[inside]), True
        self.measured[:, column], self.valid[:, column] = values, valid

    def simulate(self, cases: Sequence[Case]) -> list[FloatArray | str]:
        """Return the predictions (samples, channels) of each case, or the reason of its failure."""
        return [self._predictions(case) for case in cases]

    def _predictions(self, case: Case) -> FloatArray | str:
        assert self.gains is not None
        try:
            model = self._model(case)
        except FlexarmError as error:
            return str(error)
        z, size = model.start, 2 * model.step.arm.dof
        predicted = np.zeros(self.measured.shape)
        with np.errstate(all="ignore"):
            for k in range(self.times.size):
                predicted[k] = model.H @ z
                z = z + self.gains.K[k] @ np.where(
                    self.valid[k], self.measured[k] - predicted[k], 0.0
                )
                if k == len(model.torques):
                    break
                for torque in model.torques[k]:
                    z[:size] = model.step.advance(z[:size], torque)
                if not np.isfinite(z[0]):
                    return f"the prediction diverges at t = {self.times[k]:.6g} s"
        return predicted

    def linearised(
        self, case: Case, torque_noise: FloatArray, noise: FloatArray
    ) -> LinearModel | str:
        """Run the extended filter; return the linear model along it, or why it fails."""
        try:
            model = self._model(case)
        except FlexarmError as error:
            return str(error)
        size, n = 2 * model.step.arm.dof, model.start.size
        count = self.times.size - 1
        F, G = np.tile(np.eye(n), (count, 1, 1)), np.zeros((count, n, torque_noise.size))
        b = np.zeros((count, n))
        z, P = model.start, self._covariance(size)
        for k in range(count):
            try:
                update = _corrected(P[None], model.H, noise[None], self.valid[k])
            except np.linalg.LinAlgError:
                return f"the filter diverges at t = {self.times[k]:.6g} s"
            missed = np.where(self.valid[k], self.measured[k] - model.H @ z, 0.0)
            z = z + update.K[0] @ missed
            before = z.copy()
            for torque in model.torques[k]:
                step = model.step.take(z[:size], torque)
                z[:size] = step.after
                F[k, :size, :size] = step.state @ F[k, :size, :size]
                G[k, :size] = step.state @ G[k, :size] + step.torque
            if not np.all(np.isfinite(z)):
                return f"the filter diverges at t = {self.times[k]:.6g} s"
            b[k] = z - F[k] @ before
            moved = G[k] * torque_noise
            P = F[k] @ update.P[0] @ F[k].T + moved @ moved.T
        return LinearModel(F, G, b, model.H, model.start, self._covariance(size))

    def torque_power(self, case: Case) -> FloatArray:
        """Return the mean squares (joints,) of the torques."""
        return np.asarray(np.mean(self._torque(case).at(self.times) ** 2, axis=0))

    def _covariance(self, size: int) -> FloatArray:
        """Return the covariance of the start: that of the offsets."""
        each = [np.std(self.measured[self.valid[:, k], k]) for k in range(len(self.labels))]
        deviations = _OFFSET * np.array(each) @ self._offsets
        return np.diag(np.concatenate([np.zeros(size), deviations**2]))

    def _model(self, case: Case) -> _Model:
        """Return the arm of a case along the record; FlexarmError if it is not possible."""
        arm = Arm(case.spec)
        rows = {name: reading_rows(arm, Instrument(name)) for name in self.channels}
        H = np.stack([rows[label.channel][place_of(arm, label)] for label in self.labels])
        return _Model(
            SampledStep(arm, 1.0 / (self.record.rate * self._parts), reach=_REACH),
            self._held_torques(case),
            np.hstack([self._factors[:, None] * H, self._offsets]),
            np.concatenate([*self.state(arm, case), np.zeros(self._offsets.shape[1])]),
        )

    def _held_torques(self, case: Case) -> FloatArray:
        """Return torques (samples - 1, parts, joints) of the impulse and moment of the lines."""
        edges = np.linspace(0.0, self.times[-1], self._parts * (self.times.size - 1) + 1)
        held = self._torque(case).means(edges).reshape(self.times.size - 1, self._parts, -1)
        if self._parts == 1:
            return held
        mean = held.mean(axis=1, keepdims=True)
        return np.asarray(mean + (held - mean) / (1.0 - self._parts**-2))


#: First guess of the torque noise, as a fraction of the RMS of the torques.
_GUESS = 0.1
#: Linearisations at the start of a fit.
_PASSES = 2


class PredictionProblem(FitProblem):
    """Innovations of all records and of priors, as functions of scaled changes of the parameters.

    The parameters and the intensities of the noise are estimated alternately. With the gains of the
    filter along the record, the innovations are a least-squares problem of the parameters, as for
    an observer (innovation form). Along the filtered trajectory, the intensities have the largest
    likelihood. Without process noise the gains are zero: this is output error.

    ``torque_noise`` (joints,) N m is the standard deviation of a random torque error in each
    sample; it is estimated if it is None at first.
    """

    runs: Sequence[PredictedRun]

    def __init__(
        self,
        space: Space,
        runs: Sequence[PredictedRun],
        watch: Watch | None,
        known: Mapping[str, float] = MappingProxyType({}),
        torque_noise: FloatArray | None = None,
    ) -> None:
        super().__init__(space, runs, watch, known)
        self._given = torque_noise
        # The scale is the RMS (joints,) of the torques of all records, N m; 1 without torques.
        squares = [run.torque_power(space.case(k, space.start)) for k, run in enumerate(runs)]
        size = np.sqrt(np.mean(squares, axis=0))
        self._scale = np.asarray(np.where(size > 0.0, size, size.max() or 1.0))
        self.torque_noise = self._first_guess()

    def _first_guess(self) -> FloatArray:
        return _GUESS * self._scale if self._given is None else self._given

    def prepare(self, vector: FloatArray) -> None:
        """Estimate the noise at the start of a fit; FitFailure if the arm cannot be simulated."""
        super().prepare(vector)
        self.torque_noise = self._first_guess()
        for _ in range(_PASSES):
            self._estimate(vector)

    def restore(self, fit: Fit) -> None:
        """Return to the noise and the gains of a fit."""
        super().restore(fit)
        assert fit.torque_noise is not None
        self.torque_noise = fit.torque_noise
        self._take(fit.gains)

    def beginning(self) -> None:
        """Return None: predictions over a sample have no wrong minima that a beginning avoids."""

    def whitened(self, record: int, values: FloatArray) -> FloatArray:
        """Return innovations of a record, or derivatives of them, in standard deviations."""
        run = self.runs[record]
        assert run.gains is not None
        own = values.reshape(*values.shape[:2], -1) * run.valid[..., None]
        return np.asarray(run.gains.whitening @ own).reshape(values.shape)

    def tune(
        self, vector: FloatArray, outputs: list[FloatArray], robust: bool
    ) -> tuple[list[FloatArray], float]:
        """Estimate noise and gains; return the outputs, and the larger relative change of both."""
        old = dict(self.noise)
        self._estimate(vector)
        tuned = self.outputs(vector)
        if tuned is None:
            raise FitFailure(self.failure)
        moved = [
            self.whitened(k, a - b) for k, (a, b) in enumerate(zip(tuned, outputs, strict=True))
        ]
        changes = [abs(self.noise[text] / old[text] - 1.0) for text in old]
        changes += [float(np.sqrt(np.mean(values**2))) for values in moved]
        return tuned, max(changes)

    def cost(self, vector: FloatArray, outputs: Sequence[FloatArray]) -> float:
        """Return minus the logarithm of the likelihood without constants."""
        values = self.weighted(vector, outputs)
        gains = [run.gains for run in self.runs]
        return 0.5 * float(values @ values) + sum(each.cost for each in gains if each is not None)

    def fit(self, vector: FloatArray, outputs: list[FloatArray], converged: bool) -> Fit:
        """Return a fit with the present noise and gains."""
        gains = tuple(run.gains for run in self.runs)
        fit = super().fit(vector, outputs, converged)
        return replace(fit, torque_noise=self.torque_noise, gains=gains)

    def _estimate(self, vector: FloatArray) -> None:
        """Estimate the noise along the filtered records, and set the gains."""
        models = [self._model(k, run, vector) for k, run in enumerate(self.runs)]
        self._estimate_noise(models)
        self._take(
            tuple(
                gains_of(model, run.valid, self.torque_noise, self._noise_of_run(run))
                for model, run in zip(models, self.runs, strict=True)
            )
        )

    def _model(self, record: int, run: PredictedRun, vector: FloatArray) -> LinearModel:
        try:
            case = self.space.case(record, vector)
        except InputError as error:
            raise FitFailure(f"{run.name}: {error}") from None
        model = run.linearised(case, self.torque_noise, self._noise_of_run(run))
        if isinstance(model, str):
            raise FitFailure(f"{run.name}: {model}")
        return model

    def _noise_of_run(self, run: PredictedRun) -> FloatArray:
        return np.array([self.noise[label.text] for label in run.labels])

    def _estimate_noise(self, models: Sequence[LinearModel]) -> None:
        texts = [text for text in self.noise if text not in self.fixed]
        joints = self.torque_noise.size if self._given is None else 0
        if not texts and not joints:
            return

        def cost(values: FloatArray) -> FloatArray:
            total = np.zeros(len(values))
            torque = values[:, :joints] if joints else np.tile(self.torque_noise, (len(values), 1))
            for model, run in zip(models, self.runs, strict=True):
                noise = np.tile(self._noise_of_run(run), (len(values), 1))
                for k, label in enumerate(run.labels):
                    if label.text in texts:
                        noise[:, k] = values[:, joints + texts.index(label.text)]
                total += likelihoods(model, run.measured, run.valid, torque, noise)
            return total

        guesses = np.array([self._guess[text] for text in texts])
        start = np.concatenate([self.torque_noise[:joints], [self.noise[t] for t in texts]])
        intensities = _most_likely(cost, start, np.concatenate([self._scale[:joints], guesses]))
        if joints:
            self.torque_noise = intensities[:joints]
        self.noise |= dict(zip(texts, intensities[joints:].tolist(), strict=True))

    def _take(self, gains: Sequence[_Gains]) -> None:
        for run, own in zip(self.runs, gains, strict=True):
            run.gains = own
        self._last = self._kept = None  # outputs and derivatives depend on the gains


#: Range of estimated intensities, as factors on their scales, and their relative step for slopes.
_LEAST, _MOST, _STEP = 1e-5, 1e3, 1e-4
#: Largest change of the logarithms in a search, and most searches.
_BOX, _BOXES = 1.5, 12
#: Most iterations of the search for intensities, and the cost of those that have no filter.
_ITERATIONS, _IMPOSSIBLE = 60, 1e30


class LinearModel(NamedTuple):
    """Model of a record about a trajectory.

    State after a sample: ``F[k] x + G[k] w + b[k]``, with torque errors w (joints,) of standard
    deviation 1. Readings: ``H x``.
    """

    F: FloatArray  # (samples - 1, n, n)
    G: FloatArray  # (samples - 1, n, joints)
    b: FloatArray  # (samples - 1, n)
    H: FloatArray  # (channels, n)
    start: FloatArray  # (n,)
    P: FloatArray  # (n, n) covariance of the start


class _Gains(NamedTuple):
    """Gains of a filter along a record."""

    K: FloatArray  # (samples, n, channels)
    whitening: FloatArray  # (samples, channels, channels): deviations of innovations become one
    cost: float  # sum of the logarithms of the deviations


class _Update(NamedTuple):
    """Correction by the readings of one sample, for m intensities."""

    K: FloatArray  # (m, n, channels)
    factor: FloatArray  # (m, channels, channels), of Cholesky, of the innovations' covariance
    P: FloatArray  # (m, n, n) after the correction


def _corrected(
    P: FloatArray, H: FloatArray, noise: FloatArray, valid: NDArray[np.bool_]
) -> _Update:
    """Return the correction of covariances (m, n, n) by the ``valid`` readings H (channels, n)."""
    noise = np.where(valid, noise, 1.0)
    # Readings in their own deviations, because rows of angles and strains differ by many digits.
    rows = H * valid[:, None] / noise[:, :, None]
    seen = rows @ P
    S = np.eye(len(H)) + seen @ np.swapaxes(rows, 1, 2)
    K = np.swapaxes(np.linalg.solve(S, seen), 1, 2)
    left = np.eye(P.shape[1]) - K @ rows
    # The Joseph form keeps the covariance symmetric and positive despite rounding.
    after = left @ P @ np.swapaxes(left, 1, 2) + K @ np.swapaxes(K, 1, 2)
    return _Update(K / noise[:, None, :], noise[:, :, None] * np.linalg.cholesky(S), after)


def likelihoods(
    model: LinearModel,
    measured: FloatArray,
    valid: NDArray[np.bool_],
    torque_noise: FloatArray,
    noise: FloatArray,
) -> FloatArray:
    """Return minus the logarithms (m,) of the likelihoods of m noises, without constants."""
    x, total = np.tile(model.start, (len(noise), 1)), np.zeros(len(noise))
    for k, update in enumerate(_updates(model, valid, torque_noise, noise)):
        missed = np.where(valid[k], measured[k] - x @ model.H.T, 0.0)
        white = np.linalg.solve(update.factor, missed[..., None])[..., 0]
        total += 0.5 * np.sum(white**2, axis=1)
        total += np.sum(np.log(np.diagonal(update.factor, axis1=1, axis2=2)), axis=1)
        if k < len(model.b):
            x = x + (update.K @ missed[..., None])[..., 0]
            x = x @ model.F[k].T + model.b[k]
    return total


def _updates(
    model: LinearModel, valid: NDArray[np.bool_], torque_noise: FloatArray, noise: FloatArray
) -> Iterator[_Update]:
    """Yield the correction of each sample for noises (m, joints) and (m, channels)."""
    P = np.tile(model.P, (len(noise), 1, 1))
    for k, now in enumerate(valid):
        update = _corrected(P, model.H, noise, now)
        yield update
        if k < len(model.F):
            moved = model.G[k] * torque_noise[:, None, :]
            P = model.F[k] @ update.P @ model.F[k].T + moved @ np.swapaxes(moved, 1, 2)


def gains_of(
    model: LinearModel, valid: NDArray[np.bool_], torque_noise: FloatArray, noise: FloatArray
) -> _Gains:
    """Return the gains along a record for one pair of intensities (joints,) and (channels,)."""
    samples, channels = valid.shape
    K = np.zeros((samples, model.start.size, channels))
    whitening, cost = np.zeros((samples, channels, channels)), 0.0
    for k, update in enumerate(_updates(model, valid, torque_noise[None], noise[None])):
        K[k], whitening[k] = update.K[0], np.linalg.inv(update.factor[0])
        cost += float(np.sum(np.log(np.diagonal(update.factor[0]))))
    return _Gains(K, whitening, cost)


def _most_likely(
    cost: Callable[[FloatArray], FloatArray], start: FloatArray, scale: FloatArray
) -> FloatArray:
    """Return the positive intensities (p,), with typical values ``scale``, of the least cost."""
    from scipy.optimize import minimize

    count = start.size
    steps = _STEP * np.concatenate([np.zeros((1, count)), np.eye(count), -np.eye(count)])

    def value(logs: FloatArray) -> tuple[float, FloatArray]:
        try:
            costs = cost(np.exp(logs + steps) * scale)
        except np.linalg.LinAlgError:  # readings without noise, predicted in one direction only
            return _IMPOSSIBLE, np.zeros(count)
        return float(costs[0]), (costs[1 : count + 1] - costs[count + 1 :]) / (2.0 * _STEP)

    logs = np.clip(np.log(start / scale), np.log(_LEAST), np.log(_MOST))
    for _ in range(_BOXES):
        # The cost is convex near its minimum only, where large steps go astray.
        low = np.maximum(logs - _BOX, np.log(_LEAST))
        high = np.minimum(logs + _BOX, np.log(_MOST))
        bounds = list(zip(low.tolist(), high.tolist(), strict=True))
        options = {"maxiter": _ITERATIONS, "ftol": 1e-9}
        fit = minimize(value, logs, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        moved, logs = np.abs(fit.x - logs), fit.x
        if np.all(moved < 0.99 * _BOX):
            break
    return np.asarray(np.exp(logs) * scale)
