"""Moving-horizon estimator of states, payload, parameters and disturbances, with bounds.

Bounded least squares over the last samples, with the arrival cost of a filter. Symbols: x the
estimated numbers of `Layout`, slow numbers those without [q, qd]; w the errors of the torque
relative to their deviation, of unit variance; F, G derivatives of x at the next sample by x and w;
H, D derivatives of the readings by x and the w that led to the sample.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np

from flexarm.base.errors import AccuracyWarning, Problem, raise_any, shown, warn_caller
from flexarm.base.late import optimize
from flexarm.control.filters.estimates import innovation_covariance, squared_innovation
from flexarm.control.filters.estimator import MASS, StateEstimator
from flexarm.control.filters.kalman_filter import square_root
from flexarm.control.filters.predicted_readings import ArmModel, Link, PredictedReadings
from flexarm.control.hardware.measurement import FloatArray
from flexarm.model.drives.around import MovingHorizonParameters

#: Largest number of Gauss-Newton steps, and the largest change of a number relative to its
#: deviation that ends them.
_MOST, _SMALL = 10, 1e-4
#: Change of the last step, relative to the deviations, up to which the estimates have converged:
#: small compared with the errors of the estimates.
_TOLERATED = 1e-2
#: Smallest eigenvalue of a correlation matrix, relative to the largest: it is zero for perfectly
#: correlated numbers, so the matrix has no inverse.
_LEAST = 1e-12
#: Relative increase of the cost by rounding, and the number of halvings of a step that exceeds it.
_ROUNDING, _HALVINGS = 1e-9, 4


@dataclass
class Node:
    """A sample: the torque (joints,) that led to it, its readings, and the estimates of x and w."""

    torque: FloatArray
    x: FloatArray
    error: FloatArray
    readings: list[tuple[PredictedReadings, FloatArray]] = field(default_factory=list)


class Arrival(NamedTuple):
    """Mean and covariance of x at the first sample by all earlier readings, and that with w."""

    x: FloatArray  # (s,)
    P: FloatArray  # (s, s)
    moved: FloatArray  # (s, joints)


class Evaluated(NamedTuple):
    """Residuals of a horizon, their derivatives by its variables, and the samples."""

    residuals: FloatArray  # (r,)
    slopes: FloatArray  # (r, v)
    x: list[FloatArray]
    errors: list[FloatArray]
    last: FloatArray  # (s, v), derivative of x at the last sample


class HorizonProblem:
    """Residuals of a horizon as a function of its variables, all of about unit deviation.

    The variables are the uncertain slow numbers at the first sample, so that their bounds are those
    of variables, the other deviations there (a root of their covariance, given the slow numbers),
    and for each later sample w and the slow numbers that walk.
    """

    def __init__(
        self,
        model: ArmModel,
        arrival: Arrival,
        nodes: list[Node],
        lower: FloatArray,
        upper: FloatArray,
    ) -> None:
        self._model, self._arrival, self._nodes = model, arrival, nodes
        s, joints, dof2 = arrival.x.size, model.noise.size, model.layout.states.stop
        slow = np.arange(dof2, s)
        self._active = active = slow[np.diag(arrival.P)[slow] > 0.0]
        self._walking = slow[model.walk[slow] > 0.0]
        self._step = np.sqrt(model.walk[self._walking])
        self._scale = scale = np.sqrt(np.diag(arrival.P)[active])
        rest = np.concatenate([np.arange(dof2), s + np.arange(joints)])
        whole = np.block([[arrival.P, arrival.moved], [arrival.moved.T, np.eye(joints)]])
        mean = np.concatenate([arrival.x, np.zeros(joints)])
        own, across = whole[np.ix_(active, active)], whole[np.ix_(rest, active)]
        values, vectors = np.linalg.eigh(own / np.outer(scale, scale))
        values = np.maximum(values, _LEAST * np.max(values, initial=0.0))
        self._inverse = vectors.T / np.sqrt(values)[:, None]
        gain = (across / scale) @ self._inverse.T @ self._inverse / scale
        self._root = square_root(whole[np.ix_(rest, rest)] - gain @ across.T)
        self._first = first = active.size + rest.size
        self._each = joints + self._walking.size
        self.size = first + (len(nodes) - 1) * self._each
        # [x, w] at the first sample is base + slope @ variables.
        self._base, self._slope = mean.copy(), np.zeros((s + joints, self.size))
        self._base[active] = 0.0
        self._base[rest] -= gain @ arrival.x[active]
        self._slope[active, np.arange(active.size)] = scale
        self._slope[rest, : active.size] = gain * scale
        self._slope[rest, active.size : first] = self._root
        self._rest = rest

        def bounds(bound: FloatArray, infinite: float) -> FloatArray:
            later = np.append(np.full(joints, infinite), bound[self._walking] / self._step)
            first = bound[active] / scale, np.full(rest.size, infinite)
            return np.concatenate([*first, np.tile(later, len(nodes) - 1)])

        self.lower, self.upper = bounds(lower, -np.inf), bounds(upper, np.inf)

    def start(self) -> FloatArray:
        """Return the variables (v,) of the estimates of the nodes, within their bounds."""
        first, size = self._nodes[0], self._active.size
        found = np.zeros(self.size)
        found[:size] = first.x[self._active] / self._scale
        found[:size] = np.clip(found[:size], self.lower[:size], self.upper[:size])
        whole = np.concatenate([first.x, first.error])
        missed = (whole - self._base - self._slope @ found)[self._rest]
        size_of = np.maximum(np.linalg.norm(self._root, axis=1), np.finfo(float).tiny)
        scaled = self._root / size_of[:, None]
        found[size : self._first] = np.linalg.lstsq(scaled, missed / size_of, rcond=1e-10)[0]
        parts = [[n.error, n.x[self._walking] / self._step] for n in self._nodes[1:]]
        found[self._first :] = [number for part in parts for one in part for number in one]
        return np.clip(found, self.lower, self.upper)

    def evaluate(self, v: FloatArray) -> Evaluated:
        """Return the residuals at the variables v, and all derivatives."""
        model, joints = self._model, self._model.noise.size
        whole, size = self._base + self._slope @ v, self._arrival.x.size
        x, error = whole[:size], whole[size:]
        X, W = self._slope[:size], self._slope[size:]
        unit = np.eye(self.size)
        mean = self._arrival.x[self._active] / self._scale
        early = self._inverse @ (v[: self._active.size] - mean)
        residuals = [early, v[self._active.size : self._first]]
        slopes = [self._inverse @ unit[: self._active.size], unit[self._active.size : self._first]]
        xs, errors = [x], [error]
        for k, node in enumerate(self._nodes):
            if k:
                at = self._first + (k - 1) * self._each
                own, walked = slice(at, at + joints), slice(at + joints, at + self._each)
                link = model.carry(x, node.torque, v[own])
                before, X_before = x, X
                x, error, W = link.after.copy(), v[own], unit[own]
                X = link.F @ X + link.G @ W
                x[self._walking] = self._step * v[walked]
                X[self._walking] = self._step[:, None] * unit[walked]
                residuals += [v[own], (x - before)[self._walking] / self._step]
                slopes += [W, (X - X_before)[self._walking] / self._step[:, None]]
                xs.append(x)
                errors.append(error)
            for seen, reading in node.readings:
                found = model.observe(seen, x, node.torque, error)
                deviation = np.sqrt(seen.variance)
                residuals.append((found.values - reading) / deviation)
                slopes.append((found.H @ X + found.D @ W) / deviation[:, None])
        whole, slope = np.concatenate(residuals), np.vstack(slopes)
        return Evaluated(whole, slope, xs, errors, X)

    def solve(self) -> tuple[Evaluated, bool]:
        """Return the least squares within the bounds, and whether the search converged."""
        v = self.start()
        best = self.evaluate(v)
        for _ in range(_MOST):
            bounds = np.minimum(self.lower - v, 0.0), np.maximum(self.upper - v, 0.0)
            found = optimize.lsq_linear(
                best.slopes, -best.residuals, bounds, method="bvls", tol=1e-14
            )
            change, largest = found.x, float(np.max(np.abs(found.x)))
            if largest < _SMALL:
                break
            limit = (1.0 + _ROUNDING) * float(best.residuals @ best.residuals)
            for _ in range(1 + _HALVINGS):
                trial = self.evaluate(v + change)
                if float(trial.residuals @ trial.residuals) <= limit:
                    break
                change = 0.5 * change
            else:
                break
            v, best = v + change, trial
        return best, found.status > 0 and largest < _TOLERATED


def next_arrival(model: ArmModel, arrival: Arrival, node: Node, link: Link) -> Arrival:
    """Return the arrival at the second sample: an extended Kalman filter along the estimates."""
    size, joints = arrival.x.size, model.noise.size
    mean = np.concatenate([arrival.x, np.zeros(joints)])
    P = np.block([[arrival.P, arrival.moved], [arrival.moved.T, np.eye(joints)]])
    at = np.concatenate([node.x, node.error])
    for seen, reading in node.readings:
        observed = model.observe(seen, node.x, node.torque, node.error)
        H, R = np.hstack([observed.H, observed.D]), np.diag(seen.variance)
        K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        mean = mean + K @ (reading - observed.values - H @ (mean - at))
        left = np.eye(mean.size) - K @ H
        P = left @ P @ left.T + K @ R @ K.T
    after = link.after + link.F @ (mean[:size] - node.x)
    covariance = link.F @ P[:size, :size] @ link.F.T + link.G @ link.G.T + np.diag(model.walk)
    return Arrival(after, 0.5 * (covariance + covariance.T), link.G)


_DISTURBANCE = "disturbance"


class MovingHorizonEstimator(MovingHorizonParameters, StateEstimator):
    """Moving-horizon estimator for bending, payload, parameters and disturbance torques.

    At each sample the estimates of the last ``horizon`` samples are the least squares of all their
    readings, torque errors and walks, within the bounds. Earlier samples enter by the arrival cost
    of an extended Kalman filter along the estimates. On a linear arm without active bounds the
    estimates equal those of the Kalman filter. Use it if bounds matter, or if readings and motion
    are far from linear over the deviations; it takes about ``horizon`` times as long as
    `ExtendedKalmanFilter`. The use is the same: in a loop with ``EstimatorController``, on a record
    with ``run``, or in your own loop.

    The covariance is that without bounds, so it is too large while a bound is active. The arrival
    cost is linearised: while the payload is unknown, a ``horizon`` that is too short makes the
    covariance too small; docs/performance/controllers.md has figures.

    Raises:
        InputError: if a number is wrong, a bound is not that of an uncertain number, bounds do not
            contain the start, or the estimator cannot use the instruments.

    Warns:
        AccuracyWarning: if the least squares of a sample do not converge, for the first one only;
            ``report`` has their number.

    References:
        C. V. Rao, J. B. Rawlings and D. Q. Mayne, IEEE Trans. Automatic Control 48 (2003) 246-258.
    """

    not_exported: ClassVar[str] = "It solves an optimisation problem at every sample."
    _changing = ("_arrival", "_nodes", "_current", "_unconverged")

    def __post_init__(self) -> None:
        self._bounded = {MASS: 0.0} | dict(self.lower_bounds or {})
        super().__post_init__()
        self._check_bounds()

    def _check_bounds(self) -> None:
        uncertain = [*self._layout.paths]
        uncertain += [MASS] if self.payload_deviation or self.payload_drift else []
        uncertain += [_DISTURBANCE] if self._layout.disturbed else []
        rule = f"have names of uncertain numbers ({', '.join(uncertain) or 'none here'})"
        problems = []
        for name in ("lower_bounds", "upper_bounds"):
            for key in getattr(self, name) or {}:
                if key not in uncertain:
                    problems.append(Problem(name, rule, shown(key)))
        for key, high in (self.upper_bounds or {}).items():
            if not self._bounded.get(key, -np.inf) < high:
                problems.append(Problem("upper_bounds", f"exceed the lower bound of {key}"))
        raise_any(problems)
        lower, upper = self._limited = (
            self._limits(self._bounded, -np.inf),
            self._limits(self.upper_bounds, np.inf),
        )
        start = np.append(self._nominal[1:], self._nominal[0])
        places = [*range(self._layout.parameters.start, self._layout.parameters.stop), -1]
        for path, place, value in zip((*self._layout.paths, MASS), places, start, strict=True):
            if not lower[place] <= value <= upper[place]:
                rule = f"contain the value of the arm for {path}"
                problems.append(Problem("bounds", rule, f"{value:g}"))
        torques = self._layout.disturbance
        if np.any(lower[torques] > 0.0) or np.any(upper[torques] < 0.0):
            problems.append(Problem("bounds", "contain the start of the disturbance", "0"))
        raise_any(problems)

    def _limits(self, given: Mapping[str, float] | None, infinite: float) -> FloatArray:
        """Return bounds (s,) of the estimated numbers."""
        layout, given = self._layout, dict(given or {})
        found = np.full(layout.size, infinite)
        found[layout.parameters] = [given.get(path, infinite) for path in layout.paths]
        found[layout.disturbance] = given.get(_DISTURBANCE, infinite)
        found[-1] = given.get(MASS, infinite)
        return found

    def _start(self, x: FloatArray, covariance: FloatArray) -> None:
        joints = self.arm.n_joints
        walk = self._walk.copy()
        walk[-1] = self.sample_time * self.payload_drift**2
        assert self._step is not None
        self._model = ArmModel(self._step, self._layout, self._noise, walk)
        self._unconverged = 0
        self._arrival = Arrival(x, covariance, np.zeros((x.size, joints)))
        self._nodes = [Node(np.zeros(joints), x, np.zeros(joints))]
        self._current = self._arrival

    def report(self) -> dict[str, float]:
        """Return the report of a filter, and the number of samples that did not converge."""
        return super().report() | {"estimator_unconverged": self._unconverged}

    def _count(self, converged: bool) -> None:
        """Count a sample that did not converge, and warn of the first one."""
        if not converged and not self._unconverged:
            text = (
                f"{type(self).__name__}: at t = {self._number * self.sample_time:g} s the least "
                "squares did not converge, so the estimates may be wrong. Reduce the deviations, "
                "or correct the arm; report()['estimator_unconverged'] counts the samples."
            )
            warn_caller(text, AccuracyWarning)
        self._unconverged += not converged

    def _moments(self) -> tuple[FloatArray, FloatArray]:
        return self._current.x, self._current.P

    def _correct(self, seen: PredictedReadings, readings: FloatArray) -> float:
        x, P, moved = self._current
        node = self._nodes[-1]
        expected = self._model.observe(seen, x, node.torque, np.zeros_like(node.torque))
        S, _, _ = innovation_covariance(P, moved, expected.H, expected.D, np.diag(seen.variance))
        squared = squared_innovation(readings - expected.values, S)
        node.readings.append((seen, readings))
        problem = HorizonProblem(self._model, self._arrival, self._nodes, *self._limited)
        found, converged = problem.solve()
        self._count(converged)
        for one, estimate, error in zip(self._nodes, found.x, found.errors, strict=True):
            one.x, one.error = estimate, error
        root = np.linalg.solve(np.linalg.qr(found.slopes)[1].T, found.last.T)
        self._current = Arrival(found.x[-1], root.T @ root, np.zeros_like(moved))
        return squared

    def _predict(self) -> None:
        last, none = self._nodes[-1], np.zeros(self.arm.n_joints)
        link = self._model.carry(last.x, self._torque, none)
        P = link.F @ self._current.P @ link.F.T + link.G @ link.G.T + np.diag(self._model.walk)
        self._current = Arrival(link.after, P, link.G)
        self._nodes.append(Node(self._torque.copy(), link.after, none))
        if len(self._nodes) > self.horizon:
            first, second = self._nodes[:2]
            ahead = self._model.carry(first.x, second.torque, second.error)
            # The derivatives are those at the estimated error; its mean is zero.
            ahead = ahead._replace(after=ahead.after - ahead.G @ second.error)
            self._arrival = next_arrival(self._model, self._arrival, first, ahead)
            del self._nodes[0]
