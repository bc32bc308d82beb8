"""Result of an identification, its dataset, and its statistics.

Statistics: fit in percent, tests of residuals, covariance, directions without effect. Ljung,
*System Identification*, 2nd ed., 1999, sections 9 (covariance) and 16.6 (tests); Ljung and Box,
Biometrika 65 (1978) 297; for coloured residuals Morelli and Klein, Journal of Guidance, Control,
and Dynamics 20 (1997) 155, with the lag chosen as in Politis, Journal of Nonparametric Statistics
15 (2003) 661.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flexarm.arm.arm import Arm, save_arm
from flexarm.base.arguments import check_kind
from flexarm.base.errors import InputError, Problem, public_call, shown, suggestion
from flexarm.base.notebook import html_table
from flexarm.base.references import package_version
from flexarm.base.writing.places import AnyPath
from flexarm.identification.record import is_number
from flexarm.integrate.base import FloatArray
from flexarm.model import Motors
from flexarm.model.file_format.files import arm_spec_of_text, content_of, file_text

#: Lags of the tests of residuals.
LAGS = 20
#: Longest lag of the correlation of residuals, as a fraction of the record.
_LONGEST = 0.1
#: Relative standard deviation of a combination of parameters above which the data do not determine
#: it, and the smallest singular value, as a fraction of the largest, that is not rounding.
UNDETERMINED, _ROUNDING = 0.5, 1e-6
#: Smallest eigenvalue of the normalised information that counts, as a fraction of the largest.
_SINGULAR = 1e-14
#: Components of such a combination that are named, as a fraction of its largest one.
_NAMED = 0.02


def fit_percent(measured: FloatArray, simulated: FloatArray) -> float:
    """Return 100 (1 - |y - s| / |y - mean y|): 100 is perfect, 0 as good as the mean."""
    signal = float(np.linalg.norm(measured - measured.mean()))
    error = float(np.linalg.norm(measured - simulated))
    return 100.0 * (1.0 - error / signal) if signal > 0.0 else (100.0 if error == 0.0 else -np.inf)


class Column(NamedTuple):
    """Residuals of one channel of a record, weighted, and their derivatives."""

    residuals: FloatArray  # (samples,), zero where missing
    derivatives: FloatArray  # (samples, parameters) of the residuals, zero where missing
    valid: NDArray[np.bool_]  # (samples,) whether the record has the sample


def pair_sums(values: FloatArray, lags: int) -> FloatArray:
    """Return the sums (lags + 1,) of products of values (samples,) at a distance of each lag."""
    from scipy.signal import correlate

    full = correlate(values, values, method="fft")
    return np.asarray(full[values.size - 1 : values.size + lags])


def correlation_of(
    residuals: FloatArray, valid: NDArray[np.bool_], lags: int
) -> tuple[FloatArray, FloatArray]:
    """Return correlations (lags + 1,) of residuals (samples,), and the pairs of valid samples."""
    # The residuals are zero where missing. Each covariance is the mean over the pairs of its lag; a
    # lag without pairs has the correlation zero.
    pairs = np.rint(pair_sums(valid.astype(np.float64), lags))
    covariance = pair_sums(residuals, lags) / np.maximum(pairs, 1.0)
    if covariance[0] <= 0.0:
        return np.eye(1, lags + 1)[0], pairs
    return np.where(pairs > 0.0, covariance / covariance[0], 0.0), pairs


def centred(values: FloatArray, valid: NDArray[np.bool_]) -> FloatArray:
    """Return values minus the mean of the valid ones, zero where not valid."""
    return np.where(valid, values - values[valid].mean(), 0.0)


def whiteness(residuals: FloatArray, valid: NDArray[np.bool_], lags: int = LAGS) -> float:
    """Return the probability of correlations as large as those of residuals, if they were white.

    The test of Ljung and Box; below 0.01 the residuals contain something that the model lacks. NaN
    without residuals. ``valid`` (samples,) states whether the record has the sample.
    """
    from scipy.stats import chi2

    count = int(valid.sum())
    if not np.any(residuals):
        return np.nan
    lags = min(lags, max(1, count // 4))
    rho, pairs = correlation_of(centred(residuals, valid), valid, lags)
    statistic = (count + 2) / count * float(np.sum(pairs[1:] * rho[1:] ** 2))
    return float(chi2.sf(statistic, np.count_nonzero(pairs[1:])))


def independence(
    residuals: FloatArray, valid: NDArray[np.bool_], signal: FloatArray, lags: int = LAGS
) -> float:
    """Return the probability of correlations as large as those between residuals and an input.

    Residuals that depend on past inputs (0 to ``lags`` samples) give a small value, residuals that
    are correlated over time for another reason do not. NaN without residuals or input.
    """
    from scipy.stats import chi2

    residuals, signal = centred(residuals, valid), signal - signal.mean()
    scale = float(np.sum(residuals**2)) / int(valid.sum())
    if scale == 0.0 or not np.any(signal):
        return np.nan
    lags = min(lags, max(1, signal.size // 4))
    past = np.stack([np.concatenate([np.zeros(k), signal[: signal.size - k]]) for k in range(lags)])
    column = Column(residuals, (past * valid).T, valid)
    values, vectors = np.linalg.eigh(information([column]))
    # Neighbours of a smooth input are nearly equal.
    vectors = vectors[:, values > 1e-6 * values[-1]]
    crossed = vectors.T @ (past @ residuals)
    expected = scale * vectors.T @ coloured_information([column]) @ vectors
    statistic = float(crossed @ np.linalg.pinv(expected, hermitian=True) @ crossed)
    return float(chi2.sf(statistic, crossed.size))


def cross_correlation(
    residuals: FloatArray, valid: NDArray[np.bool_], signal: FloatArray, lags: int = LAGS
) -> tuple[FloatArray, float]:
    """Return correlations (lags + 1,) of residuals with a signal, and their standard deviation."""
    # The deviation is that without a relation, with the correlation over time of both. At lag k the
    # signal is that of k samples before.
    residuals, signal = centred(residuals, valid), signal - signal.mean()
    size = float(np.linalg.norm(residuals) * np.linalg.norm(signal))
    if size == 0.0:
        return np.zeros(lags + 1), 1.0 / np.sqrt(valid.sum())
    count = residuals.size
    crossed = np.array([residuals[k:] @ signal[: count - k] for k in range(lags + 1)]) / size
    every = np.ones(count, dtype=bool)
    longest = max(1, count // 4)
    own, _ = correlation_of(residuals, valid, longest)
    driven, _ = correlation_of(signal, every, longest)
    power = 1.0 + 2.0 * float(own[1:] @ driven[1:])
    return crossed, float(np.sqrt(max(power, 1.0) / valid.sum()))


def information(columns: Sequence[Column]) -> FloatArray:
    """Return the sum of products of derivatives, (parameters, parameters)."""
    total = sum(column.derivatives.T @ column.derivatives for column in columns)
    return np.asarray(total)


def coloured_information(columns: Sequence[Column]) -> FloatArray:
    """Return the covariance of the fit's gradient; ``information`` if the residuals are white."""
    from scipy.signal import fftconvolve

    total = np.zeros((columns[0].derivatives.shape[1],) * 2)
    for residuals, derivatives, valid in columns:
        lag = significant_lag(residuals, valid)
        rho, _ = correlation_of(residuals, valid, lag)
        rho = rho * (1.0 - np.arange(lag + 1) / (lag + 1.0))
        kernel = np.concatenate([rho[:0:-1], rho])[:, None]
        smooth = fftconvolve(derivatives, kernel, mode="same", axes=0) if lag else derivatives
        total += derivatives.T @ smooth
    return 0.5 * (total + total.T)


