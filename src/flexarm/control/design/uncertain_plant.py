"""Generalised plant of a sampled arm with uncertain rigidity and payload; (C.150), (C.151)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.arm.arm import Arm, varied
from flexarm.control.design.linear_design import held
from flexarm.control.design.loop_shaping import DAMPING, Matrices, added_damping, bilinear, shaping
from flexarm.control.hardware.measurement import FloatArray
from flexarm.linear.models.linearize import linearize
from flexarm.linear.models.state_space import LinearModel
from flexarm.linear.statics.equilibrium import equilibrium

#: Rank of a change: smallest eigenvalue, relative to the largest. Rounding is 1e-12, and the
#: smallest eigenvalues of changes of links with a few elements are 1e-4, or 1e-7 with gravity.
_RANK = 1e-9
#: Change that is rounding, relative to the largest entry of the matrix.
_ROUNDING = 1e-10
#: Sensitivity at low frequencies that the performance weight accepts.
_SLOW = 0.1
#: Noise and weight of the shaped output. Without them the synthesis has no solution, because the
#: rigid motion would neither be disturbed nor penalised; a small weight makes it slow.
_NOISE, _OUTPUT = 0.1, 0.4
#: Bandwidth of the sensitivity relative to that of the loop shape.
_SENSITIVITY_BANDWIDTH = 0.5


class UncertainPlant(NamedTuple):
    """Generalised plant of a design, continuous in the bilinear variable of (C.140).

    Attributes:
        whole: from (uncertainty, performance, torque) to the same; torques are normalised.
        nominal: from the normalised torque to the shaped output.
        blocks: sizes of the blocks; the last one is the performance.
        root: (joints, joints), torque of a normalised one.
        shown: (joints, 2 joints), shaped output of the errors of angles and rates.
        model: the linear model of the arm itself.
    """

    whole: Matrices
    nominal: Matrices
    blocks: tuple[int, ...]
    root: FloatArray
    shown: FloatArray
    model: LinearModel


def uncertain_plant(
    arm: Arm,
    posture: FloatArray,
    bandwidth: FloatArray,
    *,
    rigidity: float,
    payload: float,
    sensitivity: float,
    sample_time: float,
) -> UncertainPlant:
    """Return the plant of a design at rest in a posture, with the uncertainty of varied arms.

    Args:
        arm: nominal arm. posture: (joints,) rad. bandwidth: (joints,) rad/s.
        rigidity, payload: relative changes of the rigidity of all links and of the payload.
        sensitivity: largest accepted sensitivity of the normalised torques, above 1.
        sample_time: s.

    Raises:
        InputError: if a bandwidth is not below the Nyquist frequency.
    """
    model = linearize(arm, equilibrium(arm, posture), outputs=("joint_angle", "joint_rate"))
    n, slope = arm.dof, model.A.copy()
    # Full complex blocks contain negative loss factors, with which light damping is unstable.
    slope[n:, n:] -= added_damping(arm, model, DAMPING * rigidity)
    root, shown = shaping(arm, posture, bandwidth, sample_time)
    changes = _changes(arm, posture, model, rigidity, payload)
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
    direct.append(np.zeros((arm.joints, inputs.shape[1])))
    A, B, C, D = bilinear(*held(slope, inputs, sample_time), np.vstack(outputs), sample_time)
    D += np.vstack(direct)
    blocks = tuple(factor.shape[1] for _, factor, _ in changes)
    first = sum(blocks)
    nominal = A, B[:, first:], C[first:], D[first:, first:]
    corner = _SENSITIVITY_BANDWIDTH * float(np.min(bandwidth))
    whole = _with_performance((A, B, C, D), first, corner, sensitivity)
    return UncertainPlant(whole, nominal, (*blocks, 2 * arm.joints), root, shown, model)


def _changes(
    arm: Arm, posture: FloatArray, model: LinearModel, rigidity: float, payload: float
) -> list[tuple[str, FloatArray, FloatArray]]:
    """Return the changes of stiffness and mass as products left right' of factors (dof, k).

    With gravity, both matrices depend on both changes, because the arm sags by another amount.
    """
    others = []
    if rigidity and arm.dof > arm.joints:
        others.append(varied(arm, flexural_rigidity_factor=1.0 + rigidity))
    if payload and arm.spec.payload.mass:
        others.append(varied(arm, payload_factor=1.0 + payload))
    found = []
    for other in others:
        there = linearize(other, equilibrium(other, posture))
        for kind in ("stiffness", "mass"):
            own = getattr(model, kind)
            change = getattr(there, kind) - own
            if np.abs(change).max() > _ROUNDING * np.abs(own).max():
                found.append((kind, *_factors(change)))
    return found


def _factors(change: FloatArray) -> tuple[FloatArray, FloatArray]:
    values, vectors = np.linalg.eigh(0.5 * (change + change.T))
    kept = np.abs(values) > _RANK * np.abs(values).max()
    right = vectors[:, kept] * np.sqrt(np.abs(values[kept]))
    return right * np.sign(values[kept]), right


def _with_performance(plant: Matrices, first: int, corner: float, sensitivity: float) -> Matrices:
    """Return the generalised plant: performance of disturbing torques and noise is added.

    ``first``: number of inputs and outputs of the uncertainty.
    """
    from scipy.linalg import block_diag

    A, B, C, D = plant
    n, m = len(A), len(C) - first
    one, none = np.eye(m), np.zeros
    slow, through = corner * _SLOW, 1.0 / sensitivity
    B_d, B_u, C_d, C_y = B[:, :first], B[:, first:], C[:first], C[first:]
    D_dd, D_du, D_yd, D_yu = (
        D[:first, :first],
        D[:first, first:],
        D[first:, :first],
        D[first:, first:],
    )
    states = block_diag(A, -slow * one)
    inputs = np.block(
        [
            [B_d, B_u, none((n, m)), B_u],
            [none((m, first)), one, none((m, m)), one],
        ]
    )
    outputs = np.block(
        [
            [C_d, none((first, m))],
            [none((m, n)), (corner - slow * through) * one],
            [_OUTPUT * C_y, none((m, m))],
            [C_y, none((m, m))],
        ]
    )
    direct = np.block(
        [
            [D_dd, D_du, none((first, m)), D_du],
            [none((m, first)), through * one, none((m, m)), through * one],
            [_OUTPUT * D_yd, _OUTPUT * D_yu, none((m, m)), _OUTPUT * D_yu],
            [D_yd, D_yu, _NOISE * one, D_yu],
        ]
    )
    return states, inputs, outputs, direct
