"""What a window shows of a project: picture, frequencies and margins, warnings, or a failure."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import orjson

from flexarm.arm.arm import Arm
from flexarm.arm.bending import one_warning
from flexarm.base.errors import FlexarmError, FlexarmWarning, InputError, printable
from flexarm.cases.scenario.scenario import Prepared, prepare
from flexarm.control.analysis.margins import loop_margins
from flexarm.linear import modes
from flexarm.model import PlantSpec
from flexarm.model.plausible import implausible
from flexarm.simulation.calls.compare import warnings_of
from flexarm.view.plot.animation.scene import SceneOptions, player_data, scene_of, thin
from flexarm.view.plot.drawn_result import factor_of, rigid_result, several
from flexarm.view.reporting import clock, error_panel, few_lines, report
from flexarm.view.studio.state import Project

#: Limits that keep the picture of a run small: coordinates of all frames, intervals of a history.
_MOST_COORDINATES, _INTERVALS = 47_000, 200
_MOST_ARROWS = 8
_MOST_FREQUENCIES = 6


@dataclass(frozen=True)
class Request:
    """Work for the computing process: what to simulate, and for what purpose."""

    project: Project
    purpose: Literal["picture", "margins", "report"] = "picture"


@dataclass(frozen=True)
class Picture:
    """A finished run."""

    data: bytes  # of the player, as JSON
    warnings: tuple[str, ...]  # of the arm and of the result
    frequencies: tuple[float, ...]  # with locked joints at the start, Hz
    seconds: float  # computing time


@dataclass(frozen=True)
class Margins:
    """Margins of the loop at the start of the motion."""

    #: joint, gain margin, phase margin (degrees) and delay margin (ms), as text
    rows: tuple[tuple[str, str, str, str], ...]
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
    own = project.plant or PlantSpec()
    result = prepared.run(plant=plant, loads=own.loads, changes=own.changes, progress=False)
    if request.purpose == "report":
        return Report(report(result, title=project.name, rigid=True))
    arm = plant or prepared.arm
    reference = prepared.followed.motion
    times, fps, speed = clock(result, arm.n_links, _MOST_COORDINATES)
    histories = several("channels", None, result)
    if reference is not None:
        histories = [*histories, error_panel(result, arm, reference)]
    contacts = prepared.options.get("contacts", ())
    options = SceneOptions(
        magnify=factor_of("auto", [(arm, result, bool(contacts))]),
        torque=arm.n_links <= _MOST_ARROWS,
        ghost=rigid_result(True, arm, result),
        reference=reference,
        contacts=contacts,
    )
    drawn = [thin(few_lines(each), _INTERVALS) for each in histories]
    scene = scene_of("", arm, result, times, options, drawn)
    data = orjson.dumps(player_data([scene], fps, speed), option=orjson.OPT_SERIALIZE_NUMPY)
    frequencies = modes(arm, prepared.arm.joint_angles(prepared.options["initial"])).frequency_hz
    texts = (*implausible(arm.spec), *prepared.implausible(), *warnings_of(result))
    lowest = tuple(float(f) for f in frequencies[frequencies > 0.0][:_MOST_FREQUENCIES])
    return Picture(data, texts, lowest, time.perf_counter() - began)


@lru_cache(maxsize=1)
def _prepared(project: Project) -> tuple[Prepared, Arm | None]:
    """Return the scenario, ready to run, and another simulated arm; kept for the margins."""
    prepared = prepare(project.scenario)
    arm = project.simulated_arm
    return prepared, None if arm == project.scenario.arm else Arm(arm)


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
        with one_warning():  # the run itself warns of its states
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
    return Margins(rows, "The sampled loop is unstable at the start." if unstable else "")  # type: ignore[arg-type]
