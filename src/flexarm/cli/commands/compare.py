"""``flexarm compare``: run a study, print its metrics, save and plot them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import flexarm as fa
from flexarm.base.errors import InputError, Problem, without_warnings
from flexarm.base.late import xr
from flexarm.cli.commands.sweep import (
    draw_samples,
    limits_of,
    print_statistics,
    read_study_file,
)
from flexarm.cli.failures import reported_warnings, warn
from flexarm.cli.options import Limits, Plot, Workers, argument, check_places, option
from flexarm.cli.tables import numbers, print_line, save_figure

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
    *_FREE[:2],
    ("force_error_rms", "RMS N", 1.0),
    ("force_error_peak", "peak N", 1.0),
    _FREE[-1],
)


def compare(
    study: Annotated[Path, argument("STUDY.yaml", "Drives, plants and motions to compare.")],
    out: Annotated[Path | None, option("FILE", "Save the numbers: .nc or .csv.")] = None,
    plot: Plot = None,
    workers: Workers = None,
    limits: Limits = None,
) -> None:
    """Compare drives on plants along motions: errors, vibration, torque, computing time."""
    from flexarm.base.processes import check_workers
    from flexarm.cases.results import FIGURE_SUFFIXES
    from flexarm.cases.scenario.study import PreparedStudy
    from flexarm.model import locate_study
    from flexarm.model.plausible import implausible, warn_of

    located = locate_study(study)
    check_places(("--out", out, (".nc", ".csv")), ("--plot", plot, FIGURE_SUFFIXES))
    if located[0].samples is not None:
        _compare_samples(study, out, plot, check_workers("--workers", workers), limits_of(limits))
        return
    if limits:
        raise InputError(Problem("--limit", "requires a study with samples"))
    with reported_warnings():
        prepared = PreparedStudy(*located)
        warn_of(implausible(prepared.study.arm))
    with without_warnings():  # printed below with the names of the runs
        table = prepared.run(workers=check_workers("--workers", workers))
    for reference in table["reference"].values:
        print_line(_printed(table.sel(reference=reference), str(reference)))
    if "comment" in table["residual_vibration"].attrs:
        print_line(
            "no swing after the motion: the run ends before the motion and `settling`; extend "
            "`run.duration`"
        )
    for text in _conclusions(table):
        warn(text)
    _save(table, out)
    if plot is not None:
        save_figure(fa.plot.comparison_figure(table), plot)


def _compare_samples(
    path: Path,
    out: Path | None,
    plot: Path | None,
    workers: int,
    limits: dict[str, float],
) -> None:
    """Print the statistics of samples, and write the requested files."""
    study = read_study_file(path)
    with without_warnings():  # those of the samples are printed
        nominal = study.nominal(workers=workers)
    table = study.run(workers=workers)
    print_statistics(table, limits, nominal)
    _save(table, out)
    draw_samples(table, plot)


def _printed(table: xr.Dataset, reference: str) -> object:
    import numpy as np

    presses = bool(np.isfinite(table["force_error_rms"]).any())
    columns = [c for c in (_PRESSING if presses else _FREE) if np.isfinite(table[c[0]]).any()]
    marked = any(table[kind].values.astype(bool).any() for kind in ("failure", "warning"))
    rows = []
    for drive in table["controller"].values:
        for k, plant in enumerate(table["plant"].values):
            case = table.sel(controller=drive, plant=plant)
            values = (factor * float(case[name]) for name, _, factor in columns)
            cells = [f"{value:.4g}" if np.isfinite(value) else "-" for value in values]
            if marked:
                cells.append("stopped" if case["failure"] else "warned" if case["warning"] else "")
            rows.append([str(drive) if k == 0 else "", str(plant), *cells])
    errors = "of the force" if presses else "its swing after, torque"
    title = f"Along {reference}: error of the tip, {errors}, time per sample"
    heads = [head for _, head, _ in columns] + ["status"] * marked
    return numbers(title, ["drive", "plant", *heads], rows)


def _conclusions(table: xr.Dataset) -> Iterator[str]:
    """Yield the failures, then the warnings of runs, with the names of the runs."""
    names: Any = ("controller", "plant", "reference")
    for kind in ("failure", "warning"):
        for run in product(*(table[name].values for name in names)):
            if text := table[kind].sel(dict(zip(names, run, strict=True))).item():
                drive, plant, reference = run
                yield f"{drive} on {plant} along {reference}: {text}"


def _save(table: xr.Dataset, out: Path | None) -> None:
    """Write the table, if requested, and print its path."""
    from flexarm.base.writing.places import write_text, write_whole
    from flexarm.cases.results import encode_netcdf

    if out is None:
        return
    if out.suffix.lower() == ".csv":
        write_text(table.to_dataframe().to_csv(lineterminator="\n"), out)
    else:
        write_whole(out, encode_netcdf(table))
    print_line(f"table in {out}")
