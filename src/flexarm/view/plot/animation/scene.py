"""Data of an animation as plain arrays, and the page that plays them; without Matplotlib."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from html import escape
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.surfaces import arc_of, course_of
from flexarm.base.arguments import check_list_of
from flexarm.base.errors import FlexarmError, InputError, Problem
from flexarm.base.late import xr
from flexarm.cases.scenario.references import motion_of
from flexarm.control.contract.base import check_reference
from flexarm.model import Contact, RoundWall, Surface, SurfaceTable, Wall
from flexarm.simulation.calls.metrics import on_base, tip_reference
from flexarm.view.plot.drawn_result import (
    RigidMotion,
    Signals,
    at_times,
    joints_of,
    scenario_of,
    shapes_of,
)
from flexarm.view.plot.magnified import Bending, Place, bending_of, straight_ends
from flexarm.view.plot.mechanism import Marks, marks_of
from flexarm.view.plot.palette import series_colors

#: Points along a link, enough for a smooth curve on a screen.
STATIONS = 17
#: Points of a history or a path, enough for the columns of a screen.
_MOST_POINTS = 900
#: Free margin around the motion, as a fraction of the view.
_MARGIN = 0.1
#: Largest sweep of a torque's arrow, rad, and its radius as a fraction of the width of the view.
_SWEEP, _RADIUS = 1.6 * np.pi, 0.055
#: Fraction of the largest torque below which a torque has no arrow.
_NO_ARROW = 0.02


@dataclass(frozen=True, eq=False)
class Scene:
    """Motion of one arm in F frames; lengths in m, world axes."""

    title: str  # above the arm, or empty
    times: FloatArray  # (F,) of the run, s
    links: FloatArray  # (F, links, stations, 2) as drawn, with magnified bending
    #: (links,) depths of the links in the plane, zero if the model has none
    depths: tuple[float, ...]
    bends: tuple[bool, ...]  # (links,) whether a link is flexible
    joints: FloatArray  # (F, k, 2) of movable joints, and of closures
    seats: tuple[int, ...]  # indices of the links at whose roots the movable joints are
    marks: Marks  # ground, slides and base
    serial: bool  # whether each link follows the one before
    payload: bool  # whether the arm carries one
    #: (F, movable joints, points, 2) of torques, NaN without an arrow; or None
    arrows: FloatArray | None
    ghost: FloatArray | None  # (F, links, stations, 2) of the rigid counterpart, or None
    path: FloatArray | None  # (P, 2) of the drawn tip, at times (P,) ``path_times``; or None
    path_times: FloatArray
    straight_path: FloatArray | None  # (P, 2) of the tip of the arm without bending, or None
    #: (R, 2) of the reference path, and (F, 2) reference position of the tip; or None
    reference: tuple[FloatArray, FloatArray] | None
    solids: tuple[_Solid, ...]  # surfaces of the contacts
    histories: tuple[Signals, ...]  # beside the arm
    view: FloatArray  # (4,) smallest and largest x, smallest and largest y of everything that moves
    bending: Bending
    magnify: float = 1.0  # factor on the drawn bending
    true: Scene | None = None  # the scene with the factor 1, if this one has another


@dataclass(frozen=True)
class SceneOptions:
    """Options of the drawing; see `animate`."""

    magnify: float = 1.0
    trace: bool = True
    torque: bool = True
    ghost: RigidMotion | None = None  # the rigid counterpart
    reference: Any = None  # motion with the reference of the tip
    contacts: Sequence[Contact] = ()  # whose surfaces are drawn


def scene_of(
    title: str,
    arm: Arm,
    result: xr.Dataset,
    times: FloatArray,
    options: SceneOptions,
    histories: Sequence[Signals],
) -> Scene:
    """Create the scene of a result at times (F,) s from its start, also beyond its end."""
    ghost, reference = options.ghost, options.reference
    time = result["time"].values
    now = np.clip(float(time[0]) + times, time[0], time[-1])
    q = at_times(time, result["q"].values, now)
    links = shapes_of(arm, q, stations=stations_of(arm.n_links))
    bending = bending_of(arm, q, links, touches=bool(options.contacts))
    path_times = np.linspace(time[0], time[-1], min(len(time), _MOST_POINTS))
    along = at_times(time, result["q"].values, path_times)
    path = straight_path = None
    if options.trace:
        path = at_times(time, result["tip"].values, path_times) if "tip" in result else None
        path = shapes_of(arm, along, stations=2)[:, -1, -1] if path is None else path
        straight_path = None if bending.angle is None else straight_ends(arm, along)[:, -1, -1]
    straight = None if ghost is None else ghost.shapes(now, 2)
    desired = None
    if reference is not None:
        twice = np.concatenate([path_times, now])
        base = None
        if "base_position" in result:
            base = at_times(time, result["base_position"].values, twice)
        tips = on_base(tip_reference(arm, reference, twice), base)
        desired = tips[: len(path_times)], tips[len(path_times) :]
    marks, spec = marks_of(arm, q, links), arm.spec
    seats = tuple(seat.link for seat in arm.assembly.seats)
    joints = joints_of(arm, links)[:, list(seats)]
    scene = Scene(
        title=title,
        times=now,
        links=links,
        depths=tuple(0.0 if k.section is None else float(k.section.depth) for k in spec.links),
        bends=tuple(link.flexible for link in spec.links),
        joints=np.concatenate([joints, marks.pins], axis=1),
        seats=seats,
        marks=marks,
        serial=spec.is_serial,
        payload=spec.payload.mass > 0.0,
        arrows=None,
        ghost=straight,
        path=path,
        path_times=path_times,
        straight_path=straight_path,
        reference=desired,
        solids=(),
        histories=tuple(histories),
        view=np.zeros(4),
        bending=bending,
    )
    drawn = magnified(scene, options.magnify)
    view = _view(np.concatenate([*_extent(scene), *_extent(drawn)]))
    scene = replace(
        scene,
        arrows=_torques(scene, result, view) if options.torque else None,
        solids=tuple(_solid_of(contact.surface, view) for contact in options.contacts),
        view=view,
    )
    return magnified(scene, options.magnify)


def magnified(scene: Scene, factor: float) -> Scene:
    """Return a scene with its bending drawn by a factor."""
    if factor == 1.0:
        return scene
    bending, true = scene.bending, scene.links
    links = bending.links(true, factor)

    def carried(points: FloatArray, places: Sequence[Place]) -> FloatArray:
        drawn = points.copy()
        for k, place in enumerate(places):
            drawn[:, k] = bending.carried(true, links, points[:, k], place, factor)
        return drawn

    marks = scene.marks
    rails = marks.rails.shape[1]
    path = scene.path
    if path is not None and scene.straight_path is not None:
        # Exact at the frames; between them the bending of the path is scaled.
        path = scene.straight_path + factor * (path - scene.straight_path)
        away = links[:, -1, -1] - at_times(scene.path_times, path, scene.times)
        path = path + at_times(scene.times, away, scene.path_times)
    return replace(
        scene,
        links=links,
        joints=carried(scene.joints, _carriers_of_joints(scene)),
        marks=marks._replace(
            rails=carried(marks.rails, marks.carriers[:rails]),
            pins=carried(marks.pins, marks.carriers[rails:]),
        ),
        arrows=None
        if scene.arrows is None
        else carried(scene.arrows, [Place(i, 0.0) for i in scene.seats]),
        path=path,
        magnify=factor,
        true=scene,
    )


def _carriers_of_joints(scene: Scene) -> list[Place]:
    """Return the sections that carry the joints of a scene, and its closures."""
    # See `joints_of`: a joint of a serial arm is at the tip before it.
    joints = [Place(i - 1, 1.0) if scene.serial else Place(i, 0.0) for i in scene.seats]
    return [*joints, *scene.marks.carriers[scene.marks.rails.shape[1] :]]


def _extent(scene: Scene) -> list[FloatArray]:
    """Return arrays of points (k, 2) that the view contains."""
    shown = [scene.links, scene.marks.feet, scene.marks.rails, scene.marks.body, scene.ghost]
    shown += [scene.path, None if scene.reference is None else scene.reference[0]]
    return [points.reshape(-1, 2) for points in shown if points is not None]


def _torques(scene: Scene, result: xr.Dataset, view: FloatArray) -> FloatArray | None:
    if "torque" not in result or not scene.seats:
        return None
    torque = at_times(result["time"].values, result["torque"].values, scene.times)
    scale = float(np.abs(result["torque"].values).max(initial=0.0))
    if scale == 0.0:
        return None
    # The arrow starts at the link, so that its direction is clear in any posture.
    seats = list(scene.seats)
    joints = scene.joints[:, : len(seats)]
    first = scene.links[:, seats, 1] - joints
    angle = np.arctan2(first[..., 1], first[..., 0])
    return _arrows(joints, angle, torque / scale, _RADIUS * float(view[1] - view[0]))


def stations_of(links: int) -> int:
    """Return the number of points drawn along each link, fewer for arms with many links."""
    return min(STATIONS, max(5, 4 * STATIONS // links))


def _view(points: FloatArray) -> FloatArray:
    """Return a square around points (k, 2) and the base: left, right, bottom, top."""
    low = np.minimum(points.min(axis=0), 0.0)
    high = np.maximum(points.max(axis=0), 0.0)
    half = (0.5 + _MARGIN) * max(float((high - low).max()), 1e-9)
    middle = 0.5 * (low + high)
    return np.array([middle[0] - half, middle[0] + half, middle[1] - half, middle[1] + half])


def _arrows(centers: FloatArray, start: FloatArray, part: FloatArray, radius: float) -> FloatArray:
    """Return arcs (F, joints, points, 2) of torques, fractions ``part`` of the largest."""
    sweep = _SWEEP * part
    fraction = np.linspace(0.0, 1.0, 25)
    angle = start[..., None] + sweep[..., None] * fraction
    arc = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    end, sign = angle[..., -1], np.sign(sweep)
    head = np.minimum(0.5, np.abs(sweep))  # angle of the head, rad, at most that of the arc

    def barb(side: float) -> FloatArray:
        back = end - sign * head
        reach = 1.0 + 0.56 * side * head
        return np.asarray(reach[..., None] * np.stack([np.cos(back), np.sin(back)], axis=-1))

    tip = arc[..., -1, :]
    points = [arc, barb(1.0)[..., None, :], tip[..., None, :], barb(-1.0)[..., None, :]]
    drawn: FloatArray = centers[..., None, :] + radius * np.concatenate(points, axis=-2)
    drawn[np.abs(part) < _NO_ARROW] = np.nan
    return drawn


def thin(signals: Signals, intervals: int) -> Signals:
    """Return a history with few points, and of each interval the extreme values of lines."""
    count, lines = signals.values.shape
    if count <= intervals * (1 + 2 * lines):
        return signals
    keep = {0, count - 1}
    for chunk in np.array_split(np.arange(count), intervals):
        values = signals.values[chunk]
        keep |= {int(chunk[0]), *chunk[values.argmin(axis=0)], *chunk[values.argmax(axis=0)]}
    chosen = np.array(sorted(keep))
    return replace(signals, time=signals.time[chosen], values=signals.values[chosen])


#: Thickness of the band, as a fraction of the width of the view.
_BAND = 0.03
_POINTS = 181


class _Solid(NamedTuple):
    """Surface: its outline (k, 2) m, and the far side (k, 2) of a band of the solid behind it."""

    course: FloatArray
    behind: FloatArray


def _solid_of(surface: Surface, view: FloatArray) -> _Solid:
    """Return the outline and band of a surface in a view: left, right, bottom, top, m."""
    width = float(view[1] - view[0])
    middle = np.array([view[0] + view[1], view[2] + view[3]]) / 2.0
    if isinstance(surface, SurfaceTable):
        course = course_of(surface, 2.0 * width, _POINTS)
        along = np.gradient(course, axis=0)
        along /= np.linalg.norm(along, axis=1)[:, None]
        inward = np.stack([along[:, 1], -along[:, 0]], axis=1)  # solid lies to the right
    elif isinstance(surface, RoundWall):
        angle = np.linspace(0.0, 2.0 * np.pi, _POINTS)
        outward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        course = np.asarray(surface.center, dtype=np.float64) + surface.radius * outward
        inward = outward if surface.inside else -outward
    else:
        course, inward = _line(surface, middle, width)
    return _Solid(course, course + _BAND * width * inward)


def _line(surface: Wall, middle: FloatArray, width: float) -> tuple[FloatArray, FloatArray]:
    _, point, normal = arc_of(surface)
    along = np.array([normal[1], -normal[0]])
    nearest = point + along * float(along @ (middle - point))
    course = nearest + np.outer([-2.0 * width, 2.0 * width], along)
    return course, np.array([-normal, -normal])


def surroundings(
    arm: Arm, result: xr.Dataset, reference: Any, contacts: Sequence[Contact] | None
) -> tuple[Any, Sequence[Contact]]:
    """Return the reference, or None, and the contacts to draw, by default the scenario's."""
    if contacts is not None:
        contacts = check_list_of("contacts", contacts, Contact)
    if reference is not None:
        check_reference(reference)
        angles = np.asarray(reference.joint_angle(0.0))
        # A reference of another arm is drawn if it has its own path of the tip.
        if getattr(reference, "tip", None) is None and angles.shape != (arm.n_joints,):
            rule = f"move the {arm.n_joints} joints of the arm"
            raise InputError(Problem("reference", rule, f"one for {angles.size} joints"))
    moved, touched = _of_scenario(arm, result)
    return moved if reference is None else reference, touched if contacts is None else contacts


