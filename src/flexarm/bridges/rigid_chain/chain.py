"""Flexible links as rigid bars on virtual joints with springs.

The virtual joints of a link are at the nodes of the Gauss quadrature of its flexibility
int p(x) dx / (E I), and their flexibilities are its weights. With two joints or more, this integral
is exact for the polynomials of degree 3, so the static deflection under any force and moment at the
tip of a link is exact. Frequencies converge fast with the number of joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import InputError, Problem
from flexarm.model import Joint, Link, ModalDamping, SectionTable

#: Points of the quadrature in each interval of the table of a link.
_POINTS = 20
_UNSUPPORTED = ("friction", "limits", "rotor_inertia", "winding")


class Comparison(NamedTuple):
    """A number of the flexible arm and of its chain, with locked joints at zero angles."""

    name: str
    flexible: float
    chain: float

    @property
    def error(self) -> float:
        """Relative error of the chain."""
        return self.chain / self.flexible - 1.0


@dataclass(frozen=True, eq=False)
class RigidChain:
    """Arm of rigid links."""

    arm: Arm  # the rigid arm; the bending of links is the rotation of some of its joints
    #: For each link of the flexible arm the place of its first bar in ``arm``, from 0
    starts: tuple[int, ...]
    driven: tuple[int, ...]  # the same for its joints that are not fixed
    comparisons: tuple[Comparison, ...]  # frequencies and static flexibilities


def rigid_chain(arm: Arm, count: int) -> RigidChain:
    """Replace flexible links by rigid bars on virtual joints; InputError for friction, stops."""
    problems = [
        Problem(f"joints[{k}].{name}", "is not supported")
        for k, joint in enumerate(arm.spec.joints)
        for name in _UNSUPPORTED
        if getattr(joint, name)
    ]
    if problems:
        raise InputError(*problems)
    links: list[Link] = []
    joints: list[Joint] = []
    starts = []
    for link, joint in zip(arm.spec.links, arm.spec.joints, strict=True):
        starts.append(len(links))
        bars, springs = _bars(link, count)
        links += bars
        joints += [joint, *springs]
    spec = arm.spec.replace(links=links, joints=joints, theory="linear")
    chain = Arm(spec)
    driven = [starts[number - 1] for number in arm.joint_numbers]
    compared = _comparisons(arm, chain, driven)
    return RigidChain(chain, tuple(starts), tuple(driven), compared)


def _bars(link: Link, count: int) -> tuple[list[Link], list[Joint]]:
    """Return the bars of a link, and the virtual joints between them."""
    if not link.flexible:
        return [link], []
    beam = link.beam()
    x = np.array(beam.x, dtype=np.float64)
    places, flexibility = _quadrature(x, np.array(beam.flexural_rigidity), count)
    cuts = [0.0, *places.tolist(), link.length]
    bars = [_bar(beam, start, end) for start, end in pairwise(cuts)]
    bars[0] = bars[0].replace(hub_radius=link.hub_radius)
    springs = [Joint(stiffness=1.0 / one) for one in flexibility.tolist()]
    factor = _damping_factor(link, bars, springs)
    return bars, [Joint(stiffness=one.stiffness, damping=factor * one.stiffness) for one in springs]


def _bar(beam: SectionTable, start: float, end: float) -> Link:
    """Return the rigid part of a beam from ``start`` to ``end``, m from its root."""
    inner = [one for one in beam.x if start < one < end]
    x = np.array([start, *inner, end])
    mass = np.interp(x, beam.x, beam.mass_per_length)
    inertia = np.interp(x, beam.x, beam.rotary_inertia_per_length or np.zeros(len(beam.x)))
    table = SectionTable(
        x=(x - start).tolist(),
        mass_per_length=mass.tolist(),
        rotary_inertia_per_length=inertia.tolist(),
    )
    return Link(length=end - start, table=table, flexible=False)


def _quadrature(x: FloatArray, rigidity: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights of the Gauss quadrature with the weight function 1 / (E I).

    Golub and Welsch: eigenvalues of the matrix of the recurrence of orthogonal polynomials, which
    is computed with the weight function at many points (Stieltjes).
    """
    from scipy.linalg import eigh_tridiagonal

    points, shares = np.polynomial.legendre.leggauss(_POINTS)
    half = 0.5 * np.diff(x)[:, None]
    at = (x[:-1, None] + half * (1.0 + points)).ravel()
    weight = (half * shares).ravel() / np.interp(at, x, rigidity)
    diagonal, beside = np.zeros(count), np.zeros(count)
    before, now = np.zeros_like(at), np.full_like(at, weight.sum() ** -0.5)
    for k in range(count):
        diagonal[k] = weight @ (at * now**2)
        new = (at - diagonal[k]) * now - (beside[k - 1] * before if k else 0.0)
        beside[k] = np.sqrt(weight @ new**2)
        before, now = now, new / beside[k]
    places, vectors = eigh_tridiagonal(diagonal, beside[:-1])
    return places, vectors[0] ** 2 * weight.sum()


