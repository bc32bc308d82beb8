"""Result of an identification: estimates, their uncertainty, fit, tests, and the arm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from flexarm.arm.arm import Arm, save_arm
from flexarm.base.arguments import check_kind
from flexarm.base.errors import InputError, Problem, public_call, shown, suggestion
from flexarm.base.notebook import html_table
from flexarm.base.writing.places import AnyPath
from flexarm.identification.storage import restored, stored
from flexarm.integrate.base import FloatArray
from flexarm.model import Motors
from flexarm.simulation.calls.result import package_version

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
        return stored(self)

    @classmethod
    @public_call
    def from_dataset(cls, dataset: xr.Dataset) -> Identification:
        """Return the result of a dataset, from ``to_dataset`` or ``read_result``.

        Raises:
            InputError: if the dataset does not contain an identification.
        """
        return cls(**restored(check_kind("dataset", dataset, xr.Dataset)))

    @public_call
    def write(self, path: AnyPath) -> None:
        """Write the arm with its estimates to a YAML file, for ``load_arm`` and scenarios.

        Raises:
            InputError: if the file cannot be written.
        """
        save_arm(self.arm, path)

    def rows(self) -> list[tuple[str, str, str, str, str]]:
        """Return the table of parameters: path, start, estimate, standard deviation, remark."""
        found = []
        for name in self.parameters["parameter"].values.tolist():
            one = self.parameters.sel(parameter=name)
            numbers = (float(one[k]) for k in ("start", "estimate", "standard_deviation"))
            remark = "at its bound" if bool(one["at_bound"]) else ""
            found.append((name, *(f"{value:.5g}" for value in numbers), remark))
        return found

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
    """Return a number of a table of parameters.

    Raises:
        InputError: if no parameter has this path.
    """
    names = parameters["parameter"].values.tolist()
    if path not in names:
        hint = suggestion(str(path), names)
        raise InputError(Problem("parameters", f"have no {shown(path)}", hint=hint))
    return float(parameters[column].sel(parameter=path))


_TESTS = ("whiteness", "independence")


def fit_rows(fits: xr.Dataset) -> list[tuple[str, str, str, str, str, str]]:
    """Return the table of a fit: record, channel, percent, RMS, and both tests."""
    found = []
    for record in fits["record"].values.tolist():
        for channel in fits["channel"].values.tolist():
            one = fits.sel(record=record, channel=channel)
            if not np.isfinite(one["rms"]):
                continue
            tests = (_verdict(float(one[k])) for k in _TESTS)
            numbers = f"{float(one['fit']):.2f}", f"{float(one['rms']):.3g}"
            found.append((record, channel, *numbers, *tests))
    return found


def _verdict(probability: float) -> str:
    """Return the outcome of a test of residuals."""
    if np.isnan(probability):
        return "not tested"
    return "passed" if probability > SIGNIFICANT else "failed"


def aligned(rows: list[tuple[Any, ...]]) -> str:
    """Return a table as text, with names on the left and numbers on the right."""
    columns = list(zip(*rows, strict=True))
    widths = [max(map(len, column)) for column in columns]
    left = [not any(_is_number(cell) for cell in column) for column in columns]
    lines = [
        "  ".join(
            cell.ljust(width) if to_left else cell.rjust(width)
            for cell, width, to_left in zip(row, widths, left, strict=True)
        ).rstrip()
        for row in rows
    ]
    return "\n".join(lines)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
