"""The one object users hold: an arm, its coordinates and its dynamics.

Thin methods over the kernels: they check shapes, place coordinates and take them back.
"""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.assemble import FloatArray, assemble
from flexarm.beams.shortening import shortening_matrices
from flexarm.coordinates import Coordinates
from flexarm.errors import check_array
from flexarm.kernels.articulated_body import forward_dynamics
from flexarm.kernels.composite_body import mass_matrix
from flexarm.kernels.layout import Workspace, new_workspace, no_loads, run_time_sizes
from flexarm.kernels.newton_euler import inverse_dynamics, inverse_dynamics_many
from flexarm.kernels.observables import POSE_COLUMNS, energies, poses
from flexarm.kernels.sensitivity import forward_jacobian, potential_hessian
from flexarm.kernels.shapes import axis_points, gauge_strains
from flexarm.loads import Load, place_loads, tip_load
from flexarm.model import ArmSpec, load_arm_spec, save_arm_spec


class Energy(NamedTuple):
    """Energy of a state, in J. Gravity energy is zero at the base joint."""

    kinetic: float
    strain: float
    gravity: float

    @property
    def total(self) -> float:
        """Sum of the three."""
        return self.kinetic + self.strain + self.gravity


class Derivatives(NamedTuple):
    """Jacobians of the accelerations, exact to rounding."""

    q: FloatArray  # (dof, dof)
    qd: FloatArray  # (dof, dof)
    torque: FloatArray  # (dof, joints)