def significant_lag(residuals: FloatArray, valid: NDArray[np.bool_]) -> int:
    """Return twice the lag after which residuals are not correlated significantly; 0 if white."""
    count = int(valid.sum())
    longest = max(1, int(_LONGEST * count))
    rho, _ = correlation_of(centred(residuals, valid), valid, longest)
    limit = 2.0 * np.sqrt(np.log10(count) / count)
    following = max(5, int(np.sqrt(np.log10(count))))
    large = np.abs(rho[1:]) > limit
    run = 0
    for lag, one in enumerate(large, start=1):
        run = 0 if one else run + 1
        if run == following:
            return 2 * (lag - following)
    return longest


def covariance_of(columns: Sequence[Column], priors: FloatArray) -> FloatArray:
    """Return the covariance of the estimates; ``priors`` (parameters,) are inverse variances."""
    # A parameter without information has an infinite variance, and a combination of others without
    # information a very large one.
    curvature = information(columns) + np.diag(priors)
    known = np.diag(curvature) > 0.0
    covariance = np.diag(np.where(known, 0.0, np.inf))
    part = np.ix_(known, known)
    if known.any():
        coloured = (coloured_information(columns) + np.diag(priors) - curvature)[part]
        scale = np.outer(*(2 * [np.sqrt(np.diag(curvature)[known])]))
        values, vectors = np.linalg.eigh(curvature[part] / scale)
        inverse = (vectors / np.maximum(values, _SINGULAR * values[-1])) @ vectors.T / scale
        # The sum equals the usual product for residuals that are not white, but it does not lose
        # the variance of combinations whose curvature is zero.
        total = inverse + inverse @ coloured @ inverse
        # Derivatives that are only rounding may give a negative variance.
        lost = np.diag(total) <= 0.0
        total[lost], total[:, lost] = inverse[lost], inverse[:, lost]
        covariance[part] = total
    return covariance


