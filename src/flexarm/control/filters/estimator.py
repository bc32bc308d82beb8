"""Base of the estimators: their start, and samples whose readings may arrive late or seldom."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import coordinate_sizes
from flexarm.arm.bending import one_warning
from flexarm.base.arguments import (
    check_kind,
    check_list_of,
    check_mapping,
    check_nonnegative,
    check_numbers,
)
from flexarm.base.errors import InputError, Problem, check_array, public_call, raise_any, shown
from flexarm.control.contract.parametrised import OfArm
from flexarm.control.design.arm_scales import rigid_inertias, typical_rate, typical_torque
from flexarm.control.filters.estimates import Estimates, InnovationTest, Layout
from flexarm.control.filters.predicted_readings import (
    PredictedReadings,
    check_instruments,
    reading_rows,
)
from flexarm.control.hardware.measurement import FloatArray, Measurement, stride_and_delay
from flexarm.linear.statics.equilibrium import equilibrium
from flexarm.linear.statics.gaps import warn_of_bristles
from flexarm.linear.step_derivatives.sampled_step import SampledStep
from flexarm.model import Instrument
from flexarm.model.arm.spec import CLOSURES
from flexarm.model.drives.around import FilterParameters
from flexarm.model.paths import number_at, with_number

#: Ratio of the standard deviation of joint angles before the first reading to that of the reading.
_BEFORE_READING = 100.0
#: Difference of a number for the derivative of the sag, in its standard deviations. A difference
#: is accurate enough, because sag is nearly linear in each number.
SAG_DIFFERENCE = 0.1
#: Least stiffness of a coordinate relative to the largest, which limits its variance.
LEAST_STIFFNESS = 1e-12


def first_variance(
    arm: Arm, given: FilterParameters, angle: Instrument, stiffness: FloatArray
) -> FloatArray:
    """Return the variances (2 dof,) of [q, qd] for known numbers of the arm."""
    assert given.energy_deviation is not None
    assert given.rate_deviation is not None
    joints, energy = arm.joint_index, 2.0 * given.energy_deviation
    variance = np.full(2 * arm.dof, energy)
    bending = np.delete(stiffness, joints)
    least = LEAST_STIFFNESS * np.max(bending, initial=0.0)
    variance[np.setdiff1d(np.arange(arm.dof), joints)] = energy / np.maximum(bending, least)
    # The prior is wide, because the update that follows uses the reading itself.
    bias = (given.bias_deviation or {}).get(angle.label, 0.0)
    variance[joints] = angle.noise**2 + angle.resolution**2 / 12.0 + bias**2
    variance[joints] *= _BEFORE_READING**2
    sizes, base = coordinate_sizes(arm), [coordinate.place for coordinate in arm.assembly.base]
    variance[arm.dof + joints] = (given.rate_deviation * sizes[joints]) ** 2
    if base:
        mass = np.diag(arm.mass_matrix(arm.rest(np.zeros(arm.n_joints))))
        variance[np.add(arm.dof, base)] = energy / mass[base]
        variance[base] = np.minimum(variance[base], sizes[base] ** 2)
    return variance


def sag(
    arm: Arm, angles: FloatArray, deviations: Mapping[str, float]
) -> tuple[FloatArray, FloatArray]:
    """Return the coordinates (dof,) at rest, and derivatives (p, dof) by numbers of the arm."""
    slopes = np.zeros((len(deviations), arm.dof))
    if not any(arm.spec.gravity):
        return arm.rest(angles), slopes
    q = equilibrium(arm, angles).q
    for slope, (path, deviation) in zip(slopes, deviations.items(), strict=True):
        if deviation:
            more = SAG_DIFFERENCE * deviation
            other = Arm(with_number(arm.spec, path, number_at("path", arm.spec, path) + more))
            slope[:] = (equilibrium(other, angles).q - q) / more
    return q, slopes


def tip_mass(arm: Arm) -> float:
    """Return the effective mass (kg) of the tip, without the payload.

    It is the inertia of the last link about its joint over its length squared. Accelerations of
    the tip are inversely proportional to this mass plus the payload mass. Therefore they are nearly
    exponential in the logarithm of the sum, even for a payload of zero.
    """
    inertia = float(rigid_inertias(arm)[-1])
    turns = arm.spec.joints[arm.assembly.seats[-1].link].kind == "revolute"
    whole = inertia / (float(arm.lengths[-1]) if turns else 1.0) ** 2
    return max(whole - arm.spec.payload.mass, 1e-3 * whole)


@dataclass
class Sample:
    """A sample, until all its readings have arrived.

    Attributes:
        number: of the sample. before: the estimate before its readings, to which late readings
            return. readings: by the place of the instrument. torque: (joints,) N m, after it.
        squared: normalised innovation squared. size: number of its readings.
    """

    number: int
    before: Any = None
    readings: dict[int, FloatArray] = field(default_factory=dict)
    torque: FloatArray = field(default_factory=lambda: np.zeros(0))
    squared: float = 0.0
    size: int = 0

    @property
    def innovation(self) -> float:
        """Normalised innovation squared divided by the number of readings, NaN without any."""
        return self.squared / self.size if self.size else np.nan


class Frames:
    """Frames of the instruments of a filter at its samples.

    Attributes:
        latest: the largest delay, in samples.
    """

    def __init__(self, readings: PredictedReadings, sample_time: float) -> None:
        self._readings = readings
        self._strides = [stride_and_delay(item, sample_time) for item in readings.instruments]
        self.latest = max(late for _, late in self._strides)
        ends = np.cumsum(readings.counts)
        self._parts = [slice(end - n, end) for end, n in zip(ends, readings.counts, strict=True)]
        everything = tuple(range(len(self._strides)))
        self._of: dict[tuple[int, ...], PredictedReadings] = {everything: readings}

    def arrived(self, number: int, readings: FloatArray) -> Iterator[tuple[int, int, FloatArray]]:
        """Yield the place of each instrument with a new frame, its delay (samples) and readings."""
        for place, (every, late) in enumerate(self._strides):
            frame = number - late
            if frame >= 0 and frame % every == 0:
                yield place, late, readings[self._parts[place]]

    @property
    def predictions(self) -> Iterable[PredictedReadings]:
        """Predictions of the readings of the samples so far."""
        return self._of.values()

    def of(self, sample: Sample) -> tuple[PredictedReadings, FloatArray]:
        """Return the predictions of the instruments whose readings a sample has, and those."""
        places = tuple(sorted(sample.readings))
        if places not in self._of:
            whole = self._readings
            chosen = [whole.instruments[place] for place in places]
            self._of[places] = PredictedReadings(whole.arm, chosen, whole.biased)
        return self._of[places], np.concatenate([sample.readings[place] for place in places])


#: Default torque noise, relative to `typical_torque`, and default deviation of the initial rates,
#: relative to `typical_rate`.
_NOISE, _TURNING = 0.01, 1.0 / 80.0
#: Largest start relative to the arm; the equations of motion overflow for far larger ones.
_LARGEST = 1e9
#: The parameter that every estimator has, with arguments of its own.
MASS = "payload.mass"


class StateEstimator(FilterParameters, OfArm, ABC):
    """Base of estimators: their start, their samples, and the test of their innovations.

    The estimated numbers are those of `Layout`. Parameters, disturbance torques and biases of
    readings are random walks; the disturbance torques act on the joints beside the torque.
    Readings with a delay correct the estimate at the time of their frame, from which the later
    samples are computed again.
    """

    _unsupported = CLOSURES
    #: Attributes that change with the estimate.
    _changing: ClassVar[tuple[str, ...]] = ()
    instruments: Sequence[Instrument] = Field(
        description='Instruments of "joint_angle" (required), "joint_rate", "strain" or a '
        "`Sensor`; their noise and resolution determine their weights."
    )
    sample_time: float = Field(default=1e-3, description="Time between samples (s).")

    def __post_init__(self) -> None:
        arm = self.arm
        listed = check_list_of("instruments", self.instruments, Instrument)
        self.instruments = tuple(listed)
        check_instruments(arm, self.instruments)
        warn_of_bristles(arm, "the filter")
        numbers = ("torque_noise", "rate_deviation", "energy_deviation")
        self._scaled = [name for name in numbers if getattr(self, name) is None]
        self._step: SampledStep | None = None
        self._made_for = 0.0
        self._prior, self._drift = dict(self.parameters or {}), dict(self.parameter_drift or {})
        self._errors = dict(self.bias_deviation or {})
        self._wandering = dict(self.bias_drift or {})
        self._check_names()
        sizes = {i.label: len(reading_rows(arm, i)) for i in self.instruments}
        names = dict.fromkeys([*self._errors, *self._wandering])
        biased = tuple((name, sizes[name]) for name in names)
        self._readings = PredictedReadings(arm, self.instruments, biased)
        disturbed = np.any(self.disturbance_deviation) or np.any(self.disturbance_drift)
        paths = tuple(self._prior)
        self._layout = Layout(arm.dof, paths, arm.n_joints if disturbed else 0, biased)
        self.reset()

    def _scale_defaults(self) -> None:
        """Set the deviations without a number, in proportion to inertia and time of the arm."""
        rate = typical_rate(self.arm, self.sample_time)
        turning = _TURNING * rate
        # A joint that slides moves by the reach where one that turns moves by a radian.
        size = float(coordinate_sizes(self.arm)[self.arm.joint_index[0]])
        inertia = float(rigid_inertias(self.arm)[0]) * size**2
        noise = _NOISE * typical_torque(self.arm, None, rate)
        values: dict[str, Any] = {"torque_noise": noise, "rate_deviation": turning}
        values["energy_deviation"] = 0.5 * inertia * turning**2
        vars(self).update({name: values[name] for name in self._scaled})

    @property
    def _noise(self) -> FloatArray:
        """Standard deviation of the torque error (joints,) N m."""
        return np.asarray(self.torque_noise, dtype=np.float64)

    def _check_names(self) -> None:
        problems = []
        if MASS in self._prior:
            hint = "It has arguments of its own: payload_deviation and payload_drift."
            problems.append(Problem("parameters", f"must not contain {MASS!r}", hint=hint))
        for path in self._drift:
            if path not in self._prior:
                rule = "have paths of parameters only"
                problems.append(Problem("parameter_drift", rule, shown(path)))
        labels = [item.label for item in self.instruments]
        for argument, given in (("bias_deviation", self._errors), ("bias_drift", self._wandering)):
            for name in given:
                if name not in labels:
                    rule = f"have names of instruments of the filter ({', '.join(labels)})"
                    problems.append(Problem(argument, rule, shown(name)))
        raise_any(problems)

    def reset(self) -> None:
        """Clear the estimate; the next ``correct`` starts from its readings."""
        if self._step is None or self._made_for != self.sample_time:
            self._step = SampledStep(self.arm, self.sample_time, (MASS, *self._layout.paths))
            self._made_for = self.sample_time
            self._scale_defaults()
        self._nominal = self._step.free.values
        layout = self._layout
        self._torque = np.zeros(self.arm.n_joints)
        self._walk = np.zeros(layout.size)  # variances of the walks over a sample
        drifts = np.array([self._drift.get(path, 0.0) for path in layout.paths])
        self._walk[layout.parameters] = self.sample_time * drifts**2
        if layout.disturbed:
            self._walk[layout.disturbance] = self.sample_time * self.disturbance_drift**2
        for name, places in layout.by_instrument.items():
            self._walk[places] = self.sample_time * self._wandering.get(name, 0.0) ** 2
        self._begun = False
        self._test = InnovationTest(type(self).__name__)
        self._frames: Frames | None = None
        self._number = 0
        self._waiting: list[Sample] = []
        mean = np.concatenate([np.zeros(layout.size - 1), self._nominal[:1]])
        mean[layout.parameters] = self._nominal[1:]
        self._start(mean, np.zeros((layout.size, layout.size)))

    @property
    def q(self) -> FloatArray:
        """Estimated coordinates (dof,)."""
        return self._moments()[0][: self.arm.dof]

    @property
    def qd(self) -> FloatArray:
        """Estimated rates (dof,)."""
        return self._moments()[0][self.arm.dof : 2 * self.arm.dof]

    @property
    def payload_mass(self) -> float:
        """Estimated mass of the payload, kg."""
        return float(self._moments()[0][-1])

    @property
    def parameter_values(self) -> dict[str, float]:
        """Estimated numbers of ``parameters``, by path."""
        values = self._moments()[0][self._layout.parameters]
        return dict(zip(self._layout.paths, values.tolist(), strict=True))

    @property
    def disturbance(self) -> FloatArray:
        """Estimated disturbance torques (joints,) N m, which act beside the torque."""
        return self._disturbance(self._moments()[0])

    @property
    def biases(self) -> dict[str, FloatArray]:
        """Estimated biases by instrument, in the unit of its readings."""
        mean = self._moments()[0]
        return {name: mean[places].copy() for name, places in self._layout.by_instrument.items()}

    @property
    def covariance(self) -> FloatArray:
        """Covariance (s, s) of the errors of the estimated numbers.

        Their order is [q, qd, parameters, disturbance, biases, payload_mass].
        """
        return self._moments()[1]

    @property
    def deviations(self) -> dict[str, FloatArray]:
        """Standard deviations by name: "q", "qd", "payload.mass", "disturbance" and each path.

        Those of biases have names such as "bias of joint_rate".
        """
        return self._layout.deviations(self.covariance)

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
        """Return the largest mean innovation, 1 if the test was passed, else 0, and estimates.

        The estimates are those of uncertain numbers, with their standard deviations.
        """
        found: dict[str, float] = {
            "estimator_innovation": self._test.worst,
            "estimator_consistent": int(self.consistent),
        }
        mean, covariance = self._moments()
        for name, place in self._layout.slow.items():
            if covariance[place, place] > 0.0 or name != MASS:
                found[f"estimated {name}"] = float(mean[place])
                found[f"deviation of {name}"] = float(np.sqrt(covariance[place, place]))
        return found

    @public_call
    def begin(
        self, q: ArrayLike, qd: ArrayLike, payload_mass: float, covariance: ArrayLike
    ) -> None:
        """Start at an estimate (dof,), (dof,), kg and its covariance, not at the first reading.

        Parameters start at the numbers of the arm, disturbance torques and biases at zero; the
        covariance (s, s) is that of all estimated numbers.

        Raises:
            InputError: if a shape is wrong, a number is NaN or infinite, the mass is negative or
                above 1e9 times that of the arm, or a variance is above 1e9 times the square of one
                radian, of the arm's typical rate, or of modal coordinates of the same size.
        """
        size = self._layout.size
        parts = [check_array(n, v, (self.arm.dof,)) for n, v in (("q", q), ("qd", qd))]
        mass = check_nonnegative("payload_mass", payload_mass)
        given = check_array("covariance", covariance, (size, size))
        constants, sizes = self.arm.assembly.constants, coordinate_sizes(self.arm)
        sizes = np.append(sizes, sizes * typical_rate(self.arm, self.sample_time))
        largest = np.max(np.diag(given)[self._layout.states] / sizes**2)
        whole = float(constants.mass.sum() + constants.tip_mass.sum())
        for name, ratio, unit in (
            ("payload_mass", mass / whole, "that of the arm"),
            ("covariance", float(largest), "the squares of the arm's angles and rates"),
        ):
            if ratio > _LARGEST:
                rule = f"be at most {_LARGEST:g} times {unit}"
                raise InputError(Problem(name, rule, f"{ratio:g}"))
        self._start(self._mean(np.concatenate(parts), mass), given)
        self._begun = True

    @public_call
    def correct(self, measurement: Measurement) -> None:
        """Correct the estimate by the readings at the current sample time.

        Raises:
            InputError: if ``measurement`` is not a `Measurement`, a reading has the wrong shape, is
                not finite or above 1e13 of its standard deviations, or the estimate has diverged.
        """
        check_kind("measurement", measurement, Measurement)
        readings = self._readings.stacked(measurement)
        if not self._begun:
            self._number = 0  # the instruments have their first frames now
            self._begin(measurement)
        if not all(np.isfinite(part).all() for part in self._moments()):
            hint = "Correct the arm, the readings or the torques, and call reset."
            raise InputError(Problem("the estimate", "is not finite", hint=hint))
        if self._frames is None:  # the sample time is now known
            self._frames = Frames(self._readings, self.sample_time)
        again = bool(self._waiting) and self._waiting[-1].number == self._number
        self._latest, age = self._sample(), 0
        for place, late, values in self._frames.arrived(self._number, readings):
            if late < len(self._waiting):
                self._waiting[-1 - late].readings[place] = values
                age = max(age, late)
        samples = self._waiting[-1 - age :]
        if age or again:
            for name, value in self._copied(samples[0].before or {}).items():
                setattr(self, name, value)
        for sample, following in zip_longest(samples, samples[1:]):
            if sample.readings:
                seen, values = self._frames.of(sample)
                sample.squared, sample.size = self._correct(seen, values), values.size
            if following is not None:
                self._number = sample.number
                self._advance(sample.torque)
                following.before = self._present()
        if not self._frames.latest:
            self._close(self._number)

    @public_call
    def predict(self, torque: ArrayLike) -> None:
        """Predict the next sample under a zero-order-hold torque (joints,) N m.

        Raises:
            InputError: if the torque does not have shape (joints,), or is not finite.
        """
        given = check_array("torque", torque, self._torque.shape)
        if self._waiting:
            self._sample().torque = given
        self._advance(given)
        self._close(self._number - 1)  # readings may arrive at the present sample

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
        torques = check_array("torque", torque, (-1, self.arm.n_joints))
        if not len(torques):
            raise InputError(Problem("torque", "have at least one sample", shown(torque)))
        given_by_name = check_mapping("readings", readings, "names and readings")
        missing = [one.label for one in self.instruments if one.label not in given_by_name]
        if missing:
            hint = "The filter has an instrument for each; create it without those not measured."
            rule = f"have no {', '.join(map(repr, missing))}"
            raise InputError(Problem("readings", rule, hint=hint))
        arrays = {}
        for item in self.instruments:
            name = f"readings[{item.label!r}]"
            given = check_numbers(name, given_by_name[item.label])
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
            kept.append((*self._moments(), self._latest))
        assert self._frames is not None
        # Add all samples to the test, although some may lack readings.
        self._close(self._number + self._frames.latest)
        x, covariance = (np.array([one[part] for one in kept]) for part in (0, 1))
        samples = [sample for _, _, sample in kept]
        layout = self._layout
        states = x[:, : layout.dof], x[:, layout.dof : 2 * layout.dof], x[:, -1], covariance
        innovations = np.array([sample.innovation for sample in samples])
        sizes = np.array([sample.size for sample in samples])
        parameters = dict(zip(layout.paths, x[:, layout.parameters].T, strict=True))
        disturbance = np.array([self._disturbance(row) for row in x])
        biases = {name: x[:, places] for name, places in layout.by_instrument.items()}
        test = innovations, self.consistent, sizes
        return Estimates(*states, *test, parameters, disturbance, biases)

    @abstractmethod
    def _start(self, x: FloatArray, covariance: FloatArray) -> None:
        """Start at a mean and covariance of the estimated numbers."""

    @abstractmethod
    def _moments(self) -> tuple[FloatArray, FloatArray]:
        """Return the mean and covariance of the estimated numbers."""

    def _disturbance(self, x: FloatArray) -> FloatArray:
        """Return the disturbance torques (joints,) of the estimated numbers."""
        layout = self._layout
        return x[layout.disturbance].copy() if layout.disturbed else np.zeros(self.arm.n_joints)

    def _mean(self, state: FloatArray, mass: float) -> FloatArray:
        """Return the estimated numbers of a start at [q, qd] and a mass."""
        none = np.zeros(self._layout.biases.stop - self._layout.disturbance.start)
        return np.concatenate([state, self._nominal[1:], none, [mass]])

    def _begin(self, measurement: Measurement) -> None:
        arm, count, layout = self.arm, self.arm.dof, self._layout
        angle = next(i for i in self.instruments if i.signal == "joint_angle")
        angles = np.asarray(measurement[angle.label])
        deviations = {MASS: self.payload_deviation, **self._prior}
        with one_warning():
            q, slopes = sag(arm, angles, deviations)
        stiffness = np.diag(arm.stiffness_matrix(arm.rest(angles)))
        variance = np.zeros(layout.size)
        variance[layout.states] = first_variance(arm, self, angle, stiffness)
        variance[layout.disturbance] = self.disturbance_deviation**2 if layout.disturbed else 0.0
        for name, own in layout.by_instrument.items():
            variance[own] = self._errors.get(name, 0.0) ** 2
        P = np.diag(variance)
        places = -1, *range(layout.parameters.start, layout.parameters.stop)
        for place, slope, deviation in zip(places, slopes, deviations.values(), strict=True):
            along = np.zeros(layout.size)
            along[:count], along[place] = slope, 1.0
            P += deviation**2 * np.outer(along, along)
        self._start(self._mean(np.append(q, np.zeros(count)), self._nominal[0]), P)
        self._begun = True

    @abstractmethod
    def _correct(self, seen: PredictedReadings, readings: FloatArray) -> float:
        """Correct the estimate by readings (k,); return the normalised innovation squared."""

    @abstractmethod
    def _predict(self) -> None:
        """Carry the estimate to the next sample under ``_torque``."""

    def _sample(self) -> Sample:
        """Return the present sample, which may wait for readings."""
        if not self._waiting or self._waiting[-1].number != self._number:
            self._waiting.append(Sample(self._number, self._present()))
        return self._waiting[-1]

    def _close(self, number: int) -> None:
        """Add the samples to the test that have all their readings after sample ``number``."""
        latest = self._frames.latest if self._frames is not None else 0
        while self._waiting and self._waiting[0].number <= number - latest:
            sample = self._waiting.pop(0)
            sample.before = None
            if sample.size:
                self._test.add(sample.squared, sample.size)

    def _advance(self, torque: FloatArray) -> None:
        self._torque = torque
        self._number += 1
        self._predict()

    def _present(self) -> Any:
        """Return a copy of the present estimate, if readings may arrive that return to it."""
        if self._frames is None or not self._frames.latest:
            return None
        return self._copied({name: getattr(self, name) for name in ("_torque", *self._changing)})

    def _copied(self, estimate: Any) -> Any:
        """Return a copy of an estimate, with the same predictions of readings."""
        assert self._frames is not None
        return deepcopy(estimate, {id(one): one for one in self._frames.predictions})
