"""One record along an extended Kalman filter: predictions with given gains, and linearisation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.errors import FlexarmError, InputError, Problem
from flexarm.control.filters.predicted_readings import LINEAR_SIGNALS, reading_rows
from flexarm.identification.labels import place_of
from flexarm.identification.prediction.linear_filter import Gains, LinearModel, corrected
from flexarm.identification.record import MeasuredRecord
from flexarm.identification.runs import RecordRun
from flexarm.identification.space import Case
from flexarm.integrate.base import FloatArray
from flexarm.linear.step_derivatives.sampled_step import SampledStep
from flexarm.model import Instrument

#: Parts of a sample in which the torque is constant, if it is not a zero-order hold.
_PARTS = 4
#: Largest product of step and fastest rate. The fastest mode is 0.8 % too slow, one of a fifth of
#: its frequency 1e-5: no mass is estimated from the fast modes, as a filter does.
_REACH = 1.0
#: Deviation of an unknown offset, in standard deviations of its channel.
_OFFSET = 10.0
#: Fraction of a sample below which a delay is a whole number of samples.
_WHOLE = 1e-6


class _Model(NamedTuple):
    """An arm along a record: steps, torques (samples - 1, parts, joints), readings and start."""

    step: SampledStep
    torques: FloatArray
    H: FloatArray
    start: FloatArray


class PredictedRun(RecordRun):
    """Predictions of each sample of a record from the samples before.

    The states are [q, qd] and the offsets of channels whose mean is removed. A delayed channel is
    compared at the time of its motion: its samples are moved by the delay.

    Attributes:
        gains: of the filter; set before ``simulate``.

    Raises:
        InputError: if the record does not fit the arm, or is not supported; lists all problems.
    """

    #: The predicted strain contains measured strains.
    proportional = False

    def __init__(
        self, name: str, record: MeasuredRecord, arm: Arm, options: Mapping[str, Any]
    ) -> None:
        problems = _problems(name, record)
        if problems:
            raise InputError(*problems)
        super().__init__(name, record, arm, options)
        self.gains: Gains | None = None
        settings = record.settings
        for k, label in enumerate(self.labels):
            self._move(k, settings.delays.get(label.channel, 0.0))
        filters = [settings.filters.get(label.channel, ()) for label in self.labels]
        self._factors = np.array(
            [np.prod([i.factor for i in own if i.factor is not None]) for own in filters]
        )
        centred = [any(i.kind == "remove_mean" for i in own) for own in filters]
        self._offsets = np.eye(len(self.labels))[:, centred]
        exact = self.record.interpolation == "hold" and record.input not in settings.delays
        self._parts = 1 if exact else _PARTS

    @property
    def differentiable(self) -> bool:
        """Whether ``sensitivities`` supports the run: never, because of the corrections."""
        return False

    def _move(self, column: int, delay: float) -> None:
        """Move the samples of a channel to the times of their motion."""
        if delay == 0.0:
            return
        own = self.valid[:, column]
        count, shift = own.size, delay * self.record.rate
        values, valid = np.zeros(count), np.zeros(count, bool)
        whole = round(shift)
        if abs(shift - whole) < _WHOLE:
            kept = max(count - whole, 0)
            values[:kept], valid[:kept] = self.measured[whole:, column], own[whole:]
        else:
            from scipy.interpolate import CubicSpline

            later = np.arange(count) + shift
            edges = np.flatnonzero(np.diff(own, prepend=False, append=False))
            for first, end in edges.reshape(-1, 2):  # between gaps
                inside = (later >= first) & (later <= end - 1)
                if np.any(inside):
                    places = np.arange(first, end)
                    spline = CubicSpline(places, self.measured[first:end, column])
                    values[inside], valid[inside] = spline(later[inside]), True
        self.measured[:, column], self.valid[:, column] = values, valid

    def simulate(self, cases: Sequence[Case]) -> list[FloatArray | str]:
        """Return the predictions (samples, channels) of each case, or the reason of its failure."""
        return [self._predictions(case) for case in cases]

    def _predictions(self, case: Case) -> FloatArray | str:
        assert self.gains is not None
        try:
            model = self._model(case)
        except FlexarmError as error:
            return str(error)
        z, size = model.start, 2 * model.step.arm.dof
        found = np.zeros(self.measured.shape)
        with np.errstate(all="ignore"):
            for k in range(self.times.size):
                found[k] = model.H @ z
                z = z + self.gains.K[k] @ np.where(self.valid[k], self.measured[k] - found[k], 0.0)
                if k == len(model.torques):
                    break
                for torque in model.torques[k]:
                    z[:size] = model.step.advance(z[:size], torque)
                if not np.isfinite(z[0]):
                    return f"the prediction diverges at t = {self.times[k]:.6g} s"
        return found

    def linearised(
        self, case: Case, torque_noise: FloatArray, noise: FloatArray
    ) -> LinearModel | str:
        """Run the extended filter; return the linear model along it, or why it fails.

        Args:
            torque_noise: (joints,), N m
            noise: (channels,)
        """
        try:
            model = self._model(case)
        except FlexarmError as error:
            return str(error)
        size, n = 2 * model.step.arm.dof, model.start.size
        count = self.times.size - 1
        F, G = np.tile(np.eye(n), (count, 1, 1)), np.zeros((count, n, torque_noise.size))
        b = np.zeros((count, n))
        z, P = model.start, self._covariance(size)
        for k in range(count):
            try:
                update = corrected(P[None], model.H, noise[None], self.valid[k])
            except np.linalg.LinAlgError:
                return f"the filter diverges at t = {self.times[k]:.6g} s"
            missed = np.where(self.valid[k], self.measured[k] - model.H @ z, 0.0)
            z = z + update.K[0] @ missed
            before = z.copy()
            for torque in model.torques[k]:
                step = model.step.take(z[:size], torque)
                z[:size] = step.after
                F[k, :size, :size] = step.state @ F[k, :size, :size]
                G[k, :size] = step.state @ G[k, :size] + step.torque
            if not np.all(np.isfinite(z)):
                return f"the filter diverges at t = {self.times[k]:.6g} s"
            b[k] = z - F[k] @ before
            moved = G[k] * torque_noise
            P = F[k] @ update.P[0] @ F[k].T + moved @ moved.T
        return LinearModel(F, G, b, model.H, model.start, self._covariance(size))

    def torque_power(self, case: Case) -> FloatArray:
        """Return the mean squares (joints,) of the torques."""
        return np.asarray(np.mean(self._torque(case).at(self.times) ** 2, axis=0))

    def _covariance(self, size: int) -> FloatArray:
        """Return the covariance of the start: that of the offsets."""
        each = [np.std(self.measured[self.valid[:, k], k]) for k in range(len(self.labels))]
        deviations = _OFFSET * np.array(each) @ self._offsets
        return np.diag(np.concatenate([np.zeros(size), deviations**2]))

    def _model(self, case: Case) -> _Model:
        """Return the arm of a case along the record.

        Raises:
            FlexarmError: if the arm is not possible, or has no equilibrium.
        """
        arm = Arm(case.spec)
        rows = {name: reading_rows(arm, Instrument(name)) for name in self.channels}
        H = np.stack([rows[label.channel][place_of(arm, label)] for label in self.labels])
        return _Model(
            SampledStep(arm, 1.0 / (self.record.rate * self._parts), reach=_REACH),
            self._held_torques(case),
            np.hstack([self._factors[:, None] * H, self._offsets]),
            np.concatenate([*self._state(arm, case), np.zeros(self._offsets.shape[1])]),
        )

    def _held_torques(self, case: Case) -> FloatArray:
        """Return the torques (samples - 1, parts, joints), constant in each part of a sample.

        Impulse and first moment of a straight line over a sample are exact.
        """
        edges = np.linspace(0.0, self.times[-1], self._parts * (self.times.size - 1) + 1)
        held = self._torque(case).means(edges).reshape(self.times.size - 1, self._parts, -1)
        if self._parts == 1:
            return held
        mean = held.mean(axis=1, keepdims=True)
        return np.asarray(mean + (held - mean) / (1.0 - self._parts**-2))


def _problems(name: str, record: MeasuredRecord) -> list[Problem]:
    """Return what prediction errors do not support."""
    settings, found = record.settings, []
    with_error = "is not supported with prediction_error"
    if record.controller is not None:
        hint = "Use the measured torque as the input."
        found.append(Problem("controller", with_error, hint=hint))
    if settings.prescribed:
        found.append(Problem("prescribed", with_error))
    names = dict.fromkeys(label.channel for label in record.outputs)
    for channel in names:
        if channel not in LINEAR_SIGNALS:
            hint = f"Choose outputs from {', '.join(LINEAR_SIGNALS)}."
            found.append(Problem(f"outputs: {channel}", with_error, hint=hint))
        for item in settings.filters.get(channel, ()):
            if item.kind not in ("gain", "remove_mean"):
                found.append(Problem(f"filters: {channel}", f"{item.kind} {with_error}"))
    return [Problem(p.name, p.rule, p.value, p.hint, where=name) for p in found]
