"""Gauss collocation of linear second-order equations, for many steps at once.

The acceleration is a quadratic polynomial over a step; rate and coordinate are its integrals. The
coefficients are those of `integrate.implicit.gauss`. The method is symmetric, so it adds neither
damping nor growth, and stiff modes do not require shorter steps.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.integrate.implicit.gauss import gauss_coefficients
from flexarm.linear.small_deviations.along import SmoothMatrices
from flexarm.motion import Motion
from flexarm.motion.dynamics.dynamics_along import dynamics_along

Floats = NDArray[np.float64]

STAGES = 3
_METHOD = gauss_coefficients(STAGES)
#: Coefficients (3, 3), rising powers, of the polynomials that are 1 at one stage.
_LAGRANGE = np.linalg.inv(np.vander(_METHOD.c, increasing=True)).T


def stage_times(edges: Floats) -> Floats:
    """Return the times (N, 3) of the stages of N steps between edges (N + 1,)."""
    return np.asarray(edges[:-1, None] + np.diff(edges)[:, None] * _METHOD.c)


def stage_accelerations(h: Floats, M: Floats, D: Floats, K: Floats, force: Floats) -> Floats:
    """Solve ``M qdd + D qd + K q = force`` at the stages of N steps of length h (N,) s.

    Matrices are (N, s, k, k) at the stages or constant (N, 1, k, k), forces (N, s, k, p). The
    accelerations (N, s, k, 2 k + p) are per unit q and qd at the start, and by each force.
    """
    count, s, k, p = force.shape
    step = h[:, None, None, None, None]
    # A A, not the double integrals: their method is unstable for stiff modes.
    a, b = (part[:, :, None, None] for part in (_METHOD.AA, _METHOD.A))
    G = step**2 * a * K[:, :, None] + step * b * D[:, :, None]
    G[:, range(s), range(s)] += M
    G = G.transpose(0, 1, 3, 2, 4).reshape(count, s * k, s * k)
    by_rate = D + step[..., 0] * _METHOD.c[:, None, None] * K
    right = np.concatenate([np.broadcast_to(-K, by_rate.shape), -by_rate, force], axis=3)
    solved: Floats = np.linalg.solve(G, right.reshape(count, s * k, -1))
    return solved.reshape(count, s, k, 2 * k + p)


def step_maps(h: Floats, accelerations: Floats) -> Floats:
    """Return the state (N, 2 k, 2 k + p) at the end of each step, in the same columns."""
    k = accelerations.shape[2]
    h = h[:, None, None]
    places = h**2 * np.tensordot(accelerations, _METHOD.bA, axes=(1, 0))
    rates = h * np.tensordot(accelerations, _METHOD.b, axes=(1, 0))
    maps: Floats = np.concatenate([places, rates], axis=1)
    maps[:, range(2 * k), range(2 * k)] += 1.0
    maps[:, range(k), range(k, 2 * k)] += h[:, 0]
    return maps


def interpolate(
    edges: Floats, q: Floats, qd: Floats, stages: Floats, times: Floats
) -> tuple[Floats, Floats]:
    """Evaluate q and qd (T, k) at times (T,) from edges (N + 1, k) and stages (N, 3, k)."""
    i = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, len(edges) - 2)
    h = np.diff(edges)[i, None]
    theta = (times - edges[i])[:, None] / h
    powers = np.arange(1.0, STAGES + 1.0)
    single = (theta**powers / powers) @ _LAGRANGE.T
    double = (theta ** (powers + 1.0) / (powers * (powers + 1.0))) @ _LAGRANGE.T
    rate = np.einsum("ts,tsk->tk", single, stages[i])
    place = np.einsum("ts,tsk->tk", double, stages[i])
    return q[i] + theta * h * qd[i] + h**2 * place, qd[i] + h * rate


def step_edges(breaks: Floats, longest: float) -> Floats:
    """Divide each interval between breaks evenly into steps no longer than ``longest``."""
    parts = [breaks[:1]]
    for a, b in pairwise(breaks):
        count = max(int(np.ceil((b - a) / longest * (1.0 - 1e-12))), 1)
        parts.append(np.linspace(a, b, count + 1)[1:])
    return np.concatenate(parts)


#: Number of steps whose equations are solved in one batch: limits the memory.
_CHUNK = 256


def torque_response(
    arm: Arm, times: FloatArray, q: FloatArray, qd: FloatArray, shapes: FloatArray, rows: FloatArray
) -> FloatArray:
    """Return the change of outputs per unit of each torque shape, (T, r, shapes, joints).

    ``shapes`` (T - 1, 3, s) N m are torques at the stages of each step, the same for each joint;
    ``rows`` (T, r, dof) are derivatives of the outputs by q; q, qd (T, dof) are a run of the arm at
    evenly spaced times (T,) s. Gauss collocation of the equations linearised along the run, (D.3),
    with the matrices at the middle of each step. This is of high order for the vibrations and of
    order two for the change of posture, which is sufficient for an iteration that evaluates its
    error with the full model.
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
    """Yield linear maps of the steps of a run q, qd (T, dof) under zero-order-hold torques.

    Each chunk has the number of its first step, and the derivatives of the state [q, qd] after each
    step by that before it (N, 2 dof, 2 dof) and by its torque (N, 2 dof, joints), with the accuracy
    of `torque_response`.
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
    """Return the maps of steps from their start, and from stage torques (N, 2 dof, 3, joints)."""
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


@dataclass(frozen=True, eq=False)
class DeviationPath:
    """Deviations over N steps as piecewise polynomials."""

    edges: FloatArray  # (N + 1,) s. dq, dqd: (N + 1, k) at the edges.
    dq: FloatArray
    dqd: FloatArray
    stages: FloatArray  # (N, 3, k) accelerations

    def at(self, times: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return dq and dqd (T, k) at times (T,) within the edges."""
        return interpolate(self.edges, self.dq, self.dqd, self.stages, times)


