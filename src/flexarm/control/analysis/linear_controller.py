"""Linearisation of a controller for small deviations: theory page "control-linear"."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.control.contract.base import (
    Arrays,
    Controller,
    Reference,
    Rest,
    around,
    declares,
)
from flexarm.control.design.arm_scales import joint_sizes
from flexarm.control.hardware.measurement import FloatArray, Measurement

#: Step of the central differences of laws that do not accept complex numbers, relative to the size
#: of a number. The error is about 1e-9 for smooth laws. Imaginary step of the others, exact.
_STEP, _TINY = 1e-5, 1e-30
#: Size of joint rates times the sample time (rad): a joint that turns by 1 rad in 1000 samples,
#: or slides by the reach.
_RATE = 1e-3
#: Most reductions of a step of the memory that changes a torque more than those of the readings do.
_REDUCTIONS = 8
#: Name of the first measured angles among the numbers of a memory.
_REST = "rest"


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


def linear_controller(
    controller: Controller,
    measured: Mapping[str, FloatArray],
    reference: Reference | None = None,
    t: float = 0.0,
    signals: Mapping[str, Any] | None = None,
) -> LinearController:
    """Linearise a law about a constant measurement, after a first sample with it.

    Differences are relative to the size of a number, so that they do not depend on units.
    """
    law = deepcopy(controller)
    law.reset()
    readings = Measurement(**{name: np.array(value) for name, value in measured.items()})
    inputs = law.planned(t, Rest(readings) if reference is None else reference)
    nominal, limit = inputs.get("nominal_torque"), getattr(law, "torque_limit", None)
    if nominal is not None and limit is not None and np.all(np.abs(nominal) < limit):
        # Away from the posture of its design, a law requests more until the links have sagged.
        vars(law)["torque_limit"] = np.full(np.shape(limit), np.inf)
    memory, _ = law.step(law.initial_memory(readings, inputs), readings, inputs)
    step = StepMap(law, memory, readings, inputs)
    if step.analytic:
        return step.linear(step.slope())
    kinds = dict(signals or {})
    arms = [getattr(item, "arm", None) for item in around(law)]
    joints = next((joint_sizes(arm) for arm in arms if isinstance(arm, Arm)), 1.0)
    times = law.sample_time
    sizes = [_sizes(kinds.get(k, k), value, times, joints) for k, value in readings.items()]
    return step.linear(_differences(step, np.concatenate([np.zeros(0), *sizes])))


def _sizes(
    signal: Any, value: FloatArray, sample_time: float, joints: float | FloatArray
) -> FloatArray:
    """Return the sizes (k,) of the numbers of a reading, see `linear_controller`.

    ``joints``: `joint_sizes` of the arm of the controller.
    """
    size = joints if signal in ("joint_angle", "joint_rate") else 1.0
    if isinstance(signal, str) and signal.endswith("_rate"):
        size = _RATE / sample_time * size
    elif signal not in ("joint_angle", "strain"):
        # Laws are linear about a force or torque of zero, so that any size is good.
        size = float(np.abs(value).max(initial=0.0)) or 1.0
    return np.broadcast_to(size, np.size(value)).astype(np.float64)


def _differences(step: StepMap, sizes: FloatArray) -> FloatArray:
    """Return the derivatives (m, n) of a step, for readings of these sizes."""
    point = step.point
    n = point.size - sizes.size
    scale = np.concatenate([np.zeros(n), sizes])
    values = step(point[None])[0]
    slope, change = np.zeros((values.size, point.size)), np.zeros(point.size)
    waiting, largest = np.flatnonzero(scale), np.inf  # largest: change of a torque by a reading
    while waiting.size:
        shift = _STEP * np.maximum(scale, np.abs(point))
        moving = waiting
        for _ in range(_REDUCTIONS):
            shifts = np.diag(shift)[moving]
            rise = step(point + shifts) - step(point - shifts)
            slope[:, moving] = rise.T / (2.0 * shift[moving])
            change[moving] = np.abs(rise[:, n:]).max(axis=1, initial=0.0)
            moving = moving[change[moving] > largest]
            if not moving.size:
                break
            shift[moving] *= 0.1
        # Memory after a fast filter would request torques beyond the limits of the controller.
        largest = float(change[n:].max(initial=0.0)) or np.inf
        rest = np.flatnonzero(scale == 0.0)
        changed = np.abs(slope[rest]) @ scale
        # No reading reaches the rest, so that its size does not matter for the loop.
        scale[rest] = changed if np.any(changed) else 1.0
        waiting = rest[scale[rest] > 0.0]
    return slope


class StepMap:
    """Step of a law as a function of numbers: its memory and the readings.

    A point is [memory, readings]; its value is [memory after the step, torques]. Numbers of the
    memory that are no floats are constant.

    Args:
        law: the law. memory: before the step; None for the first step, which begins with the
            initial memory of the readings.
        readings, inputs: of the sample.
        rests: whether the first measured joint angles are the ``reference_angle`` among the inputs;
            they are then the last numbers of the memory.

    Attributes:
        point: the numbers of memory and readings. analytic: whether ``slope`` is possible.
    """

    def __init__(
        self,
        law: Controller,
        memory: Arrays | None,
        readings: Measurement,
        inputs: Arrays,
        rests: bool = False,
    ) -> None:
        self._law, self._memory, self._inputs, self._rests = law, memory, inputs, rests
        self._together, self.analytic = declares(law, "vectorized"), declares(law, "analytic")
        before = _floats(memory or {})
        if rests and memory is not None:
            before[_REST] = inputs["reference_angle"]
        self._kinds = {name: np.shape(value) for name, value in before.items()}
        self._readings = {name: np.shape(value) for name, value in readings.items()}
        self._count = sum(np.size(value) for value in before.values())
        parts = [np.ravel(value) for value in (*before.values(), *readings.values())]
        self.point = np.concatenate([np.zeros(0), *parts])

    def __call__(self, points: Any) -> Any:
        """Return the values (p, m) at points (p, n)."""
        if self._together and len(points):
            return self._at(points)
        return np.array([self._at(point) for point in points])

    def slope(self) -> FloatArray:
        """Return the derivatives (m, n) at the point, exact to rounding, by complex numbers."""
        values = self(self.point + _TINY * 1j * np.eye(self.point.size))
        return np.asarray(values.imag.T / _TINY)

    def linear(self, slope: FloatArray) -> LinearController:
        """Return derivatives (m, n) as matrices."""
        n, after = self._count, len(slope) - self._joints
        rows = slope[:after], slope[after:]
        return LinearController(*(part for row in rows for part in (row[:, :n], row[:, n:])))

    def _at(self, x: Any) -> Any:
        """Return the values at a point (n,), or at many (p, n) in one call of the law."""
        runs, inputs = x.shape[:-1], self._inputs
        readings = Measurement(**_split(x[..., self._count :], self._readings))
        memory = _split(x[..., : self._count], self._kinds)
        if self._rests:
            rest = readings.joint_angle if self._memory is None else memory.pop(_REST)
            inputs = {**inputs, "reference_angle": rest}
        if self._memory is None:
            memory = dict(self._law.initial_memory(readings, inputs))
        after, torque = self._law.step({**(self._memory or {}), **memory}, readings, inputs)
        torque = np.asarray(torque)
        self._joints = torque.shape[-1]
        parts = [np.reshape(value, (*runs, -1)) for value in _floats(after).values()]
        parts += [rest] if self._rests else []
        return np.concatenate([*parts, np.broadcast_to(torque, (*runs, self._joints))], axis=-1)


def _floats(memory: Arrays) -> dict[str, Any]:
    """Return the numbers of a memory that are differentiated."""
    return {
        name: value
        for name, value in memory.items()
        if np.asarray(value).dtype.kind in "fc" and not name.rpartition(".")[2].startswith("_")
    }


def _split(numbers: Any, shapes: Mapping[str, tuple[int, ...]]) -> dict[str, Any]:
    """Return numbers (..., n) as named arrays of given shapes."""
    arrays, start, runs = {}, 0, numbers.shape[:-1]
    for name, shape in shapes.items():
        end = start + int(np.prod(shape))
        arrays[name] = numbers[..., start:end].reshape((*runs, *shape))[()]
        start = end
    return arrays
