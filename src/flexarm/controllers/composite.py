"""Composite control: slow motion of the joints, fast vibration of the links; (C.32) to (C.38)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arguments import check_kind
from flexarm.arm import Arm
from flexarm.control.base import FloatArray
from flexarm.control_design.linear_design import (
    Design,
    bend_weight,
    bending,
    check_names,
    held,
    regulator,
    rows_of,
    scales,
    sizes_of,
)
from flexarm.controllers.lqg import LQG
from flexarm.errors import InputError, Problem
from flexarm.linear.equilibrium import equilibrium
from flexarm.linear.linearize import linearize

#: What the fast part may weigh: outputs that the links' bending alone decides.
BENDING = (
    "strain",
    "link_tip_deflection",
    "link_tip_slope",
    "link_tip_deflection_rate",
    "link_tip_slope_rate",
)


@dataclass(frozen=True, eq=False)
class FastDesign:
    """The two parts at one posture; bending has k coordinates, the fast state 2 k.

    Attributes:
        frequency: (k,) of the boundary layer, rad/s, lowest first.
        flexibility: (k, k) bending per elastic force.
        A, B: boundary layer, sampled, (2 k, 2 k) and (2 k, joints).
        gain: (joints, 2 k) of the fast part. cost: (2 k, 2 k), its least cost.
    """

    frequency: FloatArray
    flexibility: FloatArray
    A: FloatArray
    B: FloatArray
    gain: FloatArray
    cost: FloatArray


class Composite(LQG):
    """Singular-perturbation control: computed torque for the joints, damping for the links.

    The slow part gives the joint errors of the rigid arm a bandwidth and a damping ratio. The fast
    part brings the links back to the bend that goes with the slow motion, by the linear-quadratic
    gain of the boundary layer. Both are fed by the Kalman filter of `LQG`.

    Args:
        arm, posture, options: as for `LQG`, which says what each means: ``schedule``,
            ``measured``, ``disturbance``, ``torque_limit``, ``sample_time``.
        bandwidth: rad/s of the joint errors, one number or one for each joint.
        damping_ratio: of the joint errors, likewise.
        acceptable: outputs of `linearize` that bending alone decides, and the deviation of each
            that counts as much as the others'; by default 10 mm of ``link_tip_deflection`` and
            0.1 m/s of its rate.
        acceptable_torque: N m of the fast part, as for `LQG`.

    Attributes:
        fast_designs: for every posture of the grid, the `FastDesign`.

    Raises:
        InputError: as `LQG`; an arm whose links do not bend.

    Siciliano and Book 1988.
    """

    name = "composite"
    references: ClassVar[str] = "SicilianoBook1988"

    def __init__(
        self,
        arm: Arm,
        posture: ArrayLike | None = None,
        *,
        bandwidth: ArrayLike = 4.0,
        damping_ratio: ArrayLike = 1.0,
        acceptable: Mapping[str, ArrayLike] | None = None,
        sample_time: float = 1e-3,
        **options: Any,
    ) -> None:
        where = "Composite"
        for unknown in ("integral", "preview", "nominal"):
            if options.get(unknown) is not None and options[unknown] is not False:
                problem = Problem(where, unknown, "be left out", "given", f"`LQG` has `{unknown}`.")
                raise InputError(problem)
        if check_kind(where, "arm", arm, Arm).dof == arm.joints:
            raise InputError(Problem(where, "arm", "have links that bend", "rigid"))
        self.bandwidth = scales(where, "bandwidth", bandwidth, arm.joints)
        self.damping_ratio = scales(where, "damping_ratio", damping_ratio, arm.joints)
        if acceptable is None:
            acceptable = {"link_tip_deflection": 0.01, "link_tip_deflection_rate": 0.1}
        self.acceptable = check_names(where, "acceptable", acceptable, BENDING, arm)
        super().__init__(arm, posture, sample_time=sample_time, **{**options, "preview": 0.0})

    @property
    def epsilon(self) -> float:
        """The fastest bandwidth over the slowest frequency of the boundary layer; (C.33)."""
        return float(np.max(self.bandwidth) / min(item.frequency[0] for item in self.fast_designs))

    def _design_all(self, where: str) -> tuple[Design, ...]:
        pairs = [self._both(where, item) for item in super()._design_all(where)]
        self.fast_designs = tuple(fast for fast, _ in pairs)
        return tuple(item for _, item in pairs)

    def _both(self, where: str, item: Design) -> tuple[FastDesign, Design]:
        """Design both parts in a posture, and put them into one gain; (C.34) to (C.37)."""
        from scipy.linalg import eigvals

        arm, joints, elastic = self.arm, self.arm.joint_index, self._model.elastic
        rest = equilibrium(arm, item.posture)
        model = linearize(arm, rest, outputs=tuple(self.acceptable))
        M, k = model.mass, elastic.size
        K = model.stiffness[np.ix_(elastic, elastic)]
        flexibility = np.asarray(np.linalg.inv(K), dtype=np.float64)
        inverse = np.linalg.inv(M)[np.ix_(elastic, elastic)]
        pull = inverse @ K
        drag = inverse @ model.damping[np.ix_(elastic, elastic)]
        moved = np.append(elastic, arm.dof + elastic)
        A = np.block([[np.zeros((k, k)), np.eye(k)], [-pull, -drag]])
        A, B = held(A, model.B[moved], self.sample_time)
        size = sizes_of(where, "acceptable", model, self.acceptable)
        wanted = rows_of(model, tuple(self.acceptable))[:, moved] / size[:, None]
        price = np.diag(self.wishes.acceptable_torque**-2.0)
        weighed = wanted.T @ wanted
        stiffness, energy = bending(arm, model, self.wishes.acceptable_torque)
        weighed[:k, :k] += bend_weight(self.wishes.rigidity_uncertainty, stiffness, energy)
        gain, cost = regulator(where, A, B, weighed, price)
        frequency: FloatArray = np.sort(np.sqrt(np.abs(eigvals(pull))))
        fast = FastDesign(frequency, flexibility, A, B, gain, cost)
        rigid, coupling = M[np.ix_(joints, joints)], M[np.ix_(joints, elastic)]
        # As the joints turn, gravity bends the links and turns the joints: (C.38).
        whole = model.stiffness
        sag = -flexibility @ whole[np.ix_(elastic, joints)]
        weight = whole[np.ix_(joints, joints)] + whole[np.ix_(joints, elastic)] @ sag
        # The slow angles by the state, but for the bend that goes with the acceleration: (C.35).
        carried = np.linalg.solve(rigid, coupling)
        alone = np.linalg.inv(np.eye(arm.joints) + carried @ sag)
        slow, rate = np.zeros((2, arm.joints, 2 * arm.dof))
        slow[:, joints], slow[:, elastic] = alone, alone @ carried
        rate[:, arm.dof + joints], rate[:, arm.dof + elastic] = alone, alone @ carried
        # Acceleration that the slow part requests; its bend moves the slow angles in turn.
        stiff, damped = self.bandwidth**2, 2.0 * self.damping_ratio * self.bandwidth
        bend = -flexibility @ coupling.T
        moves = alone @ carried @ bend
        asked = -stiff[:, None] * slow - damped[:, None] * rate
        asked = np.asarray(np.linalg.solve(np.eye(arm.joints) - stiff[:, None] * moves, asked))
        slow -= moves @ asked
        swing = np.zeros((2 * k, 2 * arm.dof))
        swing[np.arange(2 * k), moved] = 1.0
        swing[:k] -= bend @ asked + sag @ slow
        return fast, replace(item, gain=gain @ swing - rigid @ asked - weight @ slow)

    def _known_force_gain(self, item: Design) -> FloatArray:
        """The bend under the reference's own forces is no deviation: (C.37)."""
        at = [np.array_equal(item.posture, other.posture) for other in self.designs].index(True)
        bent = item.gain[:, self._model.elastic] @ self.fast_designs[at].flexibility
        return -bent[:, None, :]
