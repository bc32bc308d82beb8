"""Equations of motion of an arm, as thin methods over the kernels.

The methods check shapes, and convert coordinates to and from the kernels' arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.actions import Environment
from flexarm.arm.assembly.assemble import FloatArray, assemble
from flexarm.arm.assembly.coordinates import Coordinates, carriers_of
from flexarm.arm.assembly.kernel_view import KernelView, Pool, Scratch, is_finite, is_plain
from flexarm.base.errors import InputError, Problem, check_array, check_result, public_call
from flexarm.kernels.columns import GAP, MULTIPLIER
from flexarm.kernels.derivatives.sensitivity import STEP, forward_jacobian, potential_hessian
from flexarm.kernels.layout import Loads, no_loads
from flexarm.kernels.recursion.closures import ROWS, closure_gaps
from flexarm.kernels.recursion.composite_body import mass_matrix
from flexarm.kernels.recursion.newton_euler import inverse_dynamics_many
from flexarm.model import ArmSpec, Contact, Load


class Derivatives(NamedTuple):
    """Jacobians of the accelerations, exact to rounding errors."""

    q: FloatArray  # (dof, dof)
    qd: FloatArray  # (dof, dof)
    torque: FloatArray  # (dof, joints)


class Dynamics(Coordinates):
    """Accelerations, forces and matrices of an arm."""

    def __init__(self, spec: ArmSpec) -> None:
        super().__init__(spec, assemble(spec))
        a = self.assembly
        self._unloaded = no_loads(a.constants)
        self._vector, self._torques = (self.dof,), (self.n_joints,)
        self._kernels = Pool(lambda: KernelView(a.constants))
        self._forward = Pool(lambda: Scratch(a, (a.bodies,), a.joint_body))
        self._inverse = Pool(lambda: Scratch(a, (a.bodies, 1 + a.modes), a.coordinates))
        self._jacobian = Pool(lambda: _Jacobian(self))
        self._perturbed = Pool(lambda: KernelView(a.constants, complex))

    def _state(self, q: ArrayLike, qd: ArrayLike | None) -> FloatArray:
        a = self.assembly
        state = np.zeros((2, a.bodies * (1 + a.modes)))
        state[0, a.coordinates] = check_array("q", q, self._vector)
        if qd is not None:
            state[1, a.coordinates] = check_array("qd", qd, self._vector)
        return state.reshape(2, a.bodies, 1 + a.modes)

    def _place(
        self,
        scratch: Scratch,
        q: ArrayLike,
        qd: ArrayLike,
        name: str,
        third: ArrayLike,
        shape: tuple[int, ...],
    ) -> None:
        """Check q, qd and a third vector, and copy them to the kernels' arrays."""
        vector = self._vector
        plain = is_plain(q, vector) and is_plain(qd, vector) and is_plain(third, shape)
        if not (plain and scratch.fill(q, qd, third)):  # type: ignore[arg-type]
            scratch.fill(
                check_array("q", q, vector),
                check_array("qd", qd, vector),
                check_array(name, third, shape),
            )

    def _outside(
        self,
        tip_force: ArrayLike | None,
        loads: Sequence[Load],
        base_acceleration: ArrayLike | None,
        contacts: Sequence[Contact],
    ) -> Loads:
        """Return the external loads; without any, always the same arrays."""
        nothing = tip_force is None and base_acceleration is None
        if nothing and type(loads) is tuple is type(contacts) and not (loads or contacts):
            return self._unloaded
        given = tip_force, loads, base_acceleration, contacts
        return Environment.of(self, *given).placed(self)

    @public_call
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
            torque: (joints,) N m, acting on each link and in opposite direction on the previous
                tip.
            tip_force: (Fx, Fy) or (Fx, Fy, Mz) on the last tip, world axes, N and N m.
            loads: further forces and moments; their time factors are ignored.
            base_acceleration: (ax, ay) of the base joint, world axes, m/s^2.
            contacts: contacts of points of the arm with surfaces.

        Raises:
            InputError: if an argument has the wrong shape or is not finite.

        Theory page "recursion", (R.4) to (R.14): O(links x modes), no matrix is formed.
        """
        scratch = self._forward.take()
        self._place(scratch, q, qd, "torque", torque, self._torques)
        placed = self._outside(tip_force, loads, base_acceleration, contacts)
        accelerations = scratch.forward_dynamics(scratch.state, scratch.third, placed)
        result: FloatArray = accelerations.take(self.assembly.coordinates)
        if not is_finite(result):  # discard the scratch, so that its values are not used again
            return check_result(result, q, qd, torque)
        self._forward.append(scratch)
        return result

    @public_call
    def inverse_dynamics(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        tip_force: ArrayLike | None = None,
        loads: Sequence[Load] = (),
        base_acceleration: ArrayLike | None = None,
        contacts: Sequence[Contact] = (),
        closure_forces: ArrayLike | None = None,
    ) -> FloatArray:
        """Return the generalised force (dof,) required for a motion: M qdd + bias.

        Its entries at ``joint_index`` are joint torques (N m). ``closure_forces`` (closure_rows,)
        are those of the method of this name, zero by default. They are subtracted, as
        ``closure_jacobian(q).T @ closure_forces``. Other arguments as in ``forward_dynamics``;
        theory page "recursion", (R.15) to (R.17).
        """
        placed = self._outside(tip_force, loads, base_acceleration, contacts)
        return self._force(q, qd, qdd, placed, closure_forces)

    def _force(
        self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, placed: Loads,
        closure_forces: ArrayLike | None = None,
    ) -> FloatArray:  # fmt: skip
        """Return the generalised force (dof,) of a motion."""
        scratch = self._newton_euler(q, qd, qdd, placed, closure_forces)
        force: FloatArray = scratch.work.force.take(self.assembly.coordinates)
        self._inverse.append(scratch)
        return force

    @public_call
    def inverse_dynamics_many(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> FloatArray:
        """Return generalised forces for many states at once: arrays (samples, dof)."""
        coordinates = check_array("q", q, (-1, self.dof))
        shape = coordinates.shape
        rates = check_array("qd", qd, shape)
        accelerations = self.padded(check_array("qdd", qdd, shape))
        states = self.padded(np.stack([coordinates, rates], axis=1))
        forces = np.empty_like(accelerations)
        kernels = KernelView(self.assembly.constants)
        kernels.call(
            inverse_dynamics_many, states, accelerations, kernels.loads, kernels.work, forces
        )
        return check_result(self.unpadded(forces), q, qd, qdd)

    def _newton_euler(
        self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, placed: Loads,
        closure_forces: ArrayLike | None,
    ) -> Scratch:  # fmt: skip
        """Return scratch with the inverse dynamics in its workspace; the caller must return it."""
        scratch, rows = self._inverse.take(), self.closure_rows
        if closure_forces is not None:
            scratch.set_closure_forces(check_array("closure_forces", closure_forces, (rows,)))
        elif rows:
            scratch.set_closure_forces(np.zeros(rows))
        self._place(scratch, q, qd, "qdd", qdd, self._vector)
        force = scratch.inverse_dynamics(scratch.state, scratch.third, placed)
        if not is_finite(force):
            check_result(force, q, qd, qdd)
        return scratch

    @public_call
    def joint_reactions(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        tip_force: ArrayLike | None = None,
        loads: Sequence[Load] = (),
        base_acceleration: ArrayLike | None = None,
        contacts: Sequence[Contact] = (),
        closure_forces: ArrayLike | None = None,
    ) -> FloatArray:
        """Return the joint reactions on the links at their roots: (links, 3), Fx, Fy, Mz.

        World axes, at the joint, N and N m; ``qdd`` from ``forward_dynamics``. The moment of a
        joint that is not fixed is the sum of the motor torque and the joint's passive torque. With
        closures, their forces are required, because a motion does not determine them: those of the
        method ``closure_forces``.
        """
        placed = self._outside(tip_force, loads, base_acceleration, contacts)
        self._require_forces(closure_forces)
        scratch = self._newton_euler(q, qd, qdd, placed, closure_forces)
        work = scratch.work
        angle = np.arctan2(work.rotation[:, 1], work.rotation[:, 0])
        for i, carrier in enumerate(carriers_of(self)):
            if carrier >= 0:
                angle[i] += angle[carrier]
        cosine, sine = np.cos(angle), np.sin(angle)
        x, y, moment = work.wrench.T
        world = np.stack([cosine * x - sine * y, sine * x + cosine * y, moment], axis=1)
        self._inverse.append(scratch)
        return np.asarray(world[self.assembly.link_root])

    def _require_forces(self, closure_forces: ArrayLike | None) -> None:
        """Raise if the forces of closures are required and not given."""
        if closure_forces is None and self.closure_rows:
            hint = "arm.closure_forces(q, qd, torque) computes them."
            raise InputError(
                Problem("closure_forces", "is required for an arm with closures", hint=hint)
            )

    @property
    def closure_rows(self) -> int:
        """Number of equations that close loops: 2 for a pin, 3 for a weld, 1 for the others."""
        return len(self.assembly.constants.closure)

    @property
    def closure_numbers(self) -> list[int]:
        """Number of the closure of each row, (closure_rows,), as given in ``closures``."""
        closures = enumerate(self.spec.closures, start=1)
        return [number for number, closure in closures for _ in ROWS[closure.kind]]

    @public_call
    def closure_gaps(self, q: ArrayLike) -> FloatArray:
        """Return how far the loops are from closed, (closure_rows,): 0 in a closed posture.

        In the order of ``closures``: of a pin x and y of the first point from the second (m, world
        axes), of a weld also the angle (rad), of a line or curve the distance from it (m).
        """
        state, kernels = self._state(q, None), self._kernels.take()
        kernels.call(closure_gaps, state, kernels.work)
        gaps = kernels.work.closure[:, GAP].copy()
        if is_finite(gaps):
            self._kernels.append(kernels)
        return gaps

    @public_call
    def closure_jacobian(self, q: ArrayLike) -> FloatArray:
        """Return the derivatives (closure_rows, dof) of ``closure_gaps``, exact to rounding."""
        coordinates = check_array("q", q, self._vector)
        return gaps_by_q(self, np.stack([coordinates, np.zeros(self.dof)]), GAP)

    @public_call
    def closure_forces(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        torque: ArrayLike,
        tip_force: ArrayLike | None = None,
        loads: Sequence[Load] = (),
        base_acceleration: ArrayLike | None = None,
        contacts: Sequence[Contact] = (),
    ) -> FloatArray:
        """Return the forces of the closures on their first points, (closure_rows,), N and N m.

        In the order of ``closure_gaps``, under the accelerations of ``forward_dynamics``, whose
        arguments these are. The opposite forces act on the second points.

        Theory page "mechanisms", (M.10) to (M.16).
        """
        scratch = self._forward.take()
        self._place(scratch, q, qd, "torque", torque, self._torques)
        placed = self._outside(tip_force, loads, base_acceleration, contacts)
        scratch.forward_dynamics(scratch.state, scratch.third, placed)
        forces = check_result(scratch.work.closure[:, MULTIPLIER].copy(), q, qd, torque)
        self._forward.append(scratch)
        return forces

    @public_call
    def mass_matrix(self, q: ArrayLike) -> FloatArray:
        """Return M (dof, dof) of the kinetic energy 1/2 qd' M qd; (R.18), (R.19)."""
        state = self._state(q, None)
        kernels = self._kernels.take()
        M = np.zeros(kernels.shape * 2)
        kernels.call(mass_matrix, state, kernels.work, M)
        check_result(M, q)
        self._kernels.append(kernels)
        return self._unpadded_square(M)

    def _unpadded_square(self, matrix: FloatArray) -> FloatArray:
        """Return the matrix (dof, dof) of a kernels' array (n, 1 + m, n, 1 + m)."""
        kept, size = self.assembly.coordinates, self.assembly.bodies * (1 + self.assembly.modes)
        return np.asarray(matrix.reshape(size, size)[np.ix_(kept, kept)])

    @public_call
    def stiffness_matrix(
        self,
        q: ArrayLike,
        tip_force: ArrayLike | None = None,
        loads: Sequence[Load] = (),
        contacts: Sequence[Contact] = (),
    ) -> FloatArray:
        """Return the static stiffness (dof, dof): change of the generalised force by q, at rest.

        Without loads it is the Hessian of strain, gravity and contact energy. It is symmetric
        except with follower loads, and exact to rounding errors. Arguments as in
        ``forward_dynamics``.
        """
        state = self._state(q, None)
        constants = self.assembly.constants
        placed = self._outside(tip_force, loads, None, contacts)
        acting = placed.body.size or placed.contacts.body.size
        if not (np.any(constants.gravity) or constants.has_joint_laws or acting):
            springs = np.concatenate([constants.joint_stiffness[:, None], constants.w2], axis=1)
            return np.diag(self.unpadded(springs))
        return self._hessian(state, placed)

    def _hessian(
        self, state: FloatArray, placed: Loads, closing: FloatArray | float = 0.0
    ) -> FloatArray:
        """Return the derivatives of the static force by q, under forces ``closing`` of closures."""
        kernels = KernelView(self.assembly.constants, complex)
        kernels.set_closure_forces(closing)
        at_rest, K = np.zeros(kernels.shape), np.zeros(kernels.shape * 2)
        kernels.call(potential_hessian, state.astype(complex), at_rest, placed, kernels.work, K)
        return self._unpadded_square(check_result(K, state))

    def damping_matrix(self) -> FloatArray:
        """Return the viscous damping (dof, dof) of joints and links, diagonal."""
        constants = self.assembly.constants
        rates = np.concatenate([constants.joint_damping[:, None], constants.damping], axis=1)
        return np.diag(self.unpadded(rates))

    @public_call
    def bias_force(self, q: ArrayLike, qd: ArrayLike) -> FloatArray:
        """Return the force (dof,) at zero acceleration: M qdd + bias = force.

        It includes velocity products, stiffness, damping and gravity.
        """
        return self._force(q, qd, np.zeros(self.dof), self._unloaded)

    @public_call
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

        Arguments as in ``forward_dynamics``. The same kernels are evaluated with complex
        perturbations (``kernels.derivatives.sensitivity``), so the result is exact to rounding.
        """
        scratch, kernels = self._forward.take(), self._jacobian.take()
        self._place(scratch, q, qd, "torque", torque, self._torques)
        placed = self._outside(tip_force, loads, base_acceleration, contacts)
        kernels.fill(scratch.state, scratch.third, placed)
        flat = kernels.by_state.ravel()
        if not is_finite(flat):
            check_result(flat, q, qd, torque)
        self._forward.append(scratch)
        self._jacobian.append(kernels)
        return Derivatives(
            flat.take(kernels.places_q).T,
            flat.take(kernels.places_qd).T,
            kernels.by_torque.take(kernels.places_torque),
        )


def gaps_by_q(arm: Dynamics, state: FloatArray, column: int) -> FloatArray:
    """Return derivatives (rows, dof) by q of a ``column`` of closures at q and qd (2, dof)."""
    kernels, states = arm._perturbed.take(), arm.padded(state).astype(complex)
    slopes = np.zeros((arm.closure_rows, arm.dof))
    flat, changes = states[0].reshape(-1), kernels.work.closure[:, column].imag
    for k, place in enumerate(arm.assembly.coordinates.tolist()):
        flat[place] += 1j * STEP
        kernels.call(closure_gaps, states, kernels.work)
        flat[place] -= 1j * STEP
        slopes[:, k] = changes
    if is_finite(slopes):
        arm._perturbed.append(kernels)
    return slopes / STEP


class _Jacobian(KernelView):
    """Kernels over complex numbers, with arrays for derivatives and indices of the results."""

    def __init__(self, arm: Dynamics) -> None:
        super().__init__(arm.assembly.constants, complex)
        assembly, (n, width) = arm.assembly, self.shape
        self._state, self._torque = self.zeros(2), np.zeros(n, dtype=complex)
        self.by_state = np.zeros((n, width, 2, n, width))
        self.by_torque = np.zeros((n, width, n))
        kept, size = assembly.coordinates, n * width
        # The indices are transposed, so that products with the matrices have the same rounding.
        self.places_q = kept * (2 * size) + kept[:, None]
        self.places_qd = self.places_q + size
        self.places_torque = kept[:, None] * n + assembly.joint_body

    def fill(self, state: FloatArray, torque: FloatArray, placed: Loads) -> None:
        self._state[...], self._torque[...] = state, torque
        jacobians = self.by_state, self.by_torque
        self.call(forward_jacobian, self._state, self._torque, placed, self.work, *jacobians)