def own_information(
    columns: Sequence[Column],
    priors: FloatArray,
    scale: FloatArray,
    physical: NDArray[np.bool_],
) -> FloatArray:
    """Return the information about the physical parameters, relative to their scales.

    The arguments are those of ``undetermined``. The other numbers, of initial states, are
    eliminated: the inverse is the covariance of the physical ones without their priors.
    """
    scaled = information(columns) * np.outer(scale, scale)
    others = ~physical
    own = scaled[np.ix_(physical, physical)]
    if not others.any():
        return own
    inner = scaled[np.ix_(others, others)] + np.diag(priors[others] * scale[others] ** 2)
    mixed = scaled[np.ix_(others, physical)]
    return np.asarray(own - mixed.T @ np.linalg.pinv(inner, hermitian=True) @ mixed)


def undetermined(
    columns: Sequence[Column],
    priors: FloatArray,
    scale: FloatArray,
    physical: NDArray[np.bool_],
) -> list[tuple[list[int], float]]:
    """Return the combinations of parameters that the data do not determine.

    The criterion is the relative standard deviation of ``covariance_of``, without the priors of
    the physical parameters; ``scale`` (parameters,) counts as 100 %, and initial states are not
    ``physical``. A combination has the places of its parameters, the most important one first, and
    its relative standard deviation, at least 0.5.
    """
    places = np.flatnonzero(physical)
    covariance = covariance_of(columns, np.where(physical, 0.0, priors))[np.ix_(places, places)]
    covariance = covariance / np.outer(scale[places], scale[places])
    lost = ~np.isfinite(np.diag(covariance))
    covariance[lost] = covariance[:, lost] = 0.0

    def deviations(vectors: FloatArray) -> FloatArray:
        """Return the standard deviations (k,) of combinations, the columns (n, k) of an array."""
        squares = np.sum(vectors * (covariance @ vectors), axis=0)
        return np.asarray(np.sqrt(np.maximum(squares, 0.0)))

    own = own_information(columns, priors, scale, physical)
    values, vectors = np.linalg.eigh(own)
    values = np.sqrt(np.maximum(values, 0.0))
    weak = (deviations(vectors) > UNDETERMINED) | (values <= _ROUNDING * values[-1])
    combinations = list(_sparse(vectors[:, weak].T))
    # A single parameter may be uncertain although no eigenvector is.
    alone = np.eye(places.size)[deviations(np.eye(places.size)) > UNDETERMINED]
    combinations += [unit for unit in alone if not np.any(unit @ vectors[:, weak])]
    named = []
    for vector in combinations:
        order = np.argsort(-np.abs(vector))
        most = _NAMED * np.abs(vector).max()
        involved = [int(k) for k in order if abs(vector[k]) > most]
        deviation = float(deviations(vector[:, None])[0] / np.linalg.norm(vector))
        hidden = lost[involved].any() or deviation == 0.0
        named.append(([int(places[k]) for k in involved], np.inf if hidden else deviation))
    return named


