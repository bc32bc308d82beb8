"""Result of an identification, and its dataset."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from flexarm.arm.arm import Arm, save_arm
from flexarm.base.arguments import check_kind
from flexarm.base.errors import InputError, Problem, public_call, shown, suggestion
from flexarm.base.notebook import html_table
from flexarm.base.references import package_version
from flexarm.base.writing.places import AnyPath
from flexarm.identification.record import is_number
from flexarm.identification.space import in_words
from flexarm.integrate.base import FloatArray
from flexarm.model import Motors
from flexarm.model.file_format.files import arm_spec_of_text, content_of, file_text

#: Probability below which a test of residuals fails.
SIGNIFICANT = 0.01
#: Ends of an interval, and difference of its halves, relative to their sum, that is printed.
_INTERVAL, _UNEVEN = ("interval_start", "interval_end"), 0.05
#: Magnitude from which the correlation of two estimates is printed.
_RELATED = 0.8
#: Ending of the names of records that are the last parts of fitted ones.
LAST_PART = ", last part"
#: Columns of the tables of parameters and of fits.
HEADS = ("parameter", "start", "estimate", "std. deviation", "")
RELATED_HEADS = ("parameter", "and", "correlation")
FIT_HEADS = ("record", "channel", "fit %", "RMS", "whiteness", "independence")


@dataclass(frozen=True, eq=False)
class Identification:
    """Result of ``identify``.

    Attributes:
        arm: the arm with the estimates that all records share.
        arms: the arm of each record by its name; they differ by parameters with ``per_record``.
        motors: with their estimates, or None.
        parameters: dataset over ``parameter`` (the paths): ``estimate``, ``standard_deviation``,
            ``interval_start`` and ``interval_end`` (95 %, within the bounds), ``start``, ``lower``,
            ``upper``, ``at_bound``, ``with_effects`` (the estimates of a coarse fit with the
            effects of ``missing``, else NaN), and ``correlation`` (parameter, other).
        initial: the same for the estimated numbers of initial states, which are changes of the
            coordinates q and their rates from the start of the record.
        undetermined: sentences about parameters, or combinations of them, that the data do not
            determine; empty if all are determined.
        missing: sentences about effects that the residuals show and the model lacks.
        alternatives: sentences about other arms that fit almost equally well.
        findings: sentences of ``commission`` about faults of instruments and physics of the arm.
        stages: of ``commission``: dataset over ``stage`` and ``channel``: ``before`` and ``after``
            (fit in percent on parts that no stage fits, the smallest of all records), ``kept``, and
            ``seconds`` (CPU); empty for ``identify``.
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
    missing: tuple[str, ...] = ()
    alternatives: tuple[str, ...] = ()
    findings: tuple[str, ...] = ()
    stages: xr.Dataset = field(default_factory=xr.Dataset)
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
        tables = {name: getattr(self, name) for name in _TABLES}
        tables |= {f"record_{k}": table for k, table in enumerate(self.histories.values())}
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
            **{name: list(getattr(self, name)) for name in _SENTENCES},
            "noise": dict(self.noise),
            "starts": list(self.starts),
            "converged": self.converged,
            "method": self.method,
            "torque_noise": None if self.torque_noise is None else self.torque_noise.tolist(),
            "histories": list(self.histories),
            "arms": {name: file_text(arm.spec) for name, arm in self.arms.items()},
            "motors": None if self.motors is None else content_of(self.motors),
        }
        return xr.merge(parts).assign_attrs(
            flexarm_version=self.flexarm_version,
            arm=file_text(self.arm.spec),
            **{_KIND: json.dumps(attributes)},
        )

    @classmethod
    @public_call
    def from_dataset(cls, dataset: xr.Dataset) -> Identification:
        """Return the result of a dataset, from ``to_dataset`` or ``read_result``.

        Raises:
            InputError: if the dataset does not contain an identification.
        """
        check_kind("dataset", dataset, xr.Dataset)
        if _KIND not in dataset.attrs:
            raise InputError(Problem("dataset", "does not contain an identification"))
        try:
            content = json.loads(dataset.attrs[_KIND])
            names = content.pop("histories")
            fields: dict[str, Any] = {name: _table(dataset, name) for name in _TABLES}
            for name in ("parameters", "initial"):
                fields[name] = fields[name] or _no_parameters()
            fields["validation"] = fields["validation"] or fields["fit"].isel(record=slice(0, 0))
            fields["histories"] = {name: _history(dataset, k) for k, name in enumerate(names)}
            noise, motors = content["torque_noise"], content["motors"]
            fields |= {
                **content,
                **{name: tuple(content.get(name, ())) for name in _SENTENCES},
                "starts": tuple(content["starts"]),
                "torque_noise": None if noise is None else np.array(noise),
                "motors": None if motors is None else Motors(**motors),
                "flexarm_version": dataset.attrs["flexarm_version"],
                "arm": _arm(dataset.attrs["arm"]),
                "arms": {name: _arm(text) for name, text in content["arms"].items()},
            }
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            rule = f"contains a damaged identification: {type(error).__name__}"
            raise InputError(Problem("dataset", rule)) from None
        return cls(**fields)

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
            start, end, value = (float(one[k]) for k in (*_INTERVAL, "estimate"))
            limited = end > start and np.isfinite([start, end]).any()
            uneven = limited and not abs(end - 2.0 * value + start) < _UNEVEN * (end - start)
            remarks = ["at its bound"] if bool(one["at_bound"]) else []
            remarks += [f"95 %: {start:.3g} to {end:.3g}"] if uneven else []
            whole = float(one.get("with_effects", np.nan))  # results of earlier versions lack it
            remarks += [f"{whole:.4g} with the missing effects"] if np.isfinite(whole) else []
            remark = ", ".join(remarks)
            table.append((name, *(f"{value:.5g}" for value in numbers), remark))
        return table

    @property
    def remarks(self) -> list[str]:
        """Sentences about a fit that has not converged and about doubts in the estimates."""
        hint = "Raise iterations, or give the noise of the channels."
        unfinished = [] if self.converged else [f"The fit has not converged. {hint}"]
        doubts = [*unfinished, *self.undetermined, *self.alternatives, *self.missing]
        return doubts + _at_bounds(self.parameters) + _failed(self.fit) + _failed(self.validation)

    def __str__(self) -> str:
        lines = [*self.findings]
        if self.stages:
            lines += [aligned([*stage_rows(self.stages)]), stage_note(self)]
        if self.parameters.sizes["parameter"]:
            lines.append(aligned([HEADS, *self.rows()]))
        if related(self.parameters):
            lines.append(aligned([RELATED_HEADS, *related(self.parameters)]))
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


