"""The equations of motion of an arm: thin methods over the kernels.

They check shapes, place coordinates and take them back.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexarm.assemble import FloatArray, assemble
from flexarm.contacts import Contact, place_outside
from flexarm.coordinates import Coordinates
from flexarm.errors import check_array, check_result
from flexarm.kernels.articulated_body import forward_dynamics
from flexarm.kernels.composite_body import mass_matrix
from flexarm.kernels.layout import Workspace, new_workspace, no_loads, run_time_sizes
from flexarm.kernels.newton_euler import inverse_dynamics, inverse_dynamics_many
from flexarm.kernels.sensitivity import forward_jacobian, potential_hessian
from flexarm.loads import Load, acting_loads
from flexarm.model import ArmSpec


class Derivatives(NamedTuple):
    """Jacobians of the accelerations, exact to rounding."""

    q: FloatArray  # (dof, dof)
    qd: FloatArray  # (dof, dof)
    torque: FloatArray  # (dof, joints)


class Dynamics(Coordinates):
    """Accelerations, forces and matrices of an arm."""

    def __init__(self, spec: ArmSpec) -> None:
        super().__init__(spec, assemble(spec))
        self._sizes = run_time_sizes(self.assembly.constants)

    def _state(self, where: str, q: ArrayLike, qd: ArrayLike | None) -> FloatArray:
        coordinates = check_array(where, "q", q, (self.dof,))
        rates = np.zeros(self.dof) if qd is None else check_array(where, "qd", qd, (self.dof,))
        return self.padded(np.stack([coordinates, rates]))

    def _work(self, dtype: Any = np.float64) -> Workspace:
        return new_workspace(self.assembly.constants, dtype)

    def forward_dynamics(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        torque: ArrayLike,
        tip_force: ArrayLike | None = None,
        loads: Sequence[Load] = (),
        base_acceleration: ArrayLike | None = None,
        contacts: Sequence[Contact] = (),
    ) -> FloatArray:
        """Return the accelerations qdd (dof,) under joint torques.

        Args:
            q, qd: (dof,) coordinates and rates.
            torque: (joints,) N m, acting on each link and back on the tip of the one before.
            tip_force: (Fx, Fy) or (Fx, Fy, Mz) on the last tip, world axes, N and N m.
            loads: further forces and moments; factors of time are left aside.
            base_acceleration: (ax, ay) of the base joint, world axes, m/s^2.
            contacts: surfaces that points of the arm may touch.

        Raises:
            InputError: wrong shape, NaN or infinity.

        Theory page "recursion", (R.4) to (R.14): O(links x modes), no matrix is formed.
        """
        where = "Arm.forward_dynamics"
        state = self._state(where, q, qd)
        tau = self.padded_torque(check_array(where, "torque", torque, (self.joints,)))
        work = self._work()
        acting = acting_loads(self, where, tip_force, loads)
        placed = place_outside(self, where, acting, base_acceleration, contacts)
        forward_dynamics(self._sizes, self.assembly.constants, state, tau, placed, work)
        return check_result(where, self.unpadded(work.acceleration), q, qd, torque)

    def inverse_dynamics(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        tip_force: ArrayLike | None = None,
        loads: Sequence[Load] = (),
        base_acceleration: ArrayLike | None = None,
        contacts: Sequence[Contact] = (),
    ) -> FloatArray:
        """Return the generalised force (dof,) that a motion takes: M qdd + bias.

        Its entries at ``joint_index`` are joint torques (N m). Arguments as in
        ``forward_dynamics``; theory page "recursion", (R.15) to (R.17).
        """
        return self.unpadded(
            self._newton_euler(
                "Arm.inverse_dynamics", q, qd, qdd, tip_force, loads, base_acceleration, contacts
            ).force
        )

    def inverse_dynamics_many(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> FloatArray:
        """Return generalised forces for many states at once: arrays (samples, dof)."""
        where = "Arm.inverse_dynamics_many"
        coordinates = check_array(where, "q", q, (-1, self.dof))
        shape = coordinates.shape
        rates = check_array(where, "qd", qd, shape)
        accelerations = self.padded(check_array(where, "qdd", qdd, shape))
        states = self.padded(np.stack([coordinates, rates], axis=1))
        forces = np.empty_like(accelerations)
        inverse_dynamics_many(
            self._sizes,
            self.assembly.constants,
            states,
            accelerations,
            no_loads(self.assembly.constants),
            self._work(),
            forces,
        )
        return check_result(where, self.unpadded(forces), q, qd, qdd)

    def _newton_euler(
        self,
        where: str,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        tip_force: ArrayLike | None = None,
        loads: Sequence[Load] = (),
        base_acceleration: ArrayLike | None = None,
        contacts: Sequence[Contact] = (),
    ) -> Workspace:
        state = self._state(where, q, qd)
        acceleration = self.padded(check_array(where, "qdd", qdd, (self.dof,)))
        work = self._work()
        acting = acting_loads(self, where, tip_force, loads)
        placed = place_outside(self, where, acting, base_acceleration, contacts)
        inverse_dynamics(self._sizes, self.assembly.constants, state, acceleration, placed, work)
        check_result(where, work.force, q, qd, qdd)
        return work

    def joint_reactions(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        tip_force: ArrayLike | None = None,
        loads: Sequence[Load] = (),
        base_acceleration: ArrayLike | None = None,
        contacts: Sequence[Contact] = (),
    ) -> FloatArray:
        """Return what the joint at each link's root gives to the link: (links, 3), Fx, Fy, Mz.

        World axes, at the joint, N and N m; ``qdd`` from ``forward_dynamics``. The moment of a
        joint that turns is the motor's torque and what the joint gives by itself.
        """
        work = self._newton_euler(
            "Arm.joint_reactions", q, qd, qdd, tip_force, loads, base_acceleration, contacts
        )
        angle = np.cumsum(np.arctan2(work.rotation[:, 1], work.rotation[:, 0]))
        cosine, sine = np.cos(angle), np.sin(angle)
        x, y, moment = work.wrench.T
        world = np.stack([cosine * x - sine * y, sine * x + cosine * y, moment], axis=1)
        return np.asarray(world[self.assembly.link_body])

    def mass_matrix(self, q: ArrayLike) -> FloatArray:
        """Return M (dof, dof) of the kinetic energy 1/2 qd' M qd; (R.18), (R.19)."""
        where = "Arm.mass_matrix"
        state = self._state(where, q, None)
        n, width = self.assembly.bodies, 1 + self.assembly.modes
        M = np.zeros((n, width, n, width))
        mass_matrix(self._sizes, self.assembly.constants, state, self._work(), M)
        check_result(where, M, q)
        kept = self.assembly.coordinates
        return M.reshape(n * width, n * width)[np.ix_(kept, kept)]

    def stiffness_matrix(
        self,
        q: ArrayLike,
        tip_force: ArrayLike | None = None,
        loads: Sequence[Load] = (),
        contacts: Sequence[Contact] = (),
    ) -> FloatArray:
        """Return the static stiffness (dof, dof): change of the generalised force by q, at rest.

        Without loads the Hessian of strain, gravity and contact energy; symmetric but for follower
        loads.
        Exact to rounding. Arguments as in ``forward_dynamics``.
        """
        where = "Arm.stiffness_matrix"
        state = self._state(where, q, None)
        n, width = self.assembly.bodies, 1 + self.assembly.modes
        constants = self.assembly.constants
        acting = acting_loads(self, where, tip_force, loads)
        placed = place_outside(self, where, acting, None, contacts)
        touching = placed.contacts.body.size
        if np.any(constants.gravity) or constants.has_joint_laws or acting or touching:
            K = np.zeros((n, width, n, width))
            work = self._work(complex)
            at_rest = np.zeros((n, width))
            potential_hessian(
                self._sizes, constants, state.astype(complex), at_rest, placed, work, K
            )
            check_result(where, K, q)
        else:
            springs = np.concatenate([constants.joint_stiffness[:, None], constants.w2], axis=1)
            K = np.diag(springs.ravel())
        kept = self.assembly.coordinates
        return K.reshape(n * width, n * width)[np.ix_(kept, kept)]

    def damping_matrix(self) -> FloatArray:
        """Return the viscous damping (dof, dof) of joints and links, diagonal."""
        constants = self.assembly.constants
        rates = np.concatenate([constants.joint_damping[:, None], constants.damping], axis=1)
        return np.diag(self.unpadded(rates))

    def bias_force(self, q: ArrayLike, qd: ArrayLike) -> FloatArray:
        """Return the force (dof,) at zero acceleration: M qdd + bias = force.

        It includes velocity products, stiffness, damping and gravity.
        """
        zero = np.zeros(self.dof)
        return self.unpadded(self._newton_euler("Arm.bias_force", q, qd, zero, None).force)

    def derivatives(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        torque: ArrayLike,
        tip_force: ArrayLike | None = None,
        loads: Sequence[Load] = (),
        base_acceleration: ArrayLike | None = None,
        contacts: Sequence[Contact] = (),
    ) -> Derivatives:
        """Return the exact Jacobians of the accelerations by q, qd and torque.

        Arguments as in ``forward_dynamics``. Complex perturbation of the same kernels
        (``kernels.sensitivity``): exact to rounding.
        """
        where = "Arm.derivatives"
        state = self._state(where, q, qd).astype(complex)
        tau = self.padded_torque(check_array(where, "torque", torque, (self.joints,)))
        acting = acting_loads(self, where, tip_force, loads)
        placed = place_outside(self, where, acting, base_acceleration, contacts)
        n, width = self.assembly.bodies, 1 + self.assembly.modes
        by_state = np.zeros((n, width, 2, n, width))
        by_torque = np.zeros((n, width, n))
        forward_jacobian(
            self._sizes,
            self.assembly.constants,
            state,
            tau.astype(complex),
            placed,
            self._work(complex),
            by_state,
            by_torque,
        )
        check_result(where, by_state, q, qd, torque)
        kept = self.assembly.coordinates
        jacobian = by_state.reshape(n * width, 2, n * width)[kept]
        torques = by_torque.reshape(n * width, n)[np.ix_(kept, self.assembly.joint_body)]
        return Derivatives(jacobian[:, 0, kept], jacobian[:, 1, kept], torques)
