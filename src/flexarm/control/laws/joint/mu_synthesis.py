"""Mixed-sensitivity H-infinity and mu synthesis for an arm with uncertain rigidity and payload."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from flexarm.arm.arm import Arm
from flexarm.arm.bending import one_warning, warn_of_first
from flexarm.base.arguments import check_positive
from flexarm.base.errors import (
    FlexarmWarning,
    InputError,
    Problem,
    UnstableLoopWarning,
    few,
    public_call,
    warn_caller,
)
from flexarm.control.analysis.dk_iteration import dk_iteration
from flexarm.control.contract.base import (
    Arrays,
    ControllerRequirements,
    FloatArray,
    Measurement,
    Reference,
)
from flexarm.control.contract.gains import applied
from flexarm.control.contract.parametrised import OfArm
from flexarm.control.contract.requirements import JOINTS
from flexarm.control.design.default_requirements import BANDWIDTH, typical_rate
from flexarm.control.design.loop_shaping import coprime_controller, sampled_growth
from flexarm.control.design.uncertain_plant import UncertainPlant, uncertain_plant
from flexarm.control.laws.joint.follower import JointFollower
from flexarm.model.drives.linear import MuSynthesisParameters

#: Growth in a sample time that is rounding.
_ROUNDING = 1e-7
#: Ratio of the norm to the least one: the optimal controller has poles that are too fast to sample.
_SUBOPTIMALITY = 1.05
#: Least and largest angle between samples at the bandwidth, rad: below, rounding errors dominate;
#: above, with fewer than 13 samples in a period, the scalings have no frequencies between them.
_LEAST_ANGLE, _LARGEST_ANGLE = 1e-5, 0.5
#: Frequencies of the bounds in rad/s, relative to the bandwidth or to half the sampling rate.
_LOWEST, _LOW, _DENSE, _FASTEST = 1e-4, 0.05, 70, 100.0


class MuSynthesis(JointFollower, MuSynthesisParameters, OfArm):
    """Mixed-sensitivity control of the joints by D-K iteration, for uncertain rigidity and payload.

    The differences between the arm and arms of `varied` are blocks of uncertainty. The controller
    minimises the structured singular value of the sensitivity at the motors over these blocks.
    Without uncertainty it is an H-infinity controller. The synthesis needs slycot (extra
    ``robust``). Without a reference the controller keeps the angles of its first measurement.

    It has no integral action, and its slowest pole is near 1/20 of the bandwidth. With gravity, add
    the gravity torque by ``feedforward``; otherwise the arm sags.

    Attributes:
        mu: largest upper bound of the structured singular value on a grid of frequencies. Below
            one, the sensitivity at the motors is at most ``sensitivity`` for all arms within the
            uncertainty. Its norm is that of torques normalised by the inertia, not of N m.
        gamma: bound on the H-infinity norm of the scaled loop in the synthesis of this controller.
        history: largest upper bound after each iteration.
        A, B, C, D: sampled state-space matrices from the errors of the joint angles (rad) and rates
            (rad/s) to the torques (N m); ``loop_models`` exports them with names.

    Raises:
        InputError: if a shape or number is wrong, ``bandwidth`` does not fit ``sample_time``,
            slycot is not installed, or the synthesis fails.
        EquilibriumError: if the arm has no equilibrium at the posture.

    Warns:
        UnstableLoopWarning: if the loop with the arm itself, without the damping that stands for
            ``rigidity_uncertainty``, is unstable.
        FlexarmWarning: if ``mu`` exceeds one, or an uncertainty has no effect, because the arm has
            no payload or no flexible link.
    """

    analytic = True
    references: ClassVar[str] = "SkogestadPostlethwaite2005 CollinsKingBernstein1992"

    _: KW_ONLY
    feedforward: Callable[[float], ArrayLike] | None = Field(default=None)

    def __post_init__(self) -> None:
        super().__post_init__()
        joints = self.arm.joints
        self.posture = np.zeros(joints) if self.posture is None else np.array(self.posture)
        # The property reads another attribute, which the design sets.
        rate = typical_rate(self.arm, vars(self)["sample_time"])
        self.bandwidth = (
            np.full(joints, BANDWIDTH * rate) if self.bandwidth is None else self.bandwidth
        )
        # The constructor leaves the number in the dictionary of the object, under the property.
        sample_time = vars(self).pop("sample_time")
        self._check_bandwidth(sample_time)
        self._warn_of_no_effect()
        self._design_for(sample_time)

    @property  # type: ignore[misc]
    def sample_time(self) -> float:
        """Time between samples, s."""
        return self._sample_time

    @sample_time.setter
    @public_call
    def sample_time(self, value: float) -> None:
        self._check_bandwidth(check_positive("sample_time", value))
        self._design_for(float(value))

    def _check_bandwidth(self, sample_time: float) -> None:
        """Raise if the bandwidth is too low or too high for a sample time (s)."""
        bandwidth = np.asarray(self.bandwidth)
        low, high = _LEAST_ANGLE / sample_time, _LARGEST_ANGLE / sample_time
        if low <= bandwidth.min() and bandwidth.max() <= high:
            return
        rule = f"be {low:.3g} to {high:.3g} rad/s at this sample_time"
        least, most = _LEAST_ANGLE / bandwidth.min(), _LARGEST_ANGLE / bandwidth.max()
        hint = f"For this bandwidth, sample_time can be {least:.3g} to {most:.3g} s."
        hint = hint if least < most else "Its values differ too much."
        raise InputError(Problem("bandwidth", rule, few(bandwidth), hint))

    def _design_for(self, sample_time: float) -> None:
        """Design the controller for a sample time (s)."""
        self._sample_time = sample_time
        with one_warning() as bent:
            plant = uncertain_plant(
                self.arm,
                np.asarray(self.posture),
                np.asarray(self.bandwidth),
                rigidity=self.rigidity_uncertainty,
                payload=self.payload_uncertainty,
                sensitivity=self.sensitivity,
                sample_time=sample_time,
            )
        warn_of_first(bent)
        self._synthesise(plant)
        self.reset()

    def _synthesise(self, plant: UncertainPlant) -> None:
        from scipy.signal import cont2discrete

        found = dk_iteration(
            plant.whole,
            plant.blocks,
            self._frequencies(plant),
            iterations=self.iterations,
            order=self.scaling_order,
            band=(0.1 * float(np.min(np.asarray(self.bandwidth))), 0.5 / self.sample_time),
            suboptimality=_SUBOPTIMALITY,
            start=coprime_controller(*plant.nominal, 1.1)[:4],
        )
        self.mu, self.gamma, self.history = found.mu, found.gamma, found.history
        A, B, C, D = found[:4]
        whole = A, B @ plant.shown, plant.root @ C, plant.root @ D @ plant.shown
        sampled = cont2discrete(whole, self.sample_time, method="bilinear")[:4]
        self.A, self.B, self.C, self.D = sampled
        growth = sampled_growth(plant.model, sampled, self.sample_time)
        if growth * self.sample_time > _ROUNDING:
            text = (
                f"The loop with the arm itself is unstable: deviations grow by {growth:.3g} 1/s. "
                "mu is that of the model with the damping of rigidity_uncertainty. Reduce the "
                "bandwidth or rigidity_uncertainty, or give the links damping."
            )
            warn_caller(text, UnstableLoopWarning)
        if self.mu > 1.0:
            text = (
                f"mu is {self.mu:.3g}: above 1, neither stability nor sensitivity is guaranteed "
                "for all arms within the uncertainty. Reduce the bandwidth or the uncertainties, "
                "or increase iterations, scaling_order or sensitivity."
            )
            warn_caller(text, FlexarmWarning)

    def _warn_of_no_effect(self) -> None:
        """Warn of uncertainties of parameters that the arm does not have."""
        arm = self.arm
        for name, without, missing in (
            ("payload_uncertainty", not arm.spec.payload.mass, "payload"),
            ("rigidity_uncertainty", arm.dof == arm.joints, "flexible link"),
        ):
            if without and getattr(self, name):
                text = f"{name} has no effect: the arm has no {missing}. Set {name}=0."
                warn_caller(text, FlexarmWarning)

    def _frequencies(self, plant: UncertainPlant) -> FloatArray:
        """Return frequencies (f,) rad/s in the bilinear variable, dense around resonances."""
        low, fast = _LOW * float(np.min(np.asarray(self.bandwidth))), 2.0 / self.sample_time
        poles = np.linalg.eigvals(plant.nominal[0])
        near = np.abs(poles.imag)[:, None] + poles.real[:, None] * np.linspace(-2.0, 2.0, 5)
        parts = (
            np.geomspace(_LOWEST * low, 0.9 * low, 12),
            np.geomspace(low, fast, _DENSE),
            np.geomspace(1.2 * fast, _FASTEST * fast, 8),
            near[(near > low) & (near < fast)],
        )
        return np.unique(np.concatenate(parts))

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        """See ``Controller.requirements``."""
        return ControllerRequirements(self.arm.joints, JOINTS)

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        """See ``Controller.initial_memory``."""
        return {"state": np.zeros((*readings.joint_angle.shape[:-1], len(self.A)))}

    def step(
        self, memory: Arrays, readings: Measurement, inputs: Arrays
    ) -> tuple[Arrays, FloatArray]:
        """See ``Controller.step``."""
        state, angle = memory["state"], inputs["reference_angle"]
        errors = readings.joint_angle - angle, readings.joint_rate - inputs["reference_rate"]
        error = np.concatenate(errors, axis=-1)
        torque = applied(self.C, state) + applied(self.D, error)
        if self.feedforward is not None:
            torque = torque + inputs["feedforward"]
        return {"state": applied(self.A, state) + applied(self.B, error)}, torque
