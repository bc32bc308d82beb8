"""Closed mechanisms with postures that close their loops: plane linkages, robots and machines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexarm.model import ArmSpec, Base, Closure, Joint, Link, Payload
from oracles.rigid_mechanisms import FourBar, SliderCrank, cross, unit


@dataclass(frozen=True)
class Closed:
    """A mechanism and the posture in which straight links close its loops.

    fields: keyword arguments of ``fa.Arm``. joints (joints,): positions of the joints that are not
    fixed, rad or m; the base is at zero.
    """

    fields: dict[str, Any]
    joints: np.ndarray

    @property
    def spec(self) -> ArmSpec:
        """Specification of the mechanism."""
        return ArmSpec(**self.fields)


def bar(length: float, **fields: Any) -> Link:
    """Return a slender link of 0.5 kg/m."""
    beam = {"flexural_rigidity": 20.0, "mass_per_length": 0.5, "elements": 2}
    return Link(length=length, **{**beam, **fields})


def two_links(root: Any, target: Any, lengths: tuple[float, float], elbow: float) -> np.ndarray:
    """Return the angles (2,) of two links, the second relative to the first, from root to target.

    elbow: 1.0 or -1.0, sign of the second angle.
    """
    a, b = lengths
    reach = np.subtract(target, root)
    bend = elbow * np.arccos((reach @ reach - a**2 - b**2) / (2 * a * b))
    ahead = np.arctan2(reach[1], reach[0])
    return np.array([ahead - np.arctan2(b * np.sin(bend), a + b * np.cos(bend)), bend])


def four_bar(crank: float = 0.7, bars: FourBar | None = None, **fields: Any) -> Closed:
    """Return crank, coupler and rocker, pinned at the tips of coupler and rocker.

    bars: lengths, ground and gravity; by default ``FOUR_BAR``. Other arguments are fields of the
    arm, or, with ``flexible``, of its links.
    """
    shape = FOUR_BAR if bars is None else bars
    flexible = fields.pop("flexible", True)
    angles = [angle.value for angle in shape.angles(crank)]
    links = [bar(length, flexible=flexible) for length in shape.lengths]
    links[2] = links[2].replace(parent=0)
    return Closed(
        {
            "links": links,
            "joints": [Joint(), Joint(), Joint(offset=(shape.ground, 0.0))],
            "closures": [Closure(link=2, to_link=3)],
            "gravity": shape.gravity,
            **fields,
        },
        np.array([angles[0], angles[1] - angles[0], angles[2]]),
    )


#: Grashof's crank-rocker of 0.5 kg/m, crank 0.3 m.
FOUR_BAR = FourBar((0.3, 0.9, 0.7), (0.15, 0.45, 0.35), ground=1.0, gravity=(0.0, -9.81))


def slider_crank(crank: float = 0.7, **fields: Any) -> Closed:
    """Return crank and connecting rod, whose tip with the slider is on a line of the ground."""
    flexible = fields.pop("flexible", True)
    theta, phi = (angle.value for angle in SLIDER_CRANK.angles(crank))
    return Closed(
        {
            "links": [bar(length, flexible=flexible) for length in SLIDER_CRANK.lengths],
            "payload": Payload(mass=SLIDER_CRANK.slider),
            "closures": [Closure(kind="line", link=2, to_offset=(0.0, SLIDER_CRANK.eccentricity))],
            "gravity": SLIDER_CRANK.gravity,
            **fields,
        },
        np.array([theta, phi - theta]),
    )


#: Slider-crank of 0.5 kg/m with an offset line.
SLIDER_CRANK = SliderCrank((0.2, 0.6), (0.1, 0.3), 0.25, 0.05, gravity=(0.0, -9.81))


def five_bar(tip: tuple[float, float] = (0.05, 0.7), **fields: Any) -> Closed:
    """Return two arms of two links on the ground, pinned at their tips."""
    lengths, roots = (0.4, 0.5), ((-0.2, 0.0), (0.2, 0.0))
    links = [bar(lengths[0]), bar(lengths[1]), bar(lengths[0], parent=0), bar(lengths[1])]
    joints = [Joint(offset=roots[0]), Joint(), Joint(offset=roots[1]), Joint()]
    posture = [two_links(roots[k], tip, lengths, (-1.0, 1.0)[k]) for k in range(2)]
    return Closed(
        {"links": links, "joints": joints, "closures": [Closure(link=2, to_link=4)], **fields},
        np.concatenate(posture),
    )


def cooperating_arms(**fields: Any) -> Closed:
    """Return two arms on a free base, welded to each other at an object."""
    lengths, roots, tip = (0.6, 0.5), ((-0.4, 0.1), (0.4, 0.1)), (0.1, 0.8)
    posture = [two_links(roots[k], tip, lengths, (-1.0, 1.0)[k]) for k in range(2)]
    ends = [angles.sum() for angles in posture]
    links = [bar(lengths[0]), bar(lengths[1]), bar(lengths[0], parent=0), bar(lengths[1])]
    return Closed(
        {
            "links": links,
            "joints": [Joint(offset=roots[0]), Joint(), Joint(offset=roots[1]), Joint()],
            "base": Base(mass=6.0, inertia=0.8, centre=(0.02, -0.05), free=("x", "y", "angle")),
            "payload": Payload(mass=0.8, inertia=0.01, offset=(0.05, 0.02)),
            "closures": [Closure(kind="weld", link=2, to_link=4, angle=ends[0] - ends[1])],
            **fields,
        },
        np.concatenate(posture),
    )


def three_rrr(
    place: tuple[float, float] = (0.03, 0.02), turned: float = 0.1, **fields: Any
) -> Closed:
    """Return a platform on three legs of two links; it is a rigid link on the first leg."""
    lengths, side = (0.4, 0.4), 0.26
    thirds = 2 * np.pi / 3 * np.arange(3) + np.pi / 6
    roots = [0.6 * unit(angle) for angle in thirds]
    corners = [np.add(place, side / 3**0.5 * unit(angle + turned)) for angle in thirds]
    legs = [two_links(roots[k], corners[k], lengths, 1.0) for k in range(3)]
    links, joints = [], []
    for root in roots:
        links += [bar(lengths[0], parent=0), bar(lengths[1])]
        joints += [Joint(offset=tuple(root.tolist())), Joint()]
    edge = corners[1] - corners[0]
    angle = np.arctan2(edge[1], edge[0])
    links.append(bar(side, parent=2, flexible=False, mass_per_length=2.0))
    third = corners[2] - corners[0]
    apex = (float(third @ edge) / side, cross(edge, third) / side)
    closures = [
        Closure(link=4, to_link=7),
        Closure(link=6, to_link=7, to_station=0.0, to_offset=apex),
    ]
    return Closed(
        {"links": links, "joints": [*joints, Joint()], "closures": closures, **fields},
        np.array([*np.concatenate(legs), angle - legs[0].sum()]),
    )


def cylinder_boom(boom: float = 0.5, **fields: Any) -> Closed:
    """Return a boom that a cylinder lifts: barrel, rod that slides in it, and a pin on the boom."""
    foot, station, rod = (0.4, -0.5), 0.6, 0.4
    pin = station * unit(boom) - foot
    length, angle = float(np.hypot(*pin)), float(np.arctan2(pin[1], pin[0]))
    links = [
        bar(1.5),
        bar(0.5, parent=0, flexible=False),
        bar(rod, parent=2, parent_station=0.0, flexible=False),
    ]
    joints = [Joint(), Joint(offset=foot), Joint(kind="prismatic")]
    return Closed(
        {
            "links": links,
            "joints": joints,
            "closures": [Closure(link=3, to_link=1, to_station=station)],
            "gravity": (0.0, -9.81),
            **fields,
        },
        np.array([boom, angle, length - rod]),
    )


def parallelograms(loops: int = 2, **fields: Any) -> Closed:
    """Return rigid four-bars in a row, of rods of 1 m and 1 kg, with upright cranks.

    The rigid benchmark of N four-bars; its energy is ``rigid_mechanisms.parallelogram_energy``.
    """
    rod = Link(length=1.0, mass_per_length=1.0, flexible=False)
    links, joints, closures, posture = [rod], [Joint()], [], [np.pi / 2]
    for k in range(loops):
        # The coupler on the crank before, and the next crank on the ground.
        before = 1 if k == 0 else 2 * k + 1
        links += [rod.replace(parent=before), rod.replace(parent=0)]
        joints += [Joint(), Joint(offset=(k + 1.0, 0.0))]
        closures.append(Closure(link=2 * k + 2, to_link=2 * k + 3))
        posture += [-np.pi / 2, np.pi / 2]
    gravity = (0.0, -9.81)
    arm = {"links": links, "joints": joints, "closures": closures, "gravity": gravity, **fields}
    return Closed(arm, np.array(posture))


#: All of them, by name; links are flexible but for rods of cylinders and parallelograms.
CLOSED = {
    function.__name__: function
    for function in (
        four_bar,
        slider_crank,
        five_bar,
        cooperating_arms,
        three_rrr,
        cylinder_boom,
        parallelograms,
    )
}
