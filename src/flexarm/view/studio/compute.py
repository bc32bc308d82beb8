"""What a window shows of a project: picture, frequencies and margins, warnings, or a failure."""

from __future__ import annotations

import math
import time
import warnings
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import orjson

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.bending import one_warning
from flexarm.base.errors import FlexarmError, FlexarmWarning, InputError, printable
from flexarm.base.late import xr
from flexarm.cases.scenario.scenario import Prepared, prepare
from flexarm.control.analysis.margins import loop_margins
from flexarm.linear import modes
from flexarm.model import PlantSpec
from flexarm.model.drives import ControllerDrive
from flexarm.model.plausible import implausible
from flexarm.model.scenarios.scenario import RunSpec, Scenario, recording_rate
from flexarm.simulation.calls.compare import warnings_of
from flexarm.simulation.calls.metrics import METRICS, metrics_of
from flexarm.view.plot.animation.scene import SceneOptions, player_data, scene_of, thin
from flexarm.view.plot.drawn_result import factor_of, rigid_result, several
from flexarm.view.reporting import clock, error_panel, few_lines, report
from flexarm.view.studio.state import Project

#: Limits that keep the picture of a run small: coordinates of all frames, intervals of a history.
_MOST_COORDINATES, _INTERVALS = 47_000, 200
#: Of a preview: coordinates of all frames, samples, and relative tolerance.
_PREVIEW_COORDINATES, _PREVIEW_SAMPLES, _PREVIEW_RTOL = 20_000, 300, 1e-4
_MOST_ARROWS = 8
_MOST_FREQUENCIES = 6


#: Row of a table, as text.
Row = tuple[str, ...]


@dataclass(frozen=True)
class Request:
    """Work for the computing process: what to simulate, and for what purpose."""

    project: Project
    #: A preview is the picture of a coarser run, without warnings, while a slider moves.
    purpose: Literal["picture", "preview", "margins", "report"] = "picture"


@dataclass(frozen=True)
class Picture:
    """A finished run."""

    data: bytes  # of the player, as JSON
    warnings: tuple[str, ...]  # of the arm and of the result
    frequencies: tuple[float, ...] | None  # with locked joints at the start, Hz; None without any
    seconds: float  # computing time
    outcome: tuple[Row, ...] = ()  # of two drives, a table with its head


@dataclass(frozen=True)
class Margins:
    """Margins of the loop at the start of the motion."""

    rows: tuple[Row, ...]  # joint, gain margin, phase margin (degrees) and delay margin (ms)
    note: str = ""  # why there are none, or a statement about all of them


@dataclass(frozen=True)
class Report:
    """Text of a report, an HTML page."""

    text: str


@dataclass(frozen=True)
class Failure:
    """A run that is not possible, or did not reach its end."""

    problems: tuple[tuple[str, str], ...]  # path of a value, or empty, and the statement about it


Part = Picture | Margins | Report | Failure


def parts_of(request: Request) -> Iterator[Part]:
    """Yield what a request asks for, or a failure."""
    try:
        with warnings.catch_warnings():  # results carry them
            warnings.simplefilter("ignore", FlexarmWarning)
            yield _part(request)
    except InputError as error:
        yield Failure(tuple((problem.name, problem.statement) for problem in error.problems))
    except (FlexarmError, MemoryError) as error:
        yield Failure((("", printable(str(error) or "out of memory")),))


def _part(request: Request) -> Part:
    project, began = request.project, time.perf_counter()
    prepared, plant = _prepared(project)
    if request.purpose == "margins":
        return _margins(prepared, plant)
    if request.purpose == "report":
        return Report(report(_run(project), title=project.name, rigid=True))
    preview = request.purpose == "preview"
    sides = dict(zip(_names(project), project.sides, strict=True))
    coarse = _coarse(project.scenario.run) if preview else {}
    results = {name: _run(side, **coarse) for name, side in sides.items()}
    arm = plant or prepared.arm
    most = (_PREVIEW_COORDINATES if preview else _MOST_COORDINATES) // len(results)
    first = next(iter(results.values()))
    times, fps, speed = clock(first, arm.n_links, most)
    contacts = prepared.options.get("contacts", ())
    drawn = [(arm, result, bool(contacts)) for result in results.values()]
    factor, scenes = factor_of("auto", drawn), []
    for name, result in results.items():
        reference = _prepared(sides[name])[0].followed.motion
        histories = several("channels", None, result)
        if reference is not None:
            histories = [*histories, error_panel(result, arm, reference)]
        options = SceneOptions(
            magnify=factor,
            torque=arm.n_links <= _MOST_ARROWS,
            ghost=rigid_result(True, arm, result),
            reference=reference,
            contacts=contacts,
        )
        thinned = [thin(few_lines(each), _INTERVALS) for each in histories]
        scenes.append(scene_of(name, arm, result, times, options, thinned))
    data = orjson.dumps(player_data(scenes, fps, speed), option=orjson.OPT_SERIALIZE_NUMPY)
    texts = [] if preview else [*implausible(arm.spec)]
    for name, result in {} if preview else results.items():
        own = (*_prepared(sides[name])[0].implausible(), *warnings_of(result))
        texts += [f"{name}: {text}" if name else text for text in own]
    lowest = _frequencies(arm, prepared.arm.joint_angles(prepared.options["initial"]))
    outcome = _outcome(sides, results) if len(sides) > 1 else ()
    return Picture(data, tuple(texts), lowest, time.perf_counter() - began, outcome)


