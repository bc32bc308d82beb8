"""Derivatives of the updates of a controller along a run, by its memory and its readings.

An update maps the memory and the readings to the next memory and the torque. Central differences
of order 8 differentiate it: for linear laws their error is rounding only, and for smooth laws it is
1e-12. Differences of order 6 estimate it, so that a law that is not smooth is rejected. A linear
law has the same derivatives at each update, which a first and a second difference in a random
direction verify.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Any

import numpy as np

from flexarm.base.errors import InputError, Problem
from flexarm.control.analysis.linear_controller import LinearController, Memory, memory_of
from flexarm.control.contract.base import Reference
from flexarm.control.hardware.measurement import FloatArray, Measurement
from flexarm.simulation.derivatives.differences import local_slopes

#: First step of the differences, relative to the largest number of a reading or of the memory, and
#: the step of numbers that have all been zero. They are no multiple of a resolution, at which a law
#: that rounds would seem to be linear.
_SHIFT, _SMALL = 0.01 * 0.95**0.5, 1e-3 * 0.95**0.5
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
        self._slope = np.zeros((0, 0))  # the same derivatives in one matrix
        self._vectorized = bool(getattr(controller, "vectorized", False))
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
        readings = [np.ravel(value) for value in measurement.values()]
        point = np.concatenate([self._before, *readings])
        parts = [*([self._before] if self._before.size else []), *readings]

        def updated(points: FloatArray) -> FloatArray:
            return self._responses(t, points, measurement)

        steps = self._steps(parts)
        if first:
            self._start_elsewhere(t, measurement)
            found = self._differenced(updated, point, steps, t)
            updated(point[None])  # leave the trial where the controller is
            self._kept = _memory(self._controller), _memory(self._trial)
        else:
            found = self._checked(updated, point, steps, t, torque)
            self._note_stored(t, measurement, torque)
        self._last = found
        return found

    def _responses(self, t: float, points: FloatArray, like: Measurement) -> FloatArray:
        """Return memory and torque after updates with memory and readings (p, n + k)."""
        n, kept = self._before.size, None if self._kept is None else self._kept[1]
        if self._vectorized and kept is not None and kept.read().size == 0:
            return np.asarray(self._trial.update(t, _measured(like, points), self._reference))
        found = []
        for x in points:
            if kept is None:
                self._trial.reset()
            else:
                kept.write(x[:n])
            torque = self._trial.update(t, _measured(like, x[n:]), self._reference)
            memory = _memory(self._trial) if kept is None else kept
            found.append(np.concatenate([memory.read(), np.ravel(torque)]))
        return np.array(found)

    def _start_elsewhere(self, t: float, measurement: Measurement) -> None:
        """Update a copy of the controller for each reading, with another first one."""
        for name, value in measurement.items():
            moved = value + _SMALL * self._random.uniform(0.5, 1.0, value.shape)
            copy = self._started[name] = deepcopy(self._trial)
            copy.reset()
            copy.update(t, Measurement(**{**measurement, name: moved}), self._reference)

    def _note_stored(self, t: float, measurement: Measurement, torque: FloatArray) -> None:
        """Note the first readings that copies with the same memory depend on."""
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

    def _checked(
        self,
        updated: Callable[[FloatArray], FloatArray],
        point: FloatArray,
        steps: FloatArray,
        t: float,
        torque: FloatArray,
    ) -> LinearController:
        """Return the last derivatives if they hold in a random direction, otherwise new ones.

        Raises:
            InputError: if the update is not differentiable, or depends on undeclared memory.
        """
        assert self._kept is not None
        far = _FAR * steps * self._random.uniform(0.5, 1.0, steps.size)
        now, ahead, behind = updated(np.array([point, point + far, point - far]))
        joints = self._joints
        if not (_same(now[:-joints], self._kept[0].read()) and _same(now[-joints:], torque)):
            raise _undeclared(t)
        last = self._last
        if last is not None and last.C.shape[1] == self._before.size and is_finite(last):
            slope = self._slope
            rounded = _ROUNDED * (np.abs(slope) @ (np.abs(point) + far) + np.abs(now))
            odd, even = 0.5 * (ahead - behind) - slope @ far, 0.5 * (ahead + behind) - now
            if np.all(np.abs(odd) <= rounded) and np.all(np.abs(even) <= rounded):
                return last
        return self._differenced(updated, point, steps, t)

    def _differenced(
        self,
        updated: Callable[[FloatArray], FloatArray],
        point: FloatArray,
        steps: FloatArray,
        t: float,
    ) -> LinearController:
        """Return derivatives by differences, infinite ones at corners.

        Raises:
            InputError: if the update is not differentiable at ``point``.
        """
        slope = local_slopes(updated, point, steps).T
        if np.any(np.isnan(slope)):
            if not _same(*updated(np.array([point, point]))):
                raise _undeclared(t)
            raise not_differentiable(self._controller, t)
        self._slope = slope
        n, after = self._before.size, len(slope) - self._joints
        return LinearController(
            slope[:after, :n], slope[:after, n:], slope[after:, :n], slope[after:, n:]
        )


def is_finite(update: LinearController) -> bool:
    """Return whether an update has no corner where it was differentiated."""
    return all(bool(np.all(np.isfinite(matrix))) for matrix in update)


def not_differentiable(controller: Any, t: float) -> InputError:
    """Return the error of a controller whose update at t (s) has no derivative."""
    given = f"{type(controller).__name__}, which is not at t = {t:.6g} s"
    return InputError(Problem("controller", "be differentiable for a derivative", given))


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
    """Return a measurement with other numbers (k,), or several with (p, k)."""
    values, start = {}, 0
    for name, value in like.items():
        end = start + value.size
        values[name] = numbers[..., start:end].reshape(*numbers.shape[:-1], *value.shape).copy()
        start = end
    return Measurement(**values)
