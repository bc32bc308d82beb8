"""The motion that linear controllers keep an arm on: coordinates, rates and torques over time."""

from __future__ import annotations

from collections import deque
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm import Arm
from flexarm.control.base import Reference
from flexarm.control.flexible_model import FlexibleModel
from flexarm.control.measurement import FloatArray
from flexarm.control.posture_grid import Interpolated
from flexarm.errors import InputError, Problem, shown


class Nominal(NamedTuple):
    """One moment of it.

    Attributes:
        angle: (joints,) rad. q, qd: (dof,). torque: (joints,) N m.
        missing: (dof - joints,) elastic forces that the links would need to stay so.
    """

    angle: FloatArray
    q: FloatArray
    qd: FloatArray
    torque: FloatArray
    missing: FloatArray


class PreviewedReference:
    """The reference with links as bent as they rest there, known some samples ahead; (C.20).

    Args:
        model: of the arm.
        sag: elastic coordinates (dof - joints,) at rest, over posture.
        sample_time: s. steps: samples known, the present one included.

    Attributes:
        missing: (steps, dof - joints) of `Nominal`, from the present sample on.
    """

    def __init__(
        self, model: FlexibleModel, sag: Interpolated, sample_time: float, steps: int
    ) -> None:
        self._model, self._sag, self._sample_time, self._steps = model, sag, sample_time, steps
        self._joints, self._elastic, self._dof = model.arm.joint_index, model.elastic, model.arm.dof
        self._nothing = np.zeros(model.arm.joints)
        # Samples move through it; when they reach its end they are copied to its beginning.
        self._buffer = np.zeros((4 * steps, model.elastic.size))
        self.reset()

    def reset(self) -> None:
        """Forget the posture held and what was known ahead."""
        self._known: deque[Nominal] = deque()
        self._last: Nominal | None = None
        self._start = 0
        self.missing = self._buffer[: self._steps]

    def at(self, t: float, angle_now: FloatArray, reference: Reference | None) -> Nominal:
        """Return the moment t (s); without a reference the arm stays where it was found."""
        tick = round(t / self._sample_time)
        if not self._known:
            for k in range(self._steps):
                self._add(k, tick + k, angle_now, reference)
            return self._known[0]
        self._known.popleft()
        self._start += 1
        if self._start + self._steps > len(self._buffer):
            kept = self._buffer[self._start : self._start + self._steps - 1].copy()
            self._buffer[: self._steps - 1] = kept
            self._start = 0
        self._add(self._start + self._steps - 1, tick + self._steps - 1, angle_now, reference)
        self.missing = self._buffer[self._start : self._start + self._steps]
        return self._known[0]

    def torques(self, count: int) -> FloatArray:
        """Return the torques (count, joints) from the present sample on, N m."""
        return np.array([moment.torque for moment in islice(self._known, count)])

    def _add(
        self, place: int, tick: int, angle_now: FloatArray, reference: Reference | None
    ) -> None:
        t = tick * self._sample_time
        if self._last is not None:
            found = self._last
        elif reference is None:
            found = self._last = self._moment(angle_now.copy(), self._nothing, self._nothing)
        else:
            found = self._moment(
                reference.joint_angle(t), reference.joint_rate(t), reference.joint_acceleration(t)
            )
            # Motions end at rest: from there on nothing needs to be computed anew.
            if t >= getattr(reference, "end_time", np.inf):
                self._last = found
        self._known.append(found)
        self._buffer[place] = found.missing

    def _moment(self, angle: FloatArray, rate: FloatArray, acceleration: FloatArray) -> Nominal:
        self._sag.move(angle)
        bend = self._sag.arrays[0]
        torque, elastic_force = self._model.forces(angle, rate, acceleration, bend)
        q, qd = np.zeros((2, self._dof))
        q[self._joints], q[self._elastic] = angle, bend
        qd[self._joints] = rate
        return Nominal(angle, q, qd, torque, -elastic_force)


class RecordedRun:
    """A run that was simulated before, as one to stay on: the links' own motion included.

    Between samples q follows the cubic through its values and rates, the torque a line.
    """

    def __init__(
        self, where: str, model: FlexibleModel, run: Any, sample_time: float, steps: int
    ) -> None:
        self._sample_time = sample_time
        arm = model.arm
        self._joints = arm.joint_index
        self.missing = np.zeros((steps, model.elastic.size))  # it satisfies the arm's equations
        try:
            self._time = np.asarray(run.time.values, dtype=np.float64)
            self._q, self._qd = np.asarray(run.q.values), np.asarray(run.qd.values)
            self._torque = np.asarray(run.torque.values)
        except AttributeError:
            rule = "be a result of simulate"
            raise InputError(Problem(where, "nominal", rule, shown(run))) from None
        shapes = self._q.shape, self._torque.shape
        if shapes != ((self._time.size, arm.dof), (self._time.size, arm.joints)):
            rule = f"be a run of this arm, of {arm.dof} coordinates and {arm.joints} joints"
            raise InputError(Problem(where, "nominal", rule, f"one of {self._q.shape[1]}"))

    def reset(self) -> None:
        """Begin anew."""
        self._now = 0.0

    def at(self, t: float, angle_now: FloatArray, reference: Reference | None) -> Nominal:
        """Return the moment t (s)."""
        self._now = t
        q, qd = self._state(t)
        torque = self._torque_from(t)
        return Nominal(q[self._joints], q, qd, torque, self.missing[0])

    def torques(self, count: int) -> FloatArray:
        """Return the torques (count, joints) from the present sample on, N m."""
        times = self._now + self._sample_time * np.arange(count)
        return np.array([self._torque_from(t) for t in times])

    def _torque_from(self, t: float) -> FloatArray:
        """Torque to hold from t on: a torque that is held does what its mean does."""
        return self._line(self._torque, t + 0.5 * self._sample_time)

    def _state(self, t: float) -> tuple[FloatArray, FloatArray]:
        k = int(np.clip(np.searchsorted(self._time, t, side="right") - 1, 0, self._time.size - 2))
        h = self._time[k + 1] - self._time[k]
        s = min(max((t - self._time[k]) / h, 0.0), 1.0)
        a, b, da, db = self._q[k], self._q[k + 1], h * self._qd[k], h * self._qd[k + 1]
        rise = b - a
        q = a + s * (da + s * (3.0 * rise - 2.0 * da - db + s * (da + db - 2.0 * rise)))
        return q, (1.0 - s) * self._qd[k] + s * self._qd[k + 1]

    def _line(self, values: FloatArray, t: float) -> FloatArray:
        k = int(np.clip(np.searchsorted(self._time, t, side="right") - 1, 0, self._time.size - 2))
        s = (t - self._time[k]) / (self._time[k + 1] - self._time[k])
        s = min(max(s, 0.0), 1.0)
        found: FloatArray = (1.0 - s) * values[k] + s * values[k + 1]
        return found


def strain_matrix(arm: Arm) -> FloatArray:
    """Return the strains by q, (gauges, dof): they are linear in q."""
    units = np.zeros((arm.dof, 2, arm.dof))
    units[:, 0] = np.eye(arm.dof)
    return arm.strains(arm.padded(units)).T
