"""Compensation of disturbances around any controller: by an observer, or learned over periods."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_kind, check_posture
from flexarm.base.errors import InputError, Problem, public_call, shown
from flexarm.control.analysis.margins import check_single_rate, loop_at, plants_of
from flexarm.control.analysis.sampled_loop import ComplexArray
from flexarm.control.contract.base import (
    Around,
    Arrays,
    Controller,
    ControllerRequirements,
    FloatArray,
    Measurement,
    Reference,
    Step,
    joints_of,
)
from flexarm.control.contract.parametrised import OfArm, Parametrised
from flexarm.control.design.arm_scales import check_sample_time, default_cutoff
from flexarm.control.design.rigid_model import RigidParameters
from flexarm.model import Hardware
from flexarm.model.arm.spec import FREE_BASE
from flexarm.model.drives.around import DisturbanceObserverParameters, RepetitiveParameters
from flexarm.motion.dynamics.dynamics_along import Actuation


class DisturbanceObserver(DisturbanceObserverParameters, OfArm, Around):
    """Generalised-momentum observer that compensates disturbance torques at the joints.

    De Luca and Mattone, Actuator failure detection and isolation using generalized momenta, ICRA
    2003; (C.52) to (C.54). The estimate is the torque that the rigid model does not explain, passed
    through a first-order filter. It needs neither accelerations nor the inverse mass matrix.

    The observer uses the measured "torque" if an instrument reads it, and the requested torque
    otherwise. In a mechanism with closures it estimates torques of the actuated joints with the
    effect of the disturbance on the independent motions.
    """

    _unsupported = FREE_BASE
    inner: Controller

    def __post_init__(self) -> None:
        check_sample_time(self.arm, self.sample_time)
        if self.cutoff is None:
            hertz = default_cutoff(self.arm, self.sample_time)
            self.cutoff = np.full(self.arm.n_joints, hertz)
        self._model = RigidParameters(self.arm)
        closed = self.actuated is not None or self.arm.closure_rows
        self._actuation = Actuation(self.arm.rigid(), self.actuated) if closed else None
        self._taken = self._filtered()

    def _filtered(self) -> FloatArray:
        """Return the part of the new estimate that a sample takes over, (joints,)."""
        # One by one, because the vector function rounds differently.
        turns = [-2.0 * math.pi * hertz * self.sample_time for hertz in np.asarray(self.cutoff)]
        return np.array([1.0 - math.exp(angle) for angle in turns])

    @property
    def estimate(self) -> FloatArray:
        """Estimated disturbance torque at the joints, (joints,) N m."""
        return np.array(self.memory.get("estimate", np.zeros(self.arm.n_joints)))

    def reset(self) -> None:
        super().reset()
        self._taken = self._filtered()

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        return self._required(arm, reference, self.arm.n_joints)

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        now = self._model.momentum(readings.joint_angle, readings.joint_rate).copy()
        nothing = 0.0 * now[0]
        # The first sample has no interval before it that the estimate could follow.
        own = {"momentum": now, "commanded": nothing, "estimate": nothing, "intervals": np.zeros(1)}
        if self._actuation is not None:
            own["angle"] = np.array(readings.joint_angle)
        return {**own, **super().initial_memory(readings, inputs)}

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        now = self._model.momentum(readings.joint_angle, readings.joint_rate).copy()
        # The trapezoidal rule is accurate, because the torque is constant over the sample and
        # the other terms are nearly linear.
        pushed = (now[0] - memory["momentum"][0]) / self.sample_time
        pushed = pushed - readings.get("torque", memory["commanded"])
        pushed = pushed - 0.5 * (now[1] + memory["momentum"][1])
        if self._actuation is not None:
            # The closure forces vanish; they are not constant over the sample, nor are the motions.
            middle = 0.5 * (memory["angle"] + readings.joint_angle)
            pushed = pushed @ self._actuation.motions(middle)
        pushed = pushed - memory["estimate"]
        estimate = memory["estimate"] + memory["intervals"] * (self._taken * pushed)
        inside, torque = self._inner_step(memory, readings, inputs)
        torque = torque - self.compensation * estimate
        own = {"momentum": now, "commanded": torque, "estimate": estimate, "intervals": np.ones(1)}
        if self._actuation is not None:
            own["angle"] = np.array(readings.joint_angle)
        return {**own, **inside}, torque


#: Half of the length of the filter, times the cutoff. A Hamming window of this length passes half
#: of the cutoff and stops one and a half of it.
_HALF = 1.65
#: Default cutoff, times the period.
_HARMONICS = 10.0
#: Difference from a whole number of samples that is rounding.
_ROUNDING = 1e-6
#: Iterations for the poles near the harmonics, the smallest factor that is not zero, and factors
#: relative to the largest for which the value at the harmonic itself is sufficient.
_ITERATIONS, _NONE, _STOPPED = 20, 1e-12, 0.05


class RepetitiveControl(Parametrised, RepetitiveParameters, Around):
    """Learns, in every period, the torque that removes the periodic errors of the joints.

    The torque of the period before, corrected by its errors and filtered without phase shift, is
    added to the torque of an inner controller; (C.107). ``harmonic_rates`` predicts how fast the
    errors decrease; the attribute ``repetitive_rate`` of a result is the measured factor of the
    last period.

    Without a reference the errors are those from the angles of the first measurement.

    Raises:
        InputError: if a number is negative or not finite, ``cutoff`` times ``period`` is below 2,
            ``inner`` is not a controller, or the period is not a multiple of its sample time, or
            too short for the lead and the filter.

    References:
        S. Hara, Y. Yamamoto, T. Omata and M. Nakano, IEEE Trans. Automatic Control 33 (1988)
        659-668.
        M. Tomizuka, T.-C. Tsao and K.-K. Chew, J. Dynamic Systems, Measurement, and Control 111
        (1989) 353-358.
    """

    inner: Controller

    def __post_init__(self) -> None:
        if self.cutoff is None:
            self.cutoff = _HARMONICS / self.period
        if self.cutoff * self.period < 2.0:
            rule = f"be at least 2 divided by the period ({2.0 / self.period:.4g} Hz)"
            raise InputError(Problem("cutoff", rule, shown(self.cutoff)))
        self._samples()
        self._history: PeriodHistory | None = None

    @public_call
    def reset(self) -> None:
        """Clear the learned torque, and the state of the inner controller.

        Raises:
            InputError: if the period is not a multiple of the sample time, or too short for the
                lead and the filter.
        """
        super().reset()
        self._samples()
        self._history = None

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        return self._required(arm, reference, joints_of(arm.n_joints, *self._per_joint()))

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        now, followed = measurement.joint_angle, self._reference_or_rest(measurement, reference)
        if self._history is None:
            self._history = PeriodHistory(now.size, *self._samples(), self._filter())
        error = self.proportional * (followed.joint_angle(t) - now)
        error = error + self.derivative * (followed.joint_rate(t) - measurement.joint_rate)
        learned = self._history.advance(error)
        return np.asarray(self.inner.update(t, measurement, reference)) + learned

    def report(self) -> dict[str, float]:
        """Return the measured rate, and the report of the inner controller.

        The rate is the change of the learned torque in the last period divided by that in the
        period before; NaN before the end of the third.
        """
        rate = np.nan if self._history is None else self._history.rate
        return {"repetitive_rate": rate} | super().report()

    @public_call
    def harmonic_rates(
        self, plant: Arm, posture: ArrayLike, hardware: Hardware | None = None
    ) -> FloatArray:
        """Predict the factor of each harmonic from period to period; (C.108).

        Repetitive control converges if the closed loop of the inner controller is stable and all
        factors are below one. The largest is the predicted rate after many periods.

        Args:
            plant: the arm. posture: (joints,) rad, about which it is linearised.
            hardware: instruments, with the sample time of the controller, and motors; None for
                exact ones.

        Returns:
            Factors (k,) of the harmonics 0 to half of the samples of a period; harmonic j has the
            frequency j / period.

        Raises:
            InputError: if the inner controller has no ``step``, an instrument has its
                own ``sample_time``, or an argument has the wrong type or number of joints.
        """
        check_kind("plant", plant, Arm)
        if hardware is not None:
            check_kind("hardware", hardware, Hardware)
        plants_of(self.inner, plant, "plant")
        required = joints_of(plant.n_joints, *self._per_joint())
        if required != plant.n_joints:
            rule = f"has numbers for {required} joint(s), but the plant has {plant.n_joints}"
            raise InputError(Problem("controller", rule))
        posture = check_posture("posture", posture, plant.n_joints)
        count, lead = self._samples()
        loop = loop_at(self.inner, plant, posture, hardware)
        check_single_rate(loop)
        signal = _LearningSignal(self)
        errors = loop_at(signal, plant, posture, hardware).controller.D
        A, push = loop.matrices()[0], loop.plant.B
        joints, size = push.shape[1], len(loop.plant.A[0])
        push_all = np.vstack([push, np.zeros((len(A) - size, joints))]).astype(complex)
        C = np.hstack([errors @ loop.plant.C[0], np.zeros((joints, len(A) - size))])
        weights = self._filter()
        half = len(weights) // 2

        def maps(z: ComplexArray) -> ComplexArray:
            response = C @ np.linalg.solve(z[:, None, None] * np.eye(len(A)) - A, push_all)
            gain = z[:, None] ** np.arange(-half, half + 1) @ weights
            later = z[:, None, None] ** lead
            return np.asarray(gain[:, None, None] * (np.eye(joints) + later * response))

        return _factors(maps, count, joints)

    def _samples(self) -> tuple[int, int]:
        """Return the number of samples of the period, and of the lead."""
        exact = self.period / self.sample_time
        count, lead = round(exact), round(self.lead / self.sample_time)
        if abs(count - exact) > _ROUNDING * exact:
            rule = f"be a multiple of the sample time of {self.sample_time:.6g} s"
            raise InputError(Problem("period", rule, shown(self.period)))
        if lead + self._half() >= count:
            least = (lead + self._half()) * self.sample_time
            rule = f"exceed {least:.4g} s, the sum of the lead and half of the filter's length"
            raise InputError(Problem("period", rule, shown(self.period)))
        return count, lead

    def _half(self) -> int:
        cutoff: float = self.cutoff
        return math.ceil(_HALF / (cutoff * self.sample_time))

    def _filter(self) -> FloatArray:
        """Return the weights of the filter without phase shift, (2 half + 1,)."""
        half = self._half()
        j = np.arange(-half, half + 1)
        weights = np.sinc(2.0 * self.cutoff * self.sample_time * j) * np.hamming(j.size)
        return np.asarray(weights / np.sum(weights))


def _factors(maps: Callable[[ComplexArray], ComplexArray], count: int, joints: int) -> FloatArray:
    """Return the largest |z|^count of the solutions of z^count = eigenvalue of maps(z).

    There is one solution near each harmonic for each joint. The iteration converges because maps
    change little over the distance of two harmonics, divided by 2 pi.
    """
    harmonics = np.arange(count // 2 + 1)
    first = np.linalg.eigvals(maps(np.exp(2j * np.pi * harmonics / count)))
    found: FloatArray = np.max(abs(first), axis=1)
    # Those that the filter stops need no exact value, and are most of them.
    kept = np.flatnonzero(found > _STOPPED * found.max())
    found[kept] = 0.0
    for joint in range(joints):
        factor = first[kept, joint]
        for _ in range(_ITERATIONS):
            # A factor of zero has no logarithm, and no effect.
            logs = np.log(np.where(factor == 0.0, _NONE, factor)) + 2j * np.pi * kept
            values = np.linalg.eigvals(maps(np.exp(logs / count)))
            nearest = np.argmin(abs(values - factor[:, None]), axis=1)
            factor = values[range(kept.size), nearest]
        found[kept] = np.maximum(found[kept], abs(factor))
    return found


class PeriodHistory:
    """Learned torques and errors of the last period."""

    def __init__(self, joints: int, count: int, lead: int, weights: FloatArray) -> None:
        self._count, self._lead, self._weights = count, lead, weights
        self._half = len(weights) // 2
        # Two copies in sequence, so that every window of the filter is contiguous.
        self._length = count + self._half + 1
        self._sums = np.zeros((2 * self._length, joints))
        self._learned = np.zeros((count, joints))
        self._k = 0
        self._last = self._change = 0.0  # squared, of the last complete period and the current one
        self.rate = np.nan

    def advance(self, error: FloatArray) -> FloatArray:
        """Add the error (joints,) of a sample, in N m, and return the learned torque."""
        k, count, length = self._k, self._count, self._length
        first = (k - count - self._half) % length  # of the window about the sample a period before
        learned: FloatArray = self._weights @ self._sums[first : first + 2 * self._half + 1]
        place = k % length
        self._sums[place] = self._sums[place + length] = learned
        earlier = (k - self._lead) % length
        self._sums[earlier] += error
        self._sums[earlier + length] = self._sums[earlier]
        change = learned - self._learned[k % count]
        self._learned[k % count] = learned
        self._change += float(change @ change)
        self._k = k + 1
        if self._k % count == 0:
            # The first period learns only from errors that the filter takes from its end, so the
            # change of the second is the first to compare with.
            if self._k >= 3 * count and self._last > 0.0:
                self.rate = math.sqrt(self._change / self._last)
            self._last, self._change = self._change, 0.0
        return learned


class _LearningSignal(Controller):
    """Controller whose torque is the error in N m that a repetitive control learns from."""

    def __init__(self, repetitive: RepetitiveControl) -> None:
        self._repetitive = repetitive
        self.sample_time = repetitive.sample_time

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        return self._repetitive.requirements(arm, reference)

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        torque: FloatArray = self._repetitive.proportional * readings.joint_angle
        return memory, -torque - self._repetitive.derivative * readings.joint_rate
