"""``flexarm run``: simulate a scenario file, print a summary, write the requested files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import flexarm as fa
from flexarm.base.errors import InputError, SimulationError, without_warnings
from flexarm.base.late import xr
from flexarm.cli.failures import collected_warnings, print_error, warn
from flexarm.cli.options import Plot, Sets, argument, check_places, flag, option
from flexarm.cli.tables import console, facts, print_line

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm.cases.scenario.scenario import Prepared


def run(
    scenario: Annotated[Path, argument("SCENARIO.yaml", "Scenario file.")],
    out: Annotated[Path | None, option("FILE", "Save the result: .nc (all of it) or .csv.")] = None,
    plot: Plot = None,
    animate: Annotated[
        Path | None, option("FILE", "Save an animation: .mp4, .gif or .html.")
    ] = None,
    sets: Sets = None,
    duration: Annotated[
        str | None, option("SECONDS", "Duration in place of that of the file.")
    ] = None,
    integrator: Annotated[
        str | None, option("NAME", "Integrator in place of that of the file.")
    ] = None,
    accuracy: Annotated[
        str | None, option("METRES", "Largest error of the tip that the integration may cause.")
    ] = None,
    json: Annotated[bool, flag("--json", "Print the summary as JSON, and nothing else.")] = False,
    quiet: Annotated[bool, flag("--quiet", "Print warnings and errors only.")] = False,
) -> None:
    """Simulate a scenario file."""
    from json import dumps

    from flexarm.base.references import package_version
    from flexarm.cases.results import FIGURE_SUFFIXES, FORMATS
    from flexarm.cases.scenario.scenario import prepare
    from flexarm.model import locate_scenario
    from flexarm.model.file_format.files import load_document
    from flexarm.model.file_format.yaml_text import Change, change_of, changed
    from flexarm.simulation.calls.compare import warnings_of
    from flexarm.view.plot.animation import check_animation_place

    changes = [change_of("--set", text) for text in sets or ()]
    for name, number in (("duration", duration), ("accuracy", accuracy)):
        if number is not None:
            change = change_of(f"--{name}", f"run.{name}={number}")
            changes.append(replace(change, origin=f"--{name} {number}"))
    if integrator is not None:
        changes.append(Change(f"--integrator {integrator}", ("run", "integrator"), integrator))
    with collected_warnings() as texts:
        prepared = prepare(*locate_scenario(changed(load_document(scenario), changes)))
    for text in texts:
        warn(text)
    check_places(("--out", out, FORMATS), ("--plot", plot, FIGURE_SUFFIXES))
    if animate is not None:
        check_animation_place("--animate", animate)
    try:
        with without_warnings():  # printed below in one line
            result = prepared.run(progress=False if quiet else None)
    except SimulationError as error:
        if out is not None and error.result is not None:
            _save_beginning(error.result, out)
        raise
    silent = json or quiet
    values = _values(result) | {"errors": {} if quiet and not json else _errors(result, prepared)}
    if not silent:
        console().print(facts(_summary(values, expected="event_name" in result)))
    for text in filter(None, [result.attrs.get("slow_instability"), *warnings_of(result)]):
        warn(text)
        texts.append(text)
    outputs = {"result": out, "plot": plot, "animation": animate}
    files = {name: path for name, path in outputs.items() if path is not None}
    for line in _written(result, files):
        if not silent:
            print_line(line)
    if json:
        summary = {
            "flexarm": package_version(),
            "scenario": str(scenario),
            "changes": [change.origin for change in changes],
            **values,
            "warnings": texts,
            "files": {name: str(path) for name, path in files.items()},
        }
        print(dumps(summary, indent=2, allow_nan=False))


def _written(result: xr.Dataset, files: Mapping[str, Path]) -> Iterator[str]:
    """Write the requested files; yield a line about each."""
    from flexarm.cases.results import write_figure

    for name, path in files.items():
        if name == "result":
            fa.write_result(result, path)
        elif name == "plot":
            write_figure(fa.plot.signals_figure(result), path)
        else:
            speed = fa.animate(result, path).speed
            name += "" if speed == 1.0 else f" at {speed:g} times the speed of the run"
        yield f"{name} in {path}"


def _values(result: xr.Dataset) -> dict[str, Any]:
    """Return the summary as plain values in SI units; see the page of the command line."""
    time, attributes = result["time"].values, result.attrs
    deflection: NDArray[Any] = abs(result["link_tip_deflection"].values).max(axis=0)
    return {
        "samples": int(time.size),
        "end_time": float(time[-1]),
        "integrator": attributes["integrator"],
        "steps": int(attributes["steps"]),
        "wall_seconds": float(attributes["wall_seconds"]),
        "accuracy": attributes.get("accuracy"),
        "integration_error": attributes.get("integration_error"),
        "rtol": attributes["rtol"],
        "tip": result["tip"].values[-1].tolist(),
        "joint_angle": result["joint_angle"].values[-1].tolist(),
        "largest_link_tip_deflection": deflection.tolist(),
        "motors": _records(
            result, joint="joint", saturation="saturation", longest="longest_saturation"
        ),
        "events": _records(result, name="event_name", time="event_time"),
        "ended_by": attributes.get("ended_by") or None,
    }


def _records(result: xr.Dataset, **names: str) -> list[dict[str, Any]]:
    """Return variables of a result over one dimension as records of plain values, if it has them.

    ``names``: variable of each key.
    """
    if not set(names.values()) <= set(result.variables):
        return []
    columns = (result[name].values.tolist() for name in names.values())
    return [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]


def _errors(result: xr.Dataset, prepared: Prepared) -> dict[str, float]:
    """Return the errors of `flexarm.compare` by name that a run has, and that at its end, in m, N.

    Relative to the reference of the controller; empty without one.
    """
    from math import isfinite

    from flexarm.simulation.calls.metrics import metrics_of, tip_error

    reference = prepared.followed.motion
    if "controller" not in prepared.options or reference is None:
        return {}
    values = metrics_of(result, prepared.arm, reference)
    values["tip_error_end"] = float(tip_error(prepared.arm, reference, result)[-1])
    names = (name for name in values if "_error_" in name or name == "residual_vibration")
    return {name: values[name] for name in names if isfinite(values[name])}


def _save_beginning(result: xr.Dataset, out: Path) -> None:
    """Save the samples of a run up to its failure."""
    path = out.with_name(f"{out.stem}.partial{out.suffix}")
    try:
        fa.write_result(result, path)
    except InputError as error:
        print_error(str(error))  # the error of the run is more important and follows
    else:
        end = f"{result['time'].values[-1]:.6g} s"
        print_error(f"flexarm run: the run up to t = {end} is in {path}")


def _summary(values: Mapping[str, Any], expected: bool) -> list[tuple[str, str]]:
    """Return the rows of the printed summary; ``expected``: whether the run looked for events."""
    from flexarm.simulation.calls.metrics import length_text

    x, y = values["tip"]
    steps = f"{values['steps']} of {values['integrator']}"
    rows = [
        ("run", f"{values['samples']} samples to t = {values['end_time']:g} s"),
        *(_events(values) if expected else ()),
        ("steps", f"{steps}, in {values['wall_seconds']:.3g} s"),
        ("tip", f"({x:.6g}, {y:.6g}) m at the end"),
    ]
    if errors := values["errors"]:
        names = {"peak": "at most {}", "rms": "{} RMS in motion", "end": "{} at the end"}
        each = {text: errors.get(f"tip_error_{name}") for name, text in names.items()}
        words = [text.format(length_text(e)) for text, e in each.items() if e is not None]
        rows.append(("task", f"tip error {', '.join(words)}"))
    if "force_error_rms" in errors:
        rows.append(("force", f"error {errors['force_error_rms']:.3g} N RMS in motion"))
    deflection = values["largest_link_tip_deflection"]
    if (most := max(deflection)) > 0.0:
        text = f"at most {1e3 * most:.4g} mm at the tip of link {deflection.index(most) + 1}"
        rows.append(("bending", text))
    at_limit = ", ".join(
        f"motor {motor['joint']} {100.0 * motor['saturation']:.3g} % of the run, "
        f"up to {motor['longest']:.3g} s at a time"
        for motor in values["motors"]
        if motor["saturation"] > 0.0
    )
    if at_limit:
        rows.append(("motors", f"at the limit: {at_limit}"))
    if values["integration_error"] is not None:
        rows.append(("error", f"about {values['integration_error']:.1g} m of the integration"))
    return rows


def _events(values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the number and first time of each event, and the event that ended the run."""
    times: dict[str, list[float]] = {}
    for event in values["events"]:
        times.setdefault(event["name"], []).append(event["time"])
    texts = []
    for name, (first, *others) in times.items():
        count = f"{len(others) + 1} times, first " if others else ""
        texts.append(f"{name}: {count}at t = {first:.6g} s")
    yield "events", "; ".join(texts) or "none"
    if values["ended_by"] in times:
        yield "ended by", values["ended_by"]
