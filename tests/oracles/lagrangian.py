"""The arm written literally: material points, their energies, Lagrange's equations.

Nothing is expanded or simplified by hand. ``_energies`` walks outward along the arm, places every
material point in the world and adds up kinetic, strain and gravity energy; number types that
differentiate (``jets``) do the rest. No symbol of the package's recursion appears.

World axes: x right, y up, origin of the base at the origin. Coordinates: x, y (m) and angle (rad)
of the base, those that are free. Then, in this order for each link: the relative joint angle (rad)
or position (m) unless the joint is fixed, of an elastic joint the motor's and then the twist of the
spring; then its nodal coordinates [v_2, phi_2, v_3, phi_3, ...] (m, rad); those of a link in parts
one part after the other, each from its own root tangent.

For loads, moving bases and reactions every joint may also be *released*: two more coordinates each,
world x and y of the joint from the section that carries it. They are constrained to zero (the first
moves with the base), and the constraint force is the joint's reaction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg

from .chain import Piece, Seat, cut
from .jets import Jet, Rate, cos, sin, sqrt
from .joint_laws import back_electromotive, joint_energy, joint_loss
from .load_points import LoadPoints, load_points
from .material_points import MaterialPoints, material_points

#: Names of the coordinates of a base, in their order.
BASE = ("x", "y", "angle")

#: World position (m) and angle (rad) of a section.
Pose = tuple[tuple[Rate, Rate], Rate]


@dataclass
class Energies:
    """Energies in J and poses: of the base, of the root and the tip of every piece.

    coordinates: those of the state, with their rates.
    """

    base: Pose
    kinetic: Any = 0.0
    strain: Any = 0.0
    gravity: Any = 0.0
    roots: list[Pose] = field(default_factory=list)
    tips: list[Pose] = field(default_factory=list)
    coordinates: Any = None

    @property
    def tip(self) -> tuple[Rate, Rate, Rate]:
        """Position x, y (m) and angle (rad) of the last tip."""
        (x, y), angle = self.tips[-1]
        return x, y, angle

    def section(self, seat: Seat) -> Pose:
        """Return the pose of the section that carries the root of a piece."""
        if seat.piece is None:
            return self.base
        return (self.roots if seat.at_root else self.tips)[seat.piece]


class Moving(NamedTuple):
    """Accelerations (dof,), motor torques (joints,) N m, forces of the joints on their outboard
    links (links, 2), world axes, N, and of closures (c,), N and N m."""

    acceleration: np.ndarray
    torque: np.ndarray
    joint_force: np.ndarray
    closure_force: np.ndarray


def half(weight: Any, speed: Any) -> Any:
    """Return ``1/2 sum(weight * speed^2)`` for a single point or for an array of points."""
    return weight @ (speed * speed) * 0.5 if np.ndim(weight) else speed * speed * (0.5 * weight)


class LagrangianOracle:
    """Dynamics of an arm from its energies.

    spec: the arm's specification. basis: for each link, or part of one, None (nodal coordinates) or
    the shapes of a reduced model, (2 * elements, m); the coordinates are then the factors of those
    shapes, and the elements of a part those of its shapes.
    precision: number type of the arithmetic inside; results are float64. Mass matrices of serial
    arms have condition numbers up to 1e6, so that accelerations computed from float64 entries are
    good to 1e-10 only: extended numbers keep the oracle out of the error of a comparison, and
    ``np.float64`` is ten times as fast.
    """

    def __init__(
        self,
        spec: Any,
        basis: list[np.ndarray | None] | None = None,
        precision: type[np.floating] = np.longdouble,
    ) -> None:
        self.spec = spec
        self.precision = precision
        pieces = cut(spec)
        self.bases = basis if basis is not None else [None] * len(pieces)
        self.pieces = [
            piece if shapes is None else piece.meshed(len(shapes) // 2)
            for piece, shapes in zip(pieces, self.bases, strict=True)
        ]
        self.points = [
            material_points(piece.link, shapes, precision)
            for piece, shapes in zip(self.pieces, self.bases, strict=True)
        ]
        sizes = [points.deflection.shape[1] for points in self.points]
        jointed = [joint_coordinates(piece.joint) for piece in self.pieces]
        self.base_index = {name: i for i, name in enumerate(n for n in BASE if n in spec.base.free)}
        starts = np.concatenate([[0], np.cumsum(np.add(jointed, sizes))]).astype(int)
        starts += len(self.base_index)
        self.dof = int(starts[-1])
        # By link: index of its joint angle, and of the twist of its spring, or again the first.
        owners = [piece.owner for piece in self.pieces]
        self.angle_of = {i: int(s) for i, s, j in zip(owners, starts, jointed, strict=False) if j}
        self.spring_of = {i: at + spec.joints[i].elastic for i, at in self.angle_of.items()}
        self.joint_index = np.array(list(self.angle_of.values()), dtype=int)
        self.shape_slice = [
            slice(int(i) + jump, int(j))
            for (i, j), jump in zip(pairwise(starts), jointed, strict=True)
        ]
        self.stiffness = self._linkwise([p.stiffness_matrix for p in self.points])
        self.damping = self._linkwise(
            [
                damping_matrix(piece.link, p)
                for piece, p in zip(self.pieces, self.points, strict=True)
            ]
        )
        for name, at in self.base_index.items():
            self.damping[at, at] = spec.base.damping[BASE.index(name)]
        for i, at in self.spring_of.items():
            self.damping[at, at] = spec.joints[i].damping
        for i, at in self.angle_of.items():
            self.damping[at, at] += back_electromotive(spec.joints[i])

    def _linkwise(self, blocks: list[np.ndarray]) -> np.ndarray:
        matrix = np.zeros((self.dof, self.dof))
        for where, block in zip(self.shape_slice, blocks, strict=True):
            matrix[where, where] = block
        return matrix

    def coordinates(self, angles: Any, shapes: Any) -> np.ndarray:
        """Join joint angles (n,) and coordinates of each link, such as (elements, 2), to q."""
        q = np.zeros(self.dof)
        q[self.joint_index] = angles
        owners = [piece.owner for piece in self.pieces]
        for where, piece in zip(self.shape_slice, self.pieces, strict=True):
            if where.stop > where.start:
                shape = np.asarray(shapes[piece.owner])
                whole = owners.count(piece.owner) == 1
                q[where] = np.ravel(shape if whole else shape[piece.rows])
        return q

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """Return the generalised mass matrix, (dof, dof), symmetric."""
        return self._lagrange(q, np.zeros(self.dof))[0].astype(float)

    def bias_force(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Return the force in ``M qdd + bias = force``, (dof,), with stiffness and damping."""
        return self._lagrange(q, qd)[1].astype(float)

    def acceleration(
        self, q: np.ndarray, qd: np.ndarray, torque: Any, tip_force: Any = None
    ) -> np.ndarray:
        """Return qdd (dof,) under joint torques (n,) in N m and a tip load (Fx, Fy) or (Fx, Fy,
        Mz)."""
        mass, bias, total = self._lagrange(q, qd)
        force = -bias
        force[self.joint_index] += torque
        if tip_force is not None:
            jacobian = np.array([pose.value.first[self.dof :] for pose in total.tip])
            force += np.asarray(tip_force) @ jacobian[: len(tip_force)]
        return constrained(mass, force, *self._closures(total, qd))[0]

    def moving(
        self,
        q: np.ndarray,
        qd: np.ndarray,
        torque: Any,
        *,
        loads: Sequence[Any] = (),
        base_velocity: Any = (0.0, 0.0),
        base_acceleration: Any = (0.0, 0.0),
        given: Mapping[int, float] | None = None,
    ) -> Moving:
        """Return the motion under loads, on a moving base, with prescribed joints.

        torque: (joints,) N m, ignored for the joints that ``given`` (by number of the link)
        assigns an acceleration, rad/s^2. The base moves the joints on it; closures with it and with
        the ground have another meaning then.
        """
        n, k = self.dof, 2 * len(self.spec.links)
        released = np.zeros((2, k))  # velocities and accelerations
        for piece in self.pieces:
            if piece.joint is not None and piece.seat.piece is None:
                at = 2 * piece.owner
                released[:, at : at + 2] = base_velocity, base_acceleration
        rates = np.append(qd, released[0])
        mass, bias, total = self._lagrange(np.append(q, np.zeros(k)), rates)
        force = self._load_force(total, loads, n + k) - bias
        motor = np.array(torque, dtype=float)
        qdd = np.append(np.zeros(n), released[1])
        free = np.ones(n + k, dtype=bool)
        free[n:] = False
        for joint, acceleration in (given or {}).items():
            free[self.angle_of[joint - 1]] = False
            qdd[self.angle_of[joint - 1]] = acceleration
            motor[list(self.angle_of).index(joint - 1)] = 0.0
        force[self.joint_index] += motor
        jacobian, gamma = self._closures(total, rates)
        part = np.ix_(free, free)
        qdd[free], closure_force = constrained(
            mass[part],
            force[free] - mass[np.ix_(free, ~free)] @ qdd[~free],
            jacobian[:, free],
            gamma + jacobian[:, ~free] @ qdd[~free],
        )
        missing = mass @ qdd - force - closure_force @ jacobian  # forces of the constraints
        for joint in given or {}:
            place_in_q = self.angle_of[joint - 1]
            motor[list(self.angle_of).index(joint - 1)] = float(missing[place_in_q])
        reactions = missing[n:].astype(float).reshape(-1, 2)
        return Moving(qdd[:n], motor, reactions, closure_force)

    def _closures(self, total: Energies, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return Jacobian (c, n) and velocity products (c,) of closures for rates (n,); ``total``
        has derivatives."""
        gaps = self._gaps(total)
        derivatives = [gap.rate.first for gap in gaps]  # by rates, then by coordinates
        by_state = np.array(derivatives, dtype=self.precision).reshape(len(gaps), 2 * len(rates))
        return by_state[:, : len(rates)], by_state[:, len(rates) :] @ rates

    def _gaps(self, total: Energies) -> list[Rate]:
        """Return the gaps of all closures; see ``mechanisms``."""
        return []

    def _load_force(self, total: Energies, loads: Sequence[Any], size: int) -> np.ndarray:
        """Return the generalised force (size,) of loads on the coordinates, with those of released
        joints."""
        force = np.zeros(size, dtype=self.precision)
        own = slice(size, 2 * size)  # derivatives by coordinates follow those by rates
        for load in load_points(loads, self.pieces, self.bases, self.precision):
            at, section = self.sections(total, load)
            force += load.generalised_force(at, section, total.roots[load.piece][1], own)
        return force

    def sections(self, total: Energies, points: LoadPoints) -> Pose:
        """Return world positions (k,) and angles (k,) of the sections at points of a piece."""
        root, frame = total.roots[points.piece]
        shape = total.coordinates[self.shape_slice[points.piece]]
        x = points.x
        if self.spec.theory == "second_order":
            slope = points.inner_slope @ shape
            x = points.running @ (slope * slope) * -0.5 + x
        return place(root, frame, x, points.deflection @ shape), frame + points.slope @ shape

    def energy(self, q: np.ndarray, qd: np.ndarray) -> tuple[float, float, float]:
        """Return kinetic, strain and gravity energy (zero for mass at the origin) in J."""
        total = self._energies(Rate(np.asarray(q, dtype=float), np.asarray(qd, dtype=float)))
        return float(total.kinetic), float(total.strain), float(total.gravity)

    def power(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> float:
        """Return the time derivative of the total energy (W) at this acceleration."""
        zero = np.zeros((self.dof, 1, 1))
        rates = Rate(Jet(q, qd[:, None], zero), Jet(qd, qdd[:, None], zero))
        total = self._energies(rates)
        return float((total.kinetic + total.strain + total.gravity).first[0])

    def tip(self, q: np.ndarray) -> tuple[float, float, float]:
        """Return world position (m) and absolute angle (rad) of the tip section."""
        x, y, angle = self._energies(Rate(np.asarray(q, dtype=float), np.zeros(self.dof))).tip
        return float(x.value), float(y.value), float(angle.value)

    def _lagrange(self, q: np.ndarray, qd: np.ndarray) -> tuple[np.ndarray, np.ndarray, Energies]:
        """Mass matrix and bias force of all coordinates in ``q``, and the energies.

        d/dt dT/dqd - dT/dq + dU/dq = Q, with d/dt dT/dqd = T_{qd qd} qdd + T_{qd q} qd.
        """
        n = len(q)
        variables = Jet.variables(np.concatenate([qd, q]).astype(self.precision), rows=n)
        total = self._energies(Rate(value=variables[n:], rate=variables[:n]))
        kinetic, potential = total.kinetic, total.strain + total.gravity
        mass = kinetic.second[:, :n]
        bias = kinetic.second[:, n:] @ qd - kinetic.first[n:] + potential.first[n:]
        bias[: self.dof] += self.damping @ qd[: self.dof]
        for i, at in self.angle_of.items():
            bias[at] -= joint_loss(self.spec.joints[i], q[at], qd[at])
        return mass, bias, total

    def _energies(self, q: Rate, ground: Rate | None = None) -> Energies:
        """Walk outward and add up. ``q`` holds the coordinates and their rates.

        ground (3,): x, y and angle of the axes that ``q`` refers to; by default those of the world.
        """
        spec = self.spec
        total = Energies(self._base_pose(q, ground), coordinates=q)
        self._base(total)
        released = np.shape(getattr(q.value, "value", q.value))[0] > self.dof
        for i, (piece, points) in enumerate(zip(self.pieces, self.points, strict=True)):
            origin, angle = total.section(piece.seat)
            if piece.joint is not None:
                if piece.seat.piece is not None or self.base_index:
                    self._point_mass(total, piece.joint.mass, origin)
                    total.kinetic += half(piece.joint.housing_inertia, angle.rate)
                if released:
                    at = self.dof + 2 * piece.owner
                    origin = (origin[0] + q[at], origin[1] + q[at + 1])
                origin, angle = self._beyond_joint(total, piece, (origin, angle), q)
                total.kinetic += half(piece.joint.hub_inertia, angle.rate)
            origin = place(origin, angle, piece.hub_radius, 0.0)
            total.roots.append((origin, angle))
            shape = q[self.shape_slice[i]]
            self._link(total, points, origin, angle, shape)

            tip_x: Any = piece.link.length
            if spec.theory == "second_order":
                tip_x = foreshortening(points.whole, points, shape) + tip_x
            origin = place(origin, angle, tip_x, points.tip_deflection @ shape)
            total.tips.append((origin, angle + points.tip_slope @ shape))

        payload, (origin, angle) = spec.payload, total.tips[-1]
        ahead, aside = payload.offset if np.ndim(payload.offset) else (payload.offset, 0.0)
        self._point_mass(total, payload.mass, place(origin, angle, ahead, aside))
        total.kinetic += half(payload.inertia, angle.rate)
        return total

    def _base_pose(self, q: Rate, ground: Rate | None) -> Pose:
        """Return the pose of the base; coordinates that are not free are zero."""
        at = self.base_index
        x, y, angle = (q[at[name]] if name in at else q[0] * 0.0 for name in BASE)
        if ground is None:
            return (x, y), angle
        return place((ground[0], ground[1]), ground[2], x, y), ground[2] + angle

    def _base(self, total: Energies) -> None:
        """Add the energies of a base that moves, and of its springs to the ground."""
        base, (origin, angle) = self.spec.base, total.base
        if not self.base_index:
            return
        self._point_mass(total, base.mass, place(origin, angle, *base.centre))
        total.kinetic += half(base.inertia, angle.rate)
        for name, at in self.base_index.items():
            total.strain += half(base.stiffness[BASE.index(name)], total.coordinates[at].value)

    def _beyond_joint(self, total: Energies, piece: Piece, section: Pose, q: Rate) -> Pose:
        """Add the energies of a joint's rotor and springs; return the pose beyond it.

        section: the one that carries the joint.
        """
        joint, (origin, angle) = piece.joint, section
        assert joint is not None
        moved: Any = joint.rest_angle
        if not joint.fixed:
            motor = q[self.angle_of[piece.owner]]
            rotor = angle.rate + motor.rate * joint.gear_ratio
            total.kinetic += half(joint.rotor_inertia, rotor)
            twist = q[self.spring_of[piece.owner]]
            total.strain += joint_energy(joint, motor.value, twist.value)
            moved = motor + twist if joint.elastic else motor
        x, y = joint.offset
        if joint.kind == "prismatic":
            along, across = np.divide(joint.axis, np.hypot(*joint.axis))
            origin = place(origin, angle, moved * along + x, moved * across + y)
            return origin, angle + joint.mounting_angle
        if x or y:
            origin = place(origin, angle, x, y)
        return origin, angle + joint.mounting_angle + moved

    def _point_mass(self, total: Energies, mass: Any, at: tuple[Rate, Rate]) -> None:
        """Add a mass in kg at a world position, or masses (k,) at positions (k,)."""
        total.kinetic += half(mass, at[0].rate) + half(mass, at[1].rate)
        total.gravity += self._gravity(mass, at)

    def _gravity(self, mass: Any, at: tuple[Rate, Rate]) -> Any:
        gx, gy = self.spec.gravity
        height = at[0].value * -gx + at[1].value * -gy
        return mass @ height if np.ndim(mass) else mass * height

    def _link(
        self,
        total: Energies,
        points: MaterialPoints,
        origin: tuple[Rate, Rate],
        angle: Rate,
        shape: Rate,
    ) -> None:
        """Add one link whose root sits at ``origin`` with its tangent at ``angle``."""
        v = points.deflection @ shape
        bend = points.curvature @ shape.value
        total.strain += half(points.rigidity, bend)
        turn = points.slope @ shape.rate
        if self.spec.theory == "linear":
            total.kinetic += half(points.rotary, angle.rate + turn)
            self._point_mass(total, points.mass, place(origin, angle, points.x, v))
            return
        u = foreshortening(points.running, points, shape)
        total.kinetic += truncated_kinetic(points, origin, angle, u, v, turn)
        total.gravity += self._gravity(points.mass, place(origin, angle, u + points.x, v))


def joint_coordinates(joint: Any) -> int:
    """Return the number of coordinates of the joint at a root; None: a rigid connection."""
    return 0 if joint is None or joint.fixed else 1 + joint.elastic


def solved(mass: np.ndarray, force: np.ndarray, scale: np.ndarray | None = None) -> np.ndarray:
    """Return ``mass^-1 force`` to the precision of the two, as float64."""
    # Unit diagonal: otherwise metres and radians would determine the scale of the rounding.
    scale = 1 / np.sqrt(abs(np.diag(mass))) if scale is None else scale
    scaled, force = (scale[:, None] * mass * scale).astype(float), scale * force
    solution = np.linalg.solve(scaled, force.astype(float))
    for _ in range(2):  # iterative refinement: reaches the precision of `mass`, not of the solver
        residual = force - scale[:, None] * mass * scale @ solution
        solution = solution + np.linalg.solve(scaled, residual.astype(float))
    return (scale * solution).astype(float)


def constrained(
    mass: np.ndarray, force: np.ndarray, jacobian: np.ndarray, gamma: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Solve M a = force + J^T lambda, J a = -gamma for a (n,) and lambda (c,), as float64."""
    if not len(jacobian):
        return solved(mass, force), np.zeros(0)
    nothing = np.zeros((len(gamma), len(gamma)), dtype=mass.dtype)
    matrix = np.block([[mass, -jacobian.T], [jacobian, nothing]])
    # Unit diagonal of M and unit rows of J, which the solution does not depend on.
    units = 1 / np.sqrt(np.diag(mass))
    rows = 1 / np.linalg.norm((jacobian * units).astype(float), axis=1)
    solution = solved(matrix, np.concatenate([force, -gamma]), np.concatenate([units, rows]))
    return solution[: len(mass)], solution[len(mass) :]


def place(origin: tuple[Rate, Rate], angle: Rate, x: Any, y: Any) -> tuple[Rate, Rate]:
    """Return the world position of a point at (x, y) in axes at ``origin``, turned by ``angle``."""
    c, s = cos(angle), sin(angle)
    return origin[0] + c * x - s * y, origin[1] + s * x + c * y


def foreshortening(weights: np.ndarray, points: MaterialPoints, shape: Rate) -> Rate:
    """Return the displacement towards the root in an inextensible link: ``u = -1/2 int v'^2``."""
    slope = points.inner_slope @ shape
    return weights @ (slope * slope) * -0.5


def truncated_kinetic(
    points: MaterialPoints, origin: tuple[Rate, Rate], angle: Rate, u: Rate, v: Rate, turn: Any
) -> Any:
    """Kinetic energy of a link, right to second order in v and its rate (u is of second order).

    In body axes, for given velocity (vx, vy) of the root and rate w, a point has the velocity
    (vx + u_dot - w v, vy + w (x + u) + v_dot); sections turn at the rate w + turn. Here rigid
    motions stand for the shortening: its mean in place of u_dot, and a translation and a rotation
    in place of u in w u. These two are such that a link that turns and does not bend has the
    momentum and the energy that belong to the integrals of u and x u; the energy by a polynomial
    that is positive, 1 + y + y^4 / 8 for 1 + y.
    """
    x, w, mass, rotary = points.x, angle.rate, points.mass, points.rotary
    c, s = cos(angle.value), sin(angle.value)
    vx = c * origin[0].rate + s * origin[1].rate
    vy = c * origin[1].rate - s * origin[0].rate
    whole, moment = mass.sum(), mass @ x
    turned = w
    if whole:
        center = moment / whole
        drawn = mass @ u.value
        central = mass @ (x - center) ** 2 + rotary.sum()
        about_center = (mass * (x - center)) @ u.value * 2.0 - drawn * drawn * (1 / whole)
        y = about_center * (1 / central)
        squared = y * y
        turned = w * sqrt(y + squared * squared * 0.125 + 1.0)
        # At the centre of mass: its velocity by the mean of u.
        vy = vy + w * (drawn * (1 / whole) + center) - turned * center
        vx = vx + mass @ u.rate * (1 / whole)
    along, across = vx - w * v.value, vy + turned * x + v.rate
    return half(mass, along) + half(mass, across) + half(rotary, turned + turn)


def damping_matrix(link: Any, points: MaterialPoints) -> np.ndarray:
    """Damping of a link's own coordinates, (m, m), N s/m and the like; zero without damping.

    Rayleigh: a multiple of mass plus a multiple of stiffness. Modal: a ratio for each vibration
    mode of the link clamped at its root and free at its tip, lowest frequency first; the last
    ratio given holds for all modes above.
    """
    mass, stiffness, damping = points.mass_matrix, points.stiffness_matrix, link.damping
    if damping is None or mass.size == 0:
        return np.zeros_like(mass)
    if damping.kind == "rayleigh":
        return damping.mass_coefficient * mass + damping.stiffness_coefficient * stiffness
    squares, modes = scipy.linalg.eigh(stiffness, mass)
    given = np.atleast_1d(damping.ratio)
    ratios = given[np.minimum(np.arange(len(squares)), len(given) - 1)]
    momenta = mass @ modes
    return momenta @ np.diag(2 * ratios * np.sqrt(squares)) @ momenta.T
