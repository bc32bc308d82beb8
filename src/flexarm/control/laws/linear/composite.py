"""Composite control of slow joint motion and fast link vibration; (C.32) to (C.38)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from flexarm.arm.assembly.coordinates import coordinate_sizes
from flexarm.base.errors import InputError, Problem
from flexarm.control.contract.base import FloatArray
from flexarm.control.design.arm_scales import TIP
from flexarm.control.design.linear_design import (
    Design,
    bend_weight,
    bending,
    check_names,
    held,
    regulator,
    rows_of,
    sizes_of,
)
from flexarm.control.laws.linear.lqg import LQG
from flexarm.linear.models.linearize import linearize
from flexarm.linear.statics.equilibrium import equilibrium
from flexarm.model.drives.linear import CompositeParameters

#: Default bandwidth, and acceptable rate of a deflection relative to the deflection, relative to
#: `typical_rate`.
_BANDWIDTH, _SPEED = 0.64, 1.6
#: Outputs that the fast part may weight: those that depend on the bending of the links only.
BENDING = (
    "strain",
    "link_tip_deflection",
    "link_tip_slope",
    "link_tip_deflection_rate",
    "link_tip_slope_rate",
)


@dataclass(frozen=True, eq=False)
class FastDesign:
    """Fast part of a `Composite` controller at one posture, with k elastic coordinates.

    Attributes:
        frequency: (k,) of the boundary layer, rad/s, lowest first.
        flexibility: (k, k) elastic coordinates per elastic force.
        A, B: sampled boundary layer, (2 k, 2 k) and (2 k, joints).
        gain: (joints, 2 k) of the fast part. cost: (2 k, 2 k), its minimum cost.
    """

    frequency: FloatArray
    flexibility: FloatArray
    A: FloatArray
    B: FloatArray
    gain: FloatArray
    cost: FloatArray


class Composite(CompositeParameters, LQG):
    """Singular-perturbation control: computed torque for the joints, damping for the links.

    The slow part gives the joint errors of the rigid model a bandwidth and a damping ratio. The
    fast part returns the links to the slow manifold with the linear-quadratic gain of the boundary
    layer. Both use the state that the Kalman filter of `LQG` estimates.

    Attributes:
        fast_designs: the `FastDesign` of each posture of the grid.

    Raises:
        InputError: as for `LQG`, or if the links of the arm are rigid.

    Siciliano and Book 1988.
    """

    references: ClassVar[str] = "SicilianoBook1988"

    integral: ClassVar[None] = None  # type: ignore[misc]
    preview: ClassVar[float] = 0.0  # type: ignore[misc]
    nominal: ClassVar[None] = None  # type: ignore[misc]

    def __post_init__(self) -> None:
        arm = self.arm
        if arm.dof == arm.joints:
            raise InputError(Problem("arm", "has no flexible links"))
        super().__post_init__()

    def _scale_defaults(self, rate: float) -> None:
        """See `LQG`."""
        if self.bandwidth is None:
            self.bandwidth = np.full(self.arm.joints, _BANDWIDTH * rate)
        bend = TIP * float(np.sum(self.arm.lengths))
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
        pairs = [self._both(item) for item in super()._design_all()]
        self.fast_designs = tuple(fast for fast, _ in pairs)
        return tuple(item for _, item in pairs)

    def _both(self, item: Design) -> tuple[FastDesign, Design]:
        """Design both parts at a posture, and combine them into one gain; (C.34) to (C.37)."""
        from scipy.linalg import eigvals

        weighted = self.acceptable or {}
        arm, joints, elastic = self.arm, self.arm.joint_index, self._model.elastic
        rest = equilibrium(arm, item.posture)
        model = linearize(arm, rest, outputs=tuple(weighted))
        M, k = model.mass, elastic.size
        K = model.stiffness[np.ix_(elastic, elastic)]
        flexibility = np.asarray(np.linalg.inv(K), dtype=np.float64)
        inverse = np.linalg.inv(M)[np.ix_(elastic, elastic)]
        pull = inverse @ K
        drag = inverse @ model.damping[np.ix_(elastic, elastic)]
        moved = np.append(elastic, arm.dof + elastic)
        A = np.block([[np.zeros((k, k)), np.eye(k)], [-pull, -drag]])
        A, B = held(A, model.B[moved], self.sample_time)
        size = sizes_of("acceptable", model, weighted)
        rows = rows_of(model, tuple(weighted))[:, moved] / size[:, None]
        price = np.diag(self.design_requirements.acceptable_torque**-2.0)
        weighed = rows.T @ rows
        stiffness, energy = bending(arm, model, self.design_requirements.acceptable_torque)
        weighed[:k, :k] += bend_weight(
            self.design_requirements.rigidity_uncertainty, stiffness, energy
        )
        sizes = np.append(
            coordinate_sizes(arm), self.design_requirements.rate * coordinate_sizes(arm)
        )
        gain, cost = regulator(A, B, weighed, price, sizes[moved])
        frequency: FloatArray = np.sort(np.sqrt(np.abs(eigvals(pull))))
        fast = FastDesign(frequency, flexibility, A, B, gain, cost)
        rigid, coupling = M[np.ix_(joints, joints)], M[np.ix_(joints, elastic)]
        # Gravity adds a stiffness, as the sag of the links depends on the joint angles: (C.38).
        whole = model.stiffness
        sag = -flexibility @ whole[np.ix_(elastic, joints)]
        weight = whole[np.ix_(joints, joints)] + whole[np.ix_(joints, elastic)] @ sag
        # Slow angles as a function of the state, without the bending due to acceleration: (C.35).
        carried = np.linalg.solve(rigid, coupling)
        alone = np.linalg.inv(np.eye(arm.joints) + carried @ sag)
        slow, rate = np.zeros((2, arm.joints, 2 * arm.dof))
        slow[:, joints], slow[:, elastic] = alone, alone @ carried
        rate[:, arm.dof + joints], rate[:, arm.dof + elastic] = alone, alone @ carried
        # The acceleration that the slow part requests bends the links, and this bending changes the
        # slow angles. Solve for both.
        bandwidth = np.asarray(self.bandwidth)
        stiff, damped = bandwidth**2, 2.0 * self.damping_ratio * bandwidth
        bend = -flexibility @ coupling.T
        moves = alone @ carried @ bend
        request = -stiff[:, None] * slow - damped[:, None] * rate
        request = np.asarray(np.linalg.solve(np.eye(arm.joints) - stiff[:, None] * moves, request))
        slow -= moves @ request
        swing = np.zeros((2 * k, 2 * arm.dof))
        swing[np.arange(2 * k), moved] = 1.0
        swing[:k] -= bend @ request + sag @ slow
        return fast, replace(item, gain=gain @ swing - rigid @ request - weight @ slow)

    def _known_force_gain(self, item: Design) -> FloatArray:
        """Return the gain of elastic forces, whose bending belongs to the slow manifold: (C.37)."""
        at = [np.array_equal(item.posture, other.posture) for other in self.designs].index(True)
        bent = item.gain[:, self._model.elastic] @ self.fast_designs[at].flexibility
        return -bent[:, None, :]
