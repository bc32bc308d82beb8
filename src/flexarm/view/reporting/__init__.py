"""Report of a result: one HTML page that plays the arm and needs no network.

Its tables of numbers and its histories fill a Jinja template.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from numbers import Real
from typing import Any
from urllib.parse import quote

import numpy as np
import xarray as xr

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.arguments import check_kind, library_missing
from flexarm.base.errors import InputError, Problem, printable, public_call, shown
from flexarm.base.references import citation, package_version
from flexarm.base.writing.places import AnyPath, check_place, write_text
from flexarm.cases.scenario.summary import about_arm, about_run
from flexarm.identification.result import Identification, is_identification
from flexarm.model import Contact
from flexarm.simulation.calls.compare import warnings_of
from flexarm.simulation.calls.metrics import METRICS, metrics_of, tip_error
from flexarm.simulation.calls.result import arm_of
from flexarm.view.plot import drawn_result
from flexarm.view.plot.animation.scene import (
    SceneOptions,
    fragment,
    scene_of,
    stations_of,
    style,
    surroundings,
    thin,
)
from flexarm.view.plot.magnified import Magnify, check_magnify, nearest_round

#: Longest file that is shown in full, and longest link to save one, characters. Tables of torques
#: may take megabytes.
_MOST_TEXT, _MOST_LINK = 100_000, 200_000


def template_engine() -> Any:
    """Return the Jinja environment with the templates of reports."""
    try:
        import jinja2
    except ImportError:
        raise library_missing("Jinja2", "report") from None
    return jinja2.Environment(
        loader=jinja2.FunctionLoader(text_of),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )


@cache
def text_of(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def render(
    engine: Any,
    result: xr.Dataset,
    arm: Arm,
    reference: Any,
    histories: Sequence[drawn_result.Signals],
    title: str,
    notes: str,
    player: str,
    magnify: float,
) -> str:
    """Return the page of a report; errors are from ``reference``, unless it is None."""
    scenario = drawn_result.scenario_of(result)
    tables = [_energies_table(result)] if "kinetic_energy" in result else []
    if reference is not None:
        tables.insert(0, errors_table(result, arm, reference))
    page: str = engine.get_template("report.html").render(
        title=clean(title),
        notes=clean(notes.strip()),
        style=style() + text_of("report.css"),
        failure=clean(str(result.attrs.get("failure", ""))),
        warnings=[clean(text) for text in warnings_of(result)],
        player=player,
        magnify=magnify,
        figures=key_figures(result, arm, reference),
        about=[*about_arm(arm), *(about_run(scenario) if scenario else [])],
        run=run_facts(result),
        tables=[extremes_table(each for each in histories if each.name != "energy"), *tables],
        files=[file_item(*each) for each in _model_files(result, arm)],
        scenario=scenario is not None,
        version=str(result.attrs.get("flexarm_version", "")),
        software=str(result.attrs.get("software", "")),
        writer=package_version(),
        citation=file_item("citation.bib", citation(result)),
    )
    return page


def _model_files(result: xr.Dataset, arm: Arm) -> list[tuple[str, str]]:
    """Return names and texts of the files in a result: the scenario, and the arm if it differs."""
    scenario, text = drawn_result.scenario_of(result), result.attrs.get("scenario")
    texts = [("scenario.yaml", str(text))] if text else []
    if scenario is None or scenario.arm != arm.spec:
        texts.append(("arm.yaml", str(result.attrs["arm"])))
    return texts


def file_item(name: str, text: str) -> dict[str, str]:
    """Return name, shown text and link of a file."""
    shown, link = text, f"data:text/plain;charset=utf-8,{quote(text[:_MOST_LINK])}"
    if len(text) > _MOST_TEXT:
        more = len(text) - _MOST_TEXT
        shown = f"{text[:_MOST_TEXT]}\n... ({more} more characters, in the result)"
    if max(len(text), len(link)) > _MOST_LINK:
        link = ""
    return {"name": name, "text": clean(shown), "link": link}


def clean(text: str) -> str:
    """Return text without control characters, line by line."""
    return "\n".join(map(printable, text.split("\n")))


#: Channels that are not in the table of extreme values.
_ENERGIES = ("kinetic_energy", "strain_energy", "gravity_energy", "contact_energy")


@dataclass(frozen=True)
class Table:
    """Table of numbers: title, headings, rows of text with the name first, notes by name."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: Mapping[str, str] = field(default_factory=dict)


