"""Result of iterative learning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm.control.hardware.measurement import FloatArray
from flexarm.planning.learning.added_torque import AddedTorque

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, eq=False)
class LearnedMotion:
    """Torques learned in repeated trials of a motion, their errors, and the rate of convergence.

    Attributes:
        controller: the controller with the learned torque added, for ``simulate`` or your own loop.
        interval: s, time in which a learned torque is constant.
        torques: (trials, N, joints) N m, added in each trial.
        errors: (trials, N, outputs) m or rad, reference minus output at the ends of the intervals.
        predicted_errors: of the same shape, as the model predicts them from the first trial.
        predicted_rate: factor of the change of torque from trial to trial after many trials: the
            spectral radius of the learning; (C.103). Learning converges if it is below one.
        predicted_bound: largest factor in any trial, the largest singular value. If it is below
            one, the change of torque decreases in every trial.
        rate: (trials - 2,), measured factors: norm of each change of torque over that before it;
            NaN after no change.
        result: dataset of the last trial; None for trials of your own.
    """

    controller: AddedTorque
    interval: float
    torques: FloatArray
    errors: FloatArray
    predicted_errors: FloatArray
    predicted_rate: float
    predicted_bound: float
    rate: FloatArray
    result: xr.Dataset | None

    def __repr__(self) -> str:
        first, last = self.error_rms[0], self.error_rms[-1]
        return (
            f"<flexarm.LearnedMotion: {len(self.torques)} trials, error {first:.3g} to "
            f"{last:.3g} RMS, predicted rate {self.predicted_rate:.3g}>"
        )

    @property
    def time(self) -> FloatArray:
        """Ends of the intervals (N,), s."""
        return self.interval * np.arange(1, self.torques.shape[1] + 1)

    @property
    def error_rms(self) -> FloatArray:
        """Root of the mean squared length of the error, for each trial (trials,), m or rad."""
        return _rms(self.errors)

    @property
    def predicted_error_rms(self) -> FloatArray:
        """The same for ``predicted_errors``, (trials,)."""
        return _rms(self.predicted_errors)


def _rms(errors: FloatArray) -> FloatArray:
    found: FloatArray = np.sqrt(np.mean(np.sum(errors**2, axis=2), axis=1))
    return found
