"""Modes of vibration that fit records over time: ``flexarm.measured_modes``.

y(t) = sum_k 2 Re(A_k x_k + B_k exp(p_k t)) + other terms, with x' = p x + u: output error, whose
residues A and initial states B are linear and eliminated, as in the fit of frequency responses
(Golub and Pereyra, SIAM Journal on Numerical Analysis 10 (1973) 413). The other terms are those of
the poles 0 and -a of the rigid arm, and a multiple of the input for modes above the band.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from flexarm.base.errors import InputError, Problem, public_call, shown
from flexarm.identification.frequency.fit import (
    ComplexArray,
    MeasuredModes,
    ModeProblem,
    fitted_modes,
    root_of,
)
from flexarm.identification.frequency.response import POOR, alike_records, check_band
from flexarm.identification.record import Label, MeasuredRecord, Records, treated
from flexarm.identification.statistics import Column, covariance_of, fit_percent, warn_of_fits
from flexarm.integrate.base import FloatArray
from flexarm.model.quantities import Count
from flexarm.simulation.histories.piecewise import sampled_torque

#: Nodes of Gauss's rule in a sample: exact to rounding up to the highest frequency.
_NODES = 10
#: Trial frequencies: of a grid, and highest lines of the spectra of errors.
_PLACES, _PEAKS = 40, 12
#: Highest frequency by default, as a fraction of half the rate.
_HIGHEST = 0.98


@public_call
def measured_modes(
    records: Records, count: Count, *, band: ArrayLike | None = None
) -> MeasuredModes:
    """Fit modes of vibration to records over time, by output error.

    Lightly damped vibrations that have not decayed at the end of a record, or at the end of its
    segments, bias its frequency response; a fit over time has their initial states. Noise of the
    outputs does not bias it; noise of the inputs does.

    Args:
        records: as for `frequency_response`. They may start in motion, and samples of outputs may
            be missing.
        count: number of modes in the band. Fit a few more and read the diagram ``orders``.
        band: lowest and highest frequency of the modes, Hz; by default one period in the record,
            and half its rate.

    Returns:
        The modes, in the order of ascending frequency, with standard deviations as in `identify`.

    Raises:
        InputError: if records have different channels or rates, the band is not ascending, or there
            are too few samples for the number of modes.

    Warns:
        AccuracyWarning: if the fit of an output is below 50 %.
    """
    given, inputs, outputs = alike_records(records)
    low, high = check_band(band)
    longest, rate = max(r.duration for r in given.values()), next(iter(given.values())).rate
    limits = max(low, 1.0 / longest), min(high, 0.5 * _HIGHEST * rate)
    if limits[0] >= limits[1]:
        rule = f"overlap the frequencies of the records, {1.0 / longest:.3g} to {0.5 * rate:.3g} Hz"
        raise InputError(Problem("band", rule, shown([low, high])))
    problem = _OverTime(list(given.values()), inputs, outputs, limits)
    needed = count * (2 + 2 * (len(inputs) + len(given))) + 4 * len(inputs) + 2 * len(given)
    if problem.values.shape[0] < 2 * needed:
        rule = f"contain at least {2 * needed} samples for {count} modes"
        raise InputError(Problem("records", rule, str(problem.values.shape[0])))
    arrays = fitted_modes(problem, count)
    columns = zip(problem.measured.T, arrays["fitted"].T, problem.valid.T, strict=True)
    fit = np.array([fit_percent(m[v], p[v]) for m, p, v in columns])
    names = tuple(label.text for label in outputs)
    warn_of_fits(dict(zip(names, fit.tolist(), strict=True)), *POOR)
    return MeasuredModes(
        **arrays,
        fit=fit,
        outputs=names,
        inputs=tuple(label.text for label in inputs),
        _labels=tuple(outputs),
    )


class _OverTime(ModeProblem):
    """Weighted errors of records over time; the rows are the samples of all of them."""

    def __init__(
        self,
        records: Sequence[MeasuredRecord],
        inputs: Sequence[Label],
        outputs: Sequence[Label],
        band: tuple[float, float],
    ) -> None:
        low, high = np.log(2.0 * np.pi * np.array(band)).tolist()
        self.limits = low, high
        self._outputs, self._interval = outputs, 1.0 / records[0].rate
        nodes, weights = np.polynomial.legendre.leggauss(_NODES)
        self._nodes, self._weights = 0.5 * (nodes + 1.0), 0.5 * weights * self._interval
        self._times = [record.times - record.times[0] for record in records]
        self._driven: list[tuple[FloatArray, FloatArray]] = []  # at the samples, and in between
        for record, times in zip(records, self._times, strict=True):
            samples = np.stack(list(record.inputs.values()), axis=1)
            history = sampled_torque(
                samples, record.rate, record.duration, len(inputs), record.interpolation
            )
            between = times[:-1, None] + self._interval * self._nodes
            inside = history.at(between.ravel()).reshape(*between.shape, -1)
            self._driven.append((samples, inside))
        after = [treated(record, input_delay=True) for record in records]
        self._paths = [paths for paths, _, _ in after]
        self.measured = np.concatenate([measured for _, measured, _ in after])
        self.valid = np.concatenate([valid for _, _, valid in after])
        self._records = np.repeat(np.arange(len(records)), [t.size for t in self._times])
        sizes = [np.std(m[v]) or 1.0 for m, v in zip(self.measured.T, self.valid.T, strict=True)]
        self._weigh(np.array(sizes))

    def _weigh(self, noise: FloatArray) -> None:
        self._weight = self.valid / noise
        self.values = self.measured * self._weight

    def reweight(self, numbers: FloatArray) -> None:
        """Take the RMS of the errors of each output for its noise."""
        errors = self.errors(numbers).reshape(self.values.shape[::-1]).T
        rms = np.sqrt(np.sum(errors**2, axis=0) / self.valid.sum(axis=0))
        noise = 1.0 / self._weight.max(axis=0)
        self._weigh(noise * np.maximum(rms, 1e-9 * np.abs(self.values).max(axis=0)))

    def _responses(self, root: complex) -> tuple[list[ComplexArray], list[ComplexArray]]:
        """Return states (samples, inputs) of a pole in each record, and its free motions."""
        from scipy.signal import lfilter

        weights = self._weights * np.exp(root * self._interval * (1.0 - self._nodes))
        driven = []
        for _, inside in self._driven:
            steps = np.einsum("g,kgm->km", weights, inside)
            steps = np.concatenate([np.zeros((1, steps.shape[1])), steps])
            driven.append(lfilter([1.0], [1.0, -np.exp(root * self._interval)], steps, axis=0))
        return driven, [np.exp(root * times)[:, None] for times in self._times]

    def _recorded(
        self, driven: Sequence[FloatArray], free: Sequence[FloatArray]
    ) -> list[FloatArray]:
        """Return weighted terms as the records contain them: shared ones, and each record's own."""
        terms = []
        for q in range(len(self._outputs)):
            shared, initial = (
                [paths[q].simulated(part) for paths, part in zip(self._paths, parts, strict=True)]
                for parts in (driven, free)
            )
            columns = np.hstack([np.concatenate(shared), block_diag(*initial)])
            terms.append(columns * self._weight[:, q : q + 1])
        return terms

    def trial_frequencies(self, errors: Sequence[FloatArray]) -> FloatArray:
        """Return a coarse grid, and the peaks of the spectra of the errors."""
        omega = 2.0 * np.pi * np.fft.rfftfreq(errors[0].size, self._interval)[1:]
        power = sum(np.abs(np.fft.rfft(rest))[1:] ** 2 for rest in errors)
        inside = np.abs(np.log(omega) - np.mean(self.limits)) < 0.5 * np.ptp(self.limits)
        highest = np.argsort(np.where(inside, power, 0.0))[-_PEAKS:]
        return np.concatenate([np.linspace(*self.limits, _PLACES), np.log(omega[highest])])

    def terms_of_pole(self, pole: FloatArray) -> list[FloatArray]:
        (root,) = root_of(pole[None])
        parts = [
            [np.hstack([each.real, each.imag]) for each in every]
            for every in self._responses(complex(root))
        ]
        return self._recorded(*parts)

    def other_terms(self, rigid: float) -> list[FloatArray]:
        still, slow = self._responses(0.0), self._responses(-float(np.exp(rigid)))
        driven = [
            np.hstack([samples, a.real, b.real])
            for (samples, _), a, b in zip(self._driven, still[0], slow[0], strict=True)
        ]
        free = [np.hstack([a.real, b.real]) for a, b in zip(still[1], slow[1], strict=True)]
        return self._recorded(driven, free)

    def deviations(self, numbers: FloatArray) -> FloatArray:
        """Return standard deviations (k, 2), with the correlation of errors over time."""
        shape = self.values.shape[::-1]
        slopes = self.slopes(numbers).reshape(*shape, -1)
        errors = self.errors(numbers).reshape(shape)
        columns = [
            Column(errors[q, rows], slopes[q, rows], self.valid[rows, q], record)
            for record in range(len(self._times))
            for rows in [self._records == record]
            for q in range(shape[0])
        ]
        covariance = covariance_of(columns, np.zeros(numbers.size))
        return np.sqrt(np.diag(covariance)[1:]).reshape(-1, 2)

    def residues(self, numbers: FloatArray) -> tuple[ComplexArray, FloatArray]:
        count, m = numbers.size // 2, self._driven[0][0].shape[1]
        others, width = 3 * m + 2 * len(self._times), 2 * (m + len(self._times))
        factors = [self.linear(matrix, q) for q, matrix in enumerate(self.matrices(numbers))]
        weight, self._weight = self._weight, np.ones_like(self._weight)  # in gaps, too
        predicted = [m @ f for m, f in zip(self.matrices(numbers), factors, strict=True)]
        residues, self._weight = [], weight
        for linear in factors:
            driven = linear[others:].reshape(count, width)[:, : 2 * m]
            residues.append(0.5 * (driven[:, :m] - 1j * driven[:, m:]))
        return np.stack(residues, axis=1), np.stack(predicted, axis=1)
