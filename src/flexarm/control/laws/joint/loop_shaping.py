"""H-infinity loop shaping of the joint angles of a flexible arm; (C.140) to (C.144)."""

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
from flexarm.base.errors import UnstableLoopWarning, few, public_call, warn_caller
from flexarm.control.contract.base import (
    JOINTS,
    Arrays,
    ControllerRequirements,
    Measurement,
    Reference,
    Step,
    applied,
)
from flexarm.control.contract.parametrised import OfArm
from flexarm.control.design.arm_scales import BANDWIDTH, typical_rate
from flexarm.control.design.loop_shaping import ShapedDesign, shaped_design
from flexarm.control.design.nominal import Interpolated, PostureGrid
from flexarm.control.laws.joint.joint_pd import JointFollower
from flexarm.model.drives.linear import LoopShapingParameters

#: Growth in a sample time that is rounding.
_ROUNDING = 1e-9


class LoopShaping(JointFollower, LoopShapingParameters, OfArm):
    """H-infinity loop shaping: feedback of joint angles and rates with a guaranteed margin.

    Weights with the mass matrix of the rigid arm shape the linear model of the flexible arm. The
    controller is the most robust one against changes of the normalised coprime factors of this
    shaped plant. Its states are those of an observer of the flexible arm, without gauges. Without a
    reference the controller keeps the angles of its first measurement.

    Attributes:
        designs: the `ShapedDesign` of each posture of the grid, with its ``margin``.

    Raises:
        InputError: if a shape or number is wrong, a bandwidth is not below the Nyquist frequency
            of ``sample_time``, or the Riccati equations have no solution.
        EquilibriumError: if the arm has no equilibrium at a posture.

    Warns:
        UnstableLoopWarning: if the loop with the arm itself, without the damping that stands for
            ``rigidity_uncertainty``, is unstable.
    """

    @property
    def analytic(self) -> bool:  # type: ignore[override]
        """Whether ``step`` accepts complex numbers, over which gains are not interpolated."""
        return self.schedule is None

    references: ClassVar[str] = "McFarlaneGlover1992 HydeGlover1993 CollinsKingBernstein1992"

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
        self._grid = PostureGrid(self.posture, self.schedule)
        # The constructor leaves the number in the dictionary of the object, under the property.
        self._design_for(vars(self).pop("sample_time"))

    @property  # type: ignore[misc]
    def sample_time(self) -> float:
        """Time between samples, s."""
        return self._sample_time

    @sample_time.setter
    @public_call
    def sample_time(self, value: float) -> None:
        self._design_for(check_positive("sample_time", value))

    def _design_for(self, sample_time: float) -> None:
        """Design the controller of each posture for a sample time (s)."""
        self._sample_time = sample_time
        with one_warning() as bent:
            self.designs: tuple[ShapedDesign, ...] = tuple(
                shaped_design(self.arm, posture, self, sample_time)
                for posture in self._grid.postures
            )
        warn_of_first(bent)
        worst = max(self.designs, key=lambda one: one.growth)
        if worst.growth * sample_time > _ROUNDING:
            text = (
                f"The loop with the arm itself is unstable at joint angles {few(worst.posture)}: "
                f"deviations grow by {worst.growth:.3g} 1/s. The margin is that of the model with "
                "the damping of rigidity_uncertainty. Reduce it, or give the links damping."
            )
            warn_caller(text, UnstableLoopWarning)
        nodes = [[np.block([[one.A, one.B], [one.C, one.D]])] for one in self.designs]
        self._arrays = Interpolated(self._grid, nodes)
        self._states = len(self.designs[0].A)
        self.reset()

    @property
    def margin(self) -> float:
        """Least robust stability margin of the designs, between 0 and 1.

        For the model with the damping that stands for ``rigidity_uncertainty``. Gains may change by
        factors from (1 - margin) / (1 + margin) to the inverse at all joints together, or phases by
        2 arcsin(margin).
        """
        return min(one.margin for one in self.designs)

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        return ControllerRequirements(self.arm.joints, JOINTS)

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        return {"state": np.zeros((*readings.joint_angle.shape[:-1], self._states))}

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        angle = inputs["reference_angle"]
        errors = readings.joint_angle - angle, readings.joint_rate - inputs["reference_rate"]
        known = np.concatenate([memory["state"], *errors], axis=-1)
        result = applied(self._arrays.at(angle)[0], known)
        state, torque = result[..., : self._states], result[..., self._states :]
        if self.feedforward is not None:
            torque = torque + inputs["feedforward"]
        return {"state": state}, torque
