"""Separation into a rigid motion and small elastic deviations from it, as in the paper.

The deviations obey a linear system whose matrices change with time as the rigid reference moves.
Theory page "separation", (D.1) to (D.7). Gauss collocation integrates it, for many steps at once:
the acceleration is a quadratic polynomial over a step, with the coefficients of
`integrate.implicit.gauss`. The method is symmetric, so it adds neither damping nor growth, and
stiff modes do not require shorter steps.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from io import BytesIO
from itertools import pairwise
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.arguments import check_choice, check_times
from flexarm.base.errors import InputError, Problem, check_array, public_call
from flexarm.base.late import xr
from flexarm.base.writing.places import check_place, write_whole
from flexarm.integrate.implicit.gauss import gauss_coefficients
from flexarm.linear.statics.gaps import warn_of_bristles
from flexarm.model.arm.spec import serial_only
from flexarm.model.quantities import Positive
from flexarm.model.scenarios.scenario import recording_rate, sample_fault
from flexarm.motion import Motion
from flexarm.motion.dynamics.base_motion import BaseMotion, base_motion
from flexarm.motion.dynamics.dynamics_along import dynamics_along
from flexarm.motion.motion import check_motion

JOINTS = ("free", "locked")
#: Number of times evaluated, or of steps solved, in one batch: limits the memory for long motions
#: with many coordinates.
_CHUNK = 256


class Reference(NamedTuple):
    """Rigid motion in the coordinates of the flexible arm, and its torques, at T times."""

    time: FloatArray  # (T,) s
    q: FloatArray  # (T, dof), straight links
    qd: FloatArray  # (T, dof)
    qdd: FloatArray  # (T, dof)
    torque: FloatArray  # (T, joints) N m, the rigid torque


class Deviation(NamedTuple):
    """Matrices and forces of the deviations at T times: M dqdd + D dqd + K dq = r + (added torque).

    Over the k coordinates that deviate: matrices (T, k, k); ``r`` (T, k), the inertia and gravity
    forces that bend the links; ``tip`` (T, 2, k), derivatives of the tip position by dq, world
    axes, m.
    """

    M: FloatArray
    D: FloatArray
    K: FloatArray
    r: FloatArray
    tip: FloatArray


@dataclass(frozen=True, eq=False)
class Separation:
    """A rigid reference motion and the linear time-varying system of the deviations from it.

    With ``x = [dq, dqd]`` over the k coordinates that deviate, ``x' = A x + B u + f``, where ``u``
    (joints,) is the torque added to the rigid one, N m. ``A``, ``B``, ``f`` and the other arrays
    are samples at ``time``; ``at(t)`` evaluates them exactly, without interpolation, at any time.

    Attributes:
        arm, motion: the linearised arm and the reference motion.
        joints: "free", or "locked" if the joints follow the motion and only the links deviate.
        kept: (k,) positions in the arm's q of the coordinates that deviate.
        reference: the rigid motion at the samples.
        deviation: matrices at the samples.
        base_motion: motion of a base that moves, which follows the rigid mechanism.
    """

    arm: Arm
    motion: Motion
    joints: str
    kept: NDArray[np.intp]
    reference: Reference
    deviation: Deviation
    base_motion: BaseMotion | None = None

    def __repr__(self) -> str:
        samples = f"{self.time.size} samples"
        if self.time.size:
            samples += f" from {self.time[0]:.4g} to {self.time[-1]:.4g} s"
        inputs = self._inputs.shape[1]
        return (
            f"<flexarm.Separation: {2 * self.kept.size} states, {inputs} inputs, joints "
            f"{self.joints}, {samples}>"
        )

    @property
    def time(self) -> FloatArray:
        """Times of the samples (T,), s."""
        return self.reference.time

    @property
    def A(self) -> FloatArray:
        """System matrices (T, 2 k, 2 k); (D.5)."""
        M, D, K = self.deviation[:3]
        count, k = M.shape[:2]
        A = np.zeros((count, 2 * k, 2 * k))
        A[:, :k, k:] = np.eye(k)
        A[:, k:] = -np.linalg.solve(M, np.concatenate([K, D], axis=2))
        return A

    @property
    def B(self) -> FloatArray:
        """Input matrices (T, 2 k, joints); no input where joints are locked; (D.5)."""
        count, k = self.deviation.M.shape[:2]
        B = np.zeros((count, 2 * k, self._inputs.shape[1]))
        B[:, k:] = np.linalg.solve(self.deviation.M, np.broadcast_to(self._inputs, B[:, k:].shape))
        return B

    @property
    def f(self) -> FloatArray:
        """Forcing (T, 2 k): effect of the inertia and gravity forces ``r`` on the links; (D.5)."""
        count, k = self.deviation.r.shape
        f = np.zeros((count, 2 * k))
        f[:, k:] = np.linalg.solve(self.deviation.M, self.deviation.r[:, :, None])[:, :, 0]
        return f

    @property
    def _inputs(self) -> FloatArray:
        """Generalised forces (k, inputs) per unit torque."""
        chosen = self.kept[:, None] == self.arm.joint_index
        return np.asarray(chosen[:, chosen.any(axis=0)].astype(np.float64))

    @public_call
    def at(self, t: ArrayLike) -> Separation:
        """Return a separation sampled at other times (T,), s, evaluated exactly."""
        times = check_array("t", np.atleast_1d(check_times("t", t)), (-1,))
        parts = [_sample(self, times[k : k + _CHUNK]) for k in range(0, max(times.size, 1), _CHUNK)]
        reference, deviation = (
            [np.concatenate(arrays) for arrays in zip(*records, strict=True)]
            for records in zip(*parts, strict=True)
        )
        samples = Reference(*reference), Deviation(*deviation)
        return replace(self, reference=samples[0], deviation=samples[1])

    def quasi_static(self) -> FloatArray:
        """Return the quasi-static estimate of dq (T, k), the static deflection under ``r``; (D.7).

        It neglects the dynamics of the links and keeps the joints on the reference.
        """
        return self.bent(self.deviation.K, self.deviation.r)

    @public_call
    def bent(self, K: FloatArray, r: FloatArray) -> FloatArray:
        """Return the static deflection dq (T, k) of the links under forces r (T, k); (D.7).

        Raises:
            InputError: if K does not have shape (T, k, k), or r does not have shape (T, k).
        """
        k = self.kept.size
        r = check_array("r", r, (-1, k))
        K = check_array("K", K, (len(r), k, k))
        elastic = np.flatnonzero(~np.isin(self.kept, self.arm.joint_index))
        dq = np.zeros_like(r)
        if elastic.size:
            stiffness = K[:, elastic[:, None], elastic]
            dq[:, elastic] = np.linalg.solve(stiffness, r[:, elastic, None])[:, :, 0]
        return dq

    def to_dataset(self) -> xr.Dataset:
        """Return the samples as an ``xarray.Dataset`` labelled with states and inputs."""
        q = [f"q[{i}]" for i in self.kept]
        tau = [f"torque_{number}" for number in self.arm.joint_numbers]
        states = [f"d{name}" for name in q] + [f"d{name}/dt" for name in q]
        ref, dev = self.reference, self.deviation
        pairs, whole = ("time", "coordinate", "coordinate_too"), ("time", "arm_coordinate")
        variables: dict[str, Any] = {
            "A": (("time", "state", "state_too"), self.A),
            "B": (("time", "state", "input"), self.B),
            "f": (("time", "state"), self.f),
            "M": (pairs, dev.M),
            "D": (pairs, dev.D),
            "K": (pairs, dev.K),
            "r": (("time", "coordinate"), dev.r),
            "tip_jacobian": (("time", "axis", "coordinate"), dev.tip),
            "q": (whole, ref.q),
            "qd": (whole, ref.qd),
            "qdd": (whole, ref.qdd),
            "rigid_torque": (("time", "joint"), ref.torque, {"units": "N m"}),
        }
        coordinates: dict[str, Any] = {"time": ("time", ref.time, {"units": "s"})}
        coordinates |= dict.fromkeys(("state", "state_too"), states)
        coordinates |= {"input": tau if self.joints == "free" else []}
        coordinates |= dict.fromkeys(("coordinate", "coordinate_too"), q)
        coordinates |= {"axis": ["x", "y"], "joint": self.arm.joint_numbers}
        return xr.Dataset(variables, coords=coordinates, attrs={"joints": self.joints})

    @public_call
    def save(self, path: str | PathLike[str]) -> None:
        """Write the arrays of ``to_dataset`` to a NumPy ``.npz`` file, under the same names.

        Missing folders are created. The file is written completely or not at all.

        Raises:
            InputError: if the name does not end in ``.npz``, or the file cannot be written.
        """
        place = check_place("path", path, (".npz",))
        dataset = self.to_dataset()
        arrays: dict[str, Any] = {str(name): a.values for name, a in dataset.variables.items()}
        content = BytesIO()
        np.savez_compressed(content, **arrays)
        write_whole(place, [content.getvalue()])


@public_call
def linearize_along(
    arm: Arm,
    motion: Motion,
    *,
    joints: str = "free",
    rate: Positive | None = None,
    times: ArrayLike | None = None,
) -> Separation:
    """Linearise a flexible arm about a rigid reference motion.

    Args:
        arm: the flexible arm.
        motion: reference motion of the rigid arm.
        joints: "free": joints and links deviate, driven by the rigid torque and the torque added to
            it. "locked": the joints follow the motion exactly, and only the links deviate.
        rate: sampling rate, Hz, by default as for `simulate`; the start and the end of the motion
            are samples too.
        times: (T,) s, sample times to use instead of ``rate``.

    Raises:
        InputError: if the motion is for another number of joints, or an argument has a wrong value.

    The matrices are exact to rounding. They are computed by complex perturbation of the inverse
    dynamics with straight links, (D.3). Where an acceleration jumps, a sample has the value after
    the jump. A base that moves follows the rigid mechanism as in `rigid_torque`, and deviates from
    this motion.
    """
    motion = check_motion(motion, arm)
    serial_only(arm.spec, "linearisation along a motion", ("closures",))
    warn_of_bristles(arm, "the linear model")
    joints = check_choice("joints", joints, JOINTS)
    if times is None:
        frequency = recording_rate(rate, motion.duration)
        fault = sample_fault(motion.duration, frequency)
        if fault is not None:
            raise InputError(fault.problem())
        count = max(int(np.ceil(motion.duration * frequency)), 1)
        times = np.linspace(motion.start_time, motion.end_time, count + 1)
    kept = np.arange(arm.dof)
    if joints == "locked":
        kept = np.setdiff1d(kept, arm.joint_index)
    if kept.size == 0:
        raise InputError(Problem("arm", "is rigid and its joints are locked: it has no deviations"))
    none = np.zeros(0)
    base = base_motion(arm.rigid(), motion) if arm.assembly.base else None
    samples = Reference(*[none] * 5), Deviation(*[none] * 5)
    return Separation(arm, motion, joints, kept, *samples, base).at(times)


def _sample(model: Separation, times: FloatArray) -> tuple[Reference, Deviation]:
    """Return the reference and the matrices at times (T,)."""
    arm, motion, kept = model.arm, model.motion, model.kept
    q, qd, qdd = np.zeros((3, times.size, arm.dof))
    for array, given in zip((q, qd, qdd), motion.state(times), strict=True):
        array[:, arm.joint_index] = given
    if model.base_motion is not None:
        places = [coordinate.place for coordinate in arm.assembly.base]
        rigid = model.base_motion.following.places
        for array, whole in zip((q, qd, qdd), model.base_motion.states(times), strict=True):
            array[:, places] = whole[:, rigid]
    along = dynamics_along(arm, q, qd, qdd)
    # With straight links, the joint rows are the torques of the rigid model.
    torque = along.force[:, arm.joint_index]
    missing = -along.force
    missing[:, arm.joint_index] = 0.0
    by = along.force_by[:, kept][..., kept]
    M, D, K = (by[:, :, level] for level in (2, 1, 0))
    deviation = Deviation(M, D, K, missing[:, kept], along.tip_by[:, :2, 0][..., kept])
    return Reference(times, q, qd, qdd, torque), deviation


_FIRST, _MOST = 32, 256
#: A series is long enough if its last coefficients are below this fraction of the largest.
_DIGITS = 1e-10
#: Numbers of a matrix below this fraction of the largest have no more digits than that.
_ROUNDING = 2.0 * np.finfo(float).eps / _DIGITS


class SmoothMatrices:
    """M, D, K (T, k, k) and r (T, k) of a separation at any times, from Chebyshev series.

    They are analytic functions of time between two breaks of the motion, so a few dozen evaluations
    of the kernels give them with an error close to rounding.
    """

    def __init__(self, model: Separation) -> None:
        self._model = model
        motion = model.motion
        # Before and after the motion the matrices are constant, so one evaluation suffices.
        ends = motion.start_time - 1.0, motion.end_time
        self._rest = [self._packed(np.array([t])) for t in ends]
        self._breaks = np.array(motion.breaks)
        self._series = [self._fit(a, b) for a, b in pairwise(self._breaks)]

    def at(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return M, D, K and r at times (T,)."""
        k = self._model.kept.size
        packed = np.empty((times.size, 3 * k * k + k))
        packed[times < self._breaks[0]] = self._rest[0]
        packed[times >= self._breaks[-1]] = self._rest[1]
        for a, b, series in zip(self._breaks[:-1], self._breaks[1:], self._series, strict=True):
            own = (times >= a) & (times < b)
            scaled = (2.0 * times[own] - a - b) / (b - a)
            packed[own] = chebyshev.chebvander(scaled, len(series) - 1) @ series
        M, D, K = packed[:, : 3 * k * k].reshape(-1, 3, k, k).transpose(1, 0, 2, 3)
        return M, D, K, packed[:, 3 * k * k :]

    def _packed(self, times: FloatArray) -> FloatArray:
        parts = self._model.at(times).deviation[:4]
        return np.concatenate([part.reshape(times.size, -1) for part in parts], axis=1)

    def _fit(self, a: float, b: float) -> FloatArray:
        count = _FIRST
        while True:
            series: Any = chebyshev.chebinterpolate(
                lambda x: self._packed(0.5 * (a + b) + 0.5 * (b - a) * x), count - 1
            )
            last = np.max(np.abs(series[-3:]) / self._sizes(np.max(np.abs(series), axis=0)))
            if last < _DIGITS or count >= _MOST:
                return np.asarray(series)
            count *= 2

    def _sizes(self, largest: FloatArray) -> FloatArray:
        """Return positive sizes of the numbers of a series from their largest coefficients.

        Numbers count relative to those of the same matrix, in coordinates of equal inertia.
        """
        k = self._model.kept.size
        matrices, r = largest[: 3 * k * k].reshape(3, k, k), largest[3 * k * k :]
        inertia = np.sqrt(np.diagonal(matrices[0]))
        square = np.outer(inertia, inertia)
        most = np.max(matrices / square, axis=(1, 2), keepdims=True) * square
        least = 1e-3 * np.max(r / inertia) * inertia
        parts = np.maximum(matrices, _ROUNDING * most).ravel(), np.maximum(r, least)
        sizes: FloatArray = np.maximum(np.concatenate(parts), np.finfo(float).tiny)
        return sizes