def number(value: float) -> str:
    """Format a number with five digits; a dash stands for a missing one."""
    return f"{value + 0.0:.5g}" if np.isfinite(value) else "–"


def extremes_table(histories: Iterable[drawn_result.Signals]) -> Table:
    """Return the extreme and final values of histories, and the time of the largest magnitude."""
    rows = []
    for signals in histories:
        for label, values in zip(signals.labels, signals.values.T, strict=True):
            name = f"{signals.title}, {label}" if label else signals.title
            if not np.isfinite(values).any():
                continue
            peak = signals.time[np.nanargmax(np.abs(values))]
            numbers = (np.nanmin(values), np.nanmax(values), peak, values[-1])
            rows.append((f"{name} [{signals.unit}]", *(number(float(value)) for value in numbers)))
    heads = ("", "lowest", "highest", "peak at [s]", "at the end")
    return Table("Extreme values", heads, tuple(rows))


def errors_table(result: xr.Dataset, arm: Arm, reference: Any) -> Table:
    """Return the errors from the reference during and after the motion, and at the end."""
    values = metrics_of(result, arm, reference)
    rows, notes = [], {}
    for metric in METRICS:
        if np.isfinite(values[metric.name]) and metric.name != "controller_time":
            words = metric.name.replace("rms", "RMS").replace("_", " ")
            scale, unit = metric.display
            name = f"{words[0].upper()}{words[1:]} [{unit}]"
            rows.append((name, number(scale * values[metric.name])))
            notes[name] = metric.meaning
    end = 1e3 * float(tip_error(arm, reference, result)[-1])
    rows.append(("Tip error at the end [mm]", number(end)))
    desired = np.asarray(reference.joint_angle(float(result["time"].values[-1])))
    missed = result["joint_angle"].values[-1] - desired
    for joint, value in zip(arm.joint_numbers, missed, strict=True):
        name = f"Joint {joint}: error at the end [rad]"
        rows.append((name, number(float(value))))
        notes[name] = (
            "from the angles of the motion, at which the rigid arm has its tip on the path; "
            "joints that follow the bent arm differ from them"
        )
    return Table("Errors from the reference", ("", "value"), tuple(rows), notes)


def energies(result: xr.Dataset) -> dict[str, FloatArray]:
    """Return the energies of a result over time (T,) J by name, and their sum; zero ones apart."""
    parts = {}
    for name in _ENERGIES:
        if name in result:
            values = result[name].values
            values = values.reshape(len(values), -1).sum(axis=1)
            if np.any(values) or name == "kinetic_energy":
                parts[name.removesuffix("_energy")] = values
    return parts | {"sum": np.sum(list(parts.values()), axis=0)}


def _energies_table(result: xr.Dataset) -> Table:
    """Return the energies at the start, at their maximum and at the end."""
    rows = []
    for name, values in energies(result).items():
        numbers = (number(float(value)) for value in (values[0], values.max(), values[-1]))
        rows.append((f"{name.capitalize()} [J]", *numbers))
    return Table("Energies", ("", "at the start", "highest", "at the end"), tuple(rows))


def _worded(form: str, value: object) -> str:
    """Return a formatted attribute; its text if another program has replaced it by another kind."""
    try:
        return form.format(value)
    except (TypeError, ValueError):
        return shown(value)


def run_facts(result: xr.Dataset) -> list[tuple[str, str]]:
    """Return names and values that describe how a run was computed."""
    attributes, time = result.attrs, result["time"].values
    rows = [("time", f"{number(time[0])} to {number(time[-1])} s, {time.size} samples")]

    def add(name: str, key: str, form: str = "{}", unless: str = "") -> None:
        text = "" if attributes.get(key) is None else _worded(form, attributes[key])
        if text not in ("", unless):
            rows.append((name, text))

    add("ended by", "ended_by")
    add("integrator", "integrator")
    add("its choice", "integrator_reason")
    add("accuracy", "accuracy", "{:.3g} m at the tip")
    add("integration error", "integration_error", "about {:.1g} m")
    if "rtol" in attributes and "atol" in attributes:
        relative, absolute = (_worded("{:g}", attributes[name]) for name in ("rtol", "atol"))
        rows.append(("tolerances", f"{relative} relative, {absolute} m"))
    add("steps", "steps")
    for name in ("rejected_steps", "impact_steps"):
        add(name.replace("_", " "), name, unless="0")
    add("evaluations", "evaluations")
    add("computing time", "wall_seconds", "{:.3g} s")
    add("controller", "controller")
    add("its sample time", "sample_time", "{:g} s")
    calls, seconds = (attributes.get(f"controller_{name}") for name in ("calls", "seconds"))
    if isinstance(calls, Real) and isinstance(seconds, Real) and float(calls):
        mean = 1e6 * float(seconds) / float(calls)
        rows.append(("its computing time", f"{mean:.3g} µs for each of {calls} samples"))
    return rows


