"""Estimates along a record, the order of the estimated numbers, and the innovation test."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.base.arguments import check_mapping, check_nonnegative, check_number, check_numbers
from flexarm.base.errors import (
    InconsistentEstimateWarning,
    InputError,
    Problem,
    check_array,
    public_call,
    shown,
    warn_caller,
)
from flexarm.base.late import scipy
from flexarm.control.hardware.measurement import FloatArray

#: Matrix of NumPy or CasADi.
Matrix = Any
#: Number of samples over which normalised innovations squared are averaged.
WINDOW = 100
#: Probability that a consistent filter fails the test in a given window.
_FALSE_ALARM = 1e-9


@cache
def largest_ratio(size: int) -> float:
    """Return the limit of the mean normalised innovation squared of ``size`` readings."""
    return float(scipy.special.chdtri(size, _FALSE_ALARM)) / size


def band(size: int, probability: float) -> tuple[float, float]:
    """Return the central interval of a chi-squared variable of ``size``, divided by its mean."""
    inside = check_number("probability", probability, lambda p: 0.0 < p < 1.0, "be within 0 and 1")
    low, high = scipy.special.chdtri(size, [0.5 + 0.5 * inside, 0.5 - 0.5 * inside]) / size
    return float(low), float(high)


def innovation_covariance(
    P: Matrix, moved: Matrix, H: Matrix, felt: Matrix, noise: Matrix
) -> tuple[Matrix, Matrix, Matrix]:
    """Return the covariance S of readings, that of their errors R, and N of state and errors.

    The error of the torque affects both the state and the accelerometers, so their errors are
    correlated by N (s, readings).
    """
    N, R = moved @ felt.T, noise + felt @ felt.T
    return H @ P @ H.T + H @ N + N.T @ H.T + R, R, N


def squared_innovation(missed: FloatArray, covariance: FloatArray) -> float:
    """Return the normalised innovation squared of the difference of readings and prediction."""
    return float(missed @ np.linalg.solve(covariance, missed))


class InnovationTest:
    """Test of the mean normalised innovation squared over a window against its distribution.

    Args:
        name: of the filter, for its warning.

    Attributes:
        ratio: mean over the last ``WINDOW`` samples, about one if the filter is consistent; NaN
            before there are as many.
        worst: largest ratio so far, or NaN.
        passed: whether all windows so far were within their distribution.

    Y. Bar-Shalom, X. R. Li and T. Kirubarajan, Estimation with Applications to Tracking and
    Navigation, 2001, section 5.4. Ratios far below one pass the test: the noise is then smaller
    than specified, and so are the errors.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._last, self._sizes = np.zeros(WINDOW), np.zeros(WINDOW, dtype=int)
        self._count = 0
        self.ratio = self.worst = np.nan
        self.passed = True

    def add(self, squared: float, size: int) -> None:
        """Add the normalised innovation squared of a sample with ``size`` readings."""
        place = self._count % WINDOW
        self._last[place], self._sizes[place] = squared, size
        self._count += 1
        if self._count < WINDOW:
            return
        count = int(self._sizes.sum())
        self.ratio = float(self._last.sum()) / count
        self.worst = float(np.fmax(self.worst, self.ratio))
        if self.passed and self.ratio > largest_ratio(count):
            self.passed = False
            text = (
                f"{self._name}: over {WINDOW} samples the squared innovations are "
                f"{self.ratio:.3g} times as large as the covariance allows, so the errors of the "
                "estimates exceed its covariance. Correct the arm, or raise torque_noise or the "
                "noise of the instruments."
            )
            warn_caller(text, InconsistentEstimateWarning)


