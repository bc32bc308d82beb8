"""``flexarm compare``: run a study, print its metrics, save and plot them."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexarm.base.errors import FlexarmWarning, InputError, Problem
from flexarm.base.processes import check_workers
from flexarm.base.writing.places import check_place, write_text, write_whole
from flexarm.cases.results import FIGURE_SUFFIXES, encode_netcdf, write_figure
from flexarm.cases.scenario.study import PreparedStudy
from flexarm.cases.studies.study import Study
from flexarm.cli.commands.sweep import (
    draw_samples,
    limits_of,
    print_statistics,
    read_study_file,
)
from flexarm.cli.failures import collected_warnings, warn
from flexarm.cli.tables import console, numbers
from flexarm.model import locate_study
from flexarm.model.arm.plausibility import implausible
from flexarm.model.plausible import warn_of

if TYPE_CHECKING:
    import xarray as xr

#: File suffixes of comparisons.
TABLE_SUFFIXES = (".nc", ".csv")
#: Columns of the printed table: metric, heading, factor to the displayed unit.
_FREE = (
    ("tip_error_rms", "RMS mm", 1e3),
    ("tip_error_peak", "peak mm", 1e3),
    ("residual_vibration", "after mm", 1e3),
    ("torque_rms", "N m", 1.0),
    ("controller_time", "us", 1e6),
)
#: The same for a reference with contact force.
_PRESSING = (
    ("tip_error_rms", "RMS mm", 1e3),
    ("tip_error_peak", "peak mm", 1e3),
    ("force_error_rms", "RMS N", 1.0),
    ("force_error_peak", "peak N", 1.0),
    ("controller_time", "us", 1e6),
)


def compare_file(
    path: Path, out: Path | None, plot: Path | None, workers: int | None, limits: Sequence[str] = ()
) -> None:
    """Run the study in a file.

    The file and the output paths are validated before the runs. If numbers of the study vary, the
    table has their statistics.

    Args:
        workers: number of processes; None for one for each core.
        limits: largest acceptable metrics of samples, as ``NAME=VALUE``.

    Raises:
        InputError: if the file is not valid or an output path cannot be written.
    """
    located = locate_study(path)
    if out is not None:
        check_place("--out", out, TABLE_SUFFIXES)
    if plot is not None:
        check_place("--plot", plot, FIGURE_SUFFIXES)
    if located[0].samples is not None:
        _compare_samples(read_study_file(path), out, plot, workers, limits_of(limits))
        return
    if limits:
        raise InputError(Problem("--limit", "requires a study with samples"))
    with collected_warnings() as built:
        prepared = PreparedStudy(*located)
        warn_of(implausible(prepared.study.arm))
    for text in dict.fromkeys(built):
        warn(text)
    with warnings.catch_warnings():  # printed below with the names of the runs
        warnings.simplefilter("ignore", FlexarmWarning)
        table = prepared.run(workers=check_workers("--workers", workers))
    screen = console()
    for reference in table["reference"].values:
        screen.print(_printed(table.sel(reference=reference), str(reference)), soft_wrap=True)
    if "comment" in table["residual_vibration"].attrs:
        screen.print(
            "no swing after the motion: the run ends before the motion and `settling`; extend "
            "`run.duration`",
            soft_wrap=True,
        )
    for kind in ("failure", "warning"):
        for text in _conclusions(table, kind):
            warn(text)
    if out is not None:
        _save(table, out)
        screen.print(f"table in {out}", soft_wrap=True)
    if plot is not None:
        from flexarm.view.plot.comparison import comparison_figure

        write_figure(comparison_figure(table), plot)
        screen.print(f"plot in {plot}", soft_wrap=True)


def _compare_samples(
    study: Study,
    out: Path | None,
    plot: Path | None,
    workers: int | None,
    limits: dict[str, float],
) -> None:
    """Print the statistics of samples, and write the requested files."""
    workers = check_workers("--workers", workers)
    with warnings.catch_warnings():  # those of the samples are printed
        warnings.simplefilter("ignore", FlexarmWarning)
        nominal = study.nominal(workers=workers)
    table = study.run(workers=workers)
    print_statistics(table, limits, nominal)
    if out is not None:
        _save(table, out)
        console().print(f"table in {out}", soft_wrap=True)
    if plot is not None:
        draw_samples(table, plot)


def _printed(table: xr.Dataset, reference: str) -> object:
    presses = bool(np.isfinite(table["force_error_rms"].values).any())
    columns = _PRESSING if presses else _FREE
    shown = [column for column in columns if np.isfinite(table[column[0]].values).any()]
    marked = any(table[kind].values.astype(bool).any() for kind in ("failure", "warning"))
    rows = []
    for drive in table["controller"].values:
        for k, plant in enumerate(table["plant"].values):
            one = table.sel(controller=drive, plant=plant)
            values = (factor * float(one[name]) for name, _, factor in shown)
            cells = [f"{value:.4g}" if np.isfinite(value) else "-" for value in values]
            if marked:
                cells.append("stopped" if one["failure"] else "warned" if one["warning"] else "")
            rows.append([str(drive) if k == 0 else "", str(plant), *cells])
    numbers_are = "of the force" if presses else "its swing after, torque"
    title = f"Along {reference}: error of the tip, {numbers_are}, time per sample"
    heads = [head for _, head, _ in shown] + ["status"] * marked
    return numbers(title, ["drive", "plant", *heads], rows)


def _conclusions(table: xr.Dataset, kind: str) -> list[str]:
    """Return the failures or warnings of runs, with the names of the runs."""
    reported = []
    for drive in table["controller"].values:
        for plant in table["plant"].values:
            for reference in table["reference"].values:
                text = table[kind].sel(controller=drive, plant=plant, reference=reference).item()
                if text:
                    reported.append(f"{drive} on {plant} along {reference}: {text}")
    return reported


def _save(table: xr.Dataset, out: Path) -> None:
    if out.suffix.lower() == ".csv":
        write_text(table.to_dataframe().to_csv(lineterminator="\n"), out)
    else:
        write_whole(out, encode_netcdf(table))
