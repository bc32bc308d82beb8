"""Report of an identification: one HTML page with tables and pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from flexarm.base.references import package_version
from flexarm.cases.scenario.summary import about_arm
from flexarm.identification.result import (
    FIT_HEADS,
    HEADS,
    SIGNIFICANT,
    Identification,
    fit_rows,
    related,
    stage_note,
    stage_rows,
)
from flexarm.identification.statistics import LAGS, correlation_of, cross_correlation
from flexarm.model.file_format.files import file_text
from flexarm.view.plot import fits
from flexarm.view.plot.animation.scene import style
from flexarm.view.reporting import Table, clean, file_item, number, text_of

#: Factor on a standard deviation: 99 % of normal numbers.
_BAND = 2.576
#: Most estimates whose correlations are drawn.
_MOST_DRAWN = 24


def identification_page(engine: Any, result: Identification, title: str, notes: str) -> str:
    """Return the page of an identification."""
    names = result.parameters["parameter"].values.tolist()
    drawn = 1 < len(names) <= _MOST_DRAWN
    matrix = result.parameters["correlation"].values
    tables = [("Fitted records", result.fit)]
    if result.validation.sizes["record"]:
        tables.append(("Validation: records that were not fitted", result.validation))
    what = "simulated channels"
    if result.method == "prediction_error":
        what = "predictions from the samples before"
    rows = [("Method", result.method.replace("_", " "), "")]
    rows.append(("Smallest fit", number(float(np.nanmin(result.fit["fit"].values))), "%"))
    if result.validation.sizes["record"]:
        smallest = float(np.nanmin(result.validation["fit"].values))
        rows.append(("Smallest fit, validation", number(smallest), "%"))
    rows.append(("Parameters", str(result.parameters.sizes["parameter"]), ""))
    rows.append(("Statements on what is not determined", str(len(result.undetermined)), ""))
    page: str = engine.get_template("identification.html").render(
        title=clean(title),
        notes=clean(notes.strip()),
        style=style() + text_of("report.css"),
        version=clean(result.flexarm_version),
        writer=package_version(),
        warnings=[clean(text) for text in [*result.findings, *result.remarks]],
        figures=rows,
        estimates=_estimates(result),
        matrix=fits.matrix_picture([clean(name) for name in names], matrix) if drawn else "",
        fits=[Table(title, FIT_HEADS, tuple(fit_rows(table))) for title, table in tables],
        explained=(
            f"Fit and tests are those of the {what}. 100 % is perfect, 0 % as good as the mean. "
            "Whiteness: residuals are not correlated over time. Independence: residuals are not "
            f"correlated with past inputs. A test fails if its probability is below "
            f"{SIGNIFICANT:g}." + (f" {stage_note(result)}" if result.stages else "")
        ),
        records=[_record(result, name, table) for name, table in result.histories.items()],
        about=about_arm(result.arm),
        files=[file_item("identified.yaml", file_text(result.arm.spec))],
    )
    return page


def _estimates(result: Identification) -> list[Table]:
    tables = []
    if result.stages:
        heads, *stages = stage_rows(result.stages)
        tables.append(Table("Stages: fit on parts that no stage fits", heads, tuple(stages)))
    tables.append(_values("Parameters", result.rows(), result.parameters))
    if result.initial.sizes["parameter"]:
        columns = ("parameter", "estimate", "standard_deviation")
        initial = zip(*(result.initial[k].values for k in columns), strict=True)
        rows = [(name, number(0.0), *map(number, values), "") for name, *values in initial]
        tables.append(_values("Initial states: changes from the start", rows, result.initial))
    pairs = tuple(
        (clean(one), clean(other), size) for one, other, size in related(result.parameters)
    )
    if pairs:
        tables.append(Table("Estimates with a large correlation", ("", "", "correlation"), pairs))
    noise = [(name, number(value)) for name, value in result.noise.items()]
    if result.torque_noise is not None:
        noise += [
            (f"torque of joint {joint} (N m, in each sample)", number(float(value)))
            for joint, value in zip(result.arm.joint_numbers, result.torque_noise, strict=True)
        ]
    tables.append(Table("Noise", ("", "std. deviation"), tuple(noise)))
    return tables


def _values(title: str, rows: Any, table: xr.Dataset) -> Table:
    """Return estimates with their 95 % intervals."""
    made = []
    ends = zip(*(table[key].values for key in ("interval_start", "interval_end")), strict=True)
    for (name, start, estimate, deviation, remark), pair in zip(rows, ends, strict=True):
        low, high = (number(end) if np.isfinite(end) else "–" for end in pair)
        made.append((clean(str(name)), start, estimate, deviation, f"{low} to {high}", remark))
    return Table(title, (*HEADS[:4], "95 % interval", ""), tuple(made))


def _record(result: Identification, name: str, table: xr.Dataset) -> dict[str, str]:
    fitted = name in result.fit["record"].values
    word = "predicted" if result.method == "prediction_error" else "simulated"
    times = np.asarray(table["time"].values, dtype=np.float64)
    channels, rows = [], []
    for channel in table["channel"].values.tolist():
        one = table.sel(channel=channel)
        measured, simulated = one["measured"].values, one["simulated"].values
        unit = str(one["unit"].values)
        channels.append(fits.FittedChannel(clean(channel), unit, times, measured, simulated))
        missed = measured - simulated
        valid = np.isfinite(missed)
        residuals = np.where(valid, missed - missed[valid].mean(), 0.0)
        lags = times[: LAGS + 1] - times[0]
        own, _ = correlation_of(residuals, valid, lags.size - 1)
        bound = _BAND / np.sqrt(valid.sum())
        panels = [fits.Correlation(f"{clean(channel)}, own", lags[1:], own[1:], bound)]
        for source in table["input"].values:
            signal = table["driven"].sel(input=source).values
            crossed, deviation = cross_correlation(residuals, valid, signal, lags.size - 1)
            panels.append(fits.Correlation(f"with {source}", lags, crossed, _BAND * deviation))
        rows.append(panels)
    return {
        "title": clean(name) + ("" if fitted else ", not fitted"),
        "fit": fits.fit_picture(channels, word),
        "correlations": fits.correlations_picture(rows),
    }