STAGES = 3
_METHOD = gauss_coefficients(STAGES)
#: Coefficients (3, 3), rising powers, of the polynomials that are 1 at one stage.
_LAGRANGE = np.linalg.inv(np.vander(_METHOD.c, increasing=True)).T


def stage_times(edges: FloatArray) -> FloatArray:
    """Return the times (N, 3) of the stages of N steps between edges (N + 1,)."""
    return np.asarray(edges[:-1, None] + np.diff(edges)[:, None] * _METHOD.c)


def stage_accelerations(
    h: FloatArray, M: FloatArray, D: FloatArray, K: FloatArray, force: FloatArray
) -> FloatArray:
    """Solve ``M qdd + D qd + K q = force`` at the stages of N steps of length h (N,) s.

    Matrices are (N, s, k, k) at the stages or constant (N, 1, k, k), forces (N, s, k, p). The
    accelerations (N, s, k, 2 k + p) are per unit q and qd at the start, and by each force.
    """
    count, s, k, p = force.shape
    # Rows and columns of equal size, which the solution needs for arms of a millimetre. Powers of
    # two do not round.
    size = np.exp2(-np.round(0.5 * np.log2(np.mean(np.diagonal(M, axis1=2, axis2=3), (0, 1)))))
    M, D, K = (size[:, None] * size * part for part in (M, D, K))
    step = h[:, None, None, None, None]
    # A A, not the double integrals: their method is unstable for stiff modes.
    a, b = (part[:, :, None, None] for part in (_METHOD.AA, _METHOD.A))
    G = step**2 * a * K[:, :, None] + step * b * D[:, :, None]
    G[:, range(s), range(s)] += M
    G = G.transpose(0, 1, 3, 2, 4).reshape(count, s * k, s * k)
    by_rate = D + step[..., 0] * _METHOD.c[:, None, None] * K
    by_place = np.broadcast_to(K / size, by_rate.shape)
    right = np.concatenate([-by_place, -by_rate / size, size[:, None] * force], axis=3)
    scaled = np.linalg.solve(G, right.reshape(count, s * k, -1))
    solved: FloatArray = size[:, None] * scaled.reshape(count, s, k, 2 * k + p)
    return solved


