"""Base of the Kalman filters for elastic states and payload, from encoders and strain gauges."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from flexarm.arguments import (
    check_kind,
    check_list_of,
    check_mapping,
    check_nonnegative,
    check_numbers,
)
from flexarm.bending import one_warning, warn_of_first
from flexarm.control.parametrised import OfArm
from flexarm.errors import InputError, Problem, check_array, public_call, shown
from flexarm.estimation.first_estimate import first_variance, sag, tip_mass
from flexarm.estimation.innovation_test import InnovationTest, band
from flexarm.estimation.payload_hypotheses import (
    Hypothesis,
    combined,
    moments,
    reduced,
    split,
)
from flexarm.estimation.predicted_readings import LARGEST, PredictedReadings
from flexarm.hardware.measurement import FloatArray, Measurement
from flexarm.linear.statics.gaps import warn_of_bristles
from flexarm.linear.step_derivatives.sampled_step import SampledStep
from flexarm.model import Instrument
from flexarm.model.drives.around import FilterParameters


class Estimates(NamedTuple):
    """Estimates from a record, after the readings of each sample.

    q and qd (samples, dof), payload_mass (samples,) kg, covariance (samples, s, s) of
    [q, qd, payload_mass]; innovation (samples,), the normalised innovation squared of each sample
    divided by the number of readings, one on average; consistent, False if the innovation test
    failed; readings, their number in each sample.
    """

    q: FloatArray
    qd: FloatArray
    payload_mass: FloatArray
    covariance: FloatArray
    innovation: FloatArray
    consistent: bool
    readings: int

    @public_call
    def squared_errors(self, q: ArrayLike, qd: ArrayLike, payload_mass: float) -> FloatArray:
        """Return the normalised estimation error squared (samples,), one on average.

        Args:
            q, qd: (samples, dof), the true states. payload_mass: the true one, kg.

        Raises:
            InputError: if a shape is wrong or a number is not finite.

        Divided by the number of states that are uncertain. Y. Bar-Shalom, X. R. Li and T.
        Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.4.
        """
        true = [check_array(n, v, self.q.shape) for n, v in (("q", q), ("qd", qd))]
        mass = check_nonnegative("payload_mass", payload_mass)
        missed = np.column_stack([true[0] - self.q, true[1] - self.qd, mass - self.payload_mass])
        free = self._uncertain
        P, error = self.covariance[:, free][:, :, free], missed[:, free, None]
        squared: FloatArray = np.sum(error * np.linalg.solve(P, error), axis=(1, 2))
        return squared / np.count_nonzero(free)

    @public_call
    def error_band(self, probability: float = 0.95) -> tuple[float, float]:
        """Return the interval of ``squared_errors`` of one sample of a consistent filter.

        Raises:
            InputError: if the probability is not between 0 and 1.
        """
        return band(int(np.count_nonzero(self._uncertain)), probability)

    @public_call
    def innovation_band(self, probability: float = 0.95) -> tuple[float, float]:
        """Return the interval of ``innovation`` of one sample of a consistent filter.

        Raises:
            InputError: if the probability is not between 0 and 1.
        """
        return band(self.readings, probability)

    @property
    def _uncertain(self) -> NDArray[np.bool_]:
        """Whether each state has a variance; that of a known payload is zero."""
        found: NDArray[np.bool_] = np.any(
            np.diagonal(self.covariance, axis1=1, axis2=2) > 0, axis=0
        )
        return found


class KalmanFilter(FilterParameters, OfArm, ABC):
    """Base of the Kalman filters: a sum of Gaussians, each propagated and corrected alone.

    A filter defines ``_propagate`` and ``_update``. The payload is a sum of Gaussians over the
    logarithm of the payload mass plus the effective mass of the tip.
    """

    instruments: Sequence[Instrument] = Field(
        description='Instruments of "joint_angle" (required), "joint_rate", "strain" or a '
        "`Sensor`; their noise and resolution determine their weights."
    )
    sample_time: float = Field(default=1e-3, description="Time between samples (s).")

    def __post_init__(self) -> None:
        arm = self.arm
        listed = check_list_of("instruments", self.instruments, Instrument)
        self.instruments = tuple(listed)
        self._readings = PredictedReadings(arm, self.instruments)
        warn_of_bristles(arm, "the filter")
        self._step: SampledStep | None = None
        self._made_for = 0.0
        self._nominal = arm.spec.payload.mass
        self._own = tip_mass(arm)
        self.reset()

    def reset(self) -> None:
        """Clear the estimate; the next ``correct`` starts from its readings."""
        if self._step is None or self._made_for != self.sample_time:
            self._step = SampledStep(self.arm, self.sample_time)
            self._made_for = self.sample_time
        size, joints = 2 * self.arm.dof + 1, self.arm.joints
        self._scale = self._nominal + self._own  # kg, mass at logarithm 0
        self._parts = [Hypothesis(np.zeros(size), np.zeros((size, size)), 0.0)]
        self._torque = np.zeros(joints)
        # Change of [q, qd, payload] of each hypothesis by the error of the last torque.
        self._moved = [np.zeros((size, joints))]
        self._begun = False
        self._test = InnovationTest(type(self).__name__, self._readings.size)
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
        """Mean of the normalised innovations squared over the last 100 samples.

        It is about one if the filter is consistent, and NaN before there are as many samples.
        """
        return self._test.ratio

    @property
    def consistent(self) -> bool:
        """False once ``innovation`` exceeded its distribution (probability 1e-9).

        An ``InconsistentEstimateWarning`` reports it once after each ``reset``.
        """
        return self._test.passed

    def report(self) -> dict[str, float]:
        """Return the largest mean innovation, and 1 if the filter passed its test, else 0."""
        return {
            "estimator_innovation": self._test.worst,
            "estimator_consistent": int(self.consistent),
        }

    @public_call
    def begin(
        self, q: ArrayLike, qd: ArrayLike, payload_mass: float, covariance: ArrayLike
    ) -> None:
        """Start at an estimate (dof,), (dof,), kg and its covariance, not at the first reading.

        Raises:
            InputError: if a shape is wrong, a number is NaN, infinite or above 1e9, or the mass is
                negative.
        """
        size = 2 * self.arm.dof + 1
        parts = [check_array(n, v, (self.arm.dof,)) for n, v in (("q", q), ("qd", qd))]
        mass = check_nonnegative("payload_mass", payload_mass)
        given = check_array("covariance", covariance, (size, size))
        for name, numbers in (("payload_mass", mass), ("covariance", given)):
            if np.max(np.abs(numbers)) > LARGEST:
                rule = f"be at most {LARGEST:g}"
                raise InputError(Problem(name, rule, shown(float(np.max(np.abs(numbers))))))
        self._start(np.concatenate([*parts, [mass]]), given)

    @public_call
    def correct(self, measurement: Measurement) -> None:
        """Correct the estimate by the readings at the current sample time.

        Raises:
            InputError: if ``measurement`` is not a `Measurement`, a reading has the wrong shape, is
                not finite or above 1e9, or the estimate has diverged.
        """
        check_kind("measurement", measurement, Measurement)
        from scipy.linalg import cho_factor, cho_solve

        readings = self._readings.stacked(measurement)
        if not self._begun:
            self._begin(measurement)
        if not all(np.isfinite(part.x).all() and np.isfinite(part.P).all() for part in self._parts):
            hint = "Correct the arm, the readings or the torques, and call reset."
            raise InputError(Problem("the estimate", "is not finite", hint=hint))
        # The innovation test needs the weights of the hypotheses before the update changes them.
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

    @public_call
    def predict(self, torque: ArrayLike) -> None:
        """Predict the next sample under a zero-order-hold torque (joints,) N m.

        Raises:
            InputError: if the torque does not have shape (joints,), or is not finite.
        """
        self._torque = check_array("torque", torque, self._torque.shape)
        self._moved = [self._propagate(part) for part in self._parts]

    @public_call
    def run(self, torque: ArrayLike, readings: Mapping[str, ArrayLike]) -> Estimates:
        """Filter a record from its start, with ``correct`` and ``predict`` at each sample.

        Args:
            torque: (samples, joints) N m, constant from each sample to the next.
            readings: by the instruments' names, (samples, ...).

        Raises:
            InputError: if there is no sample, readings of an instrument are missing, or their
                number differs from that of the torques.
        """
        torques = check_array("torque", torque, (-1, self.arm.joints))
        if not len(torques):
            raise InputError(Problem("torque", "have at least one sample", shown(torque)))
        given_by_name = check_mapping("readings", readings, "names and readings")
        arrays = {}
        for item in self.instruments:
            name = f"readings[{item.label!r}]"
            given = check_numbers(name, given_by_name.get(item.label, ()))
            if given.ndim == 0 or len(given) != len(torques):
                rule = f"have one row for each of the {len(torques)} torques"
                raise InputError(Problem(name, rule, f"shape {given.shape}"))
            arrays[item.label] = check_array(name, given, (-1,) * given.ndim)
        self.reset()
        kept = []
        for k in range(len(torques)):
            if k:
                self.predict(torques[k - 1])
            self.correct(Measurement(**{name: values[k] for name, values in arrays.items()}))
            kept.append((*self._moments(), self._innovation))
        x, covariance, innovation = (np.array(part) for part in zip(*kept, strict=True))
        q, qd = x[:, : self.arm.dof], x[:, self.arm.dof : -1]
        return Estimates(
            q, qd, x[:, -1], covariance, innovation, self.consistent, self._readings.size
        )

    @abstractmethod
    def _propagate(self, part: Hypothesis) -> FloatArray:
        """Carry a hypothesis to the next sample; return its covariance with the torque error.

        (2 dof + 1, joints), for torque errors relative to ``torque_noise``.
        """

    @abstractmethod
    def _update(
        self, part: Hypothesis, moved: FloatArray, readings: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Correct a hypothesis; return its predicted readings and their covariance.

        ``moved`` is the result of ``_propagate``, zero before the first prediction.
        """

    def _add_drift(self, part: Hypothesis) -> None:
        """Add the random walk of the payload mass over a sample to the covariance."""
        if self.payload_drift:
            wandered = self.payload_drift**2 * self.sample_time
            part.P[-1, -1] += np.log1p(wandered / self._moving(part.x) ** 2)

    def _judge(
        self,
        before: list[Hypothesis],
        readings: FloatArray,
        predicted: list[FloatArray],
        expected: list[FloatArray],
    ) -> None:
        """Add the innovation of the whole mixture to the test."""
        mean, covariance = combined(before, predicted, expected)
        missed = readings - mean
        squared = float(missed @ np.linalg.solve(covariance, missed))
        self._innovation = squared / readings.size
        self._test.add(squared)

    def _moments(self) -> tuple[FloatArray, FloatArray]:
        """Return the mean and covariance of [q, qd, payload_mass]."""
        return moments(self._parts, self._scale, self._own)

    def _moving(self, x: FloatArray) -> float:
        """Return the mass (kg) whose logarithm is estimated: payload plus effective tip mass."""
        return self._scale * float(np.exp(x[-1]))

    def _change(self, x: FloatArray) -> float:
        return max(self._moving(x) - self._own, 0.0) - self._nominal

    def _start(self, x: FloatArray, covariance: FloatArray) -> None:
        """Start at a mean and covariance of [q, qd, payload_mass]."""
        self._scale, parts = split(x + self._own * np.eye(x.size)[-1], covariance)
        self._parts = [part for part in parts if self._moving(part.x) >= self._own] or parts
        self._moved = [np.zeros((x.size, self.arm.joints))] * len(self._parts)
        self._begun = True

    def _begin(self, measurement: Measurement) -> None:
        arm, count = self.arm, self.arm.dof
        angle = next(i for i in self.instruments if i.signal == "joint_angle")
        angles = np.asarray(measurement[angle.label])
        with one_warning() as bent:
            q, by_mass = sag(arm, angles, self.payload_deviation)
        warn_of_first(bent)
        stiffness = np.diag(arm.stiffness_matrix(arm.rest(angles)))
        variance = first_variance(arm, self, angle, stiffness)
        slope = np.concatenate([by_mass, np.zeros(count), [1.0]])
        P = np.diag(variance) + self.payload_deviation**2 * np.outer(slope, slope)
        self._start(np.concatenate([q, np.zeros(count), [self._nominal]]), P)