def _of_scenario(arm: Arm, result: xr.Dataset) -> tuple[Any, Sequence[Contact]]:
    """Return motion and contacts of a result's scenario, if it has one."""
    scenario = scenario_of(result)
    if scenario is None or len(scenario.arm.links) != arm.n_links:
        return None, []
    try:
        return motion_of(arm, scenario), scenario.contacts
    except FlexarmError:  # the plant differs from the arm of the scenario
        return None, scenario.contacts


#: Parts of the player's script, in their order.
_SCRIPTS = ("canvas.js", "magnified.js", "arm.js", "histories.js", "player.js")
#: Resolution of lengths: 1e-4 of the width of the view, a tenth of a pixel.
_PARTS = 1e4


def page(scenes: Sequence[Scene], fps: float, speed: float, title: str) -> str:
    """Return the text of an HTML page that plays scenes side by side; ``speed`` is run s per s."""
    head = f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}'
    head += '</title><meta name="viewport" content="width=device-width, initial-scale=1">'
    head += f"<style>{style()}</style></head>\n<body>"
    return f"{head}{fragment(scenes, fps, speed)}</body></html>\n"


def style() -> str:
    """Return the style sheet of the player."""
    return _text("player.css")


def fragment(scenes: Sequence[Scene], fps: float, speed: float, beside: int | None = None) -> str:
    """Return the player, with ``beside`` histories beside the arm, for pages with `style`."""
    # A title may contain "</script>", so write "<" as an escape sequence.
    content = player_data(scenes, fps, speed, beside)
    text = json.dumps(content, separators=(",", ":"), allow_nan=False, default=_listed)
    text = text.replace("<", "\\u003c")
    place = "document.currentScript.previousElementSibling"
    data = f"JSON.parse({place}.textContent)"
    return (
        '<div class="flexarm-player"></div>'
        f'<script type="application/json" class="flexarm-data">{text}</script>'
        f"<script>({player_function()})({place}.previousElementSibling, {data});</script>"
    )