def _damping_factor(link: Link, bars: list[Link], springs: list[Joint]) -> float:
    """Return the damping of springs over stiffness (s): that of the first mode stays."""
    damping = link.damping
    if damping is None:
        return 0.0
    if not isinstance(damping, ModalDamping):
        return damping.stiffness_coefficient
    alone = Arm(links=bars, joints=[Joint(fixed=True), *springs])
    return 2.0 * damping.ratios(1)[0] / float(locked(alone, [])[0][0])


def locked(arm: Arm, driven: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Return frequencies (rad/s) and tip flexibility (3, 3) with locked joints, without gravity."""
    from scipy.linalg import eigh

    still = Arm(arm.spec.replace(gravity=(0.0, 0.0)))
    rest = np.zeros(arm.dof)
    moving = np.setdiff1d(np.arange(arm.dof), driven)
    kept = np.ix_(moving, moving)
    K, M = still.stiffness_matrix(rest)[kept], still.mass_matrix(rest)[kept]
    tip = np.array([still.tip_velocity(rest, unit) for unit in np.eye(arm.dof)[moving]])
    return np.sqrt(eigh(K, M)[0]), tip.T @ np.linalg.solve(K, tip)


def coordinates(chain: Arm, driven: Sequence[int]) -> list[int]:
    """Return the places in q of the joints at the roots of some bars."""
    numbers = list(chain.joint_numbers)
    return [int(chain.joint_index[numbers.index(place + 1)]) for place in driven]


def _comparisons(arm: Arm, chain: Arm, driven: list[int]) -> tuple[Comparison, ...]:
    if arm.dof == arm.joints:
        return ()
    exact, bars = locked(arm, arm.joint_index.tolist()), locked(chain, coordinates(chain, driven))
    rows = [
        Comparison("tip deflection per force, m/N", exact[1][1, 1], bars[1][1, 1]),
        Comparison("tip rotation per moment, rad/(N m)", exact[1][2, 2], bars[1][2, 2]),
    ]
    for k, pair in enumerate(zip(exact[0][:4], bars[0][:4], strict=False), 1):
        rows.append(Comparison(f"frequency {k}, Hz", *(one / (2.0 * np.pi) for one in pair)))
    return tuple(Comparison(row.name, float(row.flexible), float(row.chain)) for row in rows)


class Body(NamedTuple):
    """A rigid body on a hinge, or welded to the body before. SI units.

    Body axes: origin at the hinge, x along the bar. Inertia is about the centre of mass.
    """

    name: str
    offset: float  # of the hinge along the x axis of the body before
    angle: float  # of a welded body, rad
    length: float
    mass: float
    centre: tuple[float, float]
    inertia: float
    joint: str | None  # name of the hinge; None if it is welded
    stiffness: float
    damping: float
    rest_angle: float


def bodies(chain: RigidChain) -> list[Body]:
    """Return bars, then a payload with an offset; InputError for a body without mass or inertia."""
    arm, constants = chain.arm, chain.arm.assembly.constants
    numbers = {place: number for number, place in enumerate(chain.driven, 1)}
    link, bar, chain_bodies, offset = 0, 0, [], 0.0
    for i in range(arm.assembly.bodies):
        length, tip = float(constants.length[i]), float(constants.tip_mass[i])
        mass = float(constants.mass[i]) + tip
        x = (float(constants.first_moment_x[i]) + tip * length) / mass if mass else 0.0
        y = float(constants.first_moment_y[i]) / mass if mass else 0.0
        about_hinge = float(constants.inertia[i] + constants.tip_inertia[i]) + tip * length**2
        is_bar = i < arm.links
        free = bool(constants.free[i]) and is_bar
        if i in chain.starts:
            link, bar = link + 1, 0
        bar += 1
        name = f"link{link}_{bar}" if is_bar else "payload"
        joint = f"joint{numbers[i]}" if i in numbers else f"bending{link}_{bar - 1}"
        chain_bodies.append(
            Body(
                name,
                offset,
                0.0 if free else float(constants.joint_angle[i]),
                length,
                mass,
                (x, y),
                about_hinge - mass * (x * x + y * y),
                joint if free else None,
                float(constants.joint_stiffness[i]),
                float(constants.joint_damping[i]),
                float(constants.joint_rest[i]),
            )
        )
        offset = length
    problems = [
        Problem("arm", f"has no mass or no inertia in {body.name}")
        for body in chain_bodies
        if body.mass <= 0.0 or body.inertia <= 0.0
    ]
    if problems:
        raise InputError(*problems)
    return chain_bodies