class Layout(NamedTuple):
    """Places of the estimated numbers x = [q, qd, parameters, disturbance, biases, payload].

    dof; paths of the parameters; disturbed, the number of disturbance torques; biased, the names of
    instruments with unknown biases and the numbers of their readings.
    """

    dof: int
    paths: tuple[str, ...]
    disturbed: int
    biased: tuple[tuple[str, int], ...] = ()

    @property
    def size(self) -> int:
        """Number of estimated numbers."""
        return int(self.biases.stop) + 1

    @property
    def states(self) -> slice:
        """Places of [q, qd]."""
        return slice(0, 2 * self.dof)

    @property
    def parameters(self) -> slice:
        """Places of the parameters."""
        return slice(2 * self.dof, 2 * self.dof + len(self.paths))

    @property
    def disturbance(self) -> slice:
        """Places of the disturbance torques of the joints."""
        return slice(self.parameters.stop, self.parameters.stop + self.disturbed)

    @property
    def biases(self) -> slice:
        """Places of the biases of readings."""
        first = self.disturbance.stop
        return slice(first, first + sum(count for _, count in self.biased))

    @property
    def by_instrument(self) -> dict[str, slice]:
        """Places of the biases of each instrument."""
        found, first = {}, self.biases.start
        for name, count in self.biased:
            found[name], first = slice(first, first + count), first + count
        return found

    @property
    def slow(self) -> dict[str, int]:
        """Places of all numbers except [q, qd], by name."""
        found = {"payload.mass": self.size - 1}
        found |= {path: self.parameters.start + k for k, path in enumerate(self.paths)}
        for k in range(self.disturbed):
            found[f"disturbance[{k}]"] = self.disturbance.start + k
        for name, places in self.by_instrument.items():
            for k in range(places.start, places.stop):
                found[f"bias of {name}[{k - places.start}]"] = k
        return found

    def acting(self, x: FloatArray, torque: FloatArray) -> FloatArray:
        """Return the torques (joints,) on the joints, N m: a torque and the disturbance of x."""
        return torque + x[self.disturbance] if self.disturbed else torque

    def derivative(
        self, slopes: tuple[FloatArray, ...], by_mass: float, biases: ArrayLike = 0.0
    ) -> FloatArray:
        """Return the derivative (rows, size) by x of a function with ``slopes`` by arm and torque.

        Those are by [q, qd], by the parameters of ``SampledStep``, and by the torque.
        """
        state, parameters, torque = slopes
        found = np.zeros((len(state), self.size))
        found[:, self.states] = state
        found[:, self.parameters] = parameters[:, 1:]
        found[:, self.disturbance] = torque[:, : self.disturbed]
        found[:, self.biases] = biases
        found[:, -1] = by_mass * parameters[:, 0]
        return found

    def deviations(self, covariance: FloatArray) -> dict[str, FloatArray]:
        """Return the standard deviations by name for covariances (..., size, size)."""
        found = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
        named = {"q": found[..., : self.dof], "qd": found[..., self.dof : 2 * self.dof]}
        named["payload.mass"] = found[..., -1]
        if self.disturbed:
            named["disturbance"] = found[..., self.disturbance]
        parameters = np.moveaxis(found[..., self.parameters], -1, 0)
        named |= zip(self.paths, parameters, strict=True)
        for name, places in self.by_instrument.items():
            named[f"bias of {name}"] = found[..., places]
        return named