def _frequencies(arm: Arm, angles: FloatArray) -> tuple[float, ...] | None:
    """Return the lowest frequencies (Hz); None at a dead centre, where locked joints have none."""
    try:
        frequencies = modes(arm, angles).frequency_hz
    except FlexarmError:
        return None
    return tuple(float(f) for f in frequencies[frequencies > 0.0][:_MOST_FREQUENCIES])


def _names(project: Project) -> list[str]:
    """Return the names of the drives that are shown side by side; empty for a single one."""
    if project.beside is None:
        return [""]
    first, other = (side.scenario.drive.kind.replace("_", " ") for side in project.sides)
    return [first, f"{other}, beside" if first == other else other]


def _coarse(run: RunSpec) -> dict[str, Any]:
    """Return the settings of the run of a preview: fewer samples, larger tolerances."""
    rate = recording_rate(run.rate, run.duration)
    every = math.ceil(rate * run.duration / _PREVIEW_SAMPLES)
    return {"rate": rate / every, "accuracy": None, "rtol": max(_PREVIEW_RTOL, run.rtol or 0.0)}


def _run(project: Project, **more: Any) -> xr.Dataset:
    """Simulate what a project shows."""
    prepared, plant = _prepared(project)
    own = project.plant or PlantSpec()
    if own.hardware is not None:
        more["hardware"] = own.hardware
    return prepared.run(plant=plant, loads=own.loads, changes=own.changes, progress=False, **more)


def _outcome(sides: dict[str, Project], results: dict[str, xr.Dataset]) -> tuple[Row, ...]:
    """Return the metrics of ``flexarm.compare`` for several drives, below a row of their names."""
    columns = []
    for name, side in sides.items():
        prepared = _prepared(side)[0]
        reference = prepared.followed.motion or prepared.motion
        columns.append(metrics_of(results[name], prepared.arm, reference) if reference else {})
    rows: list[Row] = [("", *sides)]
    for metric in METRICS:
        factor, unit = metric.display
        values = [factor * column.get(metric.name, np.nan) for column in columns]
        if metric.name != "controller_time" and not np.isnan(values).all():
            label = f"{metric.name.replace('_', ' ')} [{unit}]"
            rows.append((label, *("–" if np.isnan(each) else f"{each:.4g}" for each in values)))
    return tuple(rows)


#: The scenarios that were prepared last.
_RECENT: deque[tuple[Scenario, Prepared]] = deque(maxlen=2)


@lru_cache(maxsize=2)
def _prepared(project: Project) -> tuple[Prepared, Arm | None]:
    """Return the scenario, ready to run, and another simulated arm; kept for the margins."""
    scenario, arm = project.scenario, project.simulated_arm
    prepared = prepare(scenario, **_reused(scenario))
    _RECENT.append((scenario, prepared))
    return prepared, None if arm == scenario.arm else Arm(arm)


def _reused(scenario: Scenario) -> dict[str, Any]:
    """Return parts of recent scenarios that this one shares with them: a slider changes little."""
    parts: dict[str, Any] = {}
    for before, prepared in _RECENT:
        if before.arm == scenario.arm:
            parts["arm"] = prepared.arm
            if _task(before) == _task(scenario):
                parts["motion"] = prepared.motion
                if _followed(before) == _followed(scenario):
                    parts["followed"] = prepared.followed
    return parts


def _task(scenario: Scenario) -> tuple[Any, ...]:
    """Return all that a motion depends on beside the arm."""
    return scenario.motion, scenario.contacts, scenario.run.duration


def _followed(scenario: Scenario) -> Any:
    """Return what the reference or torque along a motion depends on beside it."""
    drive = scenario.drive
    return ("feedback", drive.reference_kind) if isinstance(drive, ControllerDrive) else drive


def _margins(prepared: Prepared, plant: Arm | None) -> Margins:
    """Return the margins at the start; controllers without poles have none."""
    controller, options = prepared.options.get("controller"), prepared.options
    if controller is None:
        return Margins((), "The drive has no feedback loop.")
    presses = hasattr(prepared.motion, "contact_force")
    place: dict[str, Any] = {"postures": prepared.arm.joint_angles(options["initial"])}
    if presses:
        place = {"reference": prepared.motion, "contacts": options.get("contacts", ())}
    try:
        with one_warning(report=False):  # the run itself warns of its states
            table = loop_margins(
                controller, plant or prepared.arm, hardware=options.get("hardware"), **place
            )
    except FlexarmError as error:
        return Margins((), f"Margins are not analysed: {printable(str(error))}")
    factors = {"gain_margin": 1.0, "phase_margin": 180.0 / np.pi, "delay_margin": 1e3}
    columns = [factor * table[f"worst_{name}"].values for name, factor in factors.items()]
    rows = tuple(
        (f"joint {joint}", *(f"{value:.3g}" if np.isfinite(value) else "∞" for value in row))
        for joint, row in zip(table["joint"].values, np.stack(columns, axis=1), strict=True)
    )
    unstable = float(table["growth"].max()) > 0.0
    return Margins(rows, "The sampled loop is unstable at the start." if unstable else "")
