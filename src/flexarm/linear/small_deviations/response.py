"""Response of a run to small changes of its torques, linearised along the bent arm."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.linear.small_deviations.collocation import STAGES, stage_accelerations, step_maps
from flexarm.motion.dynamics.dynamics_along import dynamics_along

_CHUNK = 256


def torque_response(
    arm: Arm, times: FloatArray, q: FloatArray, qd: FloatArray, shapes: FloatArray, rows: FloatArray
) -> FloatArray:
    """Return the change of outputs per unit of each torque shape, (T, r, shapes, joints).

    Args:
        times: (T,) s, evenly spaced. q, qd: (T, dof), a run of the arm at these times.
        shapes: (T - 1, 3, s) torque shapes at the stages of each step, N m, the same for each
            joint.
        rows: (T, r, dof) derivatives of the outputs by q.

    Gauss collocation of the equations linearised along the run, (D.3), with the matrices at the
    middle of each step. This is of high order for the vibrations and of order two for the change of
    posture, which is sufficient for an iteration that evaluates its error with the full model.
    """
    h = float(times[1] - times[0])
    count, dof = q.shape
    width = shapes.shape[2] * arm.joints
    state = np.zeros((2 * dof, width))
    answer = np.zeros((count, rows.shape[1], width))
    for first in range(0, count - 1, _CHUNK):
        part = slice(first, min(first + _CHUNK, count - 1))
        by_state, by_force = _step_maps(arm, h, q, qd, part)
        for k, (A, B) in enumerate(zip(by_state, by_force, strict=True), start=part.start):
            force = np.einsum("xsj,sp->xpj", B, shapes[k]).reshape(2 * dof, width)
            state = A @ state + force
            answer[k + 1] = rows[k + 1] @ state[:dof]
    return answer.reshape(count, rows.shape[1], shapes.shape[2], arm.joints)


def held_step_maps(
    arm: Arm, step: float, q: FloatArray, qd: FloatArray
) -> Iterator[tuple[int, FloatArray, FloatArray]]:
    """Yield the linear maps of the steps of a run under zero-order-hold torques, in chunks.

    Args:
        step: s. q, qd: (T, dof), a run of the arm at evenly spaced times.

    Yields:
        Number of the first step of the chunk, and the derivatives of the state [q, qd] after each
        step by that before it (N, 2 dof, 2 dof) and by its torque (N, 2 dof, joints), with the
        accuracy of `torque_response`.
    """
    count = len(q)
    for first in range(0, count - 1, _CHUNK):
        by_state, by_force = _step_maps(
            arm, step, q, qd, slice(first, min(first + _CHUNK, count - 1))
        )
        yield first, by_state, by_force.sum(axis=2)


def _step_maps(
    arm: Arm, h: float, q: FloatArray, qd: FloatArray, part: slice
) -> tuple[FloatArray, FloatArray]:
    """Return the linear maps of some steps.

    From the start of a step (N, 2 dof, 2 dof), and from the torques at its stages
    (N, 2 dof, 3, joints).
    """
    after = slice(part.start + 1, part.stop + 1)
    middle = [0.5 * (q[part] + q[after]), 0.5 * (qd[part] + qd[after]), (qd[after] - qd[part]) / h]
    by = dynamics_along(arm, *middle).force_by
    K, D, M = (by[:, None, :, level] for level in range(3))
    count, dof, s, joints = len(by), arm.dof, STAGES, arm.joints
    torque = np.zeros((s, dof, s, joints))
    for stage in range(s):
        torque[stage, arm.joint_index, stage, range(joints)] = 1.0
    force = np.broadcast_to(torque.reshape(s, dof, -1), (count, s, dof, s * joints))
    steps = np.full(count, h)
    maps = step_maps(steps, stage_accelerations(steps, M, D, K, force))
    by_force = maps[:, :, 2 * dof :].reshape(count, 2 * dof, s, joints)
    return maps[:, :, : 2 * dof], by_force
