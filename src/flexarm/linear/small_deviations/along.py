"""Separation into a rigid motion and small elastic deviations from it, as in the paper.

The deviations obey a linear system whose matrices change with time as the rigid reference moves.
Theory page "separation", (D.1) to (D.7).
"""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from os import PathLike
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.arguments import check_choice, check_kind, check_positive, check_times
from flexarm.base.errors import InputError, Problem, check_array, public_call
from flexarm.base.writing.places import check_place, write_whole
from flexarm.linear.statics.gaps import warn_of_bristles
from flexarm.model.scenarios.scenario import sample_fault
from flexarm.motion import Motion
from flexarm.motion.dynamics.dynamics_along import dynamics_along
from flexarm.motion.motion import check_motion

if TYPE_CHECKING:
    import xarray as xr


JOINTS = ("free", "locked")
#: Number of times evaluated in one batch: limits the memory for long motions with many coordinates.
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
    """

    arm: Arm
    motion: Motion
    joints: str
    kept: NDArray[np.intp]
    reference: Reference
    deviation: Deviation

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
        parts = [
            _sample(self.arm, self.motion, self.kept, times[k : k + _CHUNK])
            for k in range(0, max(times.size, 1), _CHUNK)
        ]
        reference = Reference(
            *(np.concatenate(p) for p in zip(*(a for a, _ in parts), strict=True))
        )
        deviation = Deviation(
            *(np.concatenate(p) for p in zip(*(b for _, b in parts), strict=True))
        )
        return Separation(self.arm, self.motion, self.joints, self.kept, reference, deviation)

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
        import xarray as xr

        q, tau = (
            [f"q[{i}]" for i in self.kept],
            [f"torque_{number}" for number in self.arm.joint_numbers],
        )
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
        coordinates: dict[str, Any] = {
            "time": ("time", ref.time, {"units": "s"}),
            "state": states,
            "state_too": states,
            "input": tau if self.joints == "free" else [],
            "coordinate": q,
            "coordinate_too": q,
            "axis": ["x", "y"],
            "joint": self.arm.joint_numbers,
        }
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
    rate: float = 500.0,
    times: ArrayLike | None = None,
) -> Separation:
    """Linearise a flexible arm about a rigid reference motion.

    Args:
        arm: the flexible arm.
        motion: reference motion of the rigid arm.
        joints: "free": joints and links deviate, driven by the rigid torque and the torque added to
            it. "locked": the joints follow the motion exactly, and only the links deviate.
        rate: sampling rate, Hz; the start and the end of the motion are samples too.
        times: (T,) s, sample times to use instead of ``rate``.

    Raises:
        InputError: if the motion is for another number of joints, or an argument has a wrong value.

    The matrices are exact to rounding. They are computed by complex perturbation of the inverse
    dynamics with straight links, (D.3). Where an acceleration jumps, a sample has the value after
    the jump.
    """
    arm = check_kind("arm", arm, Arm)
    motion = check_motion(motion, arm)
    warn_of_bristles(arm, "the linear model")
    joints = check_choice("joints", joints, JOINTS)
    if times is None:
        frequency = check_positive("rate", rate)
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
    empty = Separation(arm, motion, joints, kept, Reference(*[none] * 5), Deviation(*[none] * 5))
    return empty.at(times)


def _sample(
    arm: Arm, motion: Motion, kept: NDArray[np.intp], times: FloatArray
) -> tuple[Reference, Deviation]:
    """Return the reference and the matrices at times (T,)."""
    q, qd, qdd = np.zeros((3, times.size, arm.dof))
    for array, given in zip((q, qd, qdd), motion.state(times), strict=True):
        array[:, arm.joint_index] = given
    along = dynamics_along(arm, q, qd, qdd)
    # With straight links, the joint rows are the torques of the rigid model.
    torque = along.force[:, arm.joint_index]
    missing = -along.force
    missing[:, arm.joint_index] = 0.0
    by = along.force_by[:, kept][..., kept]
    deviation = Deviation(
        M=by[:, :, 2],
        D=by[:, :, 1],
        K=by[:, :, 0],
        r=missing[:, kept],
        tip=along.tip_by[:, :2, 0][..., kept],
    )
    return Reference(times, q, qd, qdd, torque), deviation


_FIRST, _MOST = 32, 256
#: A series is long enough if its last coefficients are below this fraction of the largest.
_DIGITS = 1e-10


class SmoothMatrices:
    """M, D, K (T, k, k) and r (T, k) of a separation at any times, from Chebyshev series.

    They are analytic functions of time between two breaks of the motion, so a few dozen evaluations
    of the kernels give them with an error close to rounding.
    """

    def __init__(self, model: Separation) -> None:
        self._model = model
        motion = model.motion
        # Before and after the motion the matrices are constant, so one evaluation suffices.
        self._rest = [
            self._packed(np.array([t])) for t in (motion.start_time - 1.0, motion.end_time)
        ]
        self._breaks = np.array(motion.breaks)
        self._series = [
            self._fit(a, b) for a, b in zip(self._breaks[:-1], self._breaks[1:], strict=True)
        ]

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
            places = chebyshev.chebpts1(count)
            values = self._packed(0.5 * (a + b) + 0.5 * (b - a) * places)
            # Chebyshev polynomials are orthogonal over these points, so no system is solved.
            series = chebyshev.chebvander(places, count - 1).T @ values * (2.0 / count)
            series[0] *= 0.5
            scale = np.max(np.abs(series), axis=0)
            k = self._model.kept.size
            scale = np.maximum(scale, 1e-3 * np.max(scale[-k:], initial=0.0))
            last = np.max(np.abs(series[-3:]) / np.maximum(scale, np.max(scale) * 1e-12))
            if last < _DIGITS or count >= _MOST:
                return np.asarray(series)
            count *= 2