def player_function() -> str:
    """Return a JavaScript function of an element and the data of a player, which it creates there.

    It returns a function ``load(data, previous)`` that shows other data at the time that is shown,
    with the arm and the histories of ``previous`` data, or null, as a ghost.
    """
    script = "".join(_text(name) for name in _SCRIPTS)
    return f'function (root, data) {{\n"use strict";\n{script}return load;\n}}'


def player_data(
    scenes: Sequence[Scene], fps: float, speed: float, beside: int | None = None
) -> dict[str, Any]:
    """Return the data of the player, plain values and arrays; arguments as in `fragment`."""
    if beside is None:
        beside = max(len(scene.histories) for scene in scenes)
    return {"fps": fps, "speed": speed, "scenes": list(map(_data, scenes)), "beside": beside}


def _listed(values: FloatArray) -> Any:
    """Return numbers for JSON, with null for those that are not finite."""
    if np.isfinite(values).all():
        return values.tolist()
    numbers = values.astype(object)
    numbers[~np.isfinite(values)] = None
    return numbers.tolist()


def inline(text: str, height: int) -> str:
    """Return a page in an iframe, which isolates its styles and script from a notebook."""
    look = f"width:100%;height:{height}px;border:0"
    return f'<iframe srcdoc="{escape(text, quote=True)}" style="{look}"></iframe>'


