"""Fit of parameters by prediction errors through an extended Kalman filter.

The parameters and the intensities of the noise are estimated alternately. With the gains of the
filter along the record, the innovations are a least-squares problem of the parameters, as for an
observer (innovation form: Ljung, *System Identification*, 2nd ed., 1999, section 7.4). Along the
filtered trajectory, the intensities have the largest likelihood (Kristensen, Madsen and Jorgensen,
Automatica 40 (2004) 225). Without process noise the gains are zero: this is output error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from flexarm.base.errors import InputError
from flexarm.identification.fitting import Fit, FitFailure, FitProblem, Watch
from flexarm.identification.prediction.linear_filter import (
    Gains,
    LinearModel,
    gains_of,
    likelihoods,
    most_likely,
)
from flexarm.identification.prediction.predicted_run import PredictedRun
from flexarm.identification.space import Space
from flexarm.integrate.base import FloatArray

#: First guess of the torque noise, as a fraction of the RMS of the torques.
_GUESS = 0.1
#: Linearisations at the start of a fit.
_PASSES = 2


class PredictionProblem(FitProblem):
    """Innovations of all records and of priors, as functions of scaled changes of the parameters.

    Args:
        torque_noise: (joints,) standard deviation of a random torque error in each sample, N m;
            None to estimate it.

    Attributes:
        torque_noise: the present one.
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
        self._scale = _size_of_torques(space, runs)
        self.torque_noise = self._first_guess()

    def _first_guess(self) -> FloatArray:
        return _GUESS * self._scale if self._given is None else self._given

    def prepare(self, vector: FloatArray) -> None:
        """Estimate the noise at the start of a fit.

        Raises:
            FitFailure: if the arm cannot be simulated there.
        """
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
        """Estimate noise and gains; return the outputs with them, and the largest change.

        It is the relative change of the noise, or the RMS change of the predictions in standard
        deviations.
        """
        old = dict(self.noise)
        self._estimate(vector)
        found = self.outputs(vector)
        if found is None:
            raise FitFailure(self.failure)
        moved = [
            self.whitened(k, a - b) for k, (a, b) in enumerate(zip(found, outputs, strict=True))
        ]
        changes = [abs(self.noise[text] / old[text] - 1.0) for text in old]
        changes += [float(np.sqrt(np.mean(values**2))) for values in moved]
        return found, max(changes)

    def cost(self, vector: FloatArray, outputs: Sequence[FloatArray]) -> float:
        """Return minus the logarithm of the likelihood without constants."""
        values = self.weighted(vector, outputs)
        gains = [run.gains for run in self.runs]
        return 0.5 * float(values @ values) + sum(each.cost for each in gains if each is not None)

    def fit(self, vector: FloatArray, outputs: list[FloatArray], converged: bool) -> Fit:
        """Return a fit with the present noise and gains."""
        gains = tuple(run.gains for run in self.runs)
        own = dict(self.noise)
        done = vector, self.cost(vector, outputs), outputs, own, self.evaluations, converged
        return Fit(*done, torque_noise=self.torque_noise, gains=gains)

    def _estimate(self, vector: FloatArray) -> None:
        """Estimate the noise along the filtered records, and set the gains.

        Raises:
            FitFailure: if a filter diverges.
        """
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
        found = run.linearised(case, self.torque_noise, self._noise_of_run(run))
        if isinstance(found, str):
            raise FitFailure(f"{run.name}: {found}")
        return found

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
        found = most_likely(cost, start, np.concatenate([self._scale[:joints], guesses]))
        if joints:
            self.torque_noise = found[:joints]
        self.noise |= dict(zip(texts, found[joints:].tolist(), strict=True))

    def _take(self, gains: Sequence[Gains]) -> None:
        for run, own in zip(self.runs, gains, strict=True):
            run.gains = own
        self._last = None  # the derivatives depend on the gains


def _size_of_torques(space: Space, runs: Sequence[PredictedRun]) -> FloatArray:
    """Return the RMS (joints,) of the torques of all records, N m; 1 without torques."""
    squares = [run.torque_power(space.case(k, space.start)) for k, run in enumerate(runs)]
    size = np.sqrt(np.mean(squares, axis=0))
    return np.asarray(np.where(size > 0.0, size, size.max() or 1.0))
