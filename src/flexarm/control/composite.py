"""Composite control: slow motion of the joints, fast vibration of the links; (C.32) to (C.36)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigvals

from flexarm.arm import Arm
from flexarm.control.base import Controller, FloatArray, Measurement, Reference
from flexarm.control.flexible_model import FlexibleModel
from flexarm.control.linear_design import (
    DISTURBANCES,
    check_names,
    columns_of,
    held,
    kalman,
    positive_time,
    regulator,
    rows_of,
    scales,
    sizes_of,
)
from flexarm.control.nominal import strain_matrix
from flexarm.control.posture_grid import Interpolated, PostureGrid
from flexarm.control.rigid_model import RigidModel
from flexarm.errors import InputError, Problem, check_array, shown
from flexarm.linear.equilibrium import equilibrium
from flexarm.linear.linearize import linearize

#: What the fast part may weigh: outputs that the links' bending alone decides.
_BENDING = (
    "strain",
    "link_tip_deflection",
    "link_tip_slope",
    "link_tip_deflection_rate",
    "link_tip_slope_rate",
)
_BRISK = 10.0


class FastDesign(NamedTuple):
    """Gains of the fast part at one posture; the state is (deviation of bending, its rate), 2 k.

    Attributes:
        posture: (joints,) rad. flexibility: (k, k) bending per elastic force.
        frequency: (k,) of the boundary layer, rad/s, lowest first.
        A, B: sampled, (2 k, 2 k), (2 k, joints). C: strains, (gauges, 2 k).
        gain: (joints, 2 k). cost: (2 k, 2 k). estimator: (2 k, gauges).
    """

    posture: FloatArray
    flexibility: FloatArray
    frequency: FloatArray
    A: FloatArray
    B: FloatArray
    C: FloatArray
    gain: FloatArray
    cost: FloatArray
    estimator: FloatArray


class Composite(Controller):
    """Computed torque of the rigid arm, and damping of how links swing about their bend.

    The bend that goes with the slow motion, and the torque it takes, come from one evaluation of
    the inverse dynamics; gauges tell how the links depart from that bend, a Kalman filter makes the
    rest of the fast state of it, and a linear-quadratic gain brings it back.

    Args:
        arm: what the controller believes; with gauges.
        posture: (joints,) rad where the fast part is designed; zeros by default.
        schedule: grid of postures, as for `LQG`.
        bandwidth: rad/s of the joint errors, one number or one for each joint.
        damping_ratio: of the joint errors, likewise.
        acceptable: outputs of `linearize` that bending alone decides, and the deviation of each
            that counts as much as the others'; by default 5 mm of ``link_tip_deflection`` and
            0.05 m/s of its rate.
        acceptable_torque: N m of the fast part, one number or one for each joint; by default what
            gives each joint of the rigid arm 10 rad/s^2.
        strain_noise: standard deviation of each reading of a gauge.
        disturbance: inputs of `linearize` that act unseen, and their standard deviations.
        sample_time: s. Setting it later designs anew.

    Attributes:
        designs: for every posture of the grid, the `FastDesign`.

    Raises:
        InputError: a wrong shape, name or number; an arm without gauges.

    Siciliano and Book 1988.
    """

    name = "composite"
    references: ClassVar[str] = "SicilianoBook1988"

    def __init__(
        self,
        arm: Arm,
        posture: ArrayLike | None = None,
        *,
        schedule: Sequence[ArrayLike | None] | None = None,
        bandwidth: ArrayLike = 6.0,
        damping_ratio: ArrayLike = 1.0,
        acceptable: Mapping[str, ArrayLike] | None = None,
        acceptable_torque: ArrayLike | None = None,
        strain_noise: ArrayLike = 2e-5,
        disturbance: Mapping[str, ArrayLike] | None = None,
        sample_time: float = 1e-3,
    ) -> None:
        if not isinstance(arm, Arm):
            raise InputError(Problem("Composite", "arm", "be an Arm", shown(arm)))
        if not arm.gauges:
            hint = "The fast part measures with them: Link(gauges=[Gauge(...)])."
            raise InputError(Problem("Composite", "arm", "have strain gauges", "without", hint))
        self.arm, joints = arm, arm.joints
        given = np.zeros(joints) if posture is None else posture
        self.posture = check_array("Composite", "posture", given, (joints,))
        self.schedule = schedule
        self.bandwidth = scales("Composite", "bandwidth", bandwidth, joints)
        self.damping_ratio = scales("Composite", "damping_ratio", damping_ratio, joints)
        if acceptable is None:
            acceptable = {"link_tip_deflection": 0.005, "link_tip_deflection_rate": 0.05}
        self.acceptable = check_names("Composite", "acceptable", acceptable, _BENDING)
        if acceptable_torque is None:
            acceptable_torque = _BRISK * np.diag(RigidModel(arm).mass_matrix(self.posture))
        torque = scales("Composite", "acceptable_torque", acceptable_torque, joints)
        self.acceptable_torque = torque
        self.strain_noise = scales("Composite", "strain_noise", strain_noise, len(arm.gauges))
        if disturbance is None:
            push = 0.2 * np.max(torque) / float(np.sum(arm.lengths))
            disturbance = {"torque": 0.1 * torque, "tip_force": push}
        self.disturbance = check_names("Composite", "disturbance", disturbance, DISTURBANCES)
        self._model = FlexibleModel(arm)
        self._strains = strain_matrix(arm)[:, self._model.elastic]
        self._straight = np.zeros(self._model.elastic.size)
        self._grid = PostureGrid("Composite", self.posture, schedule)
        self.sample_time = sample_time

    @property
    def sample_time(self) -> float:  # type: ignore[override]
        """Time between samples, s."""
        return self._sample_time

    @sample_time.setter
    def sample_time(self, value: float) -> None:
        self._sample_time = positive_time("Composite", value)
        self.designs = tuple(self._design(posture) for posture in self._grid.postures)
        k, m = self._straight.size, self.arm.joints
        self._arrays = Interpolated(self._grid, [_node(item) for item in self.designs])
        self._flexibility, self._correct, self._gain, self._predict = self._arrays.arrays
        self._known = np.zeros(2 * k + len(self.arm.gauges))  # the prediction, then the strains
        self._pushed = np.zeros(2 * k + m)  # the estimate, then the fast torque
        self.reset()

    @property
    def epsilon(self) -> float:
        """The fastest bandwidth over the slowest frequency of the boundary layer; (C.33)."""
        return float(np.max(self.bandwidth) / min(item.frequency[0] for item in self.designs))

    def reset(self) -> None:
        """Forget the estimate and the angles held."""
        self._known[:] = 0.0
        self._held: FloatArray | None = None

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``."""
        angle, rate = measurement.joint_angle, measurement.joint_rate
        if reference is None:
            if self._held is None:
                self._held = angle.copy()
            wanted, wanted_rate, wanted_acceleration = self._held, 0.0 * rate, 0.0 * rate
        else:
            wanted, wanted_rate = reference.joint_angle(t), reference.joint_rate(t)
            wanted_acceleration = reference.joint_acceleration(t)
        self._arrays.move(wanted)
        w = self.bandwidth
        slow = wanted_acceleration + w * (w * (wanted - angle))
        slow = slow + 2.0 * self.damping_ratio * w * (wanted_rate - rate)
        torque, force = self._model.forces(angle, rate, slow, self._straight)
        bend = self._flexibility @ force  # less than zero: what the links lack to follow
        n = self._gain.shape[1]
        self._known[n:] = measurement.strain + self._strains @ bend
        self._pushed[:n] = self._correct @ self._known
        self._pushed[n:] = fast = -(self._gain @ self._pushed[:n])
        self._known[:n] = self._predict @ self._pushed
        answer: FloatArray = torque + fast
        return answer

    def _design(self, posture: FloatArray) -> FastDesign:
        """Design the fast part at rest in a posture; (C.34) to (C.36)."""
        where, arm, elastic = "Composite", self.arm, self._model.elastic
        names = tuple(dict.fromkeys([*self.acceptable, "strain"]))
        inputs = tuple(dict.fromkeys(["torque", *self.disturbance]))
        model = linearize(arm, equilibrium(arm, posture), inputs=inputs, outputs=names)
        K = model.stiffness[np.ix_(elastic, elastic)]
        D = model.damping[np.ix_(elastic, elastic)]
        inverse = np.linalg.inv(model.mass)[np.ix_(elastic, elastic)]
        k, moved = elastic.size, np.append(elastic, arm.dof + elastic)
        A = np.block([[np.zeros((k, k)), np.eye(k)], [-inverse @ K, -inverse @ D]])
        A, B_all = held(A, model.B[moved], self.sample_time)
        wanted = rows_of(model, tuple(self.acceptable))[:, moved]
        wanted = wanted / sizes_of(where, "acceptable", model, self.acceptable)[:, None]
        B = B_all[:, : arm.joints]
        price = np.diag(self.acceptable_torque**-2.0)
        gain, cost = regulator(where, A, B, wanted.T @ wanted, price)
        strength = sizes_of(where, "disturbance", model, self.disturbance)
        pushed = columns_of(model, tuple(self.disturbance), B_all) * strength
        C = rows_of(model, ("strain",))[:, moved]
        noise = np.diag(self.strain_noise**2)
        estimator = kalman(where, A, C, pushed @ pushed.T, noise)[0]
        frequency = np.sort(np.sqrt(np.abs(eigvals(inverse @ K))))
        return FastDesign(
            posture, np.linalg.inv(K), frequency, A, B, C, gain, cost, estimator
        )


def _node(item: FastDesign) -> list[FloatArray]:
    """Arrays that are interpolated over posture."""
    kept = np.eye(len(item.A)) - item.estimator @ item.C
    return [
        item.flexibility,
        np.hstack([kept, item.estimator]),
        item.gain,
        np.hstack([item.A, item.B]),
    ]