def step_maps(h: FloatArray, accelerations: FloatArray) -> FloatArray:
    """Return the state (N, 2 k, 2 k + p) at the end of each step, in the same columns."""
    k = accelerations.shape[2]
    h = h[:, None, None]
    places = h**2 * np.tensordot(accelerations, _METHOD.bA, axes=(1, 0))
    rates = h * np.tensordot(accelerations, _METHOD.b, axes=(1, 0))
    maps: FloatArray = np.concatenate([places, rates], axis=1)
    maps[:, range(2 * k), range(2 * k)] += 1.0
    maps[:, range(k), range(k, 2 * k)] += h[:, 0]
    return maps


def step_edges(breaks: FloatArray, longest: float) -> FloatArray:
    """Divide each interval between breaks evenly into steps no longer than ``longest``."""
    parts = [breaks[:1]]
    for a, b in pairwise(breaks):
        count = max(int(np.ceil((b - a) / longest * (1.0 - 1e-12))), 1)
        parts.append(np.linspace(a, b, count + 1)[1:])
    return np.concatenate(parts)


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
    width = shapes.shape[2] * arm.n_joints
    state = np.zeros((2 * dof, width))
    answer = np.zeros((count, rows.shape[1], width))
    for k, A, B in run_step_maps(arm, h, q, qd):
        force = np.einsum("xsj,sp->xpj", B, shapes[k]).reshape(2 * dof, width)
        state = A @ state + force
        answer[k + 1] = rows[k + 1] @ state[:dof]
    return answer.reshape(count, rows.shape[1], shapes.shape[2], arm.n_joints)


