"""Mechanisms: everything that a state determines, with closures by multipliers and dense matrices.

``MechanismOracle`` adds closures to the arm of ``lagrangian``. A closure is written as a gap
between two points of the world; differentiation of this formula gives its Jacobian ``J`` and the
velocity products ``gamma`` of its second derivative, and one dense system gives accelerations and
closure forces:

    M q'' = force - bias + J^T lambda,      J q'' + gamma = 0

The force on the first point is lambda and that on the second point -lambda, in world axes for a
pin, along the normal of a line or curve; the third entry of a weld is a moment. Momentum is the
derivative of the kinetic energy by the rate of a rigid motion of the whole mechanism.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

import flexarm as fa
from flexarm.model import Closure

from .curves import distance
from .jets import Jet, Rate, cos, sin
from .lagrangian import Energies, LagrangianOracle, Pose, constrained, place
from .load_points import load_points


@dataclass(frozen=True)
class Mechanics:
    """Everything that the oracle computes at a state; (c,) for the equations of all closures.

    mass (dof, dof); acceleration (dof,); gap (c,): m, rad for the angle of a weld; gap_jacobian
    (c, dof); gap_bias (c,): second derivative of the gap without accelerations; closure_force
    (c,): N, N m for the moment of a weld. kinetic, strain, gravity: J. momentum (3,): P_x, P_y in
    N s, and L about the world's origin in N m s. tips (links, 3): x, y (m) and angle (rad).
    """

    mass: np.ndarray
    acceleration: np.ndarray
    gap: np.ndarray
    gap_jacobian: np.ndarray
    gap_bias: np.ndarray
    closure_force: np.ndarray
    kinetic: float
    strain: float
    gravity: float
    momentum: np.ndarray
    tips: np.ndarray


def oracle_of(arm: Any, precision: type[np.floating] = np.longdouble) -> MechanismOracle:
    """Return the oracle of an arm in the coordinates of the arm: its shapes are the basis."""
    basis = [shapes.basis if shapes.w2.size else None for shapes in arm.assembly.links]
    return MechanismOracle(arm.spec, basis, precision)


class MechanismOracle(LagrangianOracle):
    """Dynamics of an arm with any base, branches, sliding joints and closures.

    ``moving`` adds loads, prescribed joints and the reactions of joints.
    """

    def at(self, q: np.ndarray, qd: np.ndarray, torque: Any) -> Mechanics:
        """Return all results under joint torques or forces (joints,), N m or N.

        Closures must be independent.
        """
        mass, bias, total = self._lagrange(q, qd)
        force = -bias
        force[self.joint_index] += torque
        jacobian, gamma = self._closures(total, qd)
        acceleration, closure_force = constrained(mass, force, jacobian, gamma)
        kinetic, strain, gravity = self.energy(q, qd)
        return Mechanics(
            mass=mass.astype(float),
            acceleration=acceleration,
            gap=np.array([gap.value.value for gap in self._gaps(total)], dtype=float),
            gap_jacobian=jacobian.astype(float),
            gap_bias=gamma.astype(float),
            closure_force=closure_force,
            kinetic=kinetic,
            strain=strain,
            gravity=gravity,
            momentum=self.momentum(q, qd),
            tips=self.tips(q),
        )

    def gaps(self, q: np.ndarray) -> np.ndarray:
        """Return the gaps of all closures, (c,): zero if they are closed."""
        return self._plain(q, lambda total: [gap.value for gap in self._gaps(total)])

    def gap_jacobian(self, q: np.ndarray) -> np.ndarray:
        """Return the derivatives of the gaps by the coordinates, (c, dof)."""
        variables = Jet.variables(np.asarray(q, dtype=float), rows=0)
        gaps = self._gaps(self._energies(Rate(variables, np.zeros(self.dof))))
        return np.array([gap.value.first for gap in gaps], dtype=float).reshape(-1, self.dof)

    def points_of(self, closure: Closure, q: np.ndarray) -> np.ndarray:
        """Return position (m) and angle of the section (rad) of both points of a closure, (2,
        3)."""
        return self._plain(q, lambda total: [flat(end) for end in self._ends(total, closure)])

    def tips(self, q: np.ndarray) -> np.ndarray:
        """Return position (m) and angle (rad) of the tip of each link, (links, 3)."""
        last = {piece.owner: k for k, piece in enumerate(self.pieces)}
        poses = self._plain(q, lambda total: [flat(total.tips[k]) for k in last.values()])
        return poses.reshape(len(last), 3)

    def momentum(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Return P_x, P_y (N s) and L about the world's origin (N m s), (3,)."""
        q, qd = (np.asarray(v, dtype=self.precision) for v in (q, qd))
        moving = Jet.variables(np.zeros(3, dtype=self.precision), rows=0)
        total = self._energies(Rate(q, qd), ground=Rate(np.zeros(3), moving))
        return total.kinetic.first.astype(float)

    def momentum_rate(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Return the derivative of the momentum by time, (3,)."""
        by_time = np.array([0.0, 0.0, 0.0, 1.0])  # after the three rates of the rigid motion
        nothing = np.zeros((self.dof, 3, 4))
        values, rates = (
            Jet(q, np.outer(qd, by_time), nothing),
            Jet(qd, np.outer(qdd, by_time), nothing),
        )
        moving = Jet(np.zeros(3), np.eye(3, 4), np.zeros((3, 3, 4)))
        total = self._energies(Rate(values, rates), ground=Rate(np.zeros(3), moving))
        return total.kinetic.second[:, 3].astype(float)

    def _plain(self, q: np.ndarray, of: Any) -> np.ndarray:
        q = np.asarray(q, dtype=float)
        return np.array(of(self._energies(Rate(q, np.zeros(self.dof)))), dtype=float)

    def _gaps(self, total: Energies) -> list[Rate]:
        """Return the gaps of all closures, one after the other."""
        gaps: list[Rate] = []
        for closure in self.spec.closures:
            first, second = self._ends(total, closure)
            dx, dy = first[0][0] - second[0][0], first[0][1] - second[0][1]
            turned = second[1] + closure.angle
            if closure.kind == "line":
                gaps += [cos(turned) * dy - sin(turned) * dx]
                continue
            if closure.kind == "curve":
                c, s = cos(turned), sin(turned)
                gaps += [distance(closure.shape, c * dx + s * dy, c * dy - s * dx)]
                continue
            gaps += [dx, dy]
            if closure.kind == "weld":
                gaps += [first[1] - turned]
        return gaps

    def _ends(self, total: Energies, closure: Closure) -> tuple[Pose, Pose]:
        """Return the two points of a closure, with the angles of their sections."""
        first = self._point(total, closure.link, closure.station, closure.offset)
        second = self._point(total, closure.to_link, closure.to_station, closure.to_offset)
        return first, second

    def _point(self, total: Energies, link: int | None, station: float | None, offset: Any) -> Pose:
        nothing = total.coordinates[0] * 0.0
        origin, angle = (nothing, nothing), nothing  # the ground
        if link == 0:
            origin, angle = total.base
        elif link is not None:
            load = fa.Load(link=link, force=(0.0, 0.0), station=station)
            here = load_points([load], self.pieces, self.bases, self.precision)[0]
            (x, y), sections = self.sections(total, here)
            origin, angle = (x[0], y[0]), sections[0]
        return place(origin, angle, *offset), angle


def flat(pose: Pose) -> list[Any]:
    """Return the position and the angle of a pose as three numbers."""
    (x, y), angle = pose
    return [x.value, y.value, angle.value]