def _sparse(vectors: FloatArray) -> FloatArray:
    """Return vectors (k, n) of the same space with many zeros, by Gauss and Jordan."""
    vectors = vectors.copy()
    for row in range(len(vectors)):
        rest = np.abs(vectors[row:])
        pivot, column = np.unravel_index(int(np.argmax(rest)), rest.shape)
        swapped = [row + int(pivot), row]
        vectors[swapped[::-1]] = vectors[swapped]
        vectors[row] /= vectors[row, column]
        others = np.arange(len(vectors)) != row
        vectors[others] -= np.outer(vectors[others, column], vectors[row])
    return vectors


#: Probability below which a test of residuals fails.
SIGNIFICANT = 0.01
#: Columns of the tables of parameters and of fits.
HEADS = ("parameter", "start", "estimate", "std. deviation", "")
FIT_HEADS = ("record", "channel", "fit %", "RMS", "whiteness", "independence")


@dataclass(frozen=True, eq=False)
class Identification:
    """Result of ``identify``.

    Attributes:
        arm: the arm with the estimates that all records share.
        arms: the arm of each record by its name; they differ by parameters with ``per_record``.
        motors: with their estimates, or None.
        parameters: dataset over ``parameter`` (the paths): ``estimate``, ``standard_deviation``,
            ``start``, ``lower``, ``upper``, ``at_bound``, and ``correlation`` (parameter, other).
        initial: the same for the estimated numbers of initial states, which are changes of the
            coordinates q and their rates from the start of the record.
        undetermined: sentences about parameters, or combinations of them, that the data do not
            determine; empty if all are determined.
        fit: dataset over ``record`` and ``channel``: ``fit`` (percent, 100 is perfect), ``rms`` of
            the residuals (SI units), ``whiteness`` and ``independence``: the probabilities of
            correlations as large as those among residuals, and between residuals and inputs, if
            the model were complete; NaN for a test without residuals or without an input that
            changes. All are NaN for a channel that a record does not have.
        validation: the same for the records that were not fitted.
        histories: dataset by the name of a record, fitted or not: ``measured`` and ``simulated``
            (time, channel), after the filters, NaN where samples are missing. With
            "prediction_error", ``simulated`` is predicted from the samples before, and fit and
            tests are those of predictions. ``driven`` (time, input) are the inputs.
        noise: standard deviation of the noise of each channel, SI units.
        torque_noise: (joints,) N m, standard deviation of the random torque error in each sample of
            "prediction_error"; None for "output_error".
        starts: sum of squares and logarithm of the likelihood for each start; NaN if it failed.
        method: "output_error" or "prediction_error".
        converged: whether the best fit ended at a minimum, before the limit of iterations, and the
            estimated noise no longer changed.
        flexarm_version: version of flexarm that computed it.
    """

    arm: Arm
    arms: Mapping[str, Arm]
    motors: Motors | None
    parameters: xr.Dataset
    initial: xr.Dataset
    undetermined: tuple[str, ...]
    fit: xr.Dataset
    validation: xr.Dataset
    histories: Mapping[str, xr.Dataset]
    noise: Mapping[str, float]
    torque_noise: FloatArray | None
    starts: tuple[float, ...]
    method: str
    converged: bool
    flexarm_version: str = field(default_factory=package_version)

    @public_call
    def __getitem__(self, path: str) -> float:
        """Return the estimate of a parameter by its path.

        Raises:
            InputError: if no parameter has this path.
        """
        return number_of(self.parameters, path, "estimate")

    @public_call
    def to_dataset(self) -> xr.Dataset:
        """Return the whole result as one dataset, for ``write_result`` and ``report``."""
        return _stored(self)

    @classmethod
    @public_call
    def from_dataset(cls, dataset: xr.Dataset) -> Identification:
        """Return the result of a dataset, from ``to_dataset`` or ``read_result``.

        Raises:
            InputError: if the dataset does not contain an identification.
        """
        return cls(**_restored(check_kind("dataset", dataset, xr.Dataset)))

    @public_call
    def write(self, path: AnyPath) -> None:
        """Write the arm with its estimates to a YAML file, for ``load_arm`` and scenarios.

        Raises:
            InputError: if the file cannot be written.
        """
        save_arm(self.arm, path)

    def rows(self) -> list[tuple[str, str, str, str, str]]:
        """Return the table of parameters: path, start, estimate, standard deviation, remark."""
        table = []
        for name in self.parameters["parameter"].values.tolist():
            one = self.parameters.sel(parameter=name)
            numbers = (float(one[k]) for k in ("start", "estimate", "standard_deviation"))
            remark = "at its bound" if bool(one["at_bound"]) else ""
            table.append((name, *(f"{value:.5g}" for value in numbers), remark))
        return table

    @property
    def remarks(self) -> list[str]:
        """Sentences about a fit that has not converged and about what the data do not determine."""
        hint = "Raise iterations, or give the noise of the channels."
        unfinished = [] if self.converged else [f"The fit has not converged. {hint}"]
        return [*unfinished, *self.undetermined]

    def __str__(self) -> str:
        lines = [aligned([HEADS, *self.rows()])]
        lines.append(aligned([FIT_HEADS, *fit_rows(self.fit)]))
        if self.validation.sizes["record"]:
            lines.append("validation\n" + aligned([FIT_HEADS, *fit_rows(self.validation)]))
        lines += self.remarks
        return "\n\n".join(lines)

    def __repr__(self) -> str:
        count, records = self.parameters.sizes["parameter"], self.fit.sizes["record"]
        best = float(np.nanmin(self.fit["fit"].values))
        return f"<flexarm.Identification: {count} parameters, {records} records, fit {best:.1f} %>"

    def _repr_html_(self) -> str:
        return html_table(repr(self).strip("<>"), HEADS, self.rows())


