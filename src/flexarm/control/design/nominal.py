"""Nominal motion of the flexible arm along a reference, and designs on a grid of postures."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import modal_size
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.base.arguments import as_list
from flexarm.base.errors import InputError, Problem, check_array, shown
from flexarm.base.late import interpolate
from flexarm.control.contract.base import Reference
from flexarm.control.design.minimal import MinimalCoordinates
from flexarm.control.design.rigid_model import values_of
from flexarm.control.hardware.measurement import FloatArray
from flexarm.kernels.observation.observables import poses
from flexarm.kernels.recursion.newton_euler import inverse_dynamics_many
from flexarm.linear.vibration.modal import modes

#: Step of central differences by elastic coordinates, relative to ``modal_size``. It rotates links
#: by less than 1e-3 rad, so the error is below a millionth.
_STEP = 1e-5


class FlexibleModel:
    """Inverse dynamics of a flexible arm with moving joints and constant bending.

    The elastic forces are those that no actuator applies, -r in (D.3). Joint angles, rates
    and accelerations are in rad, rad/s, rad/s^2. Arguments are not checked.

    Attributes:
        arm: the arm. elastic: (dof - joints,) indices in q of the elastic coordinates, and of the
            base. unbalanced: number of coordinates on which no motor acts. strains: (gauges, dof)
            of `strain_matrix`.
    """

    def __init__(self, arm: Arm) -> None:
        self.arm, self.strains = arm, strain_matrix(arm)
        assembly = arm.assembly
        self.elastic = np.setdiff1d(np.arange(arm.dof), arm.joint_index)
        self.unbalanced = self.elastic.size
        self._kernels = KernelView(assembly.constants)
        self._state = self._kernels.zeros(2)
        self._bodies = assembly.joint_body
        self._joint_places = assembly.coordinates[arm.joint_index]
        self._elastic_places = assembly.coordinates[self.elastic]
        self._poses, self._tip = self._kernels.pose_arrays()

    def motion(
        self, angle: FloatArray, rate: FloatArray, acceleration: FloatArray, bend: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return q and qd (T, dof) of a motion, its torques, and the forces without a motor.

        The elastic forces are those that would have to act to keep the bending constant. ``bend``
        (T, dof - joints): the elastic coordinates; their rates and accelerations are zero.
        """
        joints, elastic = self._joint_places, self._elastic_places
        kernels, count = self._kernels, len(angle)
        states, accelerations = kernels.zeros(count, 2), kernels.zeros(count)
        forces = np.empty_like(accelerations)
        flat = states.reshape(count, 2, -1)
        flat[:, 0, joints], flat[:, 1, joints] = angle, rate
        flat[:, 0, elastic] = bend
        accelerations.reshape(count, -1)[:, joints] = acceleration
        motion = states, accelerations
        kernels.call(inverse_dynamics_many, *motion, kernels.loads, kernels.work, forces)
        found = forces.reshape(count, -1)
        # The arrays have the type of the angles, which are symbols in exported controllers.
        q = np.zeros_like(angle, shape=(len(angle), self.arm.dof))
        qd = np.zeros_like(q)
        q[:, self.arm.joint_index], q[:, self.elastic] = angle, bend
        qd[:, self.arm.joint_index] = rate
        return q, qd, found[:, joints], found[:, elastic]

    def chords(self, angle: FloatArray) -> FloatArray:
        """Return the rotations (joints, dof - joints) of the chords of the links by the bending.

        A chord connects a joint with the next one, or with the tip; its rotation, in rad, is
        relative to the joint before, like the joint angle. It does not depend on the posture.
        Between joints without a kink, rigid links with these rotations have the same ends.
        """
        straight = np.diff(self._joints_and_tip(angle, np.zeros(self.elastic.size)), axis=0)
        lengths = np.sum(straight**2, axis=1)
        columns = []
        step = _STEP * modal_size(self.arm)
        for small in step * np.eye(self.elastic.size):
            apart = self._joints_and_tip(angle, small) - self._joints_and_tip(angle, -small)
            x, y = np.diff(apart / (2.0 * step), axis=0).T
            columns.append((straight[:, 0] * y - straight[:, 1] * x) / lengths)
        return np.diff(np.array(columns).T, axis=0, prepend=0.0)

    def _joints_and_tip(self, angle: FloatArray, bend: FloatArray) -> FloatArray:
        """Return the positions (joints + 1, 2) of the joints and of the tip, m."""
        tip = self.tip(angle, bend)
        return np.vstack([self._poses[self._bodies, :2], tip])

    def tip(self, angle: FloatArray, bend: FloatArray) -> FloatArray:
        """Return the position (2,) of the tip, m."""
        # A flat view has one index for each coordinate in the arrays of the kernels.
        q = self._state[0].reshape(-1)
        q[self._joint_places], q[self._elastic_places] = angle, bend
        self._kernels.call(poses, self._state, self._poses, self._tip)
        return self._tip[:2].copy()

    def readings(self, names: Sequence[str], q: FloatArray, qd: FloatArray) -> FloatArray:
        """Return the measurement (T, p) at T instants of a motion."""
        parts, angle = [], q[:, self.arm.joint_index]
        for name in names:
            if name == "joint_angle":
                parts.append(angle)
            elif name == "joint_rate":
                parts.append(qd[:, self.arm.joint_index])
            elif name == "strain":
                parts.append(q @ self.strains.T)
            else:
                bent = q[:, self.elastic]
                tips = [self.tip(at, bend) for at, bend in zip(angle, bent, strict=True)]
                parts.append(np.array(tips))
        return np.concatenate(parts, axis=1)


