"""Optimal excitation of an arm for the estimation of its parameters: `optimal_excitation`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.arguments import check_count, check_kind, check_mapping
from flexarm.base.errors import (
    InputError,
    Problem,
    SimulationError,
    check_array,
    public_call,
    without_warnings,
)
from flexarm.base.late import optimize, scipy
from flexarm.identification.assessment import Identifiability, predicted
from flexarm.identification.record import MeasuredRecord
from flexarm.identification.space import check_free
from flexarm.model.arm.spec import UNDRIVEN, serial_only
from flexarm.model.checks import checked_arguments
from flexarm.model.identification import FreeParameter, RecordSettings
from flexarm.model.quantities import Count, Positive
from flexarm.planning.optimize.task import MotionLimits, Quantities, bounds_of, torque_limits
from flexarm.simulation.calls.run import simulate
from flexarm.simulation.histories.multisine import Multisine, multisine, rates_of, schroeder
from flexarm.simulation.histories.piecewise import sampled_torque
from flexarm.simulation.run.tolerance import RTOL

#: Sharpness of the smooth largest value over time, and least relative information of a combination.
_SHARP, _SINGULAR = 60.0, 1e-12
#: Change of the amplitudes for differences, relative to the first ones.
_STEP = 1e-3
#: Doublings and halvings of the search for the largest amplitude within the limits.
_DOUBLINGS, _HALVINGS = 40, 12
#: Points per sample at which the rate of the torque is limited: peaks between them are at most
#: 0.2 % higher, also those of a sine of half the rate.
_POINTS = 32
#: Value of the objective for a run that fails.
_FAILED = 1e3
#: Channels that the limits are about.
_LIMITED = ("joint_angle", "joint_rate", "strain", "tip")


@dataclass(frozen=True, eq=False)
class OptimalExcitation:
    """Result of `optimal_excitation`.

    Attributes:
        torque: the optimal torque.
        identifiability: what its record will determine; first: the same for the multisine from
            which the search started, at its largest amplitude within the limits.
        run: result of `simulate` under the torque.
        duration: s, of the experiment; rate: of its samples, Hz.
        evaluations: number of simulated experiments of the search.
    """

    torque: Multisine
    identifiability: Identifiability
    first: Identifiability
    run: xr.Dataset
    duration: float
    rate: float
    evaluations: int

    @property
    def samples(self) -> FloatArray:
        """Torque (samples, joints) of the experiment at its rate, N m."""
        return self.torque.samples(self.rate, self.duration)

    @property
    def gain(self) -> float:
        """Mean factor by which the standard deviations are smaller than those of the start."""
        change = self.identifiability.log_determinant - self.first.log_determinant
        return float(np.exp(0.5 * change / len(self.first.information)))

    def __repr__(self) -> str:
        return (
            f"<flexarm.OptimalExcitation: {self.torque!r}, standard deviations smaller by "
            f"{self.gain:.3g} than those of the first multisine>"
        )


@public_call
def optimal_excitation(
    arm: Arm,
    free: Sequence[str | FreeParameter],
    limits: MotionLimits,
    *,
    noise: Mapping[str, float],
    period: Positive,
    band: ArrayLike,
    lines: int = 8,
    duration: Positive | None = None,
    rate: Positive = 200.0,
    start: ArrayLike | None = None,
    iterations: Count = 30,
) -> OptimalExcitation:
    """Compute a torque whose record determines parameters best: a D-optimal multisine.

    It maximises the determinant of the Fisher information of the parameters, by amplitudes and
    phases of its sines, within limits. The torque rises smoothly from zero and is periodic; the
    arm starts at rest.

    Args:
        arm: with the expected values of the parameters, in a horizontal plane.
        free: parameters to be estimated, as for `identify`.
        limits: limits of torques, of their rates, of joint angles and rates, strains, and of the
            tip; at least one must bound the torque.
        noise: standard deviation of the noise of each measured channel, SI units.
        period: s, of the torque: one over the distance of its possible frequencies.
        band: lowest and highest frequency, Hz.
        lines: number of sines for each joint, with frequencies at nearly equal ratios.
        duration: s, of the experiment; two periods by default.
        rate: samples per second of torque and channels, Hz.
        start: (joints,) joint angles at the start, rad; zero by default.
        iterations: largest number of iterations of the search.

    Returns:
        The torque, its simulation, and the predicted standard deviations.

    Raises:
        InputError: if an argument has the wrong type or value, gravity acts, the limits do not
            bound the torque or exclude the start, or no torque of this kind distinguishes the
            parameters.
        SimulationError: if the arm cannot be simulated under the first multisine.

    The search is SciPy's SLSQP from a multisine with equal amplitudes and Schroeder phases; its
    result is a local optimum, scaled to the limits. Limits hold at the samples, and
    ``torque_rate`` within 0.2 % also between them, for the torque and for the cubic spline through
    its samples, which is simulated. Mehra, IEEE Transactions on Automatic Control 19 (1974) 753.
    """
    parameters = check_free(free)
    serial_only(arm.spec, "an optimal excitation", UNDRIVEN)
    check_kind("limits", limits, MotionLimits)
    check_mapping("noise", noise, "channels and standard deviations")
    if not noise:
        raise InputError(Problem("noise", "must not be empty"))
    if np.any(arm.spec.gravity):
        raise InputError(Problem("arm", "has gravity, which is not supported"))
    whole = 2.0 * period if duration is None else duration
    angles = (
        np.zeros(arm.n_joints) if start is None else check_array("start", start, (arm.n_joints,))
    )
    full = multisine(period, band, np.ones(arm.n_joints), rise=min(period, whole) / 8.0)
    first = _chosen(full, check_count("lines", lines, 2))
    first.samples(rate, whole)  # checks the rate
    experiment = _Experiment(arm, parameters, limits, dict(noise), whole, rate, angles)
    with without_warnings():
        begin = experiment.largest(first)
        initial = experiment.identifiability(experiment.run(begin))
        values = np.linalg.eigvalsh(initial.information)
        if not values[0] > _SINGULAR * values[-1]:
            rule = "contain a combination of parameters that the record does not determine"
            raise InputError(Problem("free", rule, hint=" ".join(initial.undetermined)))
        motion = experiment.largest(_search(experiment, begin, iterations))
        best = experiment.identifiability(experiment.run(motion))
        if best.log_determinant < initial.log_determinant:
            motion, best = begin, initial
    run = experiment.run(motion)
    return OptimalExcitation(
        motion, best, initial, run, experiment.duration, experiment.rate, experiment.evaluations
    )


def _chosen(full: Multisine, lines: int) -> Multisine:
    """Return a multisine with fewer lines, spread geometrically, and Schroeder phases for them."""
    low, high = full.harmonics[[0, -1]]
    chosen = np.unique(np.rint(np.geomspace(low, high, min(lines, full.harmonics.size))))
    # The joints move differently, so that their effects differ.
    products = np.outer(np.arange(chosen.size), np.arange(full.joints))
    turns = np.exp(2j * np.pi * products / (full.joints + 1.0))
    return Multisine(full.period, chosen, schroeder(chosen.size)[:, None] * turns, full.rise)


@dataclass(eq=False)
class _Experiment:
    """Experiments with multisines of the same lines."""

    arm: Arm
    free: list[FreeParameter]
    limits: MotionLimits
    noise: dict[str, float]
    duration: float
    rate: float
    angles: FloatArray

    def __post_init__(self) -> None:
        self._bounds = bounds_of(self.limits, self.arm)
        self._torques = torque_limits(self.limits, self.arm)
        if not self._bounds and np.all(np.isinf(self._torques)):
            raise InputError(Problem("limits", "must contain at least one limit"))
        self.evaluations = 0

    def run(self, torque: Multisine) -> xr.Dataset:
        """Simulate an experiment."""
        self.evaluations += 1
        return simulate(
            self.arm,
            self.duration,
            torque=torque.samples(self.rate, self.duration),
            rate=self.rate,
            rtol=RTOL,
            initial=self.arm.rest(self.angles),
            progress=False,
        )

    def excess(self, torque: Multisine, run: xr.Dataset) -> FloatArray:
        """Return the excess (k,) of values over their limits, relative; negative within them."""
        samples = torque.samples(self.rate, self.duration)
        most, fastest = (limit[:, None] for limit in self._torques)
        parts = [np.abs(samples.T) / most - 1.0]
        if self.limits.torque_rate is not None:
            parts.append(self._fastest(torque, samples).T / fastest - 1.0)
        values = {name: run[name].values.T if name in run else None for name in _LIMITED}
        state = Quantities(**values)
        for bound in self._bounds:
            found = np.asarray(bound.value(state))
            size = bound.size[:, None]
            parts.append((found - bound.upper[:, None]) / size)
            parts.append((bound.lower[:, None] - found) / size)
        limited = [
            part[np.isfinite(part).all(axis=1) & np.any(part > -1.0, axis=1)] for part in parts
        ]
        return np.concatenate([part.ravel() for part in limited])

    def _fastest(self, torque: Multisine, samples: FloatArray) -> FloatArray:
        """Return the largest torque rates (intervals, joints) between samples, N m/s."""
        intervals, joints = len(samples) - 1, self.arm.n_joints
        places = np.arange(intervals)[:, None] + np.linspace(0.0, 1.0, _POINTS + 1)
        times = places.ravel() / self.rate
        spline = sampled_torque(samples, self.rate, self.duration, joints, "cubic")
        rates = np.maximum(np.abs(rates_of(torque, times)), np.abs(spline.rates_at(times)))
        return np.asarray(rates.reshape(intervals, -1, joints).max(axis=1))

    def within(self, torque: Multisine) -> bool:
        """Return whether an experiment can be simulated and keeps all limits."""
        try:
            run = self.run(torque)
        except SimulationError:
            return False
        return bool(np.all(self.excess(torque, run) <= 0.0))

    def largest(self, torque: Multisine) -> Multisine:
        """Return the multisine with the largest common factor within the limits."""
        low, high = 0.0, 1.0
        for _ in range(_DOUBLINGS):
            if not self.within(torque.scaled(high)):
                break
            low, high = high, 2.0 * high
        else:
            raise InputError(Problem("limits", "do not bound the torque"))
        for _ in range(_DOUBLINGS if low == 0.0 else 0):
            if self.within(torque.scaled(0.5 * high)):
                low = 0.5 * high
                break
            high *= 0.5
        if low == 0.0:
            raise InputError(Problem("limits", "exclude the start"))
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.within(torque.scaled(middle)) else (low, middle)
        return torque.scaled(low)

    def identifiability(self, run: xr.Dataset) -> Identifiability:
        """Return what the record of an experiment determines.

        Raises:
            InputError: if a channel of the noise is not in results.
            SimulationError: if the derivatives cannot be computed.
        """
        settings = checked_arguments(
            RecordSettings, interpolation="cubic", outputs=list(self.noise), noise=self.noise
        )
        record = MeasuredRecord(run, settings)
        return predicted(self.arm, {"experiment": record}, self.free, None, {})


def _search(experiment: _Experiment, begin: Multisine, iterations: int) -> Multisine:
    """Return a multisine with a larger determinant, nearly within the limits."""
    shape = begin.coefficients.shape
    scale = float(np.abs(begin.coefficients).max())
    known: dict[bytes, tuple[float, float]] = {}

    def torque_of(x: FloatArray) -> Multisine:
        real, imaginary = x.reshape(2, *shape)
        values = scale * (real + 1j * imaginary)
        return Multisine(begin.period, begin.harmonics, values, begin.rise)

    def evaluated(x: FloatArray) -> tuple[float, float]:
        """Return minus the logarithm of the determinant, and the margin to the limits."""
        key = x.tobytes()
        if key not in known:
            torque = torque_of(x)
            try:
                run = experiment.run(torque)
                value = -experiment.identifiability(run).log_determinant
                # A smooth upper bound of the largest excess.
                excess = scipy.special.logsumexp(_SHARP * experiment.excess(torque, run)) / _SHARP
                margin = -float(excess)
            except SimulationError:
                value, margin = _FAILED, -1.0
            known[key] = min(value, _FAILED), margin
        return known[key]

    x = np.concatenate([begin.coefficients.real.ravel(), begin.coefficients.imag.ravel()]) / scale
    found = optimize.minimize(
        lambda x: evaluated(x)[0],
        x,
        method="SLSQP",
        constraints={"type": "ineq", "fun": lambda x: evaluated(x)[1]},
        options={"maxiter": iterations, "eps": _STEP, "ftol": 1e-3},
    )
    return torque_of(found.x)