def number_of(parameters: xr.Dataset, path: object, column: str) -> float:
    """Return a number of a table of parameters; InputError if no parameter has this path."""
    names = parameters["parameter"].values.tolist()
    if path not in names:
        hint = suggestion(str(path), names)
        raise InputError(Problem("parameters", f"have no {shown(path)}", hint=hint))
    return float(parameters[column].sel(parameter=path))


_TESTS = ("whiteness", "independence")


def fit_rows(fits: xr.Dataset) -> list[tuple[str, str, str, str, str, str]]:
    """Return the table of a fit: record, channel, percent, RMS, and both tests."""
    table = []
    for record in fits["record"].values.tolist():
        for channel in fits["channel"].values.tolist():
            one = fits.sel(record=record, channel=channel)
            if not np.isfinite(one["rms"]):
                continue
            tests = (_verdict(float(one[k])) for k in _TESTS)
            numbers = f"{float(one['fit']):.2f}", f"{float(one['rms']):.3g}"
            table.append((record, channel, *numbers, *tests))
    return table


def _verdict(probability: float) -> str:
    """Return the outcome of a test of residuals."""
    if np.isnan(probability):
        return "not tested"
    return "passed" if probability > SIGNIFICANT else "failed"


def aligned(rows: list[tuple[Any, ...]]) -> str:
    """Return a table as text, with names on the left and numbers on the right."""
    columns = list(zip(*rows, strict=True))
    widths = [max(map(len, column)) for column in columns]
    left = [not any(is_number(cell) for cell in column) for column in columns]
    lines = [
        "  ".join(
            cell.ljust(width) if to_left else cell.rjust(width)
            for cell, width, to_left in zip(row, widths, left, strict=True)
        ).rstrip()
        for row in rows
    ]
    return "\n".join(lines)


