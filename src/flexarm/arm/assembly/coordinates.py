"""Coordinates q of an arm, and their conversion to and from the kernels' arrays."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property, wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.assembly.assemble import Assembly, FloatArray
from flexarm.arm.items import items_of
from flexarm.base.arguments import as_list, check_last_axes, check_posture
from flexarm.base.errors import InputError, Problem, check_array, public_call, shown
from flexarm.model import ArmSpec, Joint, Link

A = TypeVar("A", bound="Coordinates")
P = ParamSpec("P")
R = TypeVar("R")


def once_per_arm(function: Callable[Concatenate[A, P], R]) -> Callable[Concatenate[A, P], R]:
    """Keep results of a function of an arm and of hashable arguments, because arms are constant.

    Arrays are read-only.
    """

    @wraps(function)
    def call(arm: A, /, *args: P.args, **kwargs: P.kwargs) -> R:
        results: dict[Any, R] = vars(arm).setdefault("_results", {})
        key = function, args, *kwargs.items()
        if key not in results:
            result = results[key] = function(arm, *args, **kwargs)
            if isinstance(result, np.ndarray):
                result.setflags(write=False)
        return results[key]

    return call


def check_joint(arm: Coordinates, name: str, joint: object) -> int:
    """Return the index in ``joint_index`` of a joint by its number from 1, or raise InputError."""
    numbers = arm.joint_numbers.tolist()
    whole = isinstance(joint, int | np.integer) and not isinstance(joint, bool)  # 1, but not True
    if whole and joint in numbers:
        return int(numbers.index(joint))
    known = ", ".join(map(str, numbers)) or "there are none"
    rule = f"be the number of a joint that is not fixed ({known})"
    raise InputError(Problem(name, rule, shown(joint)))


def check_state(arm: Coordinates, name: str, value: Any) -> FloatArray:
    """Return q (dof,) of a value that is q, or joint angles (joints,) of straight links.

    Warns of joint angles that look like degrees.
    """
    try:
        shape = np.shape(value)
    except ValueError:  # rows of different lengths, which the checks below report
        shape = ()
    if shape == (arm.n_joints,):
        return arm.rest(check_posture(name, value, arm.n_joints, turning_joints(arm)))
    if len(shape) == 1 and shape != (arm.dof,):
        rule = f"have shape ({arm.dof},) as coordinates q, or ({arm.n_joints},) as joint angles"
        hint = (
            "fa.equilibrium returns q of bent links, arm.rest(joint_angles) that of straight ones."
        )
        raise InputError(Problem(name, rule, f"shape ({shape[0]},)", hint))
    return check_array(name, value, (arm.dof,))


@once_per_arm
def modal_size(arm: Coordinates) -> float:
    """Return the modal coordinate (m kg^0.5) that counts as much as an angle of one radian."""
    # It is the reach times the square root of the mass of the arm, so that norms of coordinates do
    # not depend on its size. An arm without mass has no modes.
    c = arm.assembly.constants
    size = float(c.length.sum()) * float(c.mass.sum() + c.tip_mass.sum()) ** 0.5
    return size or 1.0


def carriers_of(arm: Coordinates) -> list[int]:
    """Return the body whose tip section carries the joint of each body, (n,); -1: the ground."""
    return [int(parent) for parent in arm.assembly.constants.parent]


def station_of(spec: ArmSpec, link: int) -> float:
    """Return the distance (m) of the joint of a link from the root of the link that carries it."""
    length, station = spec.links[spec.parents[link]].length, spec.links[link].parent_station
    return length if station is None else min(station, length)


@once_per_arm
def turning_joints(arm: Coordinates) -> NDArray[np.bool_]:
    """Return which of the joints that are not fixed turn, (joints,); the others slide."""
    kinds = [arm.spec.joints[seat.link].kind for seat in arm.assembly.seats]
    return np.array([kind == "revolute" for kind in kinds], dtype=bool)


@once_per_arm
def coordinate_sizes(arm: Coordinates) -> FloatArray:
    """Return coordinates (dof,) of equal size: one radian, and ``modal_size`` for modes."""
    # Coordinates of joints and bases that slide have the reach.
    sizes = np.ones(arm.dof)
    bodies = arm.assembly.coordinates // (1 + arm.assembly.modes)
    sizes[arm.assembly.constants.slides[bodies] > 0.0] = arm.reach
    for piece in arm.assembly.pieces:
        sizes[piece.modal] = modal_size(arm)
    return sizes


class Coordinates:
    """Generalised coordinates q (dof,) of an arm.

    First those of a base that moves: x, y (m) and angle (rad), as far as they are free. Then for
    each link: its joint angle (rad), relative to the tangent of the section that carries the joint
    (of a serial arm the tip tangent of the previous link, the first: to world x) plus the mounting
    angle, then its modal coordinates (m sqrt(kg)). A sliding joint has a position (m) in place of
    the angle. A fixed joint has no coordinate; an elastic one has two: the motor's angle behind the
    gear, and the additional rotation of the link by the spring.
    """

    def __init__(self, spec: ArmSpec, assembly: Assembly) -> None:
        self.spec = spec
        self.assembly = assembly

    @cached_property
    def dof(self) -> int:
        """Number of coordinates: joints and modes."""
        return int(self.assembly.coordinates.size)

    @property
    def links(self) -> Sequence[Link]:
        """Links from the base outwards; ``arm.links[0]`` is that of files and messages."""
        return items_of(self.spec.links, "links", self.n_links)

    @property
    def joints(self) -> Sequence[Joint]:
        """Joints at the roots of the links, fixed ones included; indices as for `links`."""
        return items_of(self.spec.joints, "joints", self.n_joints)

    @cached_property
    def n_joints(self) -> int:
        """Number of joints that are not fixed, and so of joint angles and torques."""
        return len(self.assembly.seats)

    @property
    def n_links(self) -> int:
        """Number of links."""
        return len(self.spec.links)

    @property
    def joint_numbers(self) -> NDArray[np.intp]:
        """Numbers of the joints that are not fixed, (joints,): the links with these roots."""
        return np.array([seat.link + 1 for seat in self.assembly.seats], dtype=np.intp)

    @property
    def joint_index(self) -> NDArray[np.intp]:
        """Indices of the joint angles in q, (joints,)."""
        return self.assembly.joint_index

    @property
    def lengths(self) -> FloatArray:
        """Distances from the joints to the tips of the straight links, (links,) m."""
        return np.array([link.reach for link in self.spec.links])

    @property
    def link_lengths(self) -> FloatArray:
        """Lengths of the links from root to tip, without their hubs, (links,) m."""
        return np.array([link.length for link in self.spec.links])

    @cached_property
    def reach(self) -> float:
        """Distance from the base to the furthest tip of the straight links in line, m."""
        if self.spec.is_serial:
            return float(np.sum(self.lengths))
        ends: list[float] = []
        for i, (link, joint) in enumerate(zip(self.spec.links, self.spec.joints, strict=True)):
            parent, start = self.spec.parents[i], 0.0
            if parent >= 0:
                start = ends[parent] - self.spec.links[parent].length
                start += station_of(self.spec, i)
            ends.append(start + math.hypot(*joint.offset) + link.reach)
        return max(ends)

    @public_call
    def rest(self, joint_angles: ArrayLike, base: ArrayLike | None = None) -> FloatArray:
        """Return q (dof,) of straight links at a posture, or their rates from rates.

        Args:
            joint_angles: (joints,) relative, rad; positions of sliding joints, m.
            base: x, y (m) and angle (rad) of a base that moves; zero by default.

        Raises:
            InputError: if an argument has the wrong shape, or a coordinate of the base that is not
                free is not zero.
        """
        angles = check_array("joint_angles", joint_angles, (self.n_joints,))
        q = np.zeros(self.dof)
        q[self.joint_index] = angles
        if base is None:
            return q
        values = dict(zip(("x", "y", "angle"), check_array("base", base, (3,)), strict=True))
        for coordinate in self.assembly.base:
            q[coordinate.place] = values.pop(coordinate.name)
        for name, value in values.items():
            if value != 0.0:
                rule = f"have {name} = 0, because the base is not free to move in it"
                raise InputError(Problem("base", rule, shown(float(value))))
        return q

    @public_call
    def joint_angles(self, q: ArrayLike) -> FloatArray:
        """Return the joint angles (joints,) of q (dof,), or joint rates from rates."""
        return check_array("q", q, (self.dof,))[self.joint_index]

    @public_call
    def from_nodal(self, joint_angles: ArrayLike, nodal: Sequence[ArrayLike]) -> FloatArray:
        """Return q (dof,) of links deformed to given nodal values.

        Args:
            joint_angles: (joints,) relative, rad.
            nodal: for each link (elements, 2): deflection (m) and section rotation (rad; without
                shear, the slope) at its free nodes, from its root tangent, or from the root tangent
                of the node's segment; any value for a rigid link. With reduced modes, the result is
                the least-squares fit weighted by mass.
        """
        q = self.rest(joint_angles)
        items = list(nodal) if isinstance(nodal, np.ndarray) and nodal.ndim else as_list(nodal)
        if items is None or len(items) != self.n_links:
            rule = f"be a list of one array for each of the {self.n_links} links"
            raise InputError(Problem("nodal", rule, shown(nodal)))
        values = {
            i: check_array(f"nodal[{i}]", items[i], (count, 2))
            for i, count in enumerate(self._elements())
            if self.spec.links[i].flexible
        }
        for piece in self.assembly.pieces:
            if piece.shapes.w2.size:
                q[piece.modal] = piece.shapes.projector @ values[piece.link][piece.rows].ravel()
        return q

    @public_call
    def nodal(self, q: ArrayLike) -> list[FloatArray]:
        """Return the deflection (m) and section rotation (rad) at the free nodes of the links.

        (elements, 2) for each link; without shear the rotation is the slope.
        """
        values = check_array("q", q, (self.dof,))
        shapes = [np.zeros((count, 2)) for count in self._elements()]
        for piece in self.assembly.pieces:
            if piece.shapes.w2.size:
                bent = piece.shapes.basis @ values[piece.modal]
                shapes[piece.link][piece.rows] = bent.reshape(-1, 2)
        return shapes

    def _elements(self) -> list[int]:
        """Return the numbers of elements of the links, which have at least one in each piece."""
        return [self.assembly.pieces_of(i)[-1].rows.stop for i in range(self.n_links)]

    @public_call
    def padded(self, vector: ArrayLike) -> FloatArray:
        """Convert a vector (dof,) or vectors (..., dof) to the kernels' array (..., n, 1 + m).

        Raises:
            InputError: if the last axis does not have dof numbers.
        """
        a = self.assembly
        vector = check_last_axes("vector", vector, a.coordinates.shape)
        array = np.zeros((*vector.shape[:-1], a.bodies * (1 + a.modes)), dtype=vector.dtype)
        array[..., a.coordinates] = vector
        return array.reshape(*vector.shape[:-1], a.bodies, 1 + a.modes)

    @public_call
    def unpadded(self, array: ArrayLike) -> FloatArray:
        """Convert the kernels' array (..., n, 1 + m) to coordinates (..., dof).

        Raises:
            InputError: if the last axes do not have the shape (n, 1 + m).
        """
        a = self.assembly
        array = check_last_axes("array", array, (a.bodies, 1 + a.modes))
        flat = array.reshape(*array.shape[:-2], a.bodies * (1 + a.modes))
        taken: FloatArray = flat[..., a.coordinates]
        return taken

    @public_call
    def padded_torque(self, torque: ArrayLike) -> FloatArray:
        """Convert joint torques (..., joints) to torques of the bodies (..., n).

        Raises:
            InputError: if the last axis does not have one number for each joint.
        """
        a = self.assembly
        torque = check_last_axes("torque", torque, a.joint_body.shape)
        array = np.zeros((*torque.shape[:-1], a.bodies), dtype=torque.dtype)
        array[..., a.joint_body] = torque
        return array
