"""``flexarm run``: simulate a scenario file, print a summary, write the requested files."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexarm.cli.failures import say, warn
from flexarm.cli.tables import console, facts
from flexarm.errors import FlexarmWarning, InputError, SimulationError
from flexarm.model import locate_scenario
from flexarm.output import FIGURE_SUFFIXES, FORMATS, write_figure, write_result
from flexarm.places import check_place
from flexarm.plot.animation.video import check_animation_place
from flexarm.scenarios.scenario import prepare
from flexarm.simulation.compare import warnings_of

if TYPE_CHECKING:
    import xarray as xr

_WHERE = "flexarm run"


def run_file(path: Path, out: Path | None, plot: Path | None, animation: Path | None) -> None:
    """Run a scenario file.

    The file and the output paths are validated before the run.

    Raises:
        InputError: if the file is not valid or an output path cannot be written.
        SimulationError: if the run stops early; the samples up to then are saved next to ``out``.
    """
    prepared = prepare(*locate_scenario(path))
    if out is not None:
        check_place(_WHERE, "--out", out, FORMATS)
    if plot is not None:
        check_place(_WHERE, "--plot", plot, FIGURE_SUFFIXES)
    if animation is not None:
        check_animation_place(_WHERE, "--animate", animation)
    try:
        with warnings.catch_warnings():  # printed below in one line
            warnings.simplefilter("ignore", FlexarmWarning)
            result = prepared.run()
    except SimulationError as error:
        if out is not None and error.result is not None:
            _save_part(error.result, out)
        raise
    screen = console()
    screen.print(facts(_summary(result)))
    for text in warnings_of(result):
        warn(text)
    if out is not None:
        write_result(result, out)
        screen.print(f"result in {out}", soft_wrap=True)
    if plot is not None:
        from flexarm.plot.signals import signals_figure

        write_figure(signals_figure(result), plot)
        screen.print(f"plot in {plot}", soft_wrap=True)
    if animation is not None:
        from flexarm.plot.animation import animate

        animate(result, animation)
        screen.print(f"animation in {animation}", soft_wrap=True)


def _save_part(result: xr.Dataset, out: Path) -> None:
    part = out.with_name(f"{out.stem}.partial{out.suffix}")
    try:
        write_result(result, part)
    except InputError as error:
        say(str(error))  # the error of the run is more important and follows
    else:
        say(f"{_WHERE}: the run up to t = {result['time'].values[-1]:.6g} s is in {part}")


def _summary(result: xr.Dataset) -> list[tuple[str, str]]:
    time, attributes = result["time"].values, result.attrs
    deflection = np.max(np.abs(result["link_tip_deflection"].values), axis=0)
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
    told = []
    for name in dict.fromkeys(names.tolist()):
        own = times[names == name]
        when = f"at t = {own[0]:.6g} s" if own.size == 1 else f"{own.size} times"
        if own.size > 1:
            when += f", first at t = {own[0]:.6g} s"
        told.append(f"{name}: {when}")
    rows = [("events", "; ".join(told) or "none")]
    if result.attrs["ended_by"] in names:
        rows.append(("ended by", result.attrs["ended_by"]))
    return rows