class Arm(Coordinates):
    """A planar serial arm of rigid and flexible links.

    Args:
        links: `Link` objects (or mappings of their fields), from the base outwards, 1 to 256.
        joints: one `Joint` for each link, at its root; None for bare revolute joints.
        payload: `Payload` on the last tip.
        gravity: (gx, gy) in world axes, m/s^2; the arm lies in a horizontal plane by default.
        theory: "linear", the paper's kinematics, or "second_order", which adds the shortening of
            bent links and with it centrifugal and axial stiffening (theory page "link").

    Raises:
        ModelError: a quantity is missing or impossible; every problem is listed.

    Coordinates ``q`` (dof,): for each link its joint angle (rad), relative to the tip tangent of
    the link before (the first: to world x), then its modal coordinates. World frame: origin at the
    base joint, x to the right, y up.
    """

    def __init__(self, spec: ArmSpec | None = None, /, **fields: Any) -> None:
        spec = ArmSpec(**fields) if spec is None else spec
        super().__init__(spec, assemble(spec))
        self._sizes = run_time_sizes(self.assembly.constants)
        gauges = [(i, gauge) for i, link in enumerate(spec.links) for gauge in link.gauges]
        self.gauges = tuple((i, gauge.station, gauge.distance) for i, gauge in gauges)
        self._gauge_rows, self._gauge_bodies = self._place_gauges()

    def rigid(self) -> Arm:
        """Make the rigid twin: the same masses and inertias, no bending, no elastic joints."""
        links = tuple(
            link.model_copy(update={"flexible": False, "segments": 1, "modes": None, "gauges": ()})
            for link in self.spec.links
        )
        joints = tuple(
            joint.model_copy(update={"stiffness": 0.0, "damping": 0.0}) if joint.elastic else joint
            for joint in self.spec.joints
        )
        return Arm(self.spec.model_copy(update={"links": links, "joints": joints}))

    def __repr__(self) -> str:
        theory = self.spec.theory
        return f"<flexarm.Arm: {self.links} links, {self.dof} coordinates, {theory} theory>"

    def _state(self, where: str, q: ArrayLike, qd: ArrayLike | None) -> FloatArray:
        coordinates = check_array(where, "q", q, (self.dof,))
        rates = np.zeros(self.dof) if qd is None else check_array(where, "qd", qd, (self.dof,))
        return self.padded(np.stack([coordinates, rates]))

    def _work(self, dtype: Any = np.float64) -> Workspace:
        return new_workspace(self.assembly.constants, dtype)

    # Dynamics ----------------------------------------------------------------------------------

    def forward_dynamics(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        torque: ArrayLike,
        tip_force: ArrayLike | None = None,
        loads: Sequence[Load] = (),
        base_acceleration: ArrayLike | None = None,
    ) -> FloatArray:
        """Return the accelerations qdd (dof,) under joint torques.

        Args:
            q, qd: (dof,) coordinates and rates.
            torque: (joints,) N m, acting on each link and back on the tip of the one before.
            tip_force: (Fx, Fy) or (Fx, Fy, Mz) on the last tip, world axes, N and N m.
            loads: further forces and moments; factors of time are left aside.
            base_acceleration: (ax, ay) of the base joint, world axes, m/s^2.

        Raises:
            InputError: wrong shape, NaN or infinity.

        Theory page "recursion", (R.4) to (R.14): O(links x modes), no matrix is formed.
        """
        where = "Arm.forward_dynamics"
        state = self._state(where, q, qd)
        tau = self.padded_torque(check_array(where, "torque", torque, (self.joints,)))
        work = self._work()
        acting = [*tip_load(self, where, tip_force), *loads]
        placed = place_loads(self, where, acting, base_acceleration)
        forward_dynamics(self._sizes, self.assembly.constants, state, tau, placed, work)
        return self.unpadded(work.acceleration)

    def inverse_dynamics(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        tip_force: ArrayLike | None = None,
        loads: Sequence[Load] = (),
        base_acceleration: ArrayLike | None = None,
    ) -> FloatArray:
        """Return the generalised force (dof,) that a motion takes: M qdd + bias.

        Its entries at ``joint_index`` are joint torques (N m). Arguments as in
        ``forward_dynamics``; theory page "recursion", (R.15) to (R.17).
        """
        return self.unpadded(
            self._newton_euler(
                "Arm.inverse_dynamics", q, qd, qdd, tip_force, loads, base_acceleration
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
        return self.unpadded(forces)

    def _newton_euler(
        self,
        where: str,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        tip_force: ArrayLike | None = None,
        loads: Sequence[Load] = (),
        base_acceleration: ArrayLike | None = None,
    ) -> Workspace:
        state = self._state(where, q, qd)
        acceleration = self.padded(check_array(where, "qdd", qdd, (self.dof,)))
        work = self._work()
        acting = [*tip_load(self, where, tip_force), *loads]
        placed = place_loads(self, where, acting, base_acceleration)
        inverse_dynamics(self._sizes, self.assembly.constants, state, acceleration, placed, work)
        return work

    def joint_reactions(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        tip_force: ArrayLike | None = None,
        loads: Sequence[Load] = (),
        base_acceleration: ArrayLike | None = None,
    ) -> FloatArray:
        """Return what the joint at each link's root gives to the link: (links, 3), Fx, Fy, Mz.

        World axes, at the joint, N and N m; ``qdd`` from ``forward_dynamics``. The moment of a
        joint that turns is the motor's torque and what the joint gives by itself.
        """
        work = self._newton_euler(
            "Arm.joint_reactions", q, qd, qdd, tip_force, loads, base_acceleration
        )
        angle = np.cumsum(np.arctan2(work.rotation[:, 1], work.rotation[:, 0]))
        cosine, sine = np.cos(angle), np.sin(angle)
        x, y, moment = work.wrench.T
        world = np.stack([cosine * x - sine * y, sine * x + cosine * y, moment], axis=1)
        return np.asarray(world[self.assembly.link_body])

    def mass_matrix(self, q: ArrayLike) -> FloatArray:
        """Return M (dof, dof) of the kinetic energy 1/2 qd' M qd; (R.18), (R.19)."""
        state = self._state("Arm.mass_matrix", q, None)
        n, width = self.assembly.bodies, 1 + self.assembly.modes
        M = np.zeros((n, width, n, width))
        mass_matrix(self._sizes, self.assembly.constants, state, self._work(), M)
        kept = self.assembly.coordinates
        return M.reshape(n * width, n * width)[np.ix_(kept, kept)]

    def stiffness_matrix(
        self, q: ArrayLike, tip_force: ArrayLike | None = None, loads: Sequence[Load] = ()
    ) -> FloatArray:
        """Return the static stiffness (dof, dof): change of the generalised force by q, at rest.

        Without loads the Hessian of strain and gravity energy; symmetric but for follower loads.
        Exact to rounding. Arguments as in ``forward_dynamics``.
        """
        where = "Arm.stiffness_matrix"
        state = self._state(where, q, None)
        n, width = self.assembly.bodies, 1 + self.assembly.modes
        constants = self.assembly.constants
        acting = [*tip_load(self, where, tip_force), *loads]
        if np.any(constants.gravity) or constants.joint_laws.size or acting:
            K = np.zeros((n, width, n, width))
            work = self._work(complex)
            at_rest, placed = np.zeros((n, width)), place_loads(self, where, acting)
            potential_hessian(
                self._sizes, constants, state.astype(complex), at_rest, placed, work, K
            )
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
    ) -> Derivatives:
        """Return the exact Jacobians of the accelerations by q, qd and torque.

        Arguments as in ``forward_dynamics``. Complex perturbation of the same kernels
        (``kernels.sensitivity``): exact to rounding.
        """
        where = "Arm.derivatives"
        state = self._state(where, q, qd).astype(complex)
        tau = self.padded_torque(check_array(where, "torque", torque, (self.joints,)))
        acting = [*tip_load(self, where, tip_force), *loads]
        placed = place_loads(self, where, acting, base_acceleration)
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
        kept = self.assembly.coordinates
        jacobian = by_state.reshape(n * width, 2, n * width)[kept]
        torques = by_torque.reshape(n * width, n)[np.ix_(kept, self.assembly.joint_body)]
        return Derivatives(jacobian[:, 0, kept], jacobian[:, 1, kept], torques)

    # What one sees -----------------------------------------------------------------------------

    def energy(self, q: ArrayLike, qd: ArrayLike) -> Energy:
        """Return kinetic, strain and gravity energy (J), and their ``total``."""
        state = self._state("Arm.energy", q, qd)
        body_poses, tip, values = self._pose_arrays()
        energies(self._sizes, self.assembly.constants, state, body_poses, tip, values)
        return Energy(*(float(value) for value in values))

    def _pose_arrays(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return np.zeros((self.assembly.bodies, POSE_COLUMNS)), np.zeros(6), np.zeros(3)

    def _poses(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        body_poses, tip, _ = self._pose_arrays()
        poses(self._sizes, self.assembly.constants, state, body_poses, tip)
        return body_poses, tip

    def tip(self, q: ArrayLike) -> FloatArray:
        """Return x, y (m) and angle (rad) of the last tip in world axes, (3,)."""
        return self._poses(self._state("Arm.tip", q, None))[1][:3]

    def tip_velocity(self, q: ArrayLike, qd: ArrayLike) -> FloatArray:
        """Return the rates of x, y (m/s) and angle (rad/s) of the last tip, (3,)."""
        return self._poses(self._state("Arm.tip_velocity", q, qd))[1][3:]

    def shape(self, q: ArrayLike, stations: int = 50) -> FloatArray:
        """Return points of the neutral axis in world axes: (links, stations, 2) m.

        The stations of a link divide it evenly, root and tip included. With the second-order
        theory each point also draws back along the root tangent as the link shortens.
        """
        state = self._state("Arm.shape", q, None)
        body_poses, _ = self._poses(state)
        m, g = self.assembly.modes, self.assembly.constants.D0.shape[1]
        count = self.links * stations
        bodies = np.zeros(count, dtype=np.intp)
        along, rows, matrices = np.zeros(count), np.zeros((count, m)), np.zeros((count, g, g))
        for i, link in enumerate(self.spec.links):
            for row, x in enumerate(np.linspace(0.0, link.length, stations), i * stations):
                piece = self.assembly.piece_at(i, x)
                bodies[row], along[row] = piece.body, x - piece.start
        for piece in self.assembly.pieces:
            own, k = np.flatnonzero(bodies == piece.body), piece.shapes.w2.size
            if k and own.size:
                rows[own, :k] = piece.shapes.deflection(along[own])
            if k and g and own.size:
                matrices[own, :k, :k] = shortening_matrices(piece.shapes, along[own])
        points = np.zeros((count, 2))
        axis_points(self._sizes, state, body_poses, bodies, along, rows, matrices, points)
        return points.reshape(self.links, stations, 2)

    def strain(self, q: ArrayLike) -> FloatArray:
        """Return the strain at each declared gauge, (gauges,): -distance * v''."""
        values: FloatArray = self.strains(self._state("Arm.strain", q, None)[None])[0]
        return values

    def strains(self, states: FloatArray) -> FloatArray:
        """Return the strains (samples, gauges) of kernel states (samples, 2, n, 1 + m)."""
        strains = np.zeros((len(states), len(self.gauges)), dtype=states.dtype)
        gauge_strains(self._sizes, states, self._gauge_bodies, self._gauge_rows, strains)
        return strains

    def _place_gauges(self) -> tuple[FloatArray, NDArray[np.intp]]:
        rows = np.zeros((len(self.gauges), self.assembly.modes))
        bodies = np.zeros(len(self.gauges), dtype=np.intp)
        for k, (i, station, distance) in enumerate(self.gauges):
            piece = self.assembly.piece_at(i, station)
            bodies[k] = piece.body
            if piece.shapes.w2.size:
                curvature = piece.shapes.curvature([station - piece.start])[0]
                rows[k, : curvature.size] = -distance * curvature
        return rows, bodies


def load_arm(path: str | PathLike[str]) -> Arm:
    """Read an arm from a YAML file (a scenario's file gives its arm).

    Raises:
        ModelError: the file cannot be read as an arm; every problem with its line.
    """
    return Arm(load_arm_spec(path))


def save_arm(arm: Arm, path: str | PathLike[str]) -> None:
    """Write an arm to a YAML file that ``load_arm`` reads back equal; never half a file."""
    save_arm_spec(arm.spec, path)
