"""Linearisation of a controller for small deviations: theory page "control-linear"."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from functools import cached_property, reduce
from typing import Any, NamedTuple

import numpy as np

from flexarm.base.errors import InputError, Problem, shown
from flexarm.control.contract.base import Controller, Reference, declares
from flexarm.control.hardware.measurement import FloatArray, Measurement

#: Step of the central differences, relative to the size of a number. The error is about 1e-9 for
#: smooth controllers, and rounding only for linear ones.
_STEP = 1e-5
#: Size of joint rates times the sample time (rad): a joint that turns by 1 rad in 1000 samples.
_RATE = 1e-3
#: Most reductions of a step of the memory that changes a torque more than those of the readings do.
_REDUCTIONS = 8


class LinearController(NamedTuple):
    """Linear controller for small deviations: x+ = A x + B y, u = C x + D y.

    Attributes:
        A, B, C, D: (n, n), (n, p), (joints, n), (joints, p). The state x is the memory of the
            controller, y the measurement, u the torque.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray


class FrozenReference:
    """Constant reference with the angles of another one at a given time, and no acceleration.

    Joint rates are ``rate`` (rad/s), although the angles are constant.
    """

    vectorized = True

    def __init__(self, reference: Any, t: float, rate: float = 0.0) -> None:
        self._reference, self._t, self._rate = reference, t, rate

    @cached_property
    def _angle(self) -> Any:
        return self._reference.joint_angle(self._t)

    def joint_angle(self, t: Any) -> FloatArray:
        """Return the constant joint angles, (joints,) or (T, joints), rad."""
        return _tiled(self._angle, t)

    def joint_rate(self, t: Any) -> FloatArray:
        """Return the joint rates, all equal to ``rate``, rad/s."""
        return 0.0 * self.joint_angle(t) + self._rate

    def joint_acceleration(self, t: Any) -> FloatArray:
        """Return the joint accelerations, zero."""
        return 0.0 * self.joint_angle(t)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        found = getattr(self._reference, name)
        if not callable(found):
            return found
        value = found(self._t)
        return lambda t: _tiled(value, t)


def _tiled(value: Any, t: Any) -> FloatArray:
    value = np.asarray(value, dtype=np.float64)
    return np.array(np.broadcast_to(value, np.shape(t) + value.shape))


class MemoryNameError(InputError):
    """Error in ``memory``: a name is not a numeric attribute of the controller."""


def memory_of(controller: object) -> tuple[str, ...] | None:
    """Return the memory that a controller declares, or None without a declaration.

    See `declares` about derived classes, which may keep other numbers.

    Raises:
        MemoryNameError: if ``memory`` is not a tuple or list of names.
    """
    memory = getattr(controller, "memory", None)
    if memory is None or not declares(controller, "memory"):
        return None
    if not isinstance(memory, tuple | list) or not all(isinstance(name, str) for name in memory):
        hint = 'Write memory = ("name",) for one attribute.'
        raise MemoryNameError(_problem(controller, "be a tuple of names", shown(memory), hint))
    return tuple(memory)


def _problem(controller: object, rule: str, value: str, hint: str = "") -> Problem:
    return Problem(f"{type(controller).__name__}.memory", rule, value, hint)