def run_step_maps(
    arm: Arm, step: float, q: FloatArray, qd: FloatArray
) -> Iterator[tuple[int, FloatArray, FloatArray]]:
    """Yield the number and the linear maps of each step of a run q, qd (T, dof).

    These are the derivatives of the state [q, qd] after the step by that before it (2 dof, 2 dof)
    and by the torques at its stages (2 dof, 3, joints), with the accuracy of `torque_response`.
    """
    for first in range(0, len(q) - 1, _CHUNK):
        part = slice(first, min(first + _CHUNK, len(q) - 1))
        yield from zip(range(first, part.stop), *_step_maps(arm, step, q, qd, part), strict=True)


def _step_maps(
    arm: Arm, h: float, q: FloatArray, qd: FloatArray, part: slice
) -> tuple[FloatArray, FloatArray]:
    """Return the maps of steps from their start, and from stage torques (N, 2 dof, 3, joints)."""
    after = slice(part.start + 1, part.stop + 1)
    middle = [0.5 * (q[part] + q[after]), 0.5 * (qd[part] + qd[after]), (qd[after] - qd[part]) / h]
    by = dynamics_along(arm, *middle).force_by
    K, D, M = (by[:, None, :, level] for level in range(3))
    count, dof, s, joints = len(by), arm.dof, STAGES, arm.n_joints
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
        i = np.clip(np.searchsorted(self.edges, times, side="right") - 1, 0, len(self.edges) - 2)
        h = np.diff(self.edges)[i, None]
        theta = (times - self.edges[i])[:, None] / h
        powers = np.arange(1.0, STAGES + 1.0)
        single = (theta**powers / powers) @ _LAGRANGE.T
        double = (theta ** (powers + 1.0) / (powers * (powers + 1.0))) @ _LAGRANGE.T
        rate = np.einsum("ts,tsk->tk", single, self.stages[i])
        place = np.einsum("ts,tsk->tk", double, self.stages[i])
        return self.dq[i] + theta * h * self.dqd[i] + h**2 * place, self.dqd[i] + h * rate


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
