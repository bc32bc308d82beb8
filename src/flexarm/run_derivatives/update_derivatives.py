"""Derivatives of the updates of a controller along a run, by its memory and its readings.

An update maps the memory and the readings to the next memory and the torque. Central differences
of order 8 differentiate it: for linear laws their error is rounding only, and for smooth laws it is
1e-12. Differences of order 6 estimate it, so that a law that is not smooth is rejected. A linear
law has the same derivatives at each update, which a difference in a random direction verifies.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Any

import numpy as np

from flexarm.control.base import Reference
from flexarm.errors import InputError, Problem
from flexarm.hardware.measurement import FloatArray, Measurement
from flexarm.loop_analysis.linear_controller import LinearController, Memory, memory_of
from flexarm.run_derivatives.differences import local_slope

#: First step of the differences, relative to the largest number of a reading or of the memory, and
#: the step of numbers that have all been zero.
_SHIFT, _SMALL = 0.01, 1e-3
#: Rounding errors of an update, relative to the sum of the absolute values of its terms.
_ROUNDED = 2e-14
#: Length of the random direction, in steps of the differences.
_FAR = 10.0
#: Relative difference of two updates with the same memory and readings that is rounding.
_SAME = 1e-9


class UpdateDerivatives:
    """Derivatives of the updates of a controller, computed in the order of the updates.

    Attributes:
        stored: names of the first readings that the controller stores without declaring it.

    Raises:
        InputError: if the controller does not declare its memory.
    """

    def __init__(self, controller: Any, reference: Reference | None) -> None:
        if memory_of(controller) is None:
            hint = "List the attributes that it keeps between samples in memory."
            rule = "declare its memory for derivatives of runs"
            raise InputError(Problem("controller", rule, type(controller).__name__, hint))
        self.stored: list[str] = []
        self._controller, self._reference = controller, reference
        self._trial: Any = deepcopy(controller)
        self._started: dict[str, Any] = {}
        self._kept: tuple[Memory, Memory] | None = None
        self._before, self._joints = np.zeros(0), 0
        self._largest = np.zeros(0)
        self._last: LinearController | None = None
        self._random = np.random.default_rng(0)

    def remember(self) -> None:
        """Store the memory of the controller before its next update."""
        self._before = np.zeros(0) if self._kept is None else self._kept[0].read()

    def after(self, t: float, measurement: Measurement, torque: FloatArray) -> LinearController:
        """Return the derivatives of the update that the controller has just made at t (s).

        Raises:
            InputError: if the update is not differentiable, or depends on undeclared memory.
        """
        first, self._joints = self._kept is None, torque.size
        respond = self._first if first else self._next
        readings = [np.ravel(value) for value in measurement.values()]
        point = np.concatenate([self._before, *readings])
        parts = [*([self._before] if self._before.size else []), *readings]

        def updated(x: FloatArray) -> FloatArray:
            return respond(t, x, measurement)

        if first:
            self._start_elsewhere(t, measurement)
        now = updated(point)
        if not first:
            self._check_memory(t, measurement, now, torque)
        steps = self._steps(parts)
        found = None if first else self._unchanged(updated, point, now, steps)
        if found is None:
            found = self._differenced(updated, point, now, steps, t)
        if first:
            updated(point)  # leave the trial where the controller is
            self._kept = _memory(self._controller), _memory(self._trial)
        self._last = found
        return found

    def _first(self, t: float, x: FloatArray, like: Measurement) -> FloatArray:
        """Return memory and torque after the first update, with readings x (p,)."""
        self._trial.reset()
        torque = self._trial.update(t, _measured(like, x), self._reference)
        return np.concatenate([_memory(self._trial).read(), np.ravel(torque)])

    def _next(self, t: float, x: FloatArray, like: Measurement) -> FloatArray:
        """Return memory and torque after an update, with memory and readings x (n + p,)."""
        assert self._kept is not None
        n = self._before.size
        self._kept[1].write(x[:n])
        torque = self._trial.update(t, _measured(like, x[n:]), self._reference)
        return np.concatenate([self._kept[1].read(), np.ravel(torque)])

    def _start_elsewhere(self, t: float, measurement: Measurement) -> None:
        """Update a copy of the controller for each reading, with another first one."""
        for name, value in measurement.items():
            moved = value + _SMALL * self._random.uniform(0.5, 1.0, value.shape)
            copy = self._started[name] = deepcopy(self._trial)
            copy.reset()
            copy.update(t, Measurement(**{**measurement, name: moved}), self._reference)

    def _check_memory(
        self, t: float, measurement: Measurement, now: FloatArray, torque: FloatArray
    ) -> None:
        """Raise if a copy with the declared memory of the controller makes another update.

        Raises:
            InputError: if it does. A copy that differs by its first readings only is noted.
        """
        assert self._kept is not None
        if not (
            _same(now[: -torque.size], self._kept[0].read()) and _same(now[-torque.size :], torque)
        ):
            raise _undeclared(t)
        for name, copy in self._started.items():
            _memory(copy).write(self._before)
            if not _same(np.ravel(copy.update(t, measurement, self._reference)), torque):
                self.stored.append(name)
        self._started = {}

    def _steps(self, parts: list[FloatArray]) -> FloatArray:
        """Return the steps of the differences, relative to the largest number of each part."""
        sizes = np.array([np.abs(part).max(initial=0.0) for part in parts])
        if sizes.size == self._largest.size:
            sizes = np.maximum(sizes, self._largest)
        self._largest = sizes
        steps = np.where(sizes > 0.0, _SHIFT * sizes, _SMALL)
        return np.repeat(steps, [part.size for part in parts])

    def _unchanged(
        self,
        updated: Callable[[FloatArray], FloatArray],
        point: FloatArray,
        now: FloatArray,
        steps: FloatArray,
    ) -> LinearController | None:
        """Return the last derivatives if they hold in a random direction, otherwise None."""
        if self._last is None:
            return None
        slope = np.block([[self._last.A, self._last.B], [self._last.C, self._last.D]])
        if slope.shape != (now.size, point.size):
            return None
        far = _FAR * steps * self._random.uniform(0.5, 1.0, steps.size)
        rise = 0.5 * (updated(point + far) - updated(point - far))
        terms = np.abs(slope) @ (np.abs(point) + far) + np.abs(now)
        return self._last if np.all(np.abs(rise - slope @ far) <= _ROUNDED * terms) else None

    def _differenced(
        self,
        updated: Callable[[FloatArray], FloatArray],
        point: FloatArray,
        now: FloatArray,
        steps: FloatArray,
        t: float,
    ) -> LinearController:
        """Return derivatives by differences.

        Raises:
            InputError: if the update is not differentiable at ``point``.
        """
        slope = np.zeros((now.size, point.size))
        for k, step in enumerate(steps):
            found = local_slope(updated, point, k, step)
            if found is None:
                if not _same(updated(point), now):
                    raise _undeclared(t)
                given = f"{type(self._controller).__name__}, which is not at t = {t:.6g} s"
                raise InputError(Problem("controller", "be differentiable for a derivative", given))
            slope[:, k] = found
        n, after = self._before.size, now.size - self._joints
        return LinearController(
            slope[:after, :n], slope[:after, n:], slope[after:, :n], slope[after:, n:]
        )


def _undeclared(t: float) -> InputError:
    rule = f"is not supported with derivatives of runs: its update at t = {t:.6g} s depends on more"
    hint = "List all attributes that it keeps between samples in memory."
    return InputError(Problem("controller", f"{rule} than its memory and readings", hint=hint))


def _same(found: FloatArray, wanted: FloatArray) -> bool:
    return bool(np.all(np.abs(found - wanted) <= _SAME * np.abs(wanted).max(initial=0.0)))


def _memory(controller: Any) -> Memory:
    """Return the memory of a controller, with what it has stored of its first readings."""
    return Memory(controller, more=getattr(controller, "start_memory", ()))


def _measured(like: Measurement, numbers: FloatArray) -> Measurement:
    """Return a measurement with other numbers (p,)."""
    values, start = {}, 0
    for name, value in like.items():
        end = start + value.size
        values[name] = numbers[start:end].reshape(value.shape).copy()
        start = end
    return Measurement(**values)