def key_figures(result: xr.Dataset, arm: Arm, reference: Any) -> list[tuple[str, str, str]]:
    """Return the main numbers of a run: name, value and unit."""
    figures = []
    if "link_tip_deflection" in result:
        bent = np.abs(result["link_tip_deflection"].values)
        figures.append(("peak tip deflection of a link", number(1e3 * float(bent.max())), "mm"))
    if reference is not None:
        end = float(tip_error(arm, reference, result)[-1])
        figures.append(("tip error at the end", number(1e3 * end), "mm"))
    if "torque" in result and result["torque"].size:
        figures.append(("peak torque", number(float(abs(result["torque"].values).max())), "N m"))
    if "kinetic_energy" in result:
        moving = float(result["kinetic_energy"].values.max())
        figures.append(("peak kinetic energy", number(moving), "J"))
    if "evaluations" in result.attrs:
        count = _worded("{:,}", result.attrs["evaluations"])
        figures.append(("evaluations of the dynamics", count, ""))
    return figures


#: Default channels, of those that a result has, after the usual ones.
_FURTHER = (
    "joint_rate",
    "tip",
    "torque_command",
    "joint_twist",
    "strain",
    "contact_force",
    "contact_gap",
)
_MOST_LINES = 12
#: Limit on the numbers of all histories, so that they take about 1.5 megabytes.
_MOST_NUMBERS = 200_000


def panels(
    result: xr.Dataset, arm: Arm, reference: Any, channels: object
) -> list[drawn_result.Signals]:
    """Return the histories of a report."""
    if channels is not None:
        return [few_lines(each) for each in drawn_result.several("channels", channels, result)]
    names = [
        name for name in (*drawn_result.USUAL, *_FURTHER) if name in result and result[name].size
    ]
    histories = [drawn_result.signals_of("result", result, name) for name in names]
    # Twists are zero without elastic joints.
    histories = [each for each in histories if each.name != "joint_twist" or np.any(each.values)]
    if "kinetic_energy" in result:
        parts = energies(result)
        histories.append(
            _readable("energy", "J", result, np.stack([*parts.values()], axis=1), *parts)
        )
    if reference is not None:
        histories.append(error_panel(result, arm, reference))
    return [few_lines(each) for each in histories]


def error_panel(result: xr.Dataset, arm: Arm, reference: Any) -> drawn_result.Signals:
    """Return the distance of the tip from its reference over time."""
    return _readable("tip_error", "m", result, tip_error(arm, reference, result)[:, None], "")


def _readable(
    name: str, unit: str, result: xr.Dataset, values: FloatArray, *labels: str
) -> drawn_result.Signals:
    scale, unit = drawn_result.readable_unit(unit, values)
    return drawn_result.Signals(name, result["time"].values, scale * values, unit, labels, labels)


def few_lines(signals: drawn_result.Signals) -> drawn_result.Signals:
    """Return at most twelve lines, evenly chosen with the first and the last."""
    count = len(signals.labels)
    if count <= _MOST_LINES:
        return signals
    kept = np.linspace(0, count - 1, _MOST_LINES).round().astype(int)
    return drawn_result.chosen_lines(signals, kept.tolist())