def linear_controller(
    controller: Controller,
    measured: Mapping[str, FloatArray],
    reference: Reference | None = None,
    t: float = 0.0,
    signals: Mapping[str, Any] | None = None,
) -> LinearController:
    """Linearise a controller about a constant measurement, by central differences.

    A copy of the controller is updated repeatedly at the same time. Each update starts from the
    same memory (``Controller.memory``) and measurement, except for one number that is changed.
    Differences are relative to the size of a number, so that they do not depend on units.

    Args:
        controller: controller that declares its ``memory``; it is not modified.
        measured: the readings by name, in the order of the columns of B and D.
        reference: constant reference, see `FrozenReference`; None for none.
        t: time of all updates, s.
        signals: what the readings measure, by name, if it is not the name. Angles and strains have
            the size one, rates that in 1000 samples, and others that of the largest number of the
            reading. Memory has the size of its change by the readings.

    Raises:
        MemoryNameError: if ``memory`` names something that is not a number or an array.
    """
    mine: Any = deepcopy(controller)
    if hasattr(mine, "_ignore_rate_limit"):
        mine._ignore_rate_limit()
    mine.reset()
    sizes = [np.shape(value) for value in measured.values()]
    ends = np.cumsum([0, *(int(np.prod(size)) for size in sizes)])

    def respond(memory: FloatArray, readings: FloatArray) -> FloatArray:
        kept.write(memory)
        values = {
            name: readings[start:end].reshape(size)
            for name, start, end, size in zip(measured, ends, ends[1:], sizes, strict=False)
        }
        torque = np.asarray(mine.update(t, Measurement(**values), reference), dtype=np.float64)
        return np.concatenate([kept.read(), torque])

    readings = np.concatenate([np.zeros(0), *(np.ravel(value) for value in measured.values())])
    mine.update(t, Measurement(**{k: np.array(v) for k, v in measured.items()}), reference)
    kept = Memory(mine)
    start = kept.read()
    n = start.size
    whole = np.concatenate([start, readings])
    names = {name: name for name in measured} | dict(signals or {})
    scale = np.concatenate(
        [np.zeros(n), *(_sizes(names[k], v, mine.sample_time) for k, v in measured.items())]
    )
    slope = np.zeros((n + respond(start, readings)[n:].size, whole.size))
    waiting, changes = np.flatnonzero(scale), np.zeros_like(scale)
    largest = np.inf  # change of a torque by a reading
    while waiting.size:
        for k in waiting:
            step = _STEP * max(scale[k], abs(whole[k]))
            for _ in range(_REDUCTIONS):
                unit = np.zeros_like(whole)
                unit[k] = step
                more, less = whole + unit, whole - unit
                rise = respond(more[:n], more[n:]) - respond(less[:n], less[n:])
                slope[:, k] = rise / (2.0 * step)
                changes[k] = np.abs(rise[n:]).max(initial=0.0)
                if not changes[k] > largest:
                    break
                step *= 0.1
        # Memory after a fast filter would request torques beyond the limits of the controller.
        largest = float(changes[n:].max(initial=0.0)) or np.inf
        left = np.flatnonzero(scale == 0.0)
        changed = np.abs(slope[left]) @ scale
        # No reading reaches the rest, so that its size does not matter for the loop.
        scale[left] = changed if np.any(changed) else 1.0
        waiting = left[scale[left] > 0.0]
    return LinearController(slope[:n, :n], slope[:n, n:], slope[n:, :n], slope[n:, n:])


def _sizes(signal: Any, value: FloatArray, sample_time: float) -> FloatArray:
    """Return the sizes (k,) of the numbers of a reading, see `linear_controller`."""
    size = 1.0
    if isinstance(signal, str) and signal.endswith("_rate"):
        size = _RATE / sample_time
    elif signal not in ("joint_angle", "strain"):
        # Laws are linear about a force or torque of zero, so that any size is good.
        size = float(np.abs(value).max(initial=0.0)) or 1.0
    return np.full(np.size(value), size)


class Memory:
    """Memory of a controller between samples, as one vector.

    Args:
        controller: controller that declares its ``memory``, after an update.
        kinds: allowed kinds of NumPy's number types. Truth values that they do not include are
            left out, because they cannot be differentiated.
        more: attributes beside the declared ones.

    Raises:
        MemoryNameError: if ``memory`` names something that is not a number or an array.
    """

    def __init__(self, controller: Any, kinds: str = "iuf", more: Sequence[str] = ()) -> None:
        self._places = []
        for path in (*(memory_of(controller) or ()), *more):
            *owners, name = path.split(".")
            try:
                owner = reduce(getattr, owners, controller)
                value = getattr(owner, name)
            except AttributeError:
                hint = f"There is no attribute {path!r} after the first update."
                rule = "name attributes of the controller"
                raise MemoryNameError(_problem(controller, rule, shown(path), hint)) from None
            kind = np.asarray(value).dtype.kind
            # An unused attribute has no state.
            if value is None or (kind == "b" and kind not in kinds):
                continue
            if kind not in kinds:
                rule = f"name numbers and arrays; {path!r} is neither"
                raise MemoryNameError(_problem(controller, rule, shown(value)))
            self._places.append((owner, name, np.shape(value)))

    @property
    def shapes(self) -> list[tuple[str, tuple[int, ...]]]:
        """Names of the attributes, without their owners, and their shapes."""
        return [(name, shape) for _, name, shape in self._places]

    def read(self) -> FloatArray:
        """Return the numbers (n,)."""
        values = [np.ravel(getattr(owner, name)) for owner, name, _ in self._places]
        return np.concatenate([np.zeros(0), *values])

    def write(self, numbers: FloatArray) -> None:
        """Write the numbers (n,) to the controller."""
        start = 0
        for owner, name, shape in self._places:
            end = start + int(np.prod(shape))
            value = numbers[start:end].reshape(shape).copy()
            setattr(owner, name, value if shape else value.item())
            start = end
