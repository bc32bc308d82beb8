"""``flexarm sweep``: run the samples of a study into a store, and print their statistics."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer

import flexarm as fa
from flexarm.base.arguments import check_choice
from flexarm.base.errors import InputError, Problem, SimulationError, shown
from flexarm.base.late import xr
from flexarm.cli.failures import reported_warnings, warn
from flexarm.cli.options import Limits, Plot, Workers, argument, check_places, flag, option
from flexarm.cli.tables import console, numbers, print_line, save_figure

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


def sweep(
    study: Annotated[Path, argument("STUDY.yaml", "A study with varied numbers.")],
    out: Annotated[
        Path | None, option("DIR", "Folder of the results; by default STUDY.zarr.")
    ] = None,
    resume: Annotated[bool, flag("--resume", "Continue the results if they exist.")] = False,
    verify: Annotated[bool, flag("--verify", "Repeat ten samples and compare all digits.")] = False,
    scheduler: Annotated[
        str | None, option("ADDRESS", "Scheduler of a Dask cluster: tcp://HOST:8786.")
    ] = None,
    workers: Workers = None,
    chunk: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Samples of a task; measured by default.")
    ] = None,
    limits: Limits = None,
    plot: Plot = None,
) -> None:
    """Run a study for many samples of uncertain numbers: quantiles and failure rates."""
    from flexarm.cases.results import FIGURE_SUFFIXES

    largest = limits_of(limits)
    sampled = read_study_file(study)
    check_places(("--plot", plot, FIGURE_SUFFIXES))
    out = out or study.with_suffix(".zarr")
    if sampled.spec.rare_failures is not None:
        print_rare_failures(sampled, workers)
        if sampled.spec.samples is None:
            return
    table = sampled.run(out, scheduler, resume=resume, workers=workers, chunk=chunk)
    print_statistics(table, largest)
    if sampled.samples == 1:
        warn("the study has one sample. Add `vary` and `samples`, or use `flexarm compare`.")
    print_line(f"{table['failure'].size} runs in {out}")
    draw_samples(table, plot)
    if verify:
        different = sampled.verify(out, _REPEATED)
        if different:
            names = ", ".join(map(str, different))
            raise SimulationError(0.0, f"samples {names} of the store differ when repeated.")
        console().print(f"{min(_REPEATED, table.sizes['sample'])} samples repeated: identical")


def read_study_file(path: Path) -> fa.Study:
    """Read the file of a study; print the warnings."""
    with reported_warnings():
        return fa.Study(path)


def print_statistics(
    table: xr.Dataset, limits: dict[str, float], nominal: xr.Dataset | None = None
) -> None:
    """Print the statistics of a study, by ratios to ``nominal``, and the first failures."""
    statistics = fa.study_statistics(table, _QUANTILES, limits=limits, nominal=nominal)
    if nominal is not None:
        statistics["nominal"] = 1e3 * nominal["tip_error_rms"]
    for reference in statistics["reference"].values:
        print_line(_printed(statistics.sel(reference=reference), str(reference)))
    for kind, runs in _REPORTED.items():
        for text in _first_of(table, kind, runs):
            warn(text)


def print_rare_failures(study: fa.Study, workers: int | None) -> None:
    """Estimate the probabilities of rare failures and print them."""
    with reported_warnings():
        table = study.rare_failures(workers=workers)
        for reference in table["reference"].values:
            rows = []
            for drive in table["controller"].values:
                for plant in table["plant"].values:
                    case = table.sel(controller=drive, plant=plant, reference=reference)
                    low, high = case["probability_low"].item(), case["probability_high"].item()
                    cells = [f"{case['probability'].item():.2g}", f"{low:.2g} - {high:.2g}"]
                    rows.append([str(drive), str(plant), *cells, str(case["runs"].item())])
            heads = ["drive", "plant", "probability", "95 % interval", "runs"]
            print_line(numbers(f"Along {reference}: rare failures", heads, rows))


def draw_samples(table: xr.Dataset, plot: Path | None) -> None:
    """Write the figure of the samples, if requested."""
    if plot is not None:
        save_figure(fa.plot.samples_figure(table), plot)


def limits_of(texts: Sequence[str] | None) -> dict[str, float]:
    """Return limits of metrics from texts ``NAME=VALUE``; InputError for another text."""
    return dict(map(_limit, texts or ()))


def _limit(text: str) -> tuple[str, float]:
    from flexarm.cases.studies.execution import RECORDED

    name, _, value = text.partition("=")
    name = check_choice("--limit", name.strip(), [metric.name for metric in RECORDED])
    try:
        return name, float(value)
    except ValueError:
        rule = "be a metric and a number, such as tip_error_peak=0.01"
        raise InputError(Problem("--limit", rule, shown(text))) from None


def _printed(statistics: xr.Dataset, reference: str) -> object:
    import numpy as np

    compared = "nominal" in statistics
    metrics = _ROBUSTNESS if compared else _COLUMNS
    columns = [column for column in metrics if np.isfinite(statistics[column[0]]).any()]
    rows = []
    for drive in statistics["controller"].values:
        for k, plant in enumerate(statistics["plant"].values):
            case = statistics.sel(controller=drive, plant=plant)
            cells = [f"{case['nominal'].item():.3g}"] if compared else []
            cells += [
                " / ".join(f"{factor * value:.3g}" for value in case[name].values)
                for name, _, factor in columns
            ]
            rate, low, high = (
                _percent(float(case[f"failure_rate{end}"])) for end in ("", "_low", "_high")
            )
            cells.append(f"{rate} ({low}-{high})")
            rows.append([str(drive) if k == 0 else "", str(plant), *cells])
    title = f"Along {reference}: median / 95 % quantile; failures with their 95 % interval"
    if compared:
        title += "; ratio: to the RMS without variation"
    heads = ["drive", "plant", *["nominal"] * compared, *(column[1] for column in columns)]
    return numbers(title, [*heads, "failed %"], rows)


def _percent(fraction: float) -> str:
    return f"{100.0 * fraction:.0f}" if fraction > 0.1 else f"{100.0 * fraction:.2g}"


def _first_of(table: xr.Dataset, kind: str, runs: str) -> Iterator[str]:
    """Yield the first failure or warning of each drive, plant and motion, and their number."""
    stacked = table[kind].stack(run=("controller", "plant", "reference"))
    for drive, plant, reference in stacked["run"].values:
        texts = table[kind].sel(controller=drive, plant=plant, reference=reference)
        reported = texts.values != ""
        if reported.any():
            k = int(reported.argmax())
            count = f"{int(reported.sum())} of {reported.size} {runs}"
            first = f"the first of sample {texts.sample.values[k]}: {texts.values[k]}"
            yield f"{drive} on {plant} along {reference}: {count}, {first}"
