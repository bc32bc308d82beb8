"""Frequency responses of measured records: ``flexarm.frequency_response``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.base.arguments import check_count, check_nonnegative, check_positive
from flexarm.base.errors import (
    AccuracyWarning,
    InputError,
    Problem,
    check_array,
    public_call,
    shown,
    warn_caller,
)
from flexarm.identification.frequency.fit import fitted
from flexarm.identification.frequency.measured_modes import MeasuredModes
from flexarm.identification.frequency.spectra import (
    ComplexArray,
    Spectra,
    instrument_response,
    periodic_spectra,
    segment_spectra,
)
from flexarm.identification.labels import MEASURED, Label
from flexarm.identification.record import MeasuredRecord, Records, check_some_records
from flexarm.integrate.base import FloatArray

#: Least power of an input at a frequency, as a fraction of its largest one, and least ratio of the
#: smallest to the largest eigenvalue of the normalised spectra of the inputs.
_EXCITED, _DISTINCT = 1e-6, 1e-6
#: Fewest frequencies of a fit, besides two for each mode.
_SPARE = 6
#: Fit (%) of modes below which some are missing or noise hides them.
_POOR = 50.0


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """Measured response of outputs to harmonic inputs, as ``LinearModel.frequency_response``.

    Attributes:
        frequency_hz: (F,) frequencies at which the inputs have power.
        response: (F, outputs, inputs) complex, output unit per input unit.
        deviation: (F, outputs, inputs) standard deviations of the complex numbers, by noise of the
            outputs; NaN if there are too few averages to estimate it.
        coherence: (F, outputs) share of the power of an output that all inputs explain, 0 to 1;
            NaN if there are too few averages to estimate it.
        inputs, outputs: names: ``torque_1`` or ``voltage_1``, ``joint_angle_1``, ``tip_x``.
        averages: number of independent averages.
    """

    frequency_hz: FloatArray
    response: NDArray[np.complex128]
    deviation: FloatArray
    coherence: FloatArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    averages: float
    _labels: tuple[Label, ...] = field(repr=False)

    def __repr__(self) -> str:
        sizes = f"{len(self.outputs)} outputs, {len(self.inputs)} inputs"
        low, high = self.frequency_hz[[0, -1]]
        known = not np.isnan(self.coherence).all()
        coherence = f"{np.nanmin(self.coherence):.3g} or better" if known else "unknown"
        return (
            f"<flexarm.FrequencyResponse: {sizes}, {self.frequency_hz.size} frequencies from "
            f"{low:.4g} to {high:.4g} Hz, coherence {coherence}>"
        )

    @public_call
    def modes(self, count: int, *, band: ArrayLike | None = None) -> MeasuredModes:
        """Fit modes of vibration to the response: frequencies, damping and shapes.

        The response of each output to each input is a sum of ``count`` modes and of powers of s for
        rigid-body motion and for the modes above the band, fitted by weighted least squares. All
        outputs and inputs share frequency and damping of the modes.

        Args:
            count: number of modes in the band.
            band: lowest and highest frequency (Hz) of the fit; all by default.

        Returns:
            The modes, in the order of ascending frequency, with standard deviations.

        Raises:
            InputError: if the band is not ascending, or has too few frequencies for the number of
                modes.

        Warns:
            AccuracyWarning: if the fit of a response is below 50 %.
        """
        low, high = _check_band(band)
        inside = (self.frequency_hz >= low) & (self.frequency_hz <= high)
        count = check_count("count", count)
        if np.count_nonzero(inside) < 2 * count + _SPARE:
            rule = f"contain at least {2 * count + _SPARE} frequencies for {count} modes"
            raise InputError(Problem("band", rule, shown(int(np.count_nonzero(inside)))))
        rates = np.array([MEASURED[one.channel].unit.endswith("/s") for one in self._labels])
        found = fitted(
            self.frequency_hz[inside], self.response[inside], self.deviation[inside], rates, count
        )
        self._warn_of_poor_fits(found.fit)
        return MeasuredModes(*found, outputs=self.outputs, inputs=self.inputs, _labels=self._labels)

    def _warn_of_poor_fits(self, fit: FloatArray) -> None:
        poor = [
            f"{output} to {given} ({percent:.2g} %)"
            for output, row in zip(self.outputs, fit, strict=True)
            for given, percent in zip(self.inputs, row, strict=True)
            if percent < _POOR
        ]
        if poor:
            text = f"the fitted modes hardly reproduce {', '.join(poor)}; 100 % is perfect. "
            warn_caller(text + "Check the number of modes and the noise.", AccuracyWarning)


@public_call
def frequency_response(
    records: Records,
    *,
    period: float | None = None,
    segment: float | None = None,
    start: float = 0.0,
    band: ArrayLike | None = None,
) -> FrequencyResponse:
    """Estimate frequency response functions from records, with coherence (estimator H1).

    The spectra are averaged over periods or segments and over records. Noise of the outputs does
    not bias the estimate; noise of the inputs reduces it, and feedback of output noise to the
    inputs biases it.

    Args:
        records: as for ``identify``, with torques, currents or voltages as inputs and the same
            channels and rate. Several inputs require as many records, such as those of
            ``Multisine.orthogonal``, or inputs that are not correlated.
        period: s, of a periodic input in steady state: whole periods are transformed, without a
            window. Only the frequencies of the input remain.
        segment: s, of segments of another input, such as a sweep; they overlap by half and have
            Hann's window. By default an eighth of the record. One over it is the resolution: use
            segments of several decay times.
        start: time (s) in each record before which it is not used, while vibrations from the start
            decay.
        band: lowest and highest frequency, Hz; by default those that have power in all inputs.

    Returns:
        The response, with delays, recorded filters and the hold of the input removed.

    Raises:
        InputError: if records have different channels or rates or missing samples, ``start`` leaves
            too few samples, a period is not a whole number of samples, the band is not ascending,
            or the inputs do not distinguish the effects of the joints.

    Warns:
        AccuracyWarning: if the inputs do not repeat after ``period``.

    Bendat and Piersol, *Random Data*, 4th ed., 2010, section 7.2 and (9.52).
    """
    given = check_some_records(records)
    start = check_nonnegative("start", start)
    if period is not None and segment is not None:
        raise InputError(Problem("segment", "cannot be combined with period"))
    limits = _check_band(band)
    inputs, outputs = _signals_of(given)
    if period is not None:
        length = check_positive("period", period, "s")
        parts = [periodic_spectra(record, length, start) for record in given.values()]
    else:
        width = None if segment is None else check_positive("segment", segment, "s")
        parts = [segment_spectra(record, width, start) for record in given.values()]
    spectra = _average(parts)
    return _estimate(spectra, next(iter(given.values())), inputs, outputs, limits)


def _check_band(band: ArrayLike | None) -> tuple[float, float]:
    """Return the lowest and the highest frequency, Hz; all without a band.

    Raises:
        InputError: if the band is not a pair of ascending numbers.
    """
    if band is None:
        return 0.0, np.inf
    low, high = check_array("band", band, (2,)).tolist()
    if low > high:
        raise InputError(Problem("band", "be ascending", shown([low, high])))
    return low, high


def _signals_of(records: Mapping[str, MeasuredRecord]) -> tuple[list[Label], list[Label]]:
    """Return the inputs and outputs that all records have.

    Raises:
        InputError: if records have no input, prescribed joints, or other signals or settings than
            the first.
    """
    names = list(records)
    first = records[names[0]]
    inputs, outputs = list(first.inputs), list(first.outputs)
    problems = []
    for name, record in records.items():
        if record.input == "none":
            problems.append(Problem(name, "has no torque, current or voltage as its input"))
        if record.settings.prescribed:
            problems.append(Problem(name, "has prescribed joints, which are not supported"))
        if [list(record.inputs), list(record.outputs)] != [inputs, outputs]:
            problems.append(Problem(name, f"has other channels than {names[0]}"))
        treated = record.interpolation, record.settings.delays, record.settings.filters
        if treated != (first.interpolation, first.settings.delays, first.settings.filters):
            problems.append(Problem(name, f"has other delays or filters than {names[0]}"))
        if abs(record.rate / first.rate - 1.0) > 1e-6:
            problems.append(Problem(name, f"has another rate than {names[0]}, {first.rate:g} Hz"))
    if problems:
        raise InputError(*problems)
    return inputs, outputs


def _average(parts: list[Spectra]) -> Spectra:
    """Return the average of the spectra of records, weighted by their numbers of averages.

    Raises:
        InputError: if segments of records have different lengths.
    """
    if any(part.frequency_hz.size != parts[0].frequency_hz.size for part in parts):
        hint = "Give its length in seconds."
        raise InputError(
            Problem("segment", "is required for records of different length", hint=hint)
        )
    averages = sum(part.averages for part in parts)
    total = sum(part.averages * part.matrix for part in parts) / averages
    return Spectra(parts[0].frequency_hz, np.asarray(total), averages)


def _estimate(
    spectra: Spectra,
    record: MeasuredRecord,
    inputs: list[Label],
    outputs: list[Label],
    band: tuple[float, float],
) -> FrequencyResponse:
    """Return H1 = S_yu S_uu^-1 with its deviation and multiple coherence.

    Raises:
        InputError: if no frequency in the band is excited by all inputs independently.
    """
    m, hertz = len(inputs), spectra.frequency_hz
    driven = spectra.matrix[:, :m, :m]
    power = np.diagonal(driven, axis1=1, axis2=2).real
    kept = (hertz > 0.0) & (hertz >= band[0]) & (hertz <= band[1])
    kept &= np.all(power > _EXCITED * power.max(axis=0), axis=1)
    if not kept.any():
        rule = "contains no frequency that is excited by all inputs"
        raise InputError(Problem("band", rule))
    size = np.sqrt(power[kept])
    values = np.linalg.eigvalsh(driven[kept] / (size[:, :, None] * size[:, None, :]))
    kept[kept] = values[:, 0] > _DISTINCT * values[:, -1]
    if not kept.any():
        rule = "do not distinguish the effects of their inputs"
        hint = "Take as many records as joints, with torques of Multisine.orthogonal()."
        raise InputError(Problem("records", rule, hint=hint))
    hertz, matrix = hertz[kept], spectra.matrix[kept]
    response, deviation, coherence = _h1(matrix, m, spectra.averages)
    path = [[instrument_response(record, one, hertz) for one in part] for part in (inputs, outputs)]
    removed = np.stack(path[1], axis=1)[:, :, None] * np.stack(path[0], axis=1)[:, None, :]
    return FrequencyResponse(
        hertz,
        response / removed,
        deviation / np.abs(removed),
        coherence,
        tuple(one.text for one in inputs),
        tuple(one.text for one in outputs),
        spectra.averages,
        tuple(outputs),
    )


def _h1(
    matrix: ComplexArray, m: int, averages: float
) -> tuple[ComplexArray, FloatArray, FloatArray]:
    """Return responses, their deviations and coherences from spectra (F, n, n) with m inputs."""
    inverse = np.linalg.inv(matrix[:, :m, :m])
    crossed = matrix[:, m:, :m]
    response = crossed @ inverse
    own = np.diagonal(matrix[:, m:, m:], axis1=1, axis2=2).real
    explained = np.einsum("foi,foi->fo", response, crossed.conj()).real
    if averages <= m:  # the inputs explain any outputs
        return response, np.full(response.shape, np.nan), np.full(own.shape, np.nan)
    safe = np.where(own > 0.0, own, 1.0)
    coherence = np.where(own > 0.0, np.clip(explained / safe, 0.0, 1.0), 1.0)
    noise = np.maximum(own - explained, 0.0) * averages / (averages - m)
    spread = np.diagonal(inverse, axis1=1, axis2=2).real / averages
    return response, np.sqrt(noise[:, :, None] * spread[:, None, :]), coherence