class Estimates(NamedTuple):
    """Estimates from a record, after the readings of each sample.

    q and qd (samples, dof), payload_mass (samples,) kg, covariance (samples, s, s) of
    [q, qd, parameters, disturbance, biases, payload_mass]; innovation (samples,), the normalised
    innovation squared of each sample divided by the number of readings, one on average, NaN without
    readings; consistent, False if the innovation test failed; readings (samples,), their number in
    each sample; parameters, (samples,) by path; disturbance (samples, joints) N m, zero if it is
    not estimated; biases (samples, k) by instrument, in the unit of its readings.
    """

    q: FloatArray
    qd: FloatArray
    payload_mass: FloatArray
    covariance: FloatArray
    innovation: FloatArray
    consistent: bool
    readings: NDArray[np.intp]
    parameters: dict[str, FloatArray]
    disturbance: FloatArray
    biases: dict[str, FloatArray]

    @property
    def deviations(self) -> dict[str, FloatArray]:
        """Standard deviations by name: "q", "qd", "payload.mass", "disturbance" and each path.

        Those of biases have names such as "bias of joint_rate".
        """
        return self._layout.deviations(self.covariance)

    @public_call
    def squared_errors(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        payload_mass: float,
        parameters: Mapping[str, float] | None = None,
        disturbance: ArrayLike | None = None,
        biases: Mapping[str, ArrayLike] | None = None,
    ) -> FloatArray:
        """Return the normalised estimation error squared (samples,), one on average.

        Args:
            q, qd: (samples, dof), the true states. payload_mass: the true one, kg.
            parameters: the true numbers by path, required for those that were estimated.
            disturbance: the true torques (joints,) or (samples, joints) N m; zero by default.
            biases: the true biases by instrument, required for those that were estimated; one
                number for all readings, or (k,) or (samples, k).

        Raises:
            InputError: if a shape is wrong, a number is missing or not finite.

        Divided by the number of states that are uncertain. Y. Bar-Shalom, X. R. Li and T.
        Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.4.
        """
        true = [check_array(n, v, self.q.shape) for n, v in (("q", q), ("qd", qd))]
        mass = check_nonnegative("payload_mass", payload_mass)
        numbers = {} if parameters is None else parameters
        true_parameters = check_mapping("parameters", numbers, "paths and numbers")
        if set(true_parameters) != set(self.parameters):
            rule = f"have the estimated paths {', '.join(self.parameters) or '(none)'}"
            raise InputError(Problem("parameters", rule, shown(list(true_parameters))))
        missed = [true[0] - self.q, true[1] - self.qd]
        for path, values in self.parameters.items():
            number = check_number(f"parameters[{path!r}]", true_parameters[path])
            missed.append((number - values)[:, None])
        joints = self.disturbance.shape[1]
        disturbance = np.zeros(joints) if disturbance is None else disturbance
        torques = check_numbers("disturbance", disturbance)
        shape = self.disturbance.shape if torques.ndim == 2 else (joints,)
        acting = check_array("disturbance", torques, shape) - self.disturbance
        missed.append(acting[:, : self._layout.disturbed])
        wrong = check_mapping("biases", {} if biases is None else biases, "names and numbers")
        if set(wrong) != set(self.biases):
            rule = f"have the instruments {', '.join(self.biases) or '(none)'}"
            raise InputError(Problem("biases", rule, shown(list(wrong))))
        for name, values in self.biases.items():
            given_bias = check_numbers(f"biases[{name!r}]", wrong[name])
            if given_bias.shape not in ((), values.shape[1:], values.shape):
                rule = f"have shape () or {values.shape[1:]}"
                raise InputError(Problem(f"biases[{name!r}]", rule, f"shape {given_bias.shape}"))
            missed.append(given_bias - values)
        whole = np.column_stack([*missed, mass - self.payload_mass])
        free = self._uncertain
        P, error = self.covariance[:, free][:, :, free], whole[:, free, None]
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
    def innovation_band(self, probability: float = 0.95) -> tuple[FloatArray, FloatArray]:
        """Return the interval of ``innovation`` of a consistent filter, (samples,) each.

        NaN for samples without readings.

        Raises:
            InputError: if the probability is not between 0 and 1.
        """
        sizes, places = np.unique(self.readings, return_inverse=True)
        found = np.array([band(int(n), probability) if n else (np.nan, np.nan) for n in sizes])
        low, high = found[places].T
        return low, high

    @property
    def _layout(self) -> Layout:
        dof, paths = self.q.shape[1], tuple(self.parameters)
        biased = tuple((name, values.shape[1]) for name, values in self.biases.items())
        known = Layout(dof, paths, 0, biased).size
        return Layout(dof, paths, self.covariance.shape[1] - known, biased)

    @property
    def _uncertain(self) -> NDArray[np.bool_]:
        """Whether each state has a variance; that of a known payload is zero."""
        variances = np.diagonal(self.covariance, axis1=1, axis2=2)
        return np.asarray(np.any(variances > 0, axis=0))