def solve_deviations(
    matrices: SmoothMatrices,
    edges: FloatArray,
    dq: FloatArray,
    dqd: FloatArray,
    added: FloatArray | None = None,
) -> DeviationPath:
    """Integrate deviations over steps between edges (N + 1,) s, with ``added`` forces (N, 3, k).

    The equations are linear, so each step is a linear map from its start to its end, computed for
    many steps at once. Unresolved modes conserve their energy: (D.6).
    """
    k, parts = dq.size, []
    for first in range(0, len(edges) - 1, _CHUNK):
        chunk = edges[first : first + _CHUNK + 1]
        force = None if added is None else added[first : first + _CHUNK]
        parts.append(_march(chunk, _accelerations(matrices, chunk, force, k), dq, dqd))
        dq, dqd = parts[-1].dq[-1], parts[-1].dqd[-1]
    return DeviationPath(
        edges,
        np.concatenate([parts[0].dq[:1], *(part.dq[1:] for part in parts)]),
        np.concatenate([parts[0].dqd[:1], *(part.dqd[1:] for part in parts)]),
        np.concatenate([part.stages for part in parts]),
    )


def _accelerations(
    matrices: SmoothMatrices, edges: FloatArray, added: FloatArray | None, k: int
) -> FloatArray:
    """Return stage accelerations (N, 3, k, 2 k + 1) per unit dq and dqd, and by forces (last)."""
    times = stage_times(edges)
    count, s = times.shape
    M, D, K, r = (part.reshape(count, s, *part.shape[1:]) for part in matrices.at(times.ravel()))
    force = r if added is None else r + added
    return stage_accelerations(np.diff(edges), M, D, K, force[..., None])


def _march(edges: FloatArray, solved: FloatArray, dq: FloatArray, dqd: FloatArray) -> DeviationPath:
    """Advance from edge to edge with the accelerations of ``_accelerations``."""
    count, _, k = solved.shape[:3]
    maps = step_maps(np.diff(edges), solved)
    states = np.empty((count + 1, 2 * k))
    states[0] = np.concatenate([dq, dqd])
    for i in range(count):
        states[i + 1] = maps[i, :, :-1] @ states[i] + maps[i, :, -1]
    stages = solved[..., -1] + np.einsum("nskj,nj->nsk", solved[..., :-1], states[:-1])
    return DeviationPath(edges, states[:, :k], states[:, k:], stages)


def break_times(motion: Motion, until: float) -> FloatArray:
    """Return zero, the breaks of a motion before ``until``, and ``until``, s."""
    return np.unique(np.clip([0.0, *motion.breaks, until], 0.0, until))