def fitted(histories: Sequence[drawn_result.Signals]) -> list[drawn_result.Signals]:
    """Return histories with few enough points for the page; peaks are kept."""
    share = _MOST_NUMBERS // max(1, len(histories))
    return [
        thin(each, max(1, share // ((1 + each.values.shape[1]) * (1 + 2 * each.values.shape[1]))))
        for each in histories
    ]


#: Histories beside the arm; the others are below it.
_BESIDE = 3
#: Limit on the coordinates of all frames, so that they take about two megabytes.
_MOST_COORDINATES = 330_000
#: Number of coordinates of a joint and its rigid counterpart, and of the arrow of a torque.
_OF_JOINT, _OF_ARROW = 6, 56
_MOST_FPS = 30.0
#: Shortest and longest duration (s) of an animation; its speed is changed to stay between them.
_SHORTEST, _LONGEST = 2.0, 60.0
#: Links beyond which no torques are drawn: their arrows would overlap.
_MOST_ARROWS = 8


@public_call
def report(
    result: xr.Dataset | Identification,
    path: AnyPath | None = None,
    *,
    title: str | None = None,
    notes: str = "",
    channels: str | Sequence[str] | None = None,
    magnify: Magnify = "auto",
    rigid: bool | xr.Dataset = False,
    reference: Any = None,
    contacts: Sequence[Contact] | None = None,
) -> str:
    """Create a report of a result: one HTML page that needs no network.

    The arm plays, and histories follow its time and can be zoomed. Tables contain peak values,
    errors from the reference, energies and the work of the integrator. The page contains the model
    file, the warnings, the versions of the software and the references to cite, and is made to be
    printed. Its size is below 5 MB for any result.

    The page of an identification has estimates with intervals and correlations, directions that
    the data do not determine, the fit of every channel and record with tests of its residuals,
    validation, and pictures of all of them; it requires no JavaScript.

    Args:
        result: a result of ``simulate``, ``run_scenario`` or ``read_result``; or of ``identify``,
            which takes only ``path``, ``title`` and ``notes`` of the other arguments.
        path: of the .html file to write; None for none.
        title: of the page.
        notes: text below the title, with its line breaks.
        channels: channels to draw over time, as in ``plot.history``; by default the main ones of
            the result. Of channels with many lines, twelve are drawn.
        magnify: factor on the drawn bending of the links, or "auto", as in ``animate``.
        rigid: True adds the rigid counterpart at the same joint angles, dashed; a result adds the
            arm of that result.
        reference: motion to compute errors from. By default that of the scenario, for results of a
            scenario.
        contacts: contacts whose surfaces to draw. By default those of the scenario.

    Returns:
        The text of the page.

    Raises:
        InputError: if an argument has the wrong type or is out of range, the file cannot be
            written, or Jinja2 is not installed.
    """
    if isinstance(result, Identification) or is_identification(result):
        others = (channels, magnify != "auto" or None, rigid or None, reference, contacts)
        from flexarm.view.reporting.identification import identification_page

        identified = (
            result if isinstance(result, Identification) else Identification.from_dataset(result)
        )
        if any(option is not None for option in others):
            rule = "of the report of an identification may be path, title and notes"
            raise InputError(Problem("arguments", rule))
        title = "Identification" if title is None else check_kind("title", title, str, "text")
        notes = check_kind("notes", notes, str, "text")
        engine = template_engine()
        place = None if path is None else check_place("path", path, (".html",))
        text = identification_page(engine, identified, title, notes)
        if place is not None:
            write_text(text, place)
        return text
    result = drawn_result.check_drawable("result", result)
    arm = arm_of("result", result)
    title = "Flexible arm" if title is None else check_kind("title", title, str, "text")
    notes = check_kind("notes", notes, str, "text")
    magnify = check_magnify(magnify)
    ghost = drawn_result.rigid_result(rigid, arm, result)
    desired, touched = surroundings(arm, result, reference, contacts)
    histories = panels(result, arm, desired, channels)
    engine = template_engine()
    place = None if path is None else check_place("path", path, (".html",))
    factor = drawn_result.factor_of(magnify, [(arm, result, bool(touched))])
    options = SceneOptions(factor, True, arm.n_links <= _MOST_ARROWS, ghost, desired, touched)
    times, fps, speed = clock(result, arm.n_links)
    scene = scene_of("", arm, result, times, options, fitted(histories))
    player = fragment([scene], fps, speed, _BESIDE)
    text = render(engine, result, arm, desired, histories, title, notes, player, factor)
    if place is not None:
        write_text(text, place)
    return text


def clock(
    result: xr.Dataset, links: int, most: int = _MOST_COORDINATES
) -> tuple[np.ndarray, float, float]:
    """Return the times of the frames from the start, s, frames per second, and the speed.

    The speed is in seconds of the run per second of the animation. All frames together have at most
    ``most`` coordinates.
    """
    duration = float(np.ptp(result["time"].values))
    if duration == 0.0:
        return np.zeros(1), _MOST_FPS, 1.0
    speed = 1.0
    if not _SHORTEST / 2.0 <= duration <= _LONGEST:
        speed = nearest_round(duration / (_SHORTEST if duration < _SHORTEST else _LONGEST))
    each = 3 * stations_of(links) + _OF_JOINT + (_OF_ARROW if links <= _MOST_ARROWS else 0)
    frames = max(2, min(most // (each * links), round(duration / speed * _MOST_FPS) + 1))
    return np.linspace(0.0, duration, frames), (frames - 1) * speed / duration, speed
