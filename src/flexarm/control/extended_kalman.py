"""An extended Kalman filter: elastic states and the payload from encoders and strain gauges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arguments import check_kind, check_list_of, check_mapping, check_times
from flexarm.arm import Arm
from flexarm.control.gains import Gains
from flexarm.control.instruments import Instrument
from flexarm.control.measurement import FloatArray, Measurement
from flexarm.control.predicted_readings import PredictedReadings
from flexarm.errors import InputError, Problem, check_array
from flexarm.linear.equilibrium import equilibrium
from flexarm.linear.sampled_step import SampledStep


class Estimates(NamedTuple):
    """What a filter made of a record, after each tick's readings.

    Of every row: q and qd (ticks, dof), payload_mass (ticks,) kg, covariance (ticks, s, s) of
    [q, qd, payload_mass].
    """

    q: FloatArray
    qd: FloatArray
    payload_mass: FloatArray
    covariance: FloatArray


class ExtendedKalmanFilter:
    """Joint angles, rates, modal coordinates and payload mass from readings; (C.55) to (C.58).

    Between samples the arm's own nonlinear equations carry the estimate, and their exact derivative
    carries its covariance; so it is with the readings. Use it in a loop by ``EstimatorController``,
    on a record by ``run``, or by hand: ``reset``, then ``correct`` and ``predict`` in turn.

    Args:
        arm: what is believed of the arm. One or two modes a link are enough.
        instruments: what is read: "joint_angle" (needed), "joint_rate", "strain", `Sensor`s; noise
            and resolution weigh them.
        torque_noise: N m, one number or one per joint, standard deviation of an error of the torque
            that is drawn anew at each sample: everything the model leaves out.
        payload_deviation: kg, standard deviation of the arm's payload mass; 0 where it is known.
        payload_drift: kg/s^0.5, by which it wanders.
        rate_deviation: rad/s, of the joint rates at the start.
        energy_deviation: J, energy of vibration expected in each mode at the start.
        sample_time: s.

    Raises:
        InputError: numbers that are negative or not finite, instruments that do not fit.

    It begins at the first readings of the encoders: links at rest as gravity bends them.
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
        self.reset()

    def reset(self) -> None:
        """Forget everything; the next ``correct`` begins anew."""
        if self._step is None or self._made_for != self.sample_time:
            self._step = SampledStep(self.arm, self.sample_time, where="ExtendedKalmanFilter")
            self._made_for = self.sample_time
        self._x = np.zeros(2 * self.arm.dof + 1)
        self._P = np.zeros((self._x.size, self._x.size))
        self._torque = np.zeros(self.arm.joints)
        # How much the error of the last torque has moved [q, qd, payload].
        self._moved = np.zeros((self._x.size, self.arm.joints))
        self._begun = False

    @property
    def q(self) -> FloatArray:
        """Estimated coordinates (dof,)."""
        return self._x[: self.arm.dof].copy()

    @property
    def qd(self) -> FloatArray:
        """Estimated rates (dof,)."""
        return self._x[self.arm.dof : -1].copy()

    @property
    def payload_mass(self) -> float:
        """Estimated mass of the payload, kg."""
        return float(self._x[-1])

    @property
    def covariance(self) -> FloatArray:
        """Covariance (2 dof + 1, 2 dof + 1) of the error of [q, qd, payload_mass]."""
        return self._P.copy()

    def begin(
        self, q: ArrayLike, qd: ArrayLike, payload_mass: float, covariance: ArrayLike
    ) -> None:
        """Begin at an estimate (dof,), (dof,), kg with a covariance, in place of the first reading.

        Raises:
            InputError: wrong shape, NaN or infinity.
        """
        where, size = "ExtendedKalmanFilter.begin", self._x.size
        parts = [check_array(where, n, v, (self.arm.dof,)) for n, v in (("q", q), ("qd", qd))]
        mass = check_array(where, "payload_mass", payload_mass, ())
        self._P = check_array(where, "covariance", covariance, (size, size))
        self._x = np.concatenate([*parts, [mass]])
        self._begun = True

    def correct(self, measurement: Measurement) -> None:
        """Take the readings of this moment.

        Raises:
            InputError: if it is not a `Measurement`.
        """
        check_kind("ExtendedKalmanFilter.correct", "measurement", measurement, Measurement)
        from scipy.linalg import cho_factor, cho_solve

        if not self._begun:
            self._begin(measurement)
        assert self._step is not None
        constants = self._step.constants(self._change)
        seen = self._readings.predict(self._x[:-1], self._torque, constants)
        H = np.hstack([seen.state, seen.parameter[:, None]])
        # Accelerometers feel the same error of the torque that has moved the state.
        felt = seen.torque * self.torque_noise
        R = np.diag(self._readings.variance) + felt @ felt.T
        N = self._moved @ felt.T
        S = H @ self._P @ H.T + H @ N + N.T @ H.T + R
        K = cho_solve(cho_factor(S), (self._P @ H.T + N).T).T
        self._x = self._x + K @ (self._readings.stacked(measurement) - seen.values)
        self._x[-1] = max(self._x[-1], 0.0)
        left = np.eye(self._x.size) - K @ H
        # In Joseph's form rounding leaves the covariance symmetric and positive.
        both = left @ N @ K.T
        self._P = left @ self._P @ left.T + K @ R @ K.T - both - both.T
        self._moved = np.zeros_like(self._moved)

    def predict(self, torque: ArrayLike) -> None:
        """Go on to the next sample time under a torque (joints,) N m, held.

        Raises:
            InputError: if the torque does not have shape (joints,), or is not finite.
        """
        where, shape = "ExtendedKalmanFilter.predict", self._torque.shape
        assert self._step is not None
        self._torque = check_array(where, "torque", torque, shape)
        step = self._step.take(self._x[:-1], self._torque, self._change)
        size = step.after.size
        F = np.eye(size + 1)
        F[:size, :size], F[:size, size] = step.state, step.parameter
        self._x[:size] = step.after
        noisy = step.torque * self.torque_noise
        self._P = F @ self._P @ F.T
        self._moved[:size] = noisy
        self._P[:size, :size] += noisy @ noisy.T
        self._P[size, size] += self.payload_drift**2 * self.sample_time

    def run(self, torque: ArrayLike, readings: Mapping[str, ArrayLike]) -> Estimates:
        """Filter a record from its start: what ``correct`` and ``predict`` give, tick by tick.

        Args:
            torque: (ticks, joints) N m, held from each tick to the next.
            readings: by the instruments' names, (ticks, ...).

        Raises:
            InputError: an instrument's readings are missing or not as many as torques.
        """
        where = "ExtendedKalmanFilter.run"
        held = check_array(where, "torque", torque, (-1, self.arm.joints))
        given_by_name = check_mapping(where, "readings", readings, "names and readings")
        arrays = {}
        for item in self.instruments:
            name, rule = f"readings[{item.label!r}]", "be an array of numbers"
            given = check_times(where, name, given_by_name.get(item.label, ()), rule)
            if given.ndim == 0 or len(given) != len(held):
                rule = f"hold {item.label!r} with one row for each of the {len(held)} torques"
                raise InputError(Problem(where, "readings", rule, f"of shape {given.shape}"))
            arrays[item.label] = given
        self.reset()
        kept = []
        for k in range(len(held)):
            if k:
                self.predict(held[k - 1])
            self.correct(Measurement(**{name: values[k] for name, values in arrays.items()}))
            kept.append((self.q, self.qd, self.payload_mass, self.covariance))
        return Estimates(*(np.array(part) for part in zip(*kept, strict=True)))

    @property
    def _change(self) -> float:
        return float(self._x[-1]) - self._nominal

    def _begin(self, measurement: Measurement) -> None:
        arm, count = self.arm, self.arm.dof
        angle_item = next(i for i in self.instruments if i.signal == "joint_angle")
        angles = np.asarray(measurement[angle_item.label])
        q = equilibrium(arm, angles).q if any(arm.spec.gravity) else arm.rest(angles)
        self._x = np.concatenate([q, np.zeros(count), [self._nominal]])
        stiffness = np.diag(arm.stiffness_matrix(arm.rest(angles))).copy()
        energy = 2.0 * self.energy_deviation
        variance = np.full(2 * count + 1, energy)
        variance[:count] = energy / np.maximum(stiffness, 1e-12)
        joints = arm.joint_index
        variance[joints] = angle_item.noise**2 + angle_item.resolution**2 / 12.0
        variance[count + joints] = self.rate_deviation**2
        variance[-1] = self.payload_deviation**2
        self._P = np.diag(variance)
        self._begun = True
