"""Robust control of the joints: H-infinity loop shaping, (C.140) to (C.144), and mu synthesis."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import KW_ONLY
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from flexarm.arm.arm import Arm, varied
from flexarm.arm.bending import one_warning
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
from flexarm.base.late import linalg, scipy
from flexarm.control.analysis.structured import dk_iteration
from flexarm.control.contract.base import (
    JOINTS,
    Arrays,
    ControllerRequirements,
    FloatArray,
    Measurement,
    Reference,
    Step,
    applied,
)
from flexarm.control.contract.parametrised import OfArm
from flexarm.control.design.arm_scales import BANDWIDTH, check_sample_time, typical_rate
from flexarm.control.design.loop_hardware import OF_DESIGN, refuse_both
from flexarm.control.design.loop_shaping import (
    DAMPING,
    Matrices,
    ShapedDesign,
    added_damping,
    bilinear,
    coprime_controller,
    given_hardware,
    sampled_growth,
    shaped_design,
    shaping,
)
from flexarm.control.design.minimal import without_dry_friction
from flexarm.control.design.nominal import Interpolated, PostureGrid
from flexarm.control.hardware.sampled_plant import held
from flexarm.control.laws.joint_laws import JointFollower
from flexarm.linear.models.linearize import linearize
from flexarm.linear.models.state_space import LinearModel
from flexarm.linear.statics.equilibrium import equilibrium
from flexarm.model import Hardware
from flexarm.model.drives.linear import (
    LoopShapingParameters,
    MuSynthesisParameters,
    RobustParameters,
)

#: Growth in a sample time that is rounding.
_STILL = 1e-9


class RobustFollower(JointFollower, RobustParameters, OfArm):
    """Base of controllers that are designed for a sample time, with joint readings alone."""

    compensates_friction = False
    _unsupported = None

    _: KW_ONLY
    feedforward: Callable[[float], ArrayLike] | None = Field(default=None)

    def __post_init__(self) -> None:
        super().__post_init__()
        joints = self.arm.n_joints
        self.posture = np.zeros(joints) if self.posture is None else np.array(self.posture)
        # The property reads another attribute, which the design sets.
        rate = typical_rate(self.arm, vars(self)["sample_time"])
        if self.bandwidth is None:
            self.bandwidth = np.full(joints, BANDWIDTH * rate)
        self._states = 0  # of the controller, set by the design
        # The constructor leaves the number in the dictionary of the object, under the property.
        self._sample_time: float = vars(self).pop("sample_time")
        self._design_for(self._sample_time)

    @property
    def sample_time(self) -> float:
        """Time between samples, s."""
        return self._sample_time

    @sample_time.setter
    @public_call
    def sample_time(self, value: float) -> None:
        self._design_for(check_positive("sample_time", value))

    @abstractmethod
    def _design_for(self, sample_time: float) -> None:
        """Design the controller for a sample time (s)."""

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        return ControllerRequirements(self.arm.n_joints, JOINTS)

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        return {"state": np.zeros((*readings.joint_angle.shape[:-1], self._states))}

    def _errors(self, readings: Measurement, inputs: Arrays) -> FloatArray:
        """Return the errors of angles and rates, (..., 2 joints)."""
        angle, rate = inputs["reference_angle"], inputs["reference_rate"]
        return np.concatenate([readings.joint_angle - angle, readings.joint_rate - rate], axis=-1)


class LoopShaping(RobustFollower, LoopShapingParameters):
    """H-infinity loop shaping: feedback of joint angles and rates with a guaranteed margin.

    Weights with the mass matrix of the rigid arm shape the linear model of the flexible arm. The
    controller is the most robust one against changes of the normalised coprime factors of this
    shaped plant. Its states are those of an observer of the flexible arm, without gauges. Without a
    reference the controller keeps the angles of its first measurement.

    Attributes:
        designs: the `ShapedDesign` of each posture of the grid, with its ``margin``.

    Raises:
        InputError: if a shape or number is wrong, ``sample_time`` is too long for the bandwidth or
            the arm, or the Riccati equations have no solution.
        EquilibriumError: if the arm has no equilibrium at a posture.

    Warns:
        UnstableLoopWarning: if the loop with the arm itself, without the damping that stands for
            ``rigidity_uncertainty``, is unstable.
    """

    _: KW_ONLY
    hardware: Hardware | None = Field(default=None, description=OF_DESIGN)

    @property
    def analytic(self) -> bool:  # type: ignore[override]
        """Whether ``step`` accepts complex numbers, over which gains are not interpolated."""
        return self.schedule is None

    references: ClassVar[str] = "McFarlaneGlover1992 HydeGlover1993 CollinsKingBernstein1992"

    def _design_for(self, sample_time: float) -> None:
        refuse_both(self)
        check_sample_time(self.arm, sample_time, self.bandwidth)
        self._grid = PostureGrid(np.asarray(self.posture), self.schedule)
        self._sample_time = sample_time
        with one_warning():
            self.designs: tuple[ShapedDesign, ...] = tuple(
                shaped_design(self.arm, posture, self, sample_time)
                for posture in self._grid.postures
            )
        worst = max(self.designs, key=lambda one: one.growth)
        if worst.growth * sample_time > _STILL:
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

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        known = np.concatenate([memory["state"], self._errors(readings, inputs)], axis=-1)
        result = applied(self._arrays.at(inputs["reference_angle"])[0], known)
        state, torque = result[..., : self._states], result[..., self._states :]
        return {"state": state}, self._with_feedforward(torque, inputs)


#: Growth in a sample time that is rounding.
_ROUNDING = 1e-7
#: Ratio of the norm to the least one: the optimal controller has poles that are too fast to sample.
_SUBOPTIMALITY = 1.05
#: Least and largest angle between samples at the bandwidth, rad: below, rounding errors dominate;
#: above, with fewer than 13 samples in a period, the scalings have no frequencies between them.
_LEAST_ANGLE, _LARGEST_ANGLE = 1e-5, 0.5
#: Frequencies of the bounds in rad/s, relative to the bandwidth or to half the sampling rate.
_LOWEST, _LOW, _DENSE, _FASTEST = 1e-4, 0.05, 70, 100.0


class MuSynthesis(RobustFollower, MuSynthesisParameters):
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

    def _design_for(self, sample_time: float) -> None:
        bandwidth = np.asarray(self.bandwidth)
        low, high = _LEAST_ANGLE / sample_time, _LARGEST_ANGLE / sample_time
        if not (low <= bandwidth.min() and bandwidth.max() <= high):
            rule = f"be {low:.3g} to {high:.3g} rad/s at this sample_time"
            least, most = _LEAST_ANGLE / bandwidth.min(), _LARGEST_ANGLE / bandwidth.max()
            hint = f"For this bandwidth, sample_time can be {least:.3g} to {most:.3g} s."
            hint = hint if least < most else "Its values differ too much."
            raise InputError(Problem("bandwidth", rule, few(bandwidth), hint))
        check_sample_time(self.arm, sample_time)
        if not hasattr(self, "mu"):  # once, at the construction
            arm = self.arm
            for name, without, missing in (
                ("payload_uncertainty", not arm.spec.payload.mass, "payload"),
                ("rigidity_uncertainty", arm.dof == arm.n_joints, "flexible link"),
            ):
                if without and getattr(self, name):
                    text = f"{name} has no effect: the arm has no {missing}. Set {name}=0."
                    warn_caller(text, FlexarmWarning)
        self._sample_time = sample_time
        with one_warning():
            plant = uncertain_plant(self.arm, self, sample_time)
        self._synthesise(plant)
        self.reset()

    def _synthesise(self, plant: UncertainPlant) -> None:
        search = self._frequencies(plant), self.iterations, self.scaling_order
        band = 0.1 * float(np.min(np.asarray(self.bandwidth))), 0.5 / self.sample_time
        start = coprime_controller(*plant.nominal, 1.1)[:4]
        synthesis = dk_iteration(plant.whole, plant.blocks, *search, band, _SUBOPTIMALITY, start)
        self.mu, self.gamma, self.history = synthesis.mu, synthesis.gamma, synthesis.history
        A, B, C, D = synthesis[:4]
        whole = A, B @ plant.shown, plant.root @ C, plant.root @ D @ plant.shown
        sampled = scipy.signal.cont2discrete(whole, self.sample_time, method="bilinear")[:4]
        self.A, self.B, self.C, self.D = sampled
        self._states = len(self.A)
        growth = sampled_growth(plant.model, sampled, given_hardware(self, self.sample_time))
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

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        state, error = memory["state"], self._errors(readings, inputs)
        torque = self._with_feedforward(applied(self.C, state) + applied(self.D, error), inputs)
        return {"state": applied(self.A, state) + applied(self.B, error)}, torque


#: Rank of a change: smallest eigenvalue, relative to the largest. Rounding is 1e-12, and the
#: smallest eigenvalues of changes of links with a few elements are 1e-4, or 1e-7 with gravity.
_RANK = 1e-9
#: Change that is rounding, relative to the largest entry of the matrix.
_UNCHANGED = 1e-10
#: Sensitivity at low frequencies that the performance weight accepts.
_SLOW = 0.1
#: Noise and weight of the shaped output. Without them the synthesis has no solution, because the
#: rigid motion would neither be disturbed nor penalised; a small weight makes it slow.
_NOISE, _OUTPUT = 0.1, 0.4
#: Bandwidth of the sensitivity relative to that of the loop shape.
_SENSITIVITY_BANDWIDTH = 0.5


class UncertainPlant(NamedTuple):
    """Generalised plant of a design, continuous in the bilinear variable of (C.140)."""

    whole: Matrices  # from (uncertainty, performance, torque) to the same; torques are normalised
    nominal: Matrices  # from the normalised torque to the shaped output
    blocks: tuple[int, ...]  # sizes of the blocks; the last one is the performance
    root: FloatArray  # (joints, joints), torque of a normalised one
    shown: FloatArray  # (joints, 2 joints), shaped output of the errors of angles and rates
    model: LinearModel  # the linear model of the arm itself


def uncertain_plant(arm: Arm, given: MuSynthesisParameters, sample_time: float) -> UncertainPlant:
    """Return the plant of a design at rest in a posture, with the uncertainty of varied arms."""
    posture, bandwidth = np.asarray(given.posture), np.asarray(given.bandwidth)
    rigidity, arm = given.rigidity_uncertainty, without_dry_friction(arm)
    model = linearize(arm, equilibrium(arm, posture), outputs=("joint_angle", "joint_rate"))
    n, slope = arm.dof, model.A.copy()
    # Full complex blocks contain negative loss factors, with which light damping is unstable.
    slope[n:, n:] -= added_damping(arm, model, DAMPING * rigidity)
    root, shown = shaping(arm, posture, bandwidth)
    changes = _changes(arm, posture, model, rigidity, given.payload_uncertainty)
    pushes = [-np.linalg.solve(model.mass, factor) for _, factor, _ in changes]
    push = np.hstack([np.zeros((n, 0)), *pushes])
    inputs = np.hstack([np.vstack([0.0 * push, push]), model.B @ root])
    outputs, direct = [], []
    for kind, _, factor in changes:
        of_mass = kind == "mass"
        row = np.hstack([factor.T, 0.0 * factor.T])
        outputs.append(factor.T @ slope[n:] if of_mass else row)
        direct.append((factor.T if of_mass else 0.0 * factor.T) @ inputs[n:])
    outputs.append(shown @ model.C)
    direct.append(np.zeros((arm.n_joints, inputs.shape[1])))
    A, B, C, D = bilinear(*held(slope, inputs, sample_time), np.vstack(outputs), sample_time)
    D += np.vstack(direct)
    blocks = tuple(factor.shape[1] for _, factor, _ in changes)
    first = sum(blocks)
    nominal = A, B[:, first:], C[first:], D[first:, first:]
    corner = _SENSITIVITY_BANDWIDTH * float(np.min(bandwidth))
    whole = _with_performance((A, B, C, D), first, corner, given.sensitivity)
    return UncertainPlant(whole, nominal, (*blocks, 2 * arm.n_joints), root, shown, model)


def _changes(
    arm: Arm, posture: FloatArray, model: LinearModel, rigidity: float, payload: float
) -> list[tuple[str, FloatArray, FloatArray]]:
    """Return the changes of stiffness and mass as products left right' of factors (dof, k).

    With gravity, both matrices depend on both changes, because the arm sags by another amount.
    """
    others = []
    if rigidity and arm.dof > arm.n_joints:
        others.append(varied(arm, flexural_rigidity_factor=1.0 + rigidity))
    if payload and arm.spec.payload.mass:
        others.append(varied(arm, payload_factor=1.0 + payload))
    found = []
    for other in others:
        there = linearize(other, equilibrium(other, posture))
        for kind in ("stiffness", "mass"):
            own = getattr(model, kind)
            change = getattr(there, kind) - own
            if np.abs(change).max() > _UNCHANGED * np.abs(own).max():
                found.append((kind, *_factors(change)))
    return found


def _factors(change: FloatArray) -> tuple[FloatArray, FloatArray]:
    values, vectors = np.linalg.eigh(0.5 * (change + change.T))
    kept = np.abs(values) > _RANK * np.abs(values).max()
    right = vectors[:, kept] * np.sqrt(np.abs(values[kept]))
    return right * np.sign(values[kept]), right


def _with_performance(plant: Matrices, first: int, corner: float, sensitivity: float) -> Matrices:
    """Return the generalised plant: performance of disturbing torques and noise is added."""
    A, B, C, D = plant
    n, m = len(A), len(C) - first
    one, none = np.eye(m), np.zeros
    slow, through = corner * _SLOW, 1.0 / sensitivity
    B_d, B_u, C_d, C_y = B[:, :first], B[:, first:], C[:first], C[first:]
    D_dd, D_du = D[:first, :first], D[:first, first:]
    D_yd, D_yu = D[first:, :first], D[first:, first:]
    states = linalg.block_diag(A, -slow * one)
    inputs = np.block([[B_d, B_u, none((n, m)), B_u], [none((m, first)), one, none((m, m)), one]])
    slowed = [none((m, n)), (corner - slow * through) * one]
    zero = none((m, m))
    outputs = np.block([[C_d, none((first, m))], slowed, [_OUTPUT * C_y, zero], [C_y, zero]])
    uncertain = [D_dd, D_du, none((first, m)), D_du]
    slowed = [none((m, first)), through * one, zero, through * one]
    seen = [_OUTPUT * D_yd, _OUTPUT * D_yu, zero, _OUTPUT * D_yu]
    direct = np.block([uncertain, slowed, seen, [D_yd, D_yu, _NOISE * one, D_yu]])
    return states, inputs, outputs, direct
