"""Frequency responses of measured records: ``flexarm.frequency_response``.

Spectra: Bendat and Piersol, *Random Data*, 4th ed., 2010, chapters 6, 7 and 9; Pintelon and
Schoukens, *System Identification: A Frequency Domain Approach*, 2nd ed., 2012, chapters 2 and 3;
for segments that overlap Harris, Proceedings of the IEEE 66 (1978) 51.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.base.arguments import check_positive
from flexarm.base.errors import (
    AccuracyWarning,
    InputError,
    Problem,
    check_array,
    public_call,
    raise_any,
    shown,
    warn_caller,
)
from flexarm.identification.frequency.fit import MeasuredModes, RationalProblem, fitted_modes
from flexarm.identification.record import (
    MEASURED,
    Label,
    MeasuredRecord,
    Records,
    check_some_records,
    coefficients,
)
from flexarm.identification.statistics import warn_of_fits
from flexarm.integrate.base import FloatArray
from flexarm.model.quantities import Count, NonNegative

#: Least power of an input at a frequency, as a fraction of its largest one, and least ratio of the
#: smallest to the largest eigenvalue of the normalised spectra of the inputs.
_EXCITED, _DISTINCT = 1e-6, 1e-6
#: Power of lines that a periodic input lacks, such as the even ones of an odd multisine, as a
#: fraction of that of lines on both sides, and distance of these: noise has a few percent of it.
_GAP, _NEAR = 0.03, 3
#: Fewest frequencies of a fit, besides two for each mode.
_SPARE = 6
#: Fit (%) of modes below which some are missing or noise hides them, and the words of the warning.
POOR = 50.0, "the fitted modes hardly reproduce", "Check the number of modes and the noise."


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
    def modes(self, count: Count, *, band: ArrayLike | None = None) -> MeasuredModes:
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
        low, high = check_band(band)
        inside = (self.frequency_hz >= low) & (self.frequency_hz <= high)
        if np.count_nonzero(inside) < 2 * count + _SPARE:
            rule = f"contain at least {2 * count + _SPARE} frequencies for {count} modes"
            raise InputError(Problem("band", rule, shown(int(np.count_nonzero(inside)))))
        rates = np.array([MEASURED[one.channel].unit.endswith("/s") for one in self._labels])
        measured = self.response[inside]
        problem = RationalProblem(
            self.frequency_hz[inside], measured, self.deviation[inside], rates
        )
        fit = fitted_modes(problem, count)
        missed = np.linalg.norm(measured - fit["fitted"], axis=0)
        fit["fit"] = 100.0 * (1.0 - missed / np.linalg.norm(measured, axis=0))
        names = [f"{output} to {given}" for output in self.outputs for given in self.inputs]
        warn_of_fits(dict(zip(names, fit["fit"].ravel().tolist(), strict=True)), *POOR)
        return MeasuredModes(**fit, outputs=self.outputs, inputs=self.inputs, _labels=self._labels)


@public_call
def frequency_response(
    records: Records,
    *,
    period: float | None = None,
    segment: float | None = None,
    start: NonNegative = 0.0,
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
            window. Only the frequencies of the input remain, those with 3 % or more of the power of
            lines nearby.
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
    given, inputs, outputs = alike_records(records)
    if period is not None and segment is not None:
        raise InputError(Problem("segment", "cannot be combined with period"))
    limits = check_band(band)
    if period is not None:
        length = check_positive("period", period, "s")
        parts = [_periodic_spectra(record, length, start) for record in given.values()]
    else:
        width = None if segment is None else check_positive("segment", segment, "s")
        parts = [_segment_spectra(record, width, start) for record in given.values()]
    if any(part.frequency_hz.size != parts[0].frequency_hz.size for part in parts):
        rule, hint = "is required for records of different length", "Give its length in seconds."
        raise InputError(Problem("segment", rule, hint=hint))
    averages = sum(part.averages for part in parts)
    total = sum(part.averages * part.matrix for part in parts) / averages
    spectra = _Spectra(parts[0].frequency_hz, np.asarray(total), averages)
    if period is not None:
        between = np.any(_between_lines(_power(spectra.matrix, len(inputs))), axis=1)
        spectra = _Spectra(spectra.frequency_hz[~between], spectra.matrix[~between], averages)
    return _estimate(spectra, next(iter(given.values())), inputs, outputs, limits)


def _power(matrix: _ComplexArray, m: int) -> FloatArray:
    """Return the power (F, m) of the inputs at each frequency."""
    return np.asarray(np.diagonal(matrix[:, :m, :m], axis1=1, axis2=2).real)


def _between_lines(power: FloatArray) -> NDArray[np.bool_]:
    """Return where the power (F, m) of a periodic input is noise between its lines."""
    padded = np.pad(power, ((_NEAR, _NEAR), (0, 0)))
    highest = np.lib.stride_tricks.sliding_window_view(padded, _NEAR, axis=0).max(axis=-1)
    before, after = highest[: len(power)], highest[_NEAR + 1 :]
    return np.asarray(power < _GAP * np.minimum(before, after))


def alike_records(
    records: Records,
) -> tuple[dict[str, MeasuredRecord], list[Label], list[Label]]:
    """Return records with inputs, and their inputs and outputs; InputError if these differ."""
    given = check_some_records(records)
    names = list(given)
    first = given[names[0]]
    inputs, outputs = list(first.inputs), list(first.outputs)
    problems = []
    for name, record in given.items():
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
    raise_any(problems)
    return given, inputs, outputs


def check_band(band: ArrayLike | None) -> tuple[float, float]:
    """Return the lowest and the highest frequency, Hz; all without a band."""
    if band is None:
        return 0.0, np.inf
    low, high = check_array("band", band, (2,)).tolist()
    if low > high:
        raise InputError(Problem("band", "be ascending", shown([low, high])))
    return low, high


def _estimate(
    spectra: _Spectra,
    record: MeasuredRecord,
    inputs: list[Label],
    outputs: list[Label],
    band: tuple[float, float],
) -> FrequencyResponse:
    """Return H1 = S_yu S_uu^-1 with its deviation and multiple coherence."""
    m, hertz = len(inputs), spectra.frequency_hz
    driven = spectra.matrix[:, :m, :m]
    power = _power(spectra.matrix, m)
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
    before, after = (
        np.stack([_instrument_response(record, label, hertz) for label in labels], axis=1)
        for labels in (inputs, outputs)
    )
    removed = after[:, :, None] * before[:, None, :]
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
    matrix: _ComplexArray, m: int, averages: float
) -> tuple[_ComplexArray, FloatArray, FloatArray]:
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


_ComplexArray = NDArray[np.complex128]
#: Distance of a period from a whole number of samples, in samples.
_WHOLE = 1e-3
#: Change of inputs from period to period, as a fraction of their size, that noise may cause.
_REPEATED = 0.3
#: Correlation of neighbouring segments that overlap by half, with Hann's window.
_OVERLAP = 1.0 / 6.0
#: Segments of a record by default, without their overlap, and the fewest samples of one.
_SEGMENTS, _FEWEST = 8, 8


class _Spectra(NamedTuple):
    """Averaged spectra of inputs and outputs, the inputs first."""

    frequency_hz: FloatArray  # (F,)
    matrix: _ComplexArray  # (F, n, n) averages of Z Z^H of the transforms Z (n,), squared SI units
    averages: float  # number of independent averages


def _periodic_spectra(record: MeasuredRecord, period: float, start: float) -> _Spectra:
    """Return the spectra of whole periods (s) of a record, without a drift between periods."""
    rate, values = record.rate, _signals(record)
    size = round(period * rate)
    if size < _FEWEST or abs(period * rate - size) > _WHOLE:
        rule = f"be at least {_FEWEST} samples, and a whole number of them, at {rate:g} Hz"
        hint = "read_record(path, rate=...) resamples a record."
        raise InputError(Problem("period", rule, f"{period * rate:.6g}", hint))
    first = int(np.ceil(start * rate - _WHOLE))
    count = (values.shape[1] - first) // size
    if count < 1:
        rule = f"leave a whole period in the record of {record.duration:g} s"
        raise InputError(Problem("start", rule, f"{start:g}"))
    values = values[:, first : first + count * size]
    if count > 1:
        ends = values[:, -size:].mean(axis=1) - values[:, :size].mean(axis=1)
        slope = ends / ((count - 1) * size)
        values = values - slope[:, None] * np.arange(count * size)
        _warn_of_other_period(values[: len(record.inputs)], count, period)
    transform = {"window": "boxcar", "nperseg": size, "noverlap": 0, "detrend": False}
    return _Spectra(*_cross_spectra(values, rate, transform), float(count))


def _cross_spectra(
    values: FloatArray, rate: float, transform: dict[str, Any]
) -> tuple[FloatArray, _ComplexArray]:
    """Return frequencies (F,) Hz and the spectra (F, n, n) of signals (n, samples)."""
    from scipy.signal import csd

    pairs = values[:, None], values[None]
    frequency, spectra = csd(*pairs, fs=rate, scaling="spectrum", **transform)
    return frequency, np.moveaxis(spectra, -1, 0).transpose(0, 2, 1)


def _warn_of_other_period(inputs: FloatArray, count: int, period: float) -> None:
    """Warn if inputs (inputs, samples) differ from one of ``count`` periods to the next."""
    parts = inputs.reshape(len(inputs), count, -1)
    middle = parts.mean(axis=(1, 2), keepdims=True)
    changed = np.linalg.norm(np.diff(parts, axis=1)) / np.sqrt(2.0 * (count - 1))
    size = np.linalg.norm(parts - middle) / np.sqrt(count)
    if changed > _REPEATED * size:
        text = f"the inputs do not repeat after the period of {period:g} s: they change by "
        text += f"{100.0 * changed / size:.0f} % of their size from one to the next. "
        warn_caller(text + "Give the period of the torque, or segment.", AccuracyWarning)


def _segment_spectra(record: MeasuredRecord, segment: float | None, start: float) -> _Spectra:
    """Return the spectra of segments (s) that overlap by half, with Hann's window (Welch)."""
    rate = record.rate
    values = _signals(record)[:, int(np.ceil(start * rate - _WHOLE)) :]
    length = values.shape[1]
    if length < _FEWEST:
        rule = f"leave at least {_FEWEST} samples in the record of {record.duration:g} s"
        raise InputError(Problem("start", rule, f"{start:g}"))
    size = length // _SEGMENTS if segment is None else round(segment * rate)
    if not _FEWEST <= size <= length:
        rule = f"have {_FEWEST} to {length} samples"
        raise InputError(Problem("segment", rule, shown(size)))
    transform = {"window": "hann", "nperseg": size, "noverlap": size // 2, "detrend": "linear"}
    count = (length - size // 2) // (size - size // 2)
    averages = count / (1.0 + 2.0 * _OVERLAP**2 * (1.0 - 1.0 / count))
    return _Spectra(*_cross_spectra(values, rate, transform), averages)


def _signals(record: MeasuredRecord) -> FloatArray:
    """Return the inputs and outputs (n, samples) of a record without missing samples."""
    columns = {**record.inputs, **record.outputs}
    missing = [label.text for label, column in columns.items() if np.isnan(column).any()]
    if missing:
        hint = "read_record(path, start=..., end=...) reads the part between gaps."
        raise InputError(*(Problem(name, "has missing samples", hint=hint) for name in missing))
    return np.stack(list(columns.values()))


def _instrument_response(record: MeasuredRecord, label: Label, hertz: FloatArray) -> _ComplexArray:
    """Return the response (F,) of the path between a quantity and its samples in the record.

    That of an input is the response of its interpolation: a zero-order hold delays a sine by half
    a sample. Delays and filters with ``recorded`` are included. Other filters are not, because the
    samples have not passed through them.
    """
    from scipy.signal import freqz

    settings, rate = record.settings, record.rate
    response = np.exp(-2j * np.pi * hertz * settings.delays.get(label.channel, 0.0))
    if label in record.inputs:
        hold = np.sinc(hertz / rate)
        if record.interpolation == "hold":
            response = response * hold * np.exp(-1j * np.pi * hertz / rate)
        elif record.interpolation == "linear":
            response = response * hold**2
    for item in settings.filters.get(label.channel, ()):
        if not item.recorded or item.kind == "remove_mean":
            continue
        if item.kind == "gain":
            assert item.factor is not None
            response = response * item.factor
            continue
        response = response * freqz(*coefficients(item, rate), worN=hertz, fs=rate)[1]
    return np.asarray(response)