class MechanismModel(FlexibleModel):
    """Inverse dynamics of a mechanism: passive joints close its loops, a free base is at rest."""

    def __init__(self, coordinates: MinimalCoordinates) -> None:
        super().__init__(coordinates.arm)
        self._coordinates = coordinates
        self.unbalanced = coordinates.unbalanced.size

    def motion(
        self, angle: FloatArray, rate: FloatArray, acceleration: FloatArray, bend: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """See ``FlexibleModel.motion``; the loops are closed with the links bent."""
        arm, rows = self.arm, list[tuple[FloatArray, ...]]()
        before: list[FloatArray] = []
        for now in zip(angle, rate, acceleration, bend, strict=True):
            if before and all(map(np.array_equal, now, before)):  # as at rest
                rows.append(rows[-1])
                continue
            before = list(now)
            q, qd, qdd = np.zeros((3, arm.dof))
            for full, joints in zip((q, qd, qdd), now, strict=False):
                full[arm.joint_index] = joints
            q[self.elastic] = now[3]
            try:
                q = self._coordinates.motions(q).closed(arm, q)
            except np.linalg.LinAlgError:
                rule, hint = "close the loops", "fa.joint_motion(arm, ..., driven=[...]) does."
                angles = shown(np.round(now[0], 4).tolist())
                raise InputError(Problem("reference", rule, angles, hint)) from None
            motions = self._coordinates.motions(q)
            qd = motions.displacements(qd[motions.independent])
            force = arm.inverse_dynamics(q, qd, qdd)
            shares = self._coordinates.shared(force, self._coordinates.basis(q, motions))
            rows.append((q, qd, *shares))
        q, qd, torque, missing = (np.array(column) for column in zip(*rows, strict=True))
        return q, qd, torque, missing


class PostureGrid:
    """Grid over some of the joint angles; the others are constant.

    Args:
        posture: (joints,) rad, of the angles that are constant.
        schedule: for each joint None, or its increasing angles in the grid; None for one posture.

    Attributes:
        postures: (k, joints) rad of all nodes.
        axes: for each joint with several angles, its place, its angles, and the distance of nodes.
    """

    def __init__(self, posture: FloatArray, schedule: Sequence[ArrayLike | None] | None) -> None:
        joints = len(posture)
        listed = [None] * joints if schedule is None else as_list(schedule)
        axes = listed or []
        if listed is None or len(axes) != joints:
            rule = f"have one entry for each of the {joints} joints"
            raise InputError(Problem("schedule", rule, shown(schedule)))
        values: list[list[float]] = []
        for k, axis in enumerate(axes):
            angles = posture[k : k + 1] if axis is None else axis
            found = check_array(f"schedule[{k}]", angles, (-1,))
            if found.size == 0 or np.any(np.diff(found) <= 0.0):
                rule = "be one or more angles in increasing order"
                raise InputError(Problem(f"schedule[{k}]", rule, shown(axis)))
            values.append(found.tolist())
        self.postures = np.array(list(product(*values)))
        strides = np.cumprod([1, *(len(v) for v in values[:0:-1])])[::-1]
        self.axes = [
            (k, v, int(stride))
            for k, (v, stride) in enumerate(zip(values, strides, strict=True))
            if len(v) > 1
        ]

    def weights(self, angle: FloatArray) -> list[tuple[int, float]]:
        """Return nodes and their weights: linear in each angle, constant outside the grid."""
        corners = [(0, 1.0)]
        for k, values, stride in self.axes:
            a = float(angle[k])
            i = min(max(bisect_right(values, a) - 1, 0), len(values) - 2)
            part = min(max((a - values[i]) / (values[i + 1] - values[i]), 0.0), 1.0)
            corners = [
                (node + (i + step) * stride, weight * share)
                for node, weight in corners
                for step, share in ((0, 1.0 - part), (1, part))
                if share > 0.0
            ]
        return corners


class Interpolated:
    """Arrays that are given at the nodes of a grid and interpolated together.

    Args:
        grid: the grid. nodes: the arrays of each node, of equal shapes.

    Attributes:
        values: (k, numbers) of all arrays, at each node. shapes: of the arrays.
        arrays: at the last posture, overwritten by ``at``.
    """

    def __init__(self, grid: PostureGrid, nodes: Sequence[Sequence[FloatArray]]) -> None:
        self.grid = grid
        self.values = np.array([np.concatenate([a.ravel() for a in node]) for node in nodes])
        self.shapes = [array.shape for array in nodes[0]]
        self._begin()

    def _begin(self) -> None:
        self._now = self.values[0].copy()
        self._at: list[tuple[int, float]] | None = None
        self.arrays: list[FloatArray] = []
        start = 0
        for shape in self.shapes:
            size = math.prod(shape)
            self.arrays.append(self._now[start : start + size].reshape(shape))
            start += size

    def __getstate__(self) -> tuple[Any, ...]:
        return self.grid, self.values, self.shapes

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        # Rebuild the arrays, because copies of them would not be views of the buffer of ``move``.
        self.grid, self.values, self.shapes = state
        self._begin()

    def at(self, angle: FloatArray) -> list[FloatArray]:
        """Return the arrays at a posture, which the next call overwrites."""
        corners = self.grid.weights(angle)
        if corners != self._at:
            self._at = corners
            first, weight = corners[0]
            np.multiply(self.values[first], weight, out=self._now)
            for node, weight in corners[1:]:
                self._now += weight * self.values[node]
        return self.arrays

    def first_at(self, angles: FloatArray) -> FloatArray:
        """Return the first array at postures (T, joints), with shape (T, ...)."""
        if len(self.values) == 1:
            return np.broadcast_to(self.arrays[0], (len(angles), *self.arrays[0].shape))
        return np.array([self.at(angle)[0].copy() for angle in angles])


#: Number of sample times computed in one call.
_AHEAD = 64


class Nominal(NamedTuple):
    """Nominal motion at one instant.

    Attributes:
        angle: (joints,) rad. q, qd: (dof,). torque: (joints,) N m.
        missing: (unbalanced,) elastic forces r that no actuator balances, (C.20).
        shown: (p,) nominal measurement.
    """

    angle: FloatArray
    q: FloatArray
    qd: FloatArray
    torque: FloatArray
    missing: FloatArray
    shown: FloatArray


#: Function that returns the measurement (T, p) at q and qd (T, dof).
Shown = Callable[[FloatArray, FloatArray], FloatArray]


class PreviewedReference:
    """Nominal motion along a reference with sagging links, computed in advance; (C.20).

    A reference with ``vectorized`` true accepts arrays of times, and is evaluated at many sample
    times at once.

    Args:
        model: model of the arm.
        sag: elastic coordinates (dof - joints,) at rest, interpolated over posture.
        sample_time: s. steps: number of samples computed, including the current one.
        show: function that computes ``shown`` of `Nominal`.

    Attributes:
        missing: (steps, unbalanced) of `Nominal`, from the current sample on.
    """

    def __init__(
        self, model: FlexibleModel, sag: Interpolated, sample_time: float, steps: int, show: Shown
    ) -> None:
        self._show = show
        self._model, self._sag, self._sample_time, self._steps = model, sag, sample_time, steps
        arm = model.arm
        # Samples fill these buffers from the start. At the end they are copied back to the start.
        places = 3 * steps + _AHEAD
        shown = show(*np.zeros((2, 1, arm.dof)))
        sizes = arm.n_joints, arm.dof, arm.dof, arm.n_joints, model.unbalanced, shown.shape[1]
        self._buffers = Nominal(*(np.zeros((places, size)) for size in sizes))
        self.reset()

    def reset(self) -> None:
        """Clear the samples computed in advance."""
        self._reference: Reference | None = None
        self._first_tick = 0
        self._now: float | None = None
        self._start = self._end = 0  # index of the current sample, and end of the computed ones
        self.missing = self._buffers.missing[: self._steps]

    def at(self, t: float, reference: Reference) -> Nominal:
        """Return the nominal motion at t (s).

        Call it in the order of the samples; at the same time again, it returns the same.
        """
        if self._end == 0:
            self._first_tick = round(t / self._sample_time)
        elif t != self._now:
            self._start += 1
            if reference is not self._reference:  # keep the samples already previewed
                self._end = min(self._end, self._start + self._steps - 1)
        self._reference, self._now = reference, t
        if self._start + self._steps > self._end:
            self._go_on(reference)
        k = self._start
        self.missing = self._buffers.missing[k : k + self._steps]
        return Nominal(*[buffer[k] for buffer in self._buffers])

    def torques(self, count: int) -> FloatArray:
        """Return the torques (count, joints) from the current sample on, N m."""
        return self._buffers.torque[self._start : self._start + min(count, self._steps)]

    def states(self, count: int) -> FloatArray:
        """Return q and qd (count, 2 dof) from the current sample on."""
        here = slice(self._start, self._start + min(count, self._steps))
        return np.hstack([self._buffers.q[here], self._buffers.qd[here]])

    def _go_on(self, reference: Reference) -> None:
        """Compute more samples, at least up to the end of the preview."""
        many = bool(getattr(reference, "vectorized", False))
        count = self._start + self._steps - self._end
        count = max(count, _AHEAD) if many and self._end else count  # an analysis has one sample
        if self._end + count > len(self._buffers.angle):
            known = self._end - self._start
            for buffer in self._buffers:
                buffer[:known] = buffer[self._start : self._end].copy()
            self._first_tick += self._start
            self._start, self._end = 0, known
        samples = self._first_tick + np.arange(self._end, self._end + count)
        times = np.asarray(samples * self._sample_time, dtype=np.float64)
        new = slice(self._end, self._end + count)
        motion = self.along(*self._motion(times, reference))
        for buffer, values in zip(self._buffers, motion, strict=True):
            buffer[new] = values
        self._end = new.stop

    def _motion(self, times: FloatArray, reference: Reference) -> list[FloatArray]:
        """Return the angles, rates and accelerations at times (T,), (T, joints) each."""
        # Motions end at rest, and need not be defined beyond their end.
        end = float(getattr(reference, "end_time", np.inf))
        rests = times > end
        times = np.minimum(times, end)
        names = "joint_angle", "joint_rate", "joint_acceleration"
        angle, *rates = [values_of(reference, name, times).copy() for name in names]
        for values in rates:
            values[rests] = 0.0
        return [angle, *rates]

    def along(self, angle: FloatArray, rate: FloatArray, acceleration: FloatArray) -> Nominal:
        """Return the nominal motion at T times, for a motion of the joints (T, joints)."""
        bend = self._sag.first_at(angle)
        q, qd, torque, elastic_force = self._model.motion(angle, rate, acceleration, bend)
        return Nominal(angle, q, qd, torque, -elastic_force, self._show(q, qd))


class RecordedRun:
    """Nominal motion from a simulated run, including the motion of the links.

    Between the samples of the run, q is interpolated by the cubic through its values and rates, and
    qd and the torque linearly.
    """

    def __init__(
        self, model: FlexibleModel, run: Any, sample_time: float, steps: int, show: Shown
    ) -> None:
        self._sample_time, self._show = sample_time, show
        arm = model.arm
        self._joints = arm.joint_index
        self.missing = np.zeros((steps, model.unbalanced))  # zero along a simulated run
        try:
            time, q, qd, torque = (run[name].values for name in ("time", "q", "qd", "torque"))
        except (TypeError, KeyError, AttributeError):
            raise InputError(Problem("nominal", "be a result of simulate", shown(run))) from None
        if (q.shape, torque.shape) != ((time.size, arm.dof), (time.size, arm.n_joints)):
            rule = f"be a run of an arm with {arm.dof} coordinates and {arm.n_joints} joints"
            raise InputError(Problem("nominal", rule, f"one with {q.shape[1]} coordinates"))
        whole = all(np.isfinite(values).all() for values in (time, q, qd, torque))
        if time.size < 2 or not whole or np.any(np.diff(time) <= 0.0):
            rule = "have at least two samples, all finite, in order of time"
            raise InputError(Problem("nominal", rule, f"times {shown(time)}" if whole else "NaN"))
        self._ends, self._q = time[[0, -1]], interpolate.CubicHermiteSpline(time, q, qd)
        self._qd, self._torque = (
            interpolate.make_interp_spline(time, rows, k=1) for rows in (qd, torque)
        )

    def reset(self) -> None:
        """Return to the start of the run."""
        self._now = 0.0

    def at(self, t: float, reference: Reference | None) -> Nominal:
        """Return the nominal motion at t (s)."""
        self._now = t
        q, qd = np.split(self.states(1)[0], 2)
        shown = self._show(q[None], qd[None])[0]
        return Nominal(q[self._joints], q, qd, self.torques(1)[0], self.missing[0], shown)

    def torques(self, count: int) -> FloatArray:
        """Return the torques (count, joints) from the current sample on, N m."""
        # At mid-sample: a zero-order-hold torque has the effect of its mean.
        times = self._now + self._sample_time * (np.arange(count) + 0.5)
        return np.asarray(self._torque(times.clip(*self._ends)))

    def states(self, count: int) -> FloatArray:
        """Return q and qd (count, 2 dof) from the current sample on."""
        times = (self._now + self._sample_time * np.arange(count)).clip(*self._ends)
        return np.hstack([self._q(times), self._qd(times)])


def chord_matrix(arm: Arm) -> FloatArray:
    """Return the rotations of `FlexibleModel.chords` by the strains, (joints, gauges).

    For bending in the lowest modes with locked joints, as many as the gauges determine.
    """
    model, straight = FlexibleModel(arm), np.zeros(arm.n_joints)
    shapes = modes(arm, straight).shapes[: len(model.strains)]
    turned = model.chords(straight) @ shapes[:, model.elastic].T
    return np.asarray(turned @ np.linalg.pinv(model.strains @ shapes.T))


def strain_matrix(arm: Arm) -> FloatArray:
    """Return the derivative (gauges, dof) of the strains by q, in which they are linear."""
    units = np.zeros((arm.dof, 2, arm.dof))
    units[:, 0] = np.eye(arm.dof)
    return arm.strains(arm.padded(units)).T
