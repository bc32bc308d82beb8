"""H-infinity loop shaping of a sampled arm: theory page "control-robust"."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem
from flexarm.base.late import linalg, scipy
from flexarm.control.contract.base import JOINTS
from flexarm.control.design.linear_design import rows_of
from flexarm.control.design.loop_hardware import LoopHardware
from flexarm.control.design.minimal import without_dry_friction
from flexarm.control.design.rigid_model import RigidModel
from flexarm.control.hardware.measurement import FloatArray
from flexarm.linear.models.linearize import linearize
from flexarm.linear.models.state_space import LinearModel, balanced
from flexarm.linear.statics.equilibrium import equilibrium
from flexarm.model import Hardware, Motors
from flexarm.model.drives.linear import LoopShapingParameters, RobustParameters

#: Zero of the shaped plant of a rigid arm, relative to the bandwidth: with this value the poles
#: under unit feedback of its output are real and equal.
_LEAD = 0.25
#: Damping ratio that stands for an uncertainty of one. With this value and an uncertainty of 0.3
#: the default design is stable on the three arms of docs/performance/measure_robustness.py: links
#: 30 % softer and stiffer, and twice the payload.
DAMPING = 1.0 / 3.0
Matrices = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True, eq=False)
class ShapedDesign:
    """Controller at one posture: x+ = A x + B e, torque = C x + D e.

    The input e (2 joints,) contains the errors of the joint angles (rad) and rates (rad/s).

    Attributes:
        posture: (joints,) rad.
        A, B, C, D: (n, n), (n, 2 joints), (joints, n), (joints, 2 joints).
        margin: guaranteed robust stability margin of the shaped loop, between 0 and 1: no smaller
            change of the normalised coprime factors of the shaped plant makes the loop unstable.
        best_margin: the largest margin of any controller.
        growth: largest real part of the poles of the sampled loop with the arm itself, without the
            damping that stands for the uncertainty, 1/s.
    """

    posture: FloatArray
    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    margin: float
    best_margin: float
    growth: float


def shaped_design(
    arm: Arm, posture: FloatArray, given: LoopShapingParameters, sample_time: float
) -> ShapedDesign:
    """Design a controller of the joints at rest in a posture; (C.140) to (C.144).

    The design is continuous in the bilinear variable w of (C.140), which preserves stability and
    H-infinity norms, so that the margin is that of the sampled loop.
    """
    arm = without_dry_friction(arm)
    model = linearize(arm, equilibrium(arm, posture), outputs=("joint_angle", "joint_rate"))
    slope: FloatArray = model.A.copy()
    slope[arm.dof :, arm.dof :] -= added_damping(arm, model, DAMPING * given.rigidity_uncertainty)
    bandwidth = np.asarray(given.bandwidth)
    root, shown = shaping(arm, posture, bandwidth)
    hardware = given_hardware(given, sample_time)
    design = hardware.plant(slope, model.B, joint_rows(model), whole=True)
    plant = bilinear(design.A[0], design.B, shown @ design.C[0], sample_time)
    weight = _weight(root, np.asarray(given.integral))
    A, B, C, D, margin, best = coprime_controller(*in_series(plant, weight), given.suboptimality)
    A, B, C, D = in_series(weight, (A, B, C, D))
    whole = A, B @ shown, C, D @ shown
    A, B, C, D, _ = scipy.signal.cont2discrete(whole, sample_time, method="bilinear")
    growth = sampled_growth(model, (A, B, C, D), hardware)
    return ShapedDesign(posture, A, B, C, D, margin, best, growth)


def shaping(arm: Arm, posture: FloatArray, bandwidth: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return N (joints, joints) and the shaped output (joints, 2 joints) of (C.141)."""
    half = np.asarray(np.linalg.cholesky(RigidModel(arm).mass_matrix(posture)), dtype=np.float64)
    root = half * np.sqrt(bandwidth)
    shown: FloatArray = root.T @ np.hstack([np.diag(_LEAD * bandwidth), np.eye(arm.n_joints)])
    return root, shown


def given_hardware(given: RobustParameters, sample_time: float) -> LoopHardware:
    """Return the hardware of a design, whose ``delay`` is one of the motors in whole samples."""
    hardware = getattr(given, "hardware", None)
    if hardware is None:
        late = round(getattr(given, "delay", 0.0) / sample_time)
        hardware = Hardware(motors=Motors(delay=late * sample_time))
    return LoopHardware(hardware, JOINTS, sample_time)


def joint_rows(model: LinearModel) -> dict[str, FloatArray]:
    """Return the rows of C for the joint angles and rates."""
    return {name: rows_of(model, (name,)) for name in JOINTS}