#: Attribute of such a dataset, and the tables of a result.
_KIND = "identification"
_TABLES = ("parameters", "initial", "fit", "validation")


def _stored(result: Identification) -> xr.Dataset:
    """Return an identification as one dataset."""
    tables = {name: getattr(result, name) for name in _TABLES}
    tables |= {f"record_{k}": table for k, table in enumerate(result.histories.values())}
    # NetCDF has no names of nothing.
    kept = {
        name: table.drop_dims([dim for dim, size in table.sizes.items() if not size])
        for name, table in tables.items()
    }
    parts: list[xr.Dataset] = [
        table.rename({str(key): f"{name}.{key}" for key in {*table.variables, *table.dims}})
        for name, table in kept.items()
        if table.data_vars
    ]
    attributes: dict[str, Any] = {
        "undetermined": list(result.undetermined),
        "noise": dict(result.noise),
        "starts": list(result.starts),
        "converged": result.converged,
        "method": result.method,
        "torque_noise": None if result.torque_noise is None else result.torque_noise.tolist(),
        "histories": list(result.histories),
        "arms": {name: file_text(arm.spec) for name, arm in result.arms.items()},
        "motors": None if result.motors is None else content_of(result.motors),
    }
    return xr.merge(parts).assign_attrs(
        flexarm_version=result.flexarm_version,
        arm=file_text(result.arm.spec),
        **{_KIND: json.dumps(attributes)},
    )


def _restored(dataset: xr.Dataset) -> dict[str, Any]:
    """Return the fields of an identification from its dataset."""
    if _KIND not in dataset.attrs:
        raise InputError(Problem("dataset", "does not contain an identification"))
    try:
        given = json.loads(dataset.attrs[_KIND])
        names = given.pop("histories")
        fields: dict[str, Any] = {name: _table(dataset, name) for name in _TABLES}
        nothing = slice(0, 0)
        fields["initial"] = fields["initial"] or fields["parameters"].isel(
            parameter=nothing, other=nothing
        )
        fields["validation"] = fields["validation"] or fields["fit"].isel(record=nothing)
        fields["histories"] = {name: _history(dataset, k) for k, name in enumerate(names)}
        noise, motors = given["torque_noise"], given["motors"]
        return {
            **fields,
            **given,
            "undetermined": tuple(given["undetermined"]),
            "starts": tuple(given["starts"]),
            "torque_noise": None if noise is None else np.array(noise),
            "motors": None if motors is None else Motors(**motors),
            "flexarm_version": dataset.attrs["flexarm_version"],
            "arm": _arm(dataset.attrs["arm"]),
            "arms": {name: _arm(text) for name, text in given["arms"].items()},
        }
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        rule = f"contains a damaged identification: {type(error).__name__}"
        raise InputError(Problem("dataset", rule)) from None


def is_identification(value: object) -> bool:
    """Return whether a value is the dataset of an identification."""
    return isinstance(value, xr.Dataset) and _KIND in value.attrs


def _history(dataset: xr.Dataset, record: int) -> xr.Dataset:
    """Return the history of a record, with ``driven`` also if it has no inputs."""
    table = _table(dataset, f"record_{record}")
    if "driven" in table:
        return table
    nothing = np.zeros((table.sizes["time"], 0))
    return table.assign(driven=(("time", "input"), nothing)).assign_coords(input=[])


def _arm(text: str) -> Arm:
    return Arm(arm_spec_of_text(text, "result"))


def _table(dataset: xr.Dataset, name: str) -> xr.Dataset:
    """Return the table whose variables have the prefix of a name."""
    own = [str(key) for key in dataset.variables if str(key).startswith(f"{name}.")]
    table = dataset[own].drop_attrs()
    for key in own:
        table[key].attrs = dict(dataset[key].attrs)
    names: Mapping[str, str] = {
        str(key): str(key).removeprefix(f"{name}.") for key in {*table.variables, *table.dims}
    }
    return table.rename(names)
