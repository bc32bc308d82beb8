"""Report of a result: one HTML page that plays the arm and needs no network."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from flexarm.base.arguments import check_kind
from flexarm.base.errors import InputError, Problem, public_call
from flexarm.base.writing.places import AnyPath, check_place, write_text
from flexarm.identification.result import Identification, is_identification
from flexarm.model import Contact
from flexarm.view.plot.animation.scene import (
    SceneOptions,
    fragment,
    scene_of,
    stations_of,
    surroundings,
)
from flexarm.view.plot.drawn_arm import arm_of, check_drawable, check_magnify, rigid_result
from flexarm.view.reporting.document import fitted, panels, render, template_engine

#: Histories beside the arm; the others are below it.
_BESIDE = 3
#: Limit on the coordinates of all frames, so that they take about two megabytes.
_MOST_COORDINATES = 300_000
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
    magnify: float = 1.0,
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
        magnify: factor on the drawn bending of the links, as in ``animate``.
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
        options = (channels, magnify != 1.0 or None, rigid or None, reference, contacts)
        return _of_identification(result, path, title, notes, options)
    result = check_drawable("result", result)
    arm = arm_of("result", result)
    title = "Flexible arm" if title is None else check_kind("title", title, str, "text")
    notes = check_kind("notes", notes, str, "text")
    magnify = check_magnify(magnify)
    ghost = rigid_result(rigid, arm, result)
    desired, touched = surroundings(arm, result, reference, contacts)
    histories = panels(result, arm, desired, channels)
    engine = template_engine()
    place = None if path is None else check_place("path", path, (".html",))
    wishes = SceneOptions(magnify, trace=True, torque=arm.links <= _MOST_ARROWS)
    times, fps, speed = clock(result, arm.links)
    start = float(result["time"].values[0])
    scene = scene_of(
        "", arm, result, start + times, wishes, ghost, desired, touched, fitted(histories)
    )
    player = fragment([scene], fps, speed, _BESIDE)
    text = render(engine, result, arm, desired, histories, title, notes, player, magnify)
    if place is not None:
        write_text(text, place)
    return text


def _of_identification(
    result: xr.Dataset | Identification,
    path: AnyPath | None,
    title: str | None,
    notes: str,
    options: Sequence[object],
) -> str:
    """Write the report of an identification; ``options`` are those of runs, which must be None."""
    from flexarm.view.reporting.identification import identification_page

    found = result if isinstance(result, Identification) else Identification.from_dataset(result)
    if any(option is not None for option in options):
        rule = "of the report of an identification may be path, title and notes"
        raise InputError(Problem("arguments", rule))
    title = "Identification" if title is None else check_kind("title", title, str, "text")
    notes = check_kind("notes", notes, str, "text")
    engine = template_engine()
    place = None if path is None else check_place("path", path, (".html",))
    text = identification_page(engine, found, title, notes)
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
        speed = _round(duration / (_SHORTEST if duration < _SHORTEST else _LONGEST))
    each = 2 * stations_of(links) + _OF_JOINT + (_OF_ARROW if links <= _MOST_ARROWS else 0)
    frames = max(2, min(most // (each * links), round(duration / speed * _MOST_FPS) + 1))
    return np.linspace(0.0, duration, frames), (frames - 1) * speed / duration, speed


def _round(value: float) -> float:
    """Return the nearest of 1, 2 and 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    steps = np.array([1.0, 2.0, 5.0, 10.0]) * power
    return float(f"{steps[np.argmin(np.abs(np.log(steps / value)))]:.0e}")