def related(parameters: xr.Dataset) -> list[tuple[str, str, str]]:
    """Return the pairs of estimates with a large correlation, the largest first."""
    names, matrix = (parameters[key].values for key in ("parameter", "correlation"))
    pairs = np.argwhere(np.triu(np.abs(matrix) > _RELATED, 1)).tolist()
    pairs.sort(key=lambda pair: -abs(matrix[tuple(pair)]))
    return [(str(names[i]), str(names[j]), f"{matrix[i, j]:.3f}") for i, j in pairs]


def stage_rows(stages: xr.Dataset) -> list[tuple[str, ...]]:
    """Return the table of stages with its heads: fit before and after on parts not fitted."""
    channels = [str(name) for name in stages["channel"].values]
    rows: list[tuple[str, ...]] = [("stage", *(f"{name} %" for name in channels), "")]
    for k, stage in enumerate(stages["stage"].values.tolist()):
        pairs = zip(stages["before"].values[k], stages["after"].values[k], strict=True)
        cells = [f"{a:.1f} to {b:.1f}" if k else f"{b:.1f}" for a, b in pairs]
        cells = ["" if "nan" in cell else cell for cell in cells]
        rows.append((stage, *cells, "kept" if stages["kept"].values[k] else "taken back"))
    return rows


def stage_note(result: Identification) -> str:
    """Return why the table of stages and the last fit of ``commission`` differ."""
    whole = not all(name.endswith(LAST_PART) for name in result.validation["record"].values)
    return (
        "Stages are coarse fits of the first 70 % of each record, compared on the rest; joints "
        'follow their measured angles in "links". The last fit is that of all kept parameters to '
        f"full accuracy{', of the whole records' if whole else ''}, so its numbers differ."
    )


def _at_bounds(parameters: xr.Dataset) -> list[str]:
    """Return a sentence for each estimate at a bound."""
    sentences = []
    for name in parameters["parameter"].values[parameters["at_bound"].values].tolist():
        path, _, record = name.partition(" ")
        words = f"{in_words(path)} {record}".strip()
        bound = f"{number_of(parameters, name, 'estimate'):.4g}"
        sentences.append(
            f"The estimate of the {words} is at its bound, {bound}: "
            "the data prefer a value beyond it, and its interval is not reliable. Widen the bound, "
            "or look for an effect that acts in the same way."
        )
    return sentences


def _failed(fits: xr.Dataset) -> list[str]:
    """Return sentences on tests of residuals that failed."""
    sentences = []
    for test, text in _TESTS.items():
        bad = (fits[test] <= SIGNIFICANT).values
        places = [
            f"{fits['channel'].values[c]} of {fits['record'].values[r]}"
            for r, c in np.argwhere(bad).tolist()
        ]
        if places:
            sentences.append(f"{test.capitalize()} failed for {', '.join(places)}: {text}")
            share = 100.0 - float(fits["fit"].values[bad].min())
            if test == "independence" and 0.0 <= share <= 100.0:
                sentences[-1] += f" The fit leaves at most {share:.2g} % of the signal unexplained."
    return sentences


#: Tests of residuals, and what their failure means.
_TESTS = {
    "whiteness": "the residuals are correlated over time. Standard deviations contain that, but "
    "not the shift of estimates by a further effect that the model lacks.",
    "independence": "the residuals depend on the inputs, so the model lacks an effect. If the fit "
    "is too poor, refine the elements, or free more parameters.",
}


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


#: Attribute of such a dataset, and the sentences and tables of a result.
_KIND = "identification"
_SENTENCES = ("undetermined", "missing", "alternatives", "findings")
_TABLES = ("parameters", "initial", "fit", "validation", "stages")


def _no_parameters() -> xr.Dataset:
    names = "estimate standard_deviation interval_start interval_end start lower upper with_effects"
    columns: dict[str, Any] = {name: ("parameter", np.zeros(0)) for name in names.split()}
    columns["at_bound"] = "parameter", np.zeros(0, dtype=bool)
    columns["correlation"] = ("parameter", "other"), np.zeros((0, 0))
    return xr.Dataset(columns, {name: np.zeros(0, dtype=str) for name in ("parameter", "other")})


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