def sampled_growth(model: LinearModel, controller: Matrices, hardware: LoopHardware) -> float:
    """Return the largest real part of the poles (1/s) of an arm with a sampled controller."""
    A, B, C, D = controller
    plant = hardware.plant(model.A, model.B, joint_rows(model), whole=True)
    pushed, shown = plant.B, plant.C[0]
    loop = np.block([[plant.A[0] + pushed @ D @ shown, pushed @ C], [B @ shown, A]])
    return float(np.log(np.abs(np.linalg.eigvals(loop)).max())) / plant.sample_time


def added_damping(arm: Arm, model: LinearModel, ratio: float) -> FloatArray:
    """Return the rates of change of qd by qd of damping (dof, dof) of the links, 1/s; (C.145)."""
    elastic = np.setdiff1d(np.arange(arm.dof), arm.joint_index)
    damping: FloatArray = np.zeros((arm.dof, arm.dof))
    if elastic.size and ratio:
        block = np.ix_(elastic, elastic)
        mass, stiffness = model.mass[block], model.stiffness[block]
        square, shapes = linalg.eigh(0.5 * (stiffness + stiffness.T), mass)
        moved = mass @ shapes
        damping[block] = (moved * 2.0 * ratio * np.sqrt(np.maximum(square, 0.0))) @ moved.T
    return np.asarray(np.linalg.solve(model.mass, damping))


def coprime_controller(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, suboptimality: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float, float]:
    """Return a controller robust to changes of the normalised coprime factors; (C.142) to (C.144).

    Returns:
        State-space matrices of the controller for positive feedback, its margin, and the largest
        margin of any controller.

    McFarlane and Glover 1992.
    """
    # The Riccati equations need states of similar size, whatever the units are.
    n, more = len(A), max(D.shape)
    whole = np.zeros((n + more, n + more))
    whole[:n, :n], whole[:n, n : n + B.shape[1]], whole[n : n + len(C), :n] = A, B, C
    scale = balanced(whole)[1]
    sizes = scale[:n] / scale[n]
    A, B, C = A * sizes / sizes[:, None], B / sizes[:, None], C * sizes
    S = np.eye(B.shape[1]) + D.T @ D
    R = np.eye(len(C)) + D @ D.T
    drift = A - B @ np.linalg.solve(S, D.T @ C)
    pushed, observed = B @ np.linalg.solve(S, B.T), C.T @ np.linalg.solve(R, C)
    X = _riccati(drift, B, observed, S)
    Z = _riccati(drift.T, C.T, pushed, R)
    size = float(np.max(np.linalg.eigvals(X @ Z).real))
    least = np.sqrt(1.0 + size)
    bound = suboptimality * least
    F = -np.linalg.solve(S, D.T @ C + B.T @ X)
    L = (1.0 - bound**2) * np.eye(len(A)) + X @ Z
    gain = bound**2 * np.linalg.solve(L.T, Z @ C.T)
    return A + B @ F + gain @ (C + D @ F), gain, B.T @ X, -D.T, 1.0 / bound, 1.0 / least


def _riccati(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray) -> FloatArray:
    # SciPy's ordering of eigenvalues fails, by rounding, for some equations that are well posed; a
    # multiple of the equation has the multiple as its solution.
    for multiple in (1.0, 1e-2, 1e2):
        try:
            X = linalg.solve_continuous_are(A, B * multiple**-0.5, Q * multiple, R)
        except (np.linalg.LinAlgError, ValueError):
            continue
        symmetric: FloatArray = (X + X.T) / (2.0 * multiple)
        return symmetric
    rule = "must have modes that the joint angles detect and the torques control"
    hint = "Give the links damping, or fewer elements; or choose another sample_time."
    raise InputError(Problem("arm", rule, hint=hint))


def bilinear(A: FloatArray, B: FloatArray, C: FloatArray, sample_time: float) -> Matrices:
    """Return a sampled model as a continuous one in w, as ``cont2discrete`` inverts it; (C.140)."""
    inverse = 2.0 * np.linalg.inv(np.eye(len(A)) + A)
    output = C @ inverse
    slope = 2.0 / sample_time * (np.eye(len(A)) - inverse)
    return slope, inverse @ B / sample_time, output, -0.5 * output @ B


def _weight(root: FloatArray, integral: FloatArray) -> Matrices:
    """Return the weight N (1 + omega_i / w) at the torques; (C.141)."""
    slow = np.flatnonzero(integral)
    A = np.zeros((slow.size, slow.size))
    return A, np.eye(len(root))[slow], root[:, slow] * integral[slow], root


def in_series(second: Matrices, first: Matrices) -> Matrices:
    """Return the model of ``first`` followed by ``second``; states of ``second`` are first."""
    A, B, C, D = second
    a, b, c, d = first
    whole = np.block([[A, B @ c], [np.zeros((len(a), len(A))), a]])
    return whole, np.vstack([B @ d, b]), np.hstack([C, D @ c]), D @ d
