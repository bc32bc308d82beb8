"""Bending of links as drawn: magnified by a factor, with links that stay connected.

Most arms bend by a few millimetres, which a picture to scale does not show. A drawn arm has the
joint angles and the lengths of the arm; every angle by which bending turns a point of its axis is
multiplied by the factor, so that a link begins at the drawn tip of the one before, in the direction
of its tangent. In arms whose tips are constrained, by closures or by drawn surfaces, the ends of
links keep their places, and the factor multiplies the distance of a link from its chord.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from flexarm.arm.arm import Arm, shapes_along
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.coordinates import station_of
from flexarm.base.arguments import check_nonnegative
from flexarm.base.errors import InputError, Problem, shown

Magnify = float | Literal["auto"]
MOST_MAGNIFIED = 1e4
#: Automatic factors draw the largest deflection at this fraction of the length of its link, and the
#: largest angle of bending, which adds up along a chain, at this many rad at most.
_DRAWN, _MOST_TURNED = 0.05, 0.5
#: Deflections below this fraction of a link are errors of the integration, and not drawn larger.
_NOTHING = 1e-7


def check_magnify(value: object) -> Magnify:
    """Validate and return a factor on the bending of links, or ``"auto"``."""
    if isinstance(value, str):
        if value != "auto":
            raise InputError(Problem("magnify", "be a number or 'auto'", shown(value)))
        return "auto"
    return check_nonnegative("magnify", value, MOST_MAGNIFIED)


def nearest_round(value: float) -> float:
    """Return the nearest of 1, 2 and 5 times a power of ten."""
    steps = np.array([1.0, 2.0, 5.0, 10.0]) * 10.0 ** np.floor(np.log10(value))
    return float(f"{steps[np.argmin(np.abs(np.log(steps / value)))]:.0e}")


class Place(NamedTuple):
    """A section that carries a point of a picture."""

    link: int  # index of the link, or -1 for the ground and the base
    share: float  # distance from the root of the link as a fraction of its length


class Bending(NamedTuple):
    """Bending of the links of an arm in F frames, with S points along each link."""

    #: (F, links, S - 1) rad by which bending turns each line between points; None if the ends of
    #: links keep their places
    angle: FloatArray | None
    carriers: tuple[Place, ...]  # of the root of each link

    def links(self, points: FloatArray, factor: float) -> FloatArray:
        """Return points (F, links, S, 2) with magnified bending."""
        if factor == 1.0:
            return points
        if self.angle is None:
            share = np.linspace(0.0, 1.0, points.shape[2])[:, None]
            chord = points[:, :, :1] + share * (points[:, :, -1:] - points[:, :, :1])
            return np.asarray(chord + factor * (points - chord))
        steps = turned(np.diff(points, axis=2), (factor - 1.0) * self.angle)
        drawn = np.empty_like(points)
        for i, carrier in enumerate(self.carriers):
            root = self.carried(points, drawn, points[:, i, 0], carrier, factor)
            drawn[:, i, 0] = root
            drawn[:, i, 1:] = root[:, None] + np.cumsum(steps[:, i], axis=1)
        return drawn

    def carried(
        self,
        points: FloatArray,
        drawn: FloatArray,
        attached: FloatArray,
        carrier: Place,
        factor: float,
    ) -> FloatArray:
        """Return the drawn places of points (F, ..., 2) that a section of a link carries."""
        if carrier.link < 0:
            return attached
        middle = (slice(None), *[None] * (attached.ndim - 2))
        before, after = (point_at(each[:, carrier.link], carrier.share) for each in (points, drawn))
        away = attached - before[middle]
        if self.angle is not None:
            k, _ = segment_at(carrier.share, points.shape[2])
            away = turned(away, (factor - 1.0) * self.angle[:, carrier.link, k][middle])
        return np.asarray(after[middle] + away)

    def deflection(self, points: FloatArray) -> float:
        """Return the largest deflection as a fraction of the length of its link."""
        steps = np.diff(points, axis=2)
        lengths = np.linalg.norm(steps, axis=-1).sum(axis=2)
        if self.angle is None:
            away = self.links(points, 2.0) - points  # from the chords
            across = np.linalg.norm(away, axis=-1)
        else:
            root = np.zeros(self.angle.shape[:2])
            for i, carrier in enumerate(self.carriers):
                root[:, i] = self._turn_of(carrier)
            size = np.linalg.norm(steps, axis=-1)
            across = np.abs(np.cumsum(size * np.sin(self.angle - root[..., None]), axis=2))
        return float(np.max(across / lengths[..., None], initial=0.0))

    def _turn_of(self, carrier: Place) -> FloatArray | float:
        if carrier.link < 0 or self.angle is None:
            return 0.0
        k, _ = segment_at(carrier.share, self.angle.shape[2] + 1)
        return np.asarray(self.angle[:, carrier.link, k])


def segment_at(share: float, stations: int) -> tuple[int, float]:
    """Return the index of a line between two of the points along a link, and the place on it."""
    place = min(share, 1.0) * (stations - 1)
    k = min(int(place), stations - 2)
    return k, place - k


def point_at(points: FloatArray, share: float) -> FloatArray:
    """Return the points (F, 2) at a fraction of the length of a link (F, stations, 2)."""
    k, fraction = segment_at(share, points.shape[1])
    return np.asarray(points[:, k] + fraction * (points[:, k + 1] - points[:, k]))


def turned(vectors: FloatArray, angle: FloatArray) -> FloatArray:
    """Return vectors (..., 2) rotated by angles (...), rad."""
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.asarray(np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1))


def bending_of(arm: Arm, q: FloatArray, points: FloatArray, touches: bool = False) -> Bending:
    """Return the bending of q (F, dof) with the points (F, links, S, 2) of the links.

    ``touches`` states whether surfaces are drawn that the arm touches.
    """
    spec = arm.spec
    carriers = tuple(
        Place(parent, station_of(spec, i) / spec.links[parent].length if parent >= 0 else 0.0)
        for i, parent in enumerate(spec.parents)
    )
    if spec.closures or touches:
        return Bending(None, carriers)
    ends, steps = straight_ends(arm, q), np.diff(points, axis=2)
    away = ends[:, :, 1] - ends[:, :, 0]
    angle = np.arctan2(steps[..., 1], steps[..., 0])
    angle -= np.arctan2(away[..., 1], away[..., 0])[..., None]
    bending = Bending(angle, carriers)
    for i, carrier in enumerate(carriers):  # without jumps of 2 pi along the arm
        root = np.reshape(bending._turn_of(carrier), (-1, 1))
        first = np.remainder(angle[:, i, :1] - root + np.pi, 2.0 * np.pi) - np.pi
        beyond = np.unwrap(np.concatenate([first, angle[:, i, 1:] - root], axis=1), axis=1)
        angle[:, i] = root + beyond
    return bending


def straight_ends(arm: Arm, q: FloatArray) -> FloatArray:
    """Return the ends (F, links, 2, 2) of the links of q (F, dof) without bending."""
    straight = q.copy()
    for piece in arm.assembly.pieces:
        straight[:, piece.modal] = 0.0
    return shapes_along(arm, straight, 2)


def automatic(bendings: Sequence[tuple[Bending, FloatArray]]) -> float:
    """Return the factor for pictures of bendings with their points: 1, 2 or 5 times a power of ten.

    The largest deflection of all is drawn at about 5 % of the length of its link. Arms that bend so
    far or farther have the factor 1, as those that do not bend.
    """
    deflection = max((bending.deflection(points) for bending, points in bendings), default=0.0)
    if deflection < _NOTHING:
        return 1.0
    angles = [np.abs(each.angle).max(initial=0.0) for each, _ in bendings if each.angle is not None]
    factor = min(_DRAWN / deflection, _MOST_TURNED / max([*angles, 1e-300]))
    return min(max(nearest_round(factor), 1.0), MOST_MAGNIFIED)
