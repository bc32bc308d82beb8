"""An extended Kalman filter: elastic states and the payload from encoders and strain gauges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arguments import (
    check_kind,
    check_list_of,
    check_mapping,
    check_nonnegative,
    check_numbers,
)
from flexarm.arm import Arm
from flexarm.bending import one_warning, warn_of_first
from flexarm.control.gains import Gains
from flexarm.control_design.rigid_model import RigidModel
from flexarm.errors import (
    InputError,
    Problem,
    check_array,
    shown,
)
from flexarm.estimation.innovation_test import InnovationTest
from flexarm.estimation.payload_hypotheses import (
    Hypothesis,
    combined,
    moments,
    reduced,
    split,
)
from flexarm.estimation.predicted_readings import LARGEST, PredictedReadings
from flexarm.hardware.instruments import Instrument
from flexarm.hardware.measurement import FloatArray, Measurement
from flexarm.linear.equilibrium import equilibrium
from flexarm.linear.sampled_step import SampledStep
from flexarm.model.variation import varied_spec

#: Encoders are read with the first sample: before it, angles are this much less certain.
_BEFORE_READING = 100.0
#: Updates by readings that are not linear in the state are linearised anew so many times.
_ITERATIONS = 3


class Estimates(NamedTuple):
    """Estimates of a record, after the readings of each tick.

    q and qd (ticks, dof), payload_mass (ticks,) kg, covariance (ticks, s, s) of
    [q, qd, payload_mass]; innovation (ticks,), the normalised innovation squared of each tick over
    the number of readings, one on average; consistent, False if the innovation test failed.
    """

    q: FloatArray
    qd: FloatArray
    payload_mass: FloatArray
    covariance: FloatArray
    innovation: FloatArray
    consistent: bool


class ExtendedKalmanFilter:
    """Joint angles, rates, modal coordinates and payload mass from readings; (C.55) to (C.58).

    Between samples the arm's nonlinear equations propagate the estimate, and their exact derivative
    its covariance. The payload is a sum of Gaussians over the logarithm of payload plus own mass
    of the tip, each with an extended Kalman filter of its own, until one is left. Use it in a loop
    by ``EstimatorController``, on a record by ``run``, or by hand: ``reset``, then ``correct`` and
    ``predict`` in turn.

    Args:
        arm: what is believed of the arm. One or two modes a link are enough.
        instruments: what is read: "joint_angle" (needed), "joint_rate", "strain", `Sensor`s; noise
            and resolution weigh them.
        torque_noise: N m, one number or one per joint, standard deviation of an error of the torque
            that is drawn anew at each sample: everything the model leaves out.
        payload_deviation: kg, standard deviation of the arm's payload mass; 0 where it is known. A
            large one raises the mean of the start, as masses are not negative.
        payload_drift: kg/s^0.5, by which it wanders.
        rate_deviation: rad/s, of the joint rates at the start.
        energy_deviation: J, energy of vibration expected in each mode at the start.
        sample_time: s.

    Attributes:
        innovation: mean of the normalised innovations squared over the last 100 samples, one if
            the filter is consistent; NaN before.
        consistent: False once that mean exceeded its distribution (probability 1e-9). An
            ``InconsistentEstimateWarning`` says so once after each ``reset``.

    Raises:
        InputError: if numbers are negative or not finite, or instruments do not fit.

    It starts at the first readings of the encoders, with links at rest as gravity bends them.
    """

    def __init__(
        self,
        arm: Arm,
        instruments: Sequence[Instrument],
        torque_noise: ArrayLike = 0.1,
        payload_deviation: float = 0.0,
        payload_drift: float = 0.0,
        rate_deviation: float = 0.1,
        energy_deviation: float = 0.01,
        sample_time: float = 1e-3,
    ) -> None:
        where, gains = "ExtendedKalmanFilter", Gains("ExtendedKalmanFilter")
        arm = check_kind(where, "arm", arm, Arm)
        instruments = check_list_of(where, "instruments", instruments, Instrument)
        self.torque_noise = gains.each("torque_noise", torque_noise, arm.joints)
        self.payload_deviation = gains.one("payload_deviation", payload_deviation)
        self.payload_drift = gains.one("payload_drift", payload_drift)
        self.rate_deviation = gains.one("rate_deviation", rate_deviation)
        self.energy_deviation = gains.one("energy_deviation", energy_deviation)
        self.sample_time = gains.one("sample_time", sample_time, positive=True)
        gains.done()
        self.arm, self.instruments = arm, tuple(instruments)
        self._readings = PredictedReadings(where, arm, self.instruments)
        self._step: SampledStep | None = None
        self._made_for = 0.0
        self._nominal = arm.spec.payload.mass
        self._own = _tip_mass(arm)
        self.reset()

    def reset(self) -> None:
        """Forget everything; the next ``correct`` begins anew."""
        if self._step is None or self._made_for != self.sample_time:
            self._step = SampledStep(self.arm, self.sample_time, where="ExtendedKalmanFilter")
            self._made_for = self.sample_time
        size, joints = 2 * self.arm.dof + 1, self.arm.joints
        self._scale = self._nominal + self._own  # kg, mass at logarithm 0
        self._parts = [Hypothesis(np.zeros(size), np.zeros((size, size)), 0.0)]
        self._torque = np.zeros(joints)
        # How much the error of the last torque has moved [q, qd, payload] of each hypothesis.
        self._moved = [np.zeros((size, joints))]
        self._begun = False
        self._test = InnovationTest(self._readings.size)
        self._innovation = np.nan

    @property
    def q(self) -> FloatArray:
        """Estimated coordinates (dof,)."""
        return self._moments()[0][: self.arm.dof]

    @property
    def qd(self) -> FloatArray:
        """Estimated rates (dof,)."""
        return self._moments()[0][self.arm.dof : -1]

    @property
    def payload_mass(self) -> float:
        """Estimated mass of the payload, kg."""
        return float(self._moments()[0][-1])

    @property
    def covariance(self) -> FloatArray:
        """Covariance (2 dof + 1, 2 dof + 1) of the error of [q, qd, payload_mass]."""
        return self._moments()[1]

    @property
    def innovation(self) -> float:
        """Mean of the normalised innovations squared over the last 100 samples; NaN before."""
        return self._test.ratio

    @property
    def consistent(self) -> bool:
        """Whether that mean has stayed within its distribution."""
        return self._test.passed

    def report(self) -> dict[str, float]:
        """Return the largest mean innovation, and 1 if the filter passed its test, else 0."""
        return {
            "estimator_innovation": self._test.worst,
            "estimator_consistent": int(self.consistent),
        }

    def begin(
        self, q: ArrayLike, qd: ArrayLike, payload_mass: float, covariance: ArrayLike
    ) -> None:
        """Begin at an estimate (dof,), (dof,), kg with a covariance, in place of the first reading.

        Raises:
            InputError: if a shape is wrong, a number NaN, infinite or above 1e9, or the mass
                negative.
        """
        where, size = "ExtendedKalmanFilter.begin", 2 * self.arm.dof + 1
        parts = [check_array(where, n, v, (self.arm.dof,)) for n, v in (("q", q), ("qd", qd))]
        mass = check_nonnegative(where, "payload_mass", payload_mass)
        given = check_array(where, "covariance", covariance, (size, size))
        for name, numbers in (("payload_mass", mass), ("covariance", given)):
            if np.max(np.abs(numbers)) > LARGEST:
                rule = f"be at most {LARGEST:g}"
                raise InputError(Problem(where, name, rule, shown(float(np.max(np.abs(numbers))))))
        self._start(np.concatenate([*parts, [mass]]), given)

    def correct(self, measurement: Measurement) -> None:
        """Take the readings of this moment.

        Raises:
            InputError: if it is not a `Measurement`, a reading has the wrong shape, is not finite
                or above 1e9, or the estimate has diverged.
        """
        where = "ExtendedKalmanFilter.correct"
        check_kind(where, "measurement", measurement, Measurement)
        from scipy.linalg import cho_factor, cho_solve

        readings = self._readings.stacked(where, measurement)
        if not self._begun:
            self._begin(measurement)
        if not all(np.isfinite(part.x).all() and np.isfinite(part.P).all() for part in self._parts):
            hint = "Correct the arm, the readings or the torques, and call reset."
            raise InputError(Problem(where, "the estimate", "be finite", "infinite", hint))
        # Weights before the readings: those of the prediction.
        before = [replace(part) for part in self._parts]
        predicted, expected = [], []
        for part, moved in zip(self._parts, self._moved, strict=True):
            values, S = self._update(part, moved, readings)
            predicted.append(values)
            expected.append(S)
            factor = cho_factor(S)
            missed = readings - values
            part.log_weight -= 0.5 * float(missed @ cho_solve(factor, missed))
            part.log_weight -= float(np.sum(np.log(np.diag(factor[0]))))
        self._judge(before, readings, predicted, expected)
        self._parts = reduced(self._parts)
        self._moved = [np.zeros_like(self._moved[0])] * len(self._parts)

    def predict(self, torque: ArrayLike) -> None:
        """Go on to the next sample time under a torque (joints,) N m, held.

        Raises:
            InputError: if the torque does not have shape (joints,), or is not finite.
        """
        where, shape = "ExtendedKalmanFilter.predict", self._torque.shape
        assert self._step is not None
        self._torque = check_array(where, "torque", torque, shape)
        self._moved = []
        for part in self._parts:
            step = self._step.take(part.x[:-1], self._torque, self._change(part.x))
            size = step.after.size
            F = np.eye(size + 1)
            mass = self._moving(part.x)
            F[:size, :size], F[:size, size] = step.state, step.parameter * mass
            part.x[:size] = step.after
            noisy = step.torque * self.torque_noise
            part.P = F @ part.P @ F.T
            part.P[:size, :size] += noisy @ noisy.T
            if self.payload_drift:
                wandered = self.payload_drift**2 * self.sample_time
                part.P[size, size] += np.log1p(wandered / mass**2)
            self._moved.append(np.vstack([noisy, np.zeros_like(noisy[:1])]))

    def run(self, torque: ArrayLike, readings: Mapping[str, ArrayLike]) -> Estimates:
        """Filter a record from its start: what ``correct`` and ``predict`` give, tick by tick.

        Args:
            torque: (ticks, joints) N m, held from each tick to the next.
            readings: by the instruments' names, (ticks, ...).

        Raises:
            InputError: if readings of an instrument are missing or not as many as torques.
        """
        where = "ExtendedKalmanFilter.run"
        held = check_array(where, "torque", torque, (-1, self.arm.joints))
        given_by_name = check_mapping(where, "readings", readings, "names and readings")
        arrays = {}
        for item in self.instruments:
            name = f"readings[{item.label!r}]"
            given = check_numbers(where, name, given_by_name.get(item.label, ()))
            if given.ndim == 0 or len(given) != len(held):
                rule = f"hold {item.label!r} with one row for each of the {len(held)} torques"
                raise InputError(Problem(where, "readings", rule, f"of shape {given.shape}"))
            arrays[item.label] = check_array(where, name, given, (-1,) * given.ndim)
        self.reset()
        kept = []
        for k in range(len(held)):
            if k:
                self.predict(held[k - 1])
            self.correct(Measurement(**{name: values[k] for name, values in arrays.items()}))
            kept.append((*self._moments(), self._innovation))
        x, covariance, innovation = (np.array(part) for part in zip(*kept, strict=True))
        q, qd = x[:, : self.arm.dof], x[:, self.arm.dof : -1]
        return Estimates(q, qd, x[:, -1], covariance, innovation, self.consistent)

    def _update(
        self, part: Hypothesis, moved: FloatArray, readings: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Correct a hypothesis; return the readings that it predicted, and their covariance."""
        from scipy.linalg import cho_factor, cho_solve

        assert self._step is not None
        before, x = part.x, part.x
        for iteration in range(1 if self._readings.linear else _ITERATIONS):
            constants = self._step.constants(self._change(x))
            seen = self._readings.predict(x[:-1], self._torque, constants)
            H = np.hstack([seen.state, (seen.parameter * self._moving(x))[:, None]])
            # Accelerometers feel the same error of the torque that has moved the state.
            felt = seen.torque * self.torque_noise
            R = np.diag(self._readings.variance) + felt @ felt.T
            N = moved @ felt.T
            S = H @ part.P @ H.T + H @ N + N.T @ H.T + R
            K = cho_solve(cho_factor(S), (part.P @ H.T + N).T).T
            expected = seen.values + H @ (before - x)
            if iteration == 0:
                predicted, deviation = expected, S
            x = before + K @ (readings - expected)
        left = np.eye(x.size) - K @ H
        # In Joseph's form rounding leaves the covariance symmetric and positive.
        both = left @ N @ K.T
        part.x, part.P = x, left @ part.P @ left.T + K @ R @ K.T - both - both.T
        return predicted, deviation

    def _judge(
        self,
        before: list[Hypothesis],
        readings: FloatArray,
        predicted: list[FloatArray],
        expected: list[FloatArray],
    ) -> None:
        """Test the innovation of the whole mixture."""
        mean, covariance = combined(before, predicted, expected)
        missed = readings - mean
        squared = float(missed @ np.linalg.solve(covariance, missed))
        self._innovation = squared / readings.size
        self._test.add(squared)

    def _moments(self) -> tuple[FloatArray, FloatArray]:
        """Return mean and covariance of [q, qd, payload_mass]."""
        return moments(self._parts, self._scale, self._own)

    def _moving(self, x: FloatArray) -> float:
        """Return the mass (kg) whose logarithm is estimated: payload and own mass of the tip."""
        return self._scale * float(np.exp(x[-1]))

    def _change(self, x: FloatArray) -> float:
        return max(self._moving(x) - self._own, 0.0) - self._nominal

    def _start(self, x: FloatArray, covariance: FloatArray) -> None:
        """Begin at mean and covariance of [q, qd, payload_mass]."""
        self._scale, parts = split(x + self._own * np.eye(x.size)[-1], covariance)
        self._parts = [part for part in parts if self._moving(part.x) >= self._own] or parts
        self._moved = [np.zeros((x.size, self.arm.joints))] * len(self._parts)
        self._begun = True

    def _begin(self, measurement: Measurement) -> None:
        arm, count = self.arm, self.arm.dof
        angle_item = next(i for i in self.instruments if i.signal == "joint_angle")
        angles = np.asarray(measurement[angle_item.label])
        with one_warning() as bent:
            q, by_mass = self._sag(angles)
        warn_of_first(bent)
        stiffness = np.diag(arm.stiffness_matrix(arm.rest(angles))).copy()
        energy = 2.0 * self.energy_deviation
        variance = np.full(2 * count + 1, energy)
        variance[:count] = energy / np.maximum(stiffness, 1e-12)
        joints = arm.joint_index
        # The reading is used once, by the update that follows.
        variance[joints] = angle_item.noise**2 + angle_item.resolution**2 / 12.0
        variance[joints] *= _BEFORE_READING**2
        variance[count + joints] = self.rate_deviation**2
        variance[-1] = 0.0
        slope = np.concatenate([by_mass, np.zeros(count), [1.0]])
        P = np.diag(variance) + self.payload_deviation**2 * np.outer(slope, slope)
        self._start(np.concatenate([q, np.zeros(count), [self._nominal]]), P)

    def _sag(self, angles: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return coordinates (dof,) at rest and their derivative by the payload, 1/kg."""
        arm = self.arm
        if not any(arm.spec.gravity):
            q = arm.rest(angles)
            return q, np.zeros_like(q)
        q = equilibrium(arm, angles).q
        if self.payload_deviation == 0.0:
            return q, np.zeros_like(q)
        # Sag is linear in the mass but for large bending: a difference is enough.
        more = 0.1 * self.payload_deviation
        heavier = Arm(varied_spec(arm.spec, payload_mass=self._nominal + more))
        return q, (equilibrium(heavier, angles).q - q) / more


def _tip_mass(arm: Arm) -> float:
    """Return the mass (kg) at the tip with the inertia of the last link about its joint.

    Accelerations of the tip go with one over this mass plus the payload's, so that they are nearly
    exponential in the logarithm of the sum, down to no payload at all.
    """
    inertia = RigidModel(arm).mass_matrix(np.zeros(arm.joints))[-1, -1]
    own = float(inertia) / float(arm.lengths[-1]) ** 2 - arm.spec.payload.mass
    return max(own, 1e-3 * float(inertia) / float(arm.lengths[-1]) ** 2)
