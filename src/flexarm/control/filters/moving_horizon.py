"""Moving-horizon estimator of states, payload, parameters and disturbances, with bounds."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flexarm.base.errors import AccuracyWarning, InputError, Problem, shown, warn_caller
from flexarm.control.filters.estimator import MASS, StateEstimator
from flexarm.control.filters.horizon import ArmModel, Arrival, HorizonProblem, Node, next_arrival
from flexarm.control.filters.innovation_test import innovation_covariance, squared_innovation
from flexarm.control.filters.predicted_readings import PredictedReadings
from flexarm.control.hardware.measurement import FloatArray
from flexarm.model.drives.around import MovingHorizonParameters

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

    The covariance is that without bounds, so it is too large while a bound is active.

    Raises:
        InputError: if a number is wrong, a bound is not that of an uncertain number, bounds do not
            contain the start, or the estimator cannot use the instruments.

    Warns:
        AccuracyWarning: if the least squares of a sample do not converge, for the first one only;
            ``report`` has their number.

    References:
        C. V. Rao, J. B. Rawlings and D. Q. Mayne, IEEE Trans. Automatic Control 48 (2003) 246-258.
    """

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
        if problems:
            raise InputError(*problems)
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
        if problems:
            raise InputError(*problems)

    def _limits(self, given: Mapping[str, float] | None, infinite: float) -> FloatArray:
        """Return bounds (s,) of the estimated numbers."""
        layout, given = self._layout, dict(given or {})
        found = np.full(layout.size, infinite)
        found[layout.parameters] = [given.get(path, infinite) for path in layout.paths]
        found[layout.disturbance] = given.get(_DISTURBANCE, infinite)
        found[-1] = given.get(MASS, infinite)
        return found

    def _start(self, x: FloatArray, covariance: FloatArray) -> None:
        """See ``StateEstimator._start``."""
        joints = self.arm.joints
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
        """See ``StateEstimator._moments``."""
        return self._current.x, self._current.P

    def _correct(self, seen: PredictedReadings, readings: FloatArray) -> float:
        """See ``StateEstimator._correct``."""
        x, P, moved = self._current
        node = self._nodes[-1]
        expected = self._model.observe(seen, x, node.torque, np.zeros_like(node.torque))
        S, _, _ = innovation_covariance(P, moved, expected.H, expected.D, seen.variance)
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
        """See ``StateEstimator._predict``."""
        last, none = self._nodes[-1], np.zeros(self.arm.joints)
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
