"""Base of a rigid mechanism that follows its joints: theory page "mechanisms", (M.27).

The base follows from its equations of motion, in which joint torques do not appear:

    M_bb q_b'' = -M_bj q_j'' - h_b - D_b q_b' - K_b q_b

If nothing holds the base, its momentum is zero, and ``q_b' = -M_bb^-1 M_bj q_j'`` (Umetani and
Yoshida, IEEE Trans. Robotics and Automation 5 (1989) 303-314).
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.coordinates import coordinate_sizes
from flexarm.base.errors import InputError, Problem
from flexarm.model import Base

#: Most Newton steps to the equilibrium at the start, the last of them, in sizes, and force on the
#: base, over the weight, that is rounding.
_NEWTON_STEPS, _CLOSE, _UNBALANCED = 30, 1e-10, 1e-8


class FollowingBase:
    """Base of a rigid mechanism that follows its joints.

    Attributes:
        arm: the rigid mechanism. fixed: the same on a fixed base.
        places: (k,) indices in q of the coordinates of the base.
    """

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        self.places = np.array([base.place for base in arm.assembly.base], dtype=np.intp)
        if any(closure.to_link is None for closure in arm.spec.closures):
            rule = "connect links or the base, because the base moves"
            raise InputError(Problem("arm.closures", rule, "one with the ground"))

    @cached_property
    def fixed(self) -> Arm:
        """The mechanism on a fixed base, whose loops close in the same postures."""
        return Arm(self.arm.spec.replace(base=Base()))

    def placed(self, joints: FloatArray, base: FloatArray | float = 0.0) -> FloatArray:
        """Return coordinates or rates (dof,) of joints (joints,) and the base (k,)."""
        q = np.zeros(self.arm.dof)
        q[self.arm.joint_index], q[self.places] = joints, base
        return q

    def split(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the mass matrix of the base (k, k), and its coupling to the joints (k, joints)."""
        rows = self.arm.mass_matrix(q)[self.places]
        return rows[:, self.places], rows[:, self.arm.joint_index]

    def rates_at_rest(self, q: FloatArray, rate: FloatArray) -> FloatArray:
        """Return the rates of the base (k,) with the momentum zero, at joint rates (joints,)."""
        mass, coupling = self.split(q)
        return np.asarray(-np.linalg.solve(mass, coupling @ rate))

    def rest(self, joints: FloatArray) -> FloatArray:
        """Return the base (k,) at rest on its springs, with joints (joints,) at rest.

        Raises:
            InputError: if the base has no equilibrium there.
        """
        base, still = np.zeros(self.places.size), np.zeros(self.arm.dof)
        sizes = coordinate_sizes(self.arm)[self.places]
        for _ in range(_NEWTON_STEPS):
            q = self.placed(joints, base)
            force = self.arm.inverse_dynamics(q, still, still)[self.places]
            stiffness = self.arm.stiffness_matrix(q)[np.ix_(self.places, self.places)]
            scaled = sizes[:, None] * stiffness * sizes
            step = -sizes * (np.linalg.pinv(scaled, hermitian=True) @ (sizes * force))
            base = base + step
            if np.all(np.abs(step) <= _CLOSE * sizes):
                break
        held = np.abs(self.arm.mass_matrix(q)) @ np.full(self.arm.dof, 1.0)
        gravity = math.hypot(*self.arm.spec.gravity)
        if np.any(np.abs(force) > _UNBALANCED * gravity * held[self.places]):
            hint = "Give it springs, or choose the direction of gravity."
            raise InputError(Problem("arm.base", "has no equilibrium at the start", hint=hint))
        return base

    def accelerated_many(self, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
        """Return ``accelerated`` at T instants, (T, dof), with joints that accelerate as in qdd."""
        rows, force = self.places, self.arm.inverse_dynamics_many(q, qd, qdd)
        columns = []
        for place in rows:  # the force is linear in the accelerations
            pushed = qdd.copy()
            pushed[:, place] += 1.0
            columns.append((self.arm.inverse_dynamics_many(q, qd, pushed) - force)[:, rows])
        mass = np.stack(columns, axis=2)
        accelerations = qdd.copy()
        accelerations[:, rows] -= np.linalg.solve(mass, force[:, rows, None])[:, :, 0]
        return accelerations

    def accelerated(self, q: FloatArray, qd: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Return accelerations (dof,) of joints (joints,) and of the base that follows them."""
        qdd = self.placed(acceleration)
        force = self.arm.inverse_dynamics(q, qd, qdd)[self.places]
        qdd[self.places] = -np.linalg.solve(self.split(q)[0], force)
        return qdd
