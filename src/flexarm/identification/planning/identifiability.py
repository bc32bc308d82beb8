"""Parameters that planned experiments determine: ``flexarm.identifiability``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_kind
from flexarm.base.errors import InputError, Problem, SimulationError, public_call
from flexarm.base.notebook import html_table
from flexarm.identification.assessment import columns_of_fit, parameters_of
from flexarm.identification.fitting import Fit, FitFailure, FitProblem
from flexarm.identification.record import MeasuredRecord, Records, check_inputs, check_some_records
from flexarm.identification.result import aligned, number_of
from flexarm.identification.runs import RecordRun
from flexarm.identification.space import Space, check_free
from flexarm.identification.statistics import own_information
from flexarm.integrate import Integrator
from flexarm.integrate.base import FloatArray
from flexarm.model import Motors
from flexarm.model.identification.parameters import FreeParameter

_HEADS = ("parameter", "value", "std. deviation", "%")


@dataclass(frozen=True, eq=False)
class Identifiability:
    """Identifiability of parameters by planned experiments.

    Attributes:
        parameters: dataset over ``parameter`` as in `Identification`: ``estimate`` (the value of
            the arm), ``standard_deviation`` (predicted), ``correlation`` and others; infinite for
            a parameter without effect.
        undetermined: sentences about parameters, or combinations of them, that the data will not
            determine; empty if all will be determined.
        information: (parameters, parameters) Fisher information of the parameters without
            priors, relative to their values: one over the squared relative deviation for a single
            one. The initial states that are estimated with them are eliminated.
    """

    parameters: xr.Dataset
    undetermined: tuple[str, ...]
    information: FloatArray

    @property
    def log_determinant(self) -> float:
        """Natural logarithm of the determinant of the information; a D-optimal one is largest.

        -inf if a combination of parameters has no effect. Half its increase is the logarithm of
        the factor by which the volume of the region of confidence shrinks.
        """
        sign, value = np.linalg.slogdet(self.information)
        return float(value) if sign > 0.0 else -np.inf

    @public_call
    def __getitem__(self, path: str) -> float:
        """Return the predicted standard deviation of a parameter by its path.

        Raises:
            InputError: if no parameter has this path.
        """
        return number_of(self.parameters, path, "standard_deviation")

    def rows(self) -> list[tuple[str, str, str, str]]:
        """Return the table of parameters: path, value, predicted deviation, also in percent."""
        found = []
        for name in self.parameters["parameter"].values.tolist():
            one = self.parameters.sel(parameter=name)
            value, deviation = float(one["estimate"]), float(one["standard_deviation"])
            share = f"{100.0 * deviation / abs(value):.3g}" if value else ""
            found.append((name, f"{value:.5g}", f"{deviation:.3g}", share))
        return found

    def __str__(self) -> str:
        return "\n\n".join([aligned([_HEADS, *self.rows()]), *self.undetermined])

    def __repr__(self) -> str:
        count, lost = self.parameters.sizes["parameter"], len(self.undetermined)
        return f"<flexarm.Identifiability: {count} parameters, {lost} combinations undetermined>"

    def _repr_html_(self) -> str:
        return html_table(repr(self).strip("<>"), _HEADS, self.rows())


@public_call
def identifiability(
    arm: Arm,
    records: Records,
    free: Sequence[str | FreeParameter],
    *,
    motors: Motors | None = None,
    integrator: str | Integrator = "auto",
    step: float | None = None,
    rtol: float = 1e-7,
    atol: float | None = None,
) -> Identifiability:
    """Predict the standard deviations that ``identify`` will report for planned experiments.

    Only the inputs, times, channels, filters and initial states of the records count, and their
    ``noise``, which is required for every compared channel; the values of the channels do not.
    Results of ``simulate`` are such records: ``fa.MeasuredRecord(result, outputs=["joint_angle"],
    noise={"joint_angle": 1e-4})``.

    Args:
        arm: with the expected values of the parameters, at which the derivatives are taken.
        records, free, motors: as for ``identify``.
        integrator, step, rtol, atol: of all runs, as in ``simulate``.

    Returns:
        Predicted standard deviations, and combinations of parameters that the records will not
        determine. They hold for white noise and small deviations (Cramer and Rao's bound, which
        least squares reach with many samples).

    Raises:
        InputError: if the noise of a channel is missing, a record does not fit the arm, or a path
            is not one of a number; all problems are listed.
        SimulationError: if a record cannot be simulated.

    Ljung, *System Identification*, 2nd ed., 1999, section 7.4.
    """
    check_kind("arm", arm, Arm)
    if motors is not None:
        check_kind("motors", motors, Motors)
    given = check_some_records(records)
    check_inputs(given)
    options: dict[str, Any] = {"integrator": integrator, "rtol": rtol, "atol": atol}
    options |= {} if step is None else {"step": step}
    return predicted(arm, given, check_free(free), motors, options)


def predicted(
    arm: Arm,
    records: dict[str, MeasuredRecord],
    free: Sequence[FreeParameter],
    motors: Motors | None,
    options: dict[str, Any],
) -> Identifiability:
    """Return the identifiability of parameters by records, from arguments that are checked.

    Raises:
        InputError, SimulationError: as ``identifiability``.
    """
    check_noise(records)
    space = Space(arm, motors, free, records)
    runs = [RecordRun(name, record, arm, options) for name, record in records.items()]
    problem = FitProblem(space, runs, None)
    # Without residuals the noise is white by assumption.
    outputs = [run.measured for run in runs]
    fit = Fit(space.start, 0.0, outputs, problem.noise, 0, True)
    try:
        table, _, undetermined = parameters_of(problem, fit)
        columns = columns_of_fit(problem, fit)
    except FitFailure as error:
        raise SimulationError(0.0, str(error)) from None
    slots = space.slots
    priors = np.array([slot.prior_deviation**-2.0 for slot in slots])
    physical = np.array([not slot.initial for slot in slots])
    information = own_information(columns, priors, space.scale, physical)
    return Identifiability(table, tuple(undetermined), information)


def check_noise(records: dict[str, MeasuredRecord]) -> None:
    """Check that every compared channel has a deviation of its noise.

    Raises:
        InputError: if it is missing; all are listed.
    """
    missing: dict[str, list[str]] = {}
    for name, record in records.items():
        channels = dict.fromkeys(label.channel for label in record.outputs)
        lacking = [channel for channel in channels if channel not in record.settings.noise]
        if lacking:
            missing.setdefault(", ".join(lacking), []).append(name)
    if missing:
        raise InputError(
            *(
                Problem(
                    f"noise of {', '.join(names)}", f"requires the standard deviation of {text}"
                )
                for text, names in missing.items()
            )
        )