@cache
def _text(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def _data(scene: Scene) -> dict[str, Any]:
    digits = max(0, 4 - math.floor(math.log10(float(scene.view[1] - scene.view[0]))))
    magnify, scene = scene.magnify, scene.true or scene  # the player magnifies the bending
    reference, rails = scene.reference, scene.marks.rails.shape[1]
    turns = scene.bending.angle if any(scene.bends) else None
    # Without angles, the player magnifies the rounding of points, by ten times the factor at most.
    finer = 0 if turns is not None else 1 + math.ceil(math.log10(max(magnify, 1.0)))
    return {
        "title": scene.title,
        "times": _rounded(scene.times, 6),
        "view": _rounded(scene.view, digits),
        "links": _rounded(scene.links, digits + finer * any(scene.bends)),
        "depths": list(scene.depths),
        "bends": [bool(bends) for bends in scene.bends],
        "joints": _rounded(scene.joints, digits),
        "feet": _rounded(scene.marks.feet, digits),
        "rails": _rounded(scene.marks.rails, digits),
        "body": _rounded(scene.marks.body, digits),
        "payload": scene.payload,
        "magnify": magnify,
        "turns": None if turns is None else _significant(turns),
        "carriers": {
            "links": list(map(list, scene.bending.carriers)),
            "joints": list(map(list, _carriers_of_joints(scene))),
            "rails": list(map(list, scene.marks.carriers[:rails])),
            "arrows": [[i, 0.0] for i in scene.seats],
        },
        "arrows": _rounded(scene.arrows, digits),
        "ghost": _rounded(scene.ghost, digits),
        "path": _rounded(scene.path, digits),
        "pathTimes": _rounded(scene.path_times, 6),
        "straightPath": _rounded(scene.straight_path, digits),
        "reference": None if reference is None else _rounded(reference[0], digits),
        "goal": None if reference is None else _rounded(reference[1], digits),
        "solids": [[_rounded(side, digits) for side in solid] for solid in scene.solids],
        "histories": [
            {
                "title": signals.title,
                "label": signals.axis_label,
                "time": _rounded(signals.time, 6),
                "lines": [_significant(line) for line in signals.values.T],
                "labels": list(signals.labels),
                "colors": list(series_colors(len(signals.labels))),
            }
            for signals in scene.histories
        ],
    }


def _rounded(values: FloatArray | None, digits: int) -> FloatArray | None:
    if values is None:
        return None
    return np.ascontiguousarray(np.round(values, digits) + 0.0)  # the sum converts -0.0 to 0.0


def _significant(values: FloatArray) -> FloatArray | None:
    """Return numbers rounded to 1e-5 of the largest."""
    largest = float(np.nanmax(np.abs(values[np.isfinite(values)]), initial=0.0))
    digits = 5 - math.floor(math.log10(largest)) if largest > 0.0 else 0
    return _rounded(values, min(max(digits, -300), 300))
