"""Observation vector of an environment: readings of instruments and values of the task."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.control.hardware.measurement import Measurement
from flexarm.model import Instrument

FloatArray = NDArray[np.float64]
Vector = NDArray[np.float32]

#: Bounds far above the values of a working arm, for clipping: rad/s, and strain in 1e-3.
_MOST_RATE, _MOST_STRAIN = 50.0, 10.0
#: Largest contact force in an observation, N.
MOST_FORCE = 100.0
#: Limit on the ratio of tip distance to reach, which exceeds 1 for a bent arm in the linear theory.
_STRETCH = 1.2


@dataclass(frozen=True)
class Part:
    """Group of components of the observation vector.

    Attributes:
        name: common name of the components.
        unit: common unit of the components.
        size: number of components.
        bound: largest magnitude.
        axes: whether the components are x and y, instead of numbers from 1.
    """

    name: str
    unit: str
    size: int
    bound: float
    axes: bool = False

    @property
    def names(self) -> list[str]:
        """Names of the components with units, in the form of the signals of linear models."""
        ends = ("x", "y") if self.axes else range(1, self.size + 1)
        return [f"{self.name}[{end}] ({self.unit})" for end in ends]


class Observation:
    """Layout of the observation vector, and conversion of measurements to it.

    A joint angle appears as cosine and sine, because angles that differ by a full turn are the same
    posture. Strains are in units of 1e-3, so that the components have similar magnitudes.

    Args:
        arm: arm whose lengths limit positions.
        instruments: instruments of the measurements.
        example: a measurement of these instruments.
        task: components of the task.
    """

    def __init__(
        self,
        arm: Arm,
        instruments: Sequence[Instrument],
        example: Measurement,
        task: Sequence[Part],
    ) -> None:
        signals = {label: signal for item in instruments for label, signal in _named(item)}
        reach = reach_of(arm)
        limits = {item.label: float(item.limit) for item in instruments}
        self.parts: list[Part] = []
        self._signals = [(label, signals[label]) for label in example]
        for label, value in example.items():
            size, signal = value.size, signals[label]
            if signal == "joint_angle":
                self.parts += [Part(f"{f} {label}", "1", size, 1.0) for f in ("cos", "sin")]
            elif signal == "joint_rate":
                self.parts.append(Part(label, "rad/s", size, _MOST_RATE))
            elif signal == "strain":
                self.parts.append(Part(label, "1e-3", size, _MOST_STRAIN))
            elif signal == "tip":
                self.parts.append(Part(label, "m", size, _STRETCH * reach, axes=True))
            elif signal == "tip_velocity":
                self.parts.append(Part(label, "m/s", size, _MOST_RATE * reach, axes=True))
            elif signal == "contact_force":
                self.parts.append(Part(label, "N", size, MOST_FORCE, axes=True))
            else:
                self.parts.append(Part(label, "SI", size, limits.get(label, np.inf)))
        self.parts += task
        bounds = np.concatenate([np.full(part.size, part.bound) for part in self.parts])
        self._most = bounds.astype(np.float32)
        self._least = -self._most
        self.space = Box(self._least, self._most, dtype=np.float32)

    @property
    def names(self) -> list[str]:
        """Names of the components with units, such as ``tip[x] (m)``."""
        return [name for part in self.parts for name in part.names]

    def vector(self, measurement: Mapping[str, FloatArray], task: FloatArray) -> Vector:
        """Return the observation (..., size), clipped to the bounds of the space."""
        values = []
        for label, signal in self._signals:
            value = measurement[label]
            if value.ndim != task.ndim:
                value = value.reshape(*task.shape[:-1], -1)
            if signal == "joint_angle":
                values.append(np.cos(value))
                values.append(np.sin(value))
            else:
                values.append(1e3 * value if signal == "strain" else value)
        values.append(task)
        seen = np.concatenate(values, axis=-1, dtype=np.float32, casting="same_kind")
        # Clip after the conversion, because rounding to single precision may exceed a bound.
        np.minimum(seen, self._most, out=seen)
        return np.maximum(seen, self._least, out=seen)


def exact_instruments(arm: Arm, extra: Sequence[str] = ()) -> list[Instrument]:
    """Return exact instruments of the joints, strain, tip and the signals ``extra``."""
    strain = ["strain"] if arm.gauges else []
    signals = ["joint_angle", "joint_rate", *strain, "tip", "tip_velocity", *extra]
    return [Instrument(signal=signal) for signal in signals]


def reach_of(arm: Arm) -> float:
    """Return the length (m) of the straight arm."""
    return float(np.sum(arm.lengths))


def _named(item: Instrument) -> list[tuple[str, object]]:
    """Return the names of an instrument in measurements, each with its signal."""
    rate = {"joint_angle": "joint_rate", "tip": "tip_velocity"}
    signals = [item.signal, rate.get(str(item.signal), "")]
    return list(zip(item.labels, signals, strict=False))
