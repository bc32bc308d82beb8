"""``flexarm run``: simulate a scenario file, print a summary, write the requested files."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.base.errors import FlexarmWarning, InputError, SimulationError
from flexarm.base.writing.places import check_place
from flexarm.cases.results import FIGURE_SUFFIXES, FORMATS, write_figure, write_result
from flexarm.cases.scenario.scenario import prepare
from flexarm.cli.failures import collected_warnings, print_error, warn
from flexarm.cli.tables import console, facts
from flexarm.model import locate_scenario
from flexarm.model.file_format.changes import Change, change_of, changed
from flexarm.model.file_format.files import load_document
from flexarm.simulation.calls.compare import warnings_of
from flexarm.view.plot.animation.video import check_animation_place

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray


@dataclass(frozen=True)
class RunOptions:
    """Options of the command.

    Attributes:
        out, plot, animation: files to write.
        changes: values in place of those of the file.
        json: whether the summary is printed as JSON.
        quiet: whether nothing but warnings and errors, and JSON if requested, is printed.
    """

    out: Path | None = None
    plot: Path | None = None
    animation: Path | None = None
    changes: Sequence[Change] = ()
    json: bool = False
    quiet: bool = False


def run_options(
    files: tuple[Path | None, Path | None, Path | None],
    sets: Sequence[str],
    duration: str | None,
    integrator: str | None,
    *,
    json: bool,
    quiet: bool,
) -> RunOptions:
    """Convert the options of the command line.

    Raises:
        InputError: if a change of ``--set`` is not a path and a value.
    """
    changes = [change_of("--set", text) for text in sets]
    if duration is not None:
        given = change_of("--duration", f"run.duration={duration}")
        changes.append(replace(given, origin=f"--duration {duration}"))
    if integrator is not None:
        changes.append(Change(f"--integrator {integrator}", ("run", "integrator"), integrator))
    return RunOptions(*files, changes, json, quiet)


def run_file(path: Path, options: RunOptions) -> None:
    """Run a scenario file.

    The file and the output paths are validated before the run.

    Raises:
        InputError: if the file or a change is not valid or an output path cannot be written.
        SimulationError: if the run stops early; the samples up to then are saved next to ``out``.
    """
    with collected_warnings() as built:
        prepared = prepare(*locate_scenario(changed(load_document(path), options.changes)))
    for text in built:
        warn(text)
    out, plot, animation = options.out, options.plot, options.animation
    if out is not None:
        check_place("--out", out, FORMATS)
    if plot is not None:
        check_place("--plot", plot, FIGURE_SUFFIXES)
    if animation is not None:
        check_animation_place("--animate", animation)
    try:
        with warnings.catch_warnings():  # printed below in one line
            warnings.simplefilter("ignore", FlexarmWarning)
            result = prepared.run(progress=False if options.quiet else None)
    except SimulationError as error:
        if out is not None and error.result is not None:
            _save_part(error.result, out)
        raise
    silent = options.json or options.quiet
    screen = console()
    if not silent:
        screen.print(facts(_summary(result)))
    found = warnings_of(result)
    for text in found:
        warn(text)
    found = [*built, *found]
    for name, place in _written(result, options):
        if not silent:
            screen.print(f"{name} in {place}", soft_wrap=True)
    if options.json:
        print(dumps(_as_json(path, result, found, options), indent=2, allow_nan=False))


def _written(result: xr.Dataset, options: RunOptions) -> Iterator[tuple[str, Path]]:
    """Write the requested files; yield name and path of each."""
    if options.out is not None:
        write_result(result, options.out)
        yield "result", options.out
    if options.plot is not None:
        from flexarm.view.plot.histories import signals_figure

        write_figure(signals_figure(result), options.plot)
        yield "plot", options.plot
    if options.animation is not None:
        from flexarm.view.plot.animation import animate

        animate(result, options.animation)
        yield "animation", options.animation


def _as_json(
    path: Path, result: xr.Dataset, found: list[str], options: RunOptions
) -> dict[str, Any]:
    """Return the summary as plain values in SI units; see the page of the command line."""
    time, attributes = result["time"].values, result.attrs
    events = []
    if "event_name" in result:
        pairs = zip(result["event_name"].values, result["event_time"].values, strict=True)
        events = [{"name": str(name), "time": float(t)} for name, t in pairs]
    files = {"result": options.out, "plot": options.plot, "animation": options.animation}
    return {
        "flexarm": version("flexarm"),
        "scenario": str(path),
        "changes": [change.origin for change in options.changes],
        "samples": int(time.size),
        "end_time": float(time[-1]),
        "integrator": attributes["integrator"],
        "steps": int(attributes["steps"]),
        "wall_seconds": float(attributes["wall_seconds"]),
        "tip": result["tip"].values[-1].tolist(),
        "joint_angle": result["joint_angle"].values[-1].tolist(),
        "largest_link_tip_deflection": _largest_deflection(result).tolist(),
        "events": events,
        "ended_by": attributes.get("ended_by") or None,
        "warnings": found,
        "files": {name: str(place) for name, place in files.items() if place is not None},
    }


def _largest_deflection(result: xr.Dataset) -> NDArray[np.float64]:
    """Return the largest deflection of the tip of each link, (links,), m."""
    largest: NDArray[np.float64] = np.max(np.abs(result["link_tip_deflection"].values), axis=0)
    return largest


def _save_part(result: xr.Dataset, out: Path) -> None:
    part = out.with_name(f"{out.stem}.partial{out.suffix}")
    try:
        write_result(result, part)
    except InputError as error:
        print_error(str(error))  # the error of the run is more important and follows
    else:
        print_error(
            f"flexarm run: the run up to t = {result['time'].values[-1]:.6g} s is in {part}"
        )


def _summary(result: xr.Dataset) -> list[tuple[str, str]]:
    time, attributes = result["time"].values, result.attrs
    deflection = _largest_deflection(result)
    worst = int(np.argmax(deflection))
    x, y = result["tip"].values[-1]
    steps = f"{attributes['steps']} of {attributes['integrator']}"
    rows = [
        ("run", f"{time.size} samples to t = {time[-1]:g} s"),
        *_events(result),
        ("steps", f"{steps}, in {attributes['wall_seconds']:.3g} s"),
        ("tip", f"({x:.6g}, {y:.6g}) m at the end"),
    ]
    if deflection[worst] > 0.0:
        most = f"{1e3 * deflection[worst]:.4g} mm at the tip of link {worst + 1}"
        rows.append(("bending", f"at most {most}"))
    return rows


def _events(result: xr.Dataset) -> list[tuple[str, str]]:
    """Return the number and first time of each event, and the event that ended the run."""
    if "event_name" not in result:
        return []
    names, times = result["event_name"].values, result["event_time"].values
    found = []
    for name in dict.fromkeys(names.tolist()):
        own = times[names == name]
        when = f"at t = {own[0]:.6g} s" if own.size == 1 else f"{own.size} times"
        if own.size > 1:
            when += f", first at t = {own[0]:.6g} s"
        found.append(f"{name}: {when}")
    rows = [("events", "; ".join(found) or "none")]
    if result.attrs["ended_by"] in names:
        rows.append(("ended by", result.attrs["ended_by"]))
    return rows
