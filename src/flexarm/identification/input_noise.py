"""Noise of measured inputs: its size, and the errors of estimates that it causes.

A simulation integrates the noise of the samples of its torque, so that a joint drifts. Estimates
follow the drift, the residuals hardly show it, and deviations from residuals alone are too small:
errors in variables, Soderstrom, Automatica 43 (2007) 939.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexarm.identification.fitting import Fit, FitProblem
from flexarm.identification.prediction import PredictedRun
from flexarm.identification.runs import RecordRun
from flexarm.identification.space import Case
from flexarm.identification.statistics import (
    Column,
    information,
    inverse_root,
    noise_scores,
)
from flexarm.integrate.base import FloatArray

#: Runs with random noise: with the one without it, two batches of eight lanes.
_RUNS = 15
#: Largest input in the noise of these runs, as a fraction of the largest one, so that its effect is
#: far above the errors of the runs; and noise that has no effect, such as rounding.
_SIZE, _LEAST = 0.01, 1e-5
#: Part of the spectrum, below half the rate, that is noise if the input is smooth.
_TOP = 0.2
#: Deviations of the power of white residuals that noise may leave without being visible.
_SURE = 2.0


def noise_of(samples: FloatArray) -> FloatArray:
    """Return the standard deviations (joints,) of white noise on the samples of inputs."""
    from scipy.signal import periodogram

    # A smooth input has no power near half the rate, and one that switches has no third differences
    # between its steps: the smaller deviation is that of noise.
    _, power = periodogram(samples, window="hann", detrend="linear", axis=0)
    floor = np.median(power[-max(1, int(_TOP * len(power))) :], axis=0) / np.log(2.0)
    rough = np.median(np.abs(np.diff(samples, 3, axis=0)), axis=0)
    return np.asarray(np.minimum(np.sqrt(0.5 * floor), 1.4826 * rough / np.sqrt(20.0)))


def with_input_noise(
    problem: FitProblem, fit: Fit, columns: Sequence[Column], priors: FloatArray
) -> list[Column]:
    """Return the columns of a fit with their changes by noise of the inputs, if there is any.

    The noise is that on the samples, or that which a record states; a zero-order hold is a command,
    which has none. Noise that would leave larger residuals than those of the fit, with each of its
    random samples, acts in part: it counts by as much as the residuals allow.
    """
    changes, random = list[FloatArray](), np.random.default_rng(0)
    for k, run in enumerate(problem.runs):
        moved = _changes_of(run, problem.space.case(k, fit.vector), random) * run.valid[..., None]
        changes += list(np.moveaxis(problem.whitened(k, moved), 1, 0))
    if not any(np.any(change) for change in changes):
        return list(columns)
    noisy = [column._replace(noise=c) for column, c in zip(columns, changes, strict=True)]
    curvature = information(columns) + np.diag(priors)
    determined = np.diag(curvature) > 0.0
    root = inverse_root(curvature[np.ix_(determined, determined)])
    moved = root @ (root.T @ noise_scores(noisy)[determined])
    pairs = zip(changes, columns, strict=True)
    left = np.concatenate([c - column.derivatives[:, determined] @ moved for c, column in pairs])
    residuals = np.concatenate([column.residuals for column in columns])
    # Powers in the space of all other samples of the noise: that of white residuals is the number
    # of these samples, with a deviation of the root of twice as many.
    others = [np.linalg.qr(np.delete(left, k, axis=1))[0] for k in range(_RUNS)]
    least = min(np.sum((q.T @ left[:, k]) ** 2) for k, q in enumerate(others))
    power = np.mean([np.sum((q.T @ residuals) ** 2) for q in others]) - (_RUNS - 1)
    largest = max(power, _SURE * np.sqrt(2.0 * (_RUNS - 1)))
    share = np.sqrt(min(1.0, largest / least)) if least > 0.0 else 1.0
    return [column._replace(noise=share * c) for column, c in zip(noisy, changes, strict=True)]


def _changes_of(run: RecordRun, case: Case, random: np.random.Generator) -> FloatArray:
    """Return changes (samples, channels, runs) of the outputs of a record; zero without noise."""
    changes = np.zeros((*run.measured.shape, _RUNS))
    record = run.record
    stated = record.settings.noise.get(record.input)
    exact = not record.driven or (record.interpolation == "hold" and stated is None)
    if exact or record.input == "none" or isinstance(run, PredictedRun):
        return changes
    largest = np.abs(run.samples).max()
    noise = noise_of(run.samples) if stated is None else np.full(run.samples.shape[1], stated)
    if noise.max() <= _LEAST * largest:
        return changes
    factor = max(1.0, _SIZE * largest / noise.max())
    signals = factor * noise * random.standard_normal((_RUNS, *run.samples.shape))
    before, *others = run.coarse().disturbed(case, [np.zeros_like(run.samples), *signals])
    for k, after in enumerate(others):
        if not (isinstance(before, str) or isinstance(after, str)):
            changes[..., k] = (after - before) / factor
    return changes
