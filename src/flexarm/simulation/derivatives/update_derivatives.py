"""Derivatives of the steps of a controller along a run, by its memory and its readings.

Those of a law that accepts complex numbers are exact. Central differences of order 8 differentiate
other laws: for smooth ones their error is 1e-12. Differences of order 6 estimate it, so that a law
that is not smooth is rejected.
"""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np

from flexarm.base.errors import InputError, Problem
from flexarm.control.analysis.linear_controller import LinearController, StepMap
from flexarm.control.contract.base import Reference, Rest, has_poles
from flexarm.control.hardware.measurement import FloatArray, Measurement
from flexarm.simulation.derivatives.differences import local_slopes

#: First step of the differences, relative to the largest number of a reading or of the memory, and
#: the step of numbers that have all been zero. They are no multiple of a resolution, at which a law
#: that rounds would seem to be linear.
_SHIFT, _SMALL = 0.01 * 0.95**0.5, 1e-3 * 0.95**0.5
#: Relative difference of two updates with the same memory and readings that is rounding.
_SAME = 1e-9


class UpdateDerivatives:
    """Derivatives of the updates of a controller, computed in the order of the updates.

    Attributes:
        stored: names of first readings on which planned inputs depend, without a reference.

    Raises:
        InputError: if the controller has no ``step`` that can be linearised.
    """

    def __init__(self, controller: Any, reference: Reference | None) -> None:
        if not has_poles(controller):
            rule = "have a step that can be linearised, for derivatives of runs"
            hint = "Write step instead of update; see the page on your own controllers."
            raise InputError(Problem("controller", rule, type(controller).__name__, hint))
        self.stored: list[str] = []
        self._controller, self._reference = controller, reference
        self._before: Any = None
        self._rests = False
        self._largest = np.zeros(0)
        self._last: LinearController | None = None
        self._slope = np.zeros((0, 0))  # the same derivatives in one matrix

    def remember(self) -> None:
        """Store the memory of the controller before its next update."""
        self._before = self._controller.memory if self._last is not None else None

    def after(self, t: float, measurement: Measurement, torque: FloatArray) -> LinearController:
        """Return the derivatives of the update that the controller has just made at t (s).

        Raises:
            InputError: if the update is not differentiable, or not a pure step.
        """
        law = self._controller
        inputs = law.planned(t, law._reference_or_rest(measurement, self._reference))
        if self._last is None and self._reference is None:
            self._rests = self._follows_rest(t, measurement)
        step = StepMap(law, self._before, measurement, inputs, self._rests)
        now, again = step(np.array([step.point, step.point]))
        if not (_same(now[-torque.size :], torque) and _same(again, now)):
            rule = f"is not supported with derivatives of runs: its step at t = {t:.6g} s depends"
            hint = "A step changes no attributes; see flexarm.Controller."
            rule += " on more than its memory, readings and inputs"
            raise InputError(Problem("controller", rule, hint=hint))
        slope = step.slope() if step.analytic else self._differenced(step, measurement, t)
        if self._last is None or not np.array_equal(slope, self._slope):
            self._slope, self._last = slope, step.linear(slope)
        return self._last

    def _follows_rest(self, t: float, measurement: Measurement) -> bool:
        """Return whether inputs contain the first measured angles; note if others do."""
        planned = []
        for shift in (0.0, _SMALL):
            law = deepcopy(self._controller)
            law.reset()
            moved = {name: value + shift for name, value in measurement.items()}
            planned.append(law.planned(t, Rest(moved)))
        first, other = planned
        changed = {name for name in first if not np.array_equal(first[name], other[name])}
        self.stored = ["joint_angle"] if changed - {"reference_angle"} else []
        return changed == {"reference_angle"}

    def _differenced(self, step: StepMap, measurement: Measurement, t: float) -> FloatArray:
        """Return derivatives by differences, infinite ones at corners.

        Raises:
            InputError: if the step is not differentiable at its point.
        """
        readings = [np.ravel(value) for value in measurement.values()]
        before = step.point[: step.point.size - sum(part.size for part in readings)]
        parts = [*([before] if before.size else []), *readings]
        sizes = np.array([np.abs(part).max(initial=0.0) for part in parts])
        if sizes.size == self._largest.size:
            sizes = np.maximum(sizes, self._largest)
        self._largest = sizes
        steps = np.where(sizes > 0.0, _SHIFT * sizes, _SMALL)
        slope = local_slopes(step, step.point, np.repeat(steps, [part.size for part in parts])).T
        if np.any(np.isnan(slope)):
            raise not_differentiable(self._controller, t)
        return slope


def is_finite(update: LinearController) -> bool:
    """Return whether an update has no corner where it was differentiated."""
    return all(bool(np.all(np.isfinite(matrix))) for matrix in update)


def not_differentiable(controller: Any, t: float) -> InputError:
    """Return the error of a controller whose update at t (s) has no derivative."""
    given = f"{type(controller).__name__}, which is not at t = {t:.6g} s"
    return InputError(Problem("controller", "be differentiable for a derivative", given))


def _same(found: FloatArray, wanted: FloatArray) -> bool:
    return bool(np.all(np.abs(found - wanted) <= _SAME * np.abs(wanted).max(initial=0.0)))
