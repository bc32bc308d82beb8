"""Ground points, slides, moving bases and closures of a mechanism, as drawn; without Matplotlib."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.coordinates import station_of
from flexarm.arm.assembly.surfaces import arc_of, course_of
from flexarm.model import Surface, SurfaceTable, Wall
from flexarm.view.plot.magnified import Place, point_at, segment_at


class Marks(NamedTuple):
    """Parts of a mechanism that are not links, in F frames; m, world axes."""

    feet: FloatArray  # (k, 2) points at which the ground carries joints and closures
    #: (F, R, P, 2) ends of the travel of slides and of points on lines; curves of closures; points
    #: of closures and the axes of their links. P = 2 without curves, else the last is repeated
    rails: FloatArray
    body: FloatArray | None  # (F, points, 2) line through a moving base and its joints
    pins: FloatArray  # (F, c, 2) first points of closures
    carriers: tuple[Place, ...]  # (R + c,) that carry rails and pins


_GROUND = Place(-1, 0.0)


class _Pose(NamedTuple):
    """Position (F, 2) and unit tangent (F, 2)."""

    at: FloatArray
    along: FloatArray

    def point(self, x: float, y: float) -> FloatArray:
        """Return a point (F, 2) at x and y in the axes of the pose."""
        return self.at + x * self.along + y * _turned(self.along)

    def direction(self, angle: float) -> FloatArray:
        """Return the unit vector (F, 2) at an angle (rad)."""
        return np.asarray(np.cos(angle) * self.along + np.sin(angle) * _turned(self.along))


def _turned(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1))


def marks_of(arm: Arm, q: FloatArray, shapes: FloatArray) -> Marks:
    """Return the marks of q (F, dof) with the drawn links (F, links, stations, 2)."""
    spec, frames = arm.spec, len(q)
    base = _base(arm, q)
    ground = _Pose(np.zeros((frames, 2)), np.tile([1.0, 0.0], (frames, 1)))
    feet, rails, pins, body = [], [], [], [base.at]
    on_rails, on_pins = [], []
    for i, (joint, parent) in enumerate(zip(spec.joints, spec.parents, strict=True)):
        carrier, at = base, _GROUND
        if parent >= 0:
            at = _section(arm, parent, station_of(spec, i))
            carrier = _on(shapes, at)
        place = carrier.point(*joint.offset)
        if parent < 0:
            body += [place, base.at]
            if not spec.base.free:
                feet.append(place[0])
        if joint.kind == "prismatic" and not joint.fixed:
            x, y = joint.axis or (1.0, 0.0)
            axis = carrier.direction(float(np.arctan2(y, x)))
            rails.append(_rail(place, axis, shapes[:, i, 0]))
            on_rails.append(at)
    for closure in spec.closures:
        at, to = _section(arm, closure.link - 1, closure.station), _GROUND
        section = _on(shapes, at)
        first = section.point(*closure.offset)
        pins.append(first)
        rails.append(np.stack([section.at, first], axis=1))
        second = base if closure.to_link == 0 else ground
        if closure.to_link:
            to = _section(arm, closure.to_link - 1, closure.to_station)
            second = _on(shapes, to)
        place = second.point(*closure.to_offset)
        if closure.to_link:
            rails.append(np.stack([second.at, place], axis=1))
        if closure.kind == "line":
            rails.append(_rail(place, second.direction(closure.angle), first))
        elif closure.shape:
            axes = _Pose(place, second.direction(closure.angle))
            rails.append(_curve(closure.shape, axes, first, arm.reach))
        elif closure.to_link is None or not (closure.to_link or spec.base.free):
            feet.append(place[0])
        on_pins.append(at)
        guided = closure.kind == "line" or closure.shape is not None
        on_rails += [at, *[to] * (bool(closure.to_link) + guided)]
    most = max((rail.shape[1] for rail in rails), default=2)
    rails = [np.pad(r, ((0, 0), (0, most - r.shape[1]), (0, 0)), mode="edge") for r in rails]
    return Marks(
        feet=np.unique(np.array(feet).reshape(-1, 2), axis=0),
        rails=np.array(rails).reshape(-1, frames, most, 2).swapaxes(0, 1),
        body=np.stack(body, axis=1) if spec.base.free else None,
        pins=np.array(pins).reshape(-1, frames, 2).swapaxes(0, 1),
        carriers=(*on_rails, *on_pins),
    )


def _base(arm: Arm, q: FloatArray) -> _Pose:
    """Return the origin and the x axis of the base."""
    values = {"x": 0.0 * q[:, 0], "y": 0.0 * q[:, 0], "angle": 0.0 * q[:, 0]}
    values |= {item.name: q[:, item.place] for item in arm.assembly.base}
    angle = values["angle"]
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return _Pose(np.stack([values["x"], values["y"]], axis=1), along)


def _section(arm: Arm, link: int, station: float | None) -> Place:
    """Return the section of a link at a distance (m) from its root, by default at its tip."""
    return Place(link, 1.0 if station is None else station / arm.spec.links[link].length)


def _on(shapes: FloatArray, place: Place) -> _Pose:
    """Return the pose of a section of a link."""
    points = shapes[:, place.link]
    k, _ = segment_at(place.share, points.shape[1])
    step = points[:, k + 1] - points[:, k]
    length = np.linalg.norm(step, axis=1, keepdims=True)
    return _Pose(point_at(points, place.share), step / np.maximum(length, 1e-300))


#: Points of a drawn curve.
_POINTS = 61


def _curve(curve: Surface, axes: _Pose, first: FloatArray, reach: float) -> FloatArray:
    """Return the points (F, P, 2) of a curve in moving axes, near the points (F, 2) on it."""
    if isinstance(curve, Wall):
        _, point, normal = arc_of(curve)
        return _rail(axes.point(*point), axes.direction(np.arctan2(-normal[0], normal[1])), first)
    if isinstance(curve, SurfaceTable):
        x, y = course_of(curve, 0.0, _POINTS).T
    else:
        away = first - axes.point(*curve.center)
        across = np.sum(away * _turned(axes.along), axis=1)
        angles = np.unwrap(np.arctan2(across, np.sum(away * axes.along, axis=1)))
        half = min(np.pi, 0.5 * float(np.ptp(angles)) + reach / curve.radius)
        middle = 0.5 * float(angles.min() + angles.max())
        angle = np.linspace(middle - half, middle + half, _POINTS)
        x = curve.center[0] + curve.radius * np.cos(angle)
        y = curve.center[1] + curve.radius * np.sin(angle)
    along, across = axes.along[:, None], _turned(axes.along)[:, None]
    return np.asarray(axes.at[:, None] + x[:, None] * along + y[:, None] * across)


def _rail(place: FloatArray, axis: FloatArray, moving: FloatArray) -> FloatArray:
    """Return the ends (F, 2, 2) of the travel of a moving point on an axis through a place."""
    travel = np.sum((moving - place) * axis, axis=1)
    ends = np.array([min(travel.min(), 0.0), max(travel.max(), 0.0)])
    return place[:, None] + ends[:, None] * axis[:, None]
