"""``flexarm sweep``: run the samples of a study into a store, and print their statistics."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.base.arguments import check_choice
from flexarm.base.errors import InputError, Problem, SimulationError, shown
from flexarm.base.writing.places import check_place
from flexarm.cases.results import FIGURE_SUFFIXES, write_figure
from flexarm.cases.studies.execution import RECORDED
from flexarm.cases.studies.statistics import study_statistics
from flexarm.cases.studies.study import Study
from flexarm.cli.failures import collected_warnings, warn
from flexarm.cli.tables import console, numbers

if TYPE_CHECKING:
    import xarray as xr

#: Columns of the printed table: metric, heading, factor to the displayed unit.
_COLUMNS = (
    ("tip_error_rms", "RMS mm", 1e3),
    ("residual_vibration", "after mm", 1e3),
    ("force_error_rms", "RMS N", 1.0),
    ("torque_peak", "peak N m", 1.0),
)
#: The same for a comparison with the runs without variation.
_ROBUSTNESS = (_COLUMNS[0], ("tip_error_rms_ratio", "ratio", 1.0), _COLUMNS[2])
_QUANTILES = (0.5, 0.95)
#: Variables whose first text is printed, with the words for their number of runs.
_REPORTED = {
    "failure": "runs",
    "infeasible": "runs are infeasible and not in the rates",
    "warning": "runs",
}
#: Samples that ``--verify`` repeats.
_REPEATED = 10


@dataclass(frozen=True)
class SweepOptions:
    """Options of the command.

    Attributes:
        out: folder of the store; None for one beside the study.
        plot: file of the plot.
        scheduler: address of a scheduler of Dask, or None for processes of this computer.
        workers: number of those processes; None for one for each core.
        chunk: samples of a task; None for a measured number.
        limits: largest acceptable metrics, as ``NAME=VALUE``.
        resume: whether an existing store is continued.
        verify: whether a random part of the samples is repeated.
    """

    out: Path | None = None
    plot: Path | None = None
    scheduler: str | None = None
    workers: int | None = None
    chunk: int | None = None
    limits: Sequence[str] = ()
    resume: bool = False
    verify: bool = False


def sweep_file(path: Path, options: SweepOptions) -> None:
    """Run the study in a file; the file and the options are validated before the runs.

    Raises:
        InputError: if the file or an option is not valid, or the store exists.
        SimulationError: if a repeated sample differs.
    """
    limits = limits_of(options.limits)
    study = read_study_file(path)
    if options.plot is not None:
        check_place("--plot", options.plot, FIGURE_SUFFIXES)
    out = options.out or path.with_suffix(".zarr")
    if study.spec.rare_failures is not None:
        print_rare_failures(study)
        if study.spec.samples is None:
            return
    given: dict[str, Any] = {"workers": options.workers, "chunk": options.chunk}
    table = study.run(out, options.scheduler, resume=options.resume, **given)
    print_statistics(table, limits)
    screen = console()
    if study.samples == 1:
        warn("the study has one sample. Add `vary` and `samples`, or use `flexarm compare`.")
    screen.print(f"{table['failure'].size} runs in {out}", soft_wrap=True)
    if options.plot is not None:
        draw_samples(table, options.plot)
    if options.verify:
        different = study.verify(out, _REPEATED)
        if different:
            names = ", ".join(map(str, different))
            raise SimulationError(0.0, f"samples {names} of the store differ when repeated.")
        screen.print(f"{min(_REPEATED, table.sizes['sample'])} samples repeated: identical")


def read_study_file(path: Path) -> Study:
    """Read the file of a study; print the warnings.

    Raises:
        InputError: if the file is not valid.
    """
    with collected_warnings() as found:
        study = Study(path)
    for text in found:
        warn(text)
    return study


def print_statistics(
    table: xr.Dataset, limits: dict[str, float], nominal: xr.Dataset | None = None
) -> None:
    """Print the statistics of a study, and the first failure and the first warning of each run.

    Args:
        nominal: table without variation, for the ratios to it.
    """
    found = study_statistics(table, _QUANTILES, limits=limits, nominal=nominal)
    if nominal is not None:
        found["nominal"] = 1e3 * nominal["tip_error_rms"]
    screen = console()
    for reference in found["reference"].values:
        screen.print(_printed(found.sel(reference=reference), str(reference)), soft_wrap=True)
    for kind, runs in _REPORTED.items():
        for text in _first_of(table, kind, runs):
            warn(text)


def print_rare_failures(study: Study) -> None:
    """Estimate the probabilities of rare failures and print them."""
    with collected_warnings() as found:
        table = study.rare_failures()
    screen = console()
    for reference in table["reference"].values:
        rows = []
        for drive in table["controller"].values:
            for plant in table["plant"].values:
                one = table.sel(controller=drive, plant=plant, reference=reference)
                ends = one["probability_low"].item(), one["probability_high"].item()
                cells = [f"{one['probability'].item():.2g}", f"{ends[0]:.2g} - {ends[1]:.2g}"]
                rows.append([str(drive), str(plant), *cells, str(one["runs"].item())])
        heads = ["drive", "plant", "probability", "95 % interval", "runs"]
        screen.print(numbers(f"Along {reference}: rare failures", heads, rows), soft_wrap=True)
    for text in found:
        warn(text)


def draw_samples(table: xr.Dataset, plot: Path) -> None:
    """Write the figure of the samples."""
    from flexarm.view.plot.comparison import samples_figure

    write_figure(samples_figure(table), plot)
    console().print(f"plot in {plot}", soft_wrap=True)


def limits_of(texts: Sequence[str]) -> dict[str, float]:
    """Return limits of metrics from texts ``NAME=VALUE``.

    Raises:
        InputError: if a text is not such a limit.
    """
    return dict(map(_limit, texts))


def _limit(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    name = check_choice("--limit", name.strip(), [metric.name for metric in RECORDED])
    try:
        return name, float(value)
    except ValueError:
        rule = "be a metric and a number, such as tip_error_peak=0.01"
        raise InputError(Problem("--limit", rule, shown(text))) from None


def _printed(found: xr.Dataset, reference: str) -> object:
    compared = "nominal" in found
    columns = _ROBUSTNESS if compared else _COLUMNS
    shown_columns = [c for c in columns if np.isfinite(found[c[0]].values).any()]
    rows = []
    for drive in found["controller"].values:
        for k, plant in enumerate(found["plant"].values):
            one = found.sel(controller=drive, plant=plant)
            cells = [f"{one['nominal'].item():.3g}"] if compared else []
            cells += [
                " / ".join(f"{factor * value:.3g}" for value in one[name].values)
                for name, _, factor in shown_columns
            ]
            rate, low, high = (
                _percent(float(one[f"failure_rate{end}"])) for end in ("", "_low", "_high")
            )
            cells.append(f"{rate} ({low}-{high})")
            rows.append([str(drive) if k == 0 else "", str(plant), *cells])
    title = f"Along {reference}: median / 95 % quantile; failures with their 95 % interval"
    if compared:
        title += "; ratio: to the RMS without variation"
    heads = ["drive", "plant", *["nominal"] * compared, *(c[1] for c in shown_columns)]
    return numbers(title, [*heads, "failed %"], rows)


def _percent(fraction: float) -> str:
    return f"{100.0 * fraction:.0f}" if fraction > 0.1 else f"{100.0 * fraction:.2g}"


def _first_of(table: xr.Dataset, kind: str, runs: str) -> Iterator[str]:
    """Yield the first failure or warning of each drive, plant and motion, and their number."""
    stacked = table[kind].stack(run=("controller", "plant", "reference"))
    for drive, plant, reference in stacked["run"].values:
        one = table[kind].sel(controller=drive, plant=plant, reference=reference)
        given = one.values != ""
        if given.any():
            k = int(np.argmax(given))
            where = f"{drive} on {plant} along {reference}"
            count = f"{int(given.sum())} of {given.size} {runs}"
            yield f"{where}: {count}, the first of sample {one.sample.values[k]}: {one.values[k]}"
