"""Composite control with the filter of LQG: (C.32) to (C.38)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from flexarm.arm.assembly.coordinates import coordinate_sizes
from flexarm.base.errors import InputError, Problem
from flexarm.base.late import linalg
from flexarm.control.contract.base import FloatArray
from flexarm.control.design.arm_scales import TIP
from flexarm.control.design.linear_design import (
    Design,
    bend_weight,
    bending,
    check_names,
    regulated,
    regulator,
    rows_of,
    sizes_of,
)
from flexarm.control.hardware.sampled_plant import held
from flexarm.control.laws.lqg import LQG
from flexarm.linear.statics.equilibrium import equilibrium
from flexarm.model.arm.spec import UNDRIVEN
from flexarm.model.drives.linear import CompositeParameters

#: Default bandwidth, and acceptable rate of a deflection relative to the deflection, relative to
#: `typical_rate`.
_BANDWIDTH, _SPEED = 0.64, 1.6
#: Rate at which the integral of the slow part removes errors, relative to the bandwidth.
_REMOVED = 0.3
#: Least bandwidth over the default one that a design tries.
_SLOWEST = 0.1
#: Growth of a stable loop in a sample that rounding may cause.
_ROUNDING = 1e-6
#: Outputs that the fast part may weight: those that depend on the bending of the links only.
_TIPS = "link_tip_deflection", "link_tip_slope"
BENDING = ("strain", *_TIPS, *(f"{name}_rate" for name in _TIPS))


@dataclass(frozen=True, eq=False)
class FastDesign:
    """Fast part of a `Composite` controller at one posture, with k elastic coordinates."""

    frequency: FloatArray  # (k,) of the boundary layer, rad/s, lowest first
    force_gain: FloatArray  # (joints, k), torque of the whole gain per elastic force
    A: FloatArray  # (2 k, 2 k) of the sampled boundary layer
    B: FloatArray  # (2 k, joints)
    gain: FloatArray  # (joints, 2 k) of the fast part
    cost: FloatArray  # (2 k, 2 k), its minimum cost


class Composite(CompositeParameters, LQG):
    """Singular-perturbation control: computed torque for the joints, damping for the links.

    The slow part gives the joint errors of the rigid model a bandwidth, a damping ratio and, with
    ``integral``, a third pole that removes the error by an unknown weight. The fast part returns
    the links to the slow manifold with the linear-quadratic gain of the boundary layer. Both use
    the state that the Kalman filter of `LQG` estimates.

    Attributes:
        fast_designs: the `FastDesign` of each posture of the grid.

    Raises:
        InputError: as for `LQG`, or if the links are rigid, or the loop with the model is unstable.

    Siciliano and Book 1988.
    """

    references: ClassVar[str] = "SicilianoBook1988"
    _unsupported = UNDRIVEN

    actuated: ClassVar[None] = None  # type: ignore[misc]
    preview: ClassVar[float] = 0.0  # type: ignore[misc]
    nominal: ClassVar[None] = None  # type: ignore[misc]

    def __post_init__(self) -> None:
        arm = self.arm
        if arm.dof == arm.n_joints:
            raise InputError(Problem("arm", "has no flexible links"))
        if self.integral == "tip":
            raise InputError(Problem("integral", "is not supported for the tip", hint="Use LQG."))
        super().__post_init__()

    def _scale_defaults(self, rate: float) -> None:
        if self.integral is None:
            self.integral = any(self.arm.spec.gravity)
        self._usual_bandwidth = None
        if self.bandwidth is None:
            self.bandwidth = np.full(self.arm.n_joints, _BANDWIDTH * rate)
            self._usual_bandwidth = self.bandwidth
        bend = TIP * self.arm.reach
        usual = {"link_tip_deflection": bend, "link_tip_deflection_rate": _SPEED * bend * rate}
        self.acceptable = check_names("acceptable", self.acceptable or usual, BENDING, self.arm)

    def _regulated(self) -> None:
        """See `LQG`; the regulator of both parts replaces that of `LQG`."""

    @property
    def epsilon(self) -> float:
        """Largest bandwidth over the lowest frequency of the boundary layer; (C.33)."""
        largest = np.max(np.asarray(self.bandwidth))
        return float(largest / min(item.frequency[0] for item in self.fast_designs))

    def _design_all(self) -> tuple[Design, ...]:
        designs, usual = super()._design_all(), self._usual_bandwidth
        while True:
            pairs = [self._both(item) for item in designs]
            poles = [(item, np.linalg.eigvals(regulated(item)[1])) for _, item in pairs]
            unstable = [item.posture for item, z in poles if np.abs(z).max() > 1.0 + _ROUNDING]
            if not unstable:
                break
            bandwidth = np.asarray(self.bandwidth, dtype=np.float64)
            if usual is None or bandwidth.max() < _SLOWEST * usual.max():
                posture = ", ".join(f"{angle:.3g}" for angle in unstable[0])
                rule = f"be smaller: the loop with the model is unstable in the posture ({posture})"
                hint = "Accept more bending, or use LQG if gravity bends the arm too far."
                raise InputError(Problem("bandwidth", rule, f"{bandwidth.max():.3g} rad/s", hint))
            self.bandwidth = 0.5 * bandwidth  # the usual one is too large for some arms
        self.fast_designs = tuple(fast for fast, _ in pairs)
        return tuple(item for _, item in pairs)

    def _both(self, item: Design) -> tuple[FastDesign, Design]:
        """Design both parts at a posture, and combine them into one gain; (C.34) to (C.37)."""
        weighted = self.acceptable or {}
        arm, joints, elastic = self.arm, self.arm.joint_index, self._model.elastic
        rest = equilibrium(arm, item.posture)
        model = self._coordinates.linearized(rest, ("torque",), tuple(weighted), sliding=True)
        M, k = model.mass, elastic.size
        K = model.stiffness[np.ix_(elastic, elastic)]
        flexibility = np.asarray(np.linalg.inv(K), dtype=np.float64)
        inverse = np.linalg.inv(M)[np.ix_(elastic, elastic)]
        pull = inverse @ K
        drag = inverse @ model.damping[np.ix_(elastic, elastic)]
        moved = np.append(elastic, arm.dof + elastic)
        A = np.block([[np.zeros((k, k)), np.eye(k)], [-pull, -drag]])
        A, B = held(A, model.B[moved], self.sample_time)
        rows = rows_of(model, tuple(weighted))[:, moved]
        rows = rows / sizes_of("acceptable", model, weighted)[:, None]
        needs, weighed = self.design_requirements, rows.T @ rows
        price = np.diag(needs.acceptable_torque**-2.0)
        stiffness, energy = bending(self._coordinates, model, needs.acceptable_torque)
        weighed[:k, :k] += bend_weight(needs.rigidity_uncertainty, stiffness, energy)
        sizes = np.outer([1.0, needs.rate], coordinate_sizes(arm)).ravel()
        gain, cost = regulator(A, B, weighed, price, sizes[moved])
        frequency: FloatArray = np.sort(np.sqrt(np.abs(linalg.eigvals(pull))))
        rigid, coupling = M[np.ix_(joints, joints)], M[np.ix_(joints, elastic)]
        # Gravity adds a stiffness, as the sag of the links depends on the joint angles: (C.38).
        whole = model.stiffness
        sag = -flexibility @ whole[np.ix_(elastic, joints)]
        weight = whole[np.ix_(joints, joints)] + whole[np.ix_(joints, elastic)] @ sag
        # Slow angles as a function of the state, without the bending due to acceleration: (C.35).
        carried = np.linalg.solve(rigid, coupling)
        alone = np.linalg.inv(np.eye(arm.n_joints) + carried @ sag)
        n, width = 2 * arm.dof, 2 * arm.dof + len(item.integrated)
        slow, rate, summed = np.zeros((3, arm.n_joints, width))
        slow[:, joints], slow[:, elastic] = alone, alone @ carried
        rate[:, arm.dof + joints], rate[:, arm.dof + elastic] = alone, alone @ carried
        # The acceleration that the slow part requests bends the links, and this bending changes the
        # slow angles. Solve for both.
        bandwidth = np.asarray(self.bandwidth)
        stiff, damped = bandwidth**2, 2.0 * self.damping_ratio * bandwidth
        if len(item.integrated):
            # Poles of (s + third) (s^2 + damped s + stiff).
            third = _REMOVED * bandwidth
            summed[:, 2 * arm.dof :] = np.diag(third * stiff)
            stiff, damped = stiff + third * damped, damped + third
        bend = -flexibility @ coupling.T
        moves = alone @ carried @ bend
        request = -stiff[:, None] * slow - damped[:, None] * rate - summed
        request = np.linalg.solve(np.eye(len(stiff)) - stiff[:, None] * moves, request)
        slow -= moves @ request
        swing = np.zeros((2 * k, width))
        swing[np.arange(2 * k), moved] = 1.0
        swing[:k] -= bend @ request + sag @ slow
        whole = gain @ swing - rigid @ request - weight @ slow
        # Elastic forces bend the links to the slow manifold, which is no error: (C.37).
        force_gain = -whole[:, elastic] @ flexibility
        fast = FastDesign(frequency, force_gain, A, B, gain, cost)
        # The gain of the state at the time when the motors have reached the torque.
        parts = whole[:, :n] @ self._predicted_state(item)[:n], whole[:, n:]
        return fast, replace(item, gain=np.hstack(parts))

    def _predicted_state(self, item: Design) -> FloatArray:
        """Return the map of a state to that after the lag of the motors, by the hardware's states.

        Requests until then are the nominal ones; whole samples of delay are predicted by `LQG`.
        """
        ahead = 0.0 if self._hardware is None else self._hardware.lead - self._hardware.delayed
        whole = int(ahead)
        first = np.linalg.matrix_power(item.A, whole)
        return first + (ahead - whole) * (item.A @ first - first) if ahead else np.eye(len(first))

    def _known_force_gain(self, item: Design) -> FloatArray:
        """Return the gain of elastic forces, whose bending belongs to the slow manifold: (C.37)."""
        at = [np.array_equal(item.posture, other.posture) for other in self.designs].index(True)
        return self.fast_designs[at].force_gain[:, None, :]
