"""What an agent sees, as one vector: readings of instruments, then what the task adds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from flexarm.arm import Arm
from flexarm.hardware.instruments import Instrument
from flexarm.hardware.measurement import Measurement

FloatArray = NDArray[np.float64]
Vector = NDArray[np.float32]

#: Bounds that a working arm stays far within; what goes beyond is cut: rad/s, and 1e-3.
_MOST_RATE, _MOST_STRAIN = 50.0, 10.0
#: Largest force of a contact that is seen, N.
MOST_FORCE = 100.0
#: A bent arm of the linear theory reaches a little farther than a straight one.
_STRETCH = 1.2


@dataclass(frozen=True)
class Part:
    """Some components of the vector.

    Attributes:
        name: of all of them. unit: of all of them. size: how many.
        bound: largest value, either way. axes: whether they are x and y, not counted from 1.
    """

    name: str
    unit: str
    size: int
    bound: float
    axes: bool = False

    @property
    def names(self) -> list[str]:
        """Name and unit of each component, as linear models name their signals."""
        ends = ("x", "y") if self.axes else range(1, self.size + 1)
        return [f"{self.name}[{end}] ({self.unit})" for end in ends]


class Observation:
    """Layout of the vector, and its making.

    Joint angles are seen as cosine and sine: an angle and the same angle a turn on are one posture.
    Strains are seen in thousandths, so that no component is tiny beside the others.

    Args:
        arm: whose lengths bound positions.
        instruments: what is measured. example: a measurement of theirs.
        task: what the task adds.
    """

    def __init__(
        self,
        arm: Arm,
        instruments: Sequence[Instrument],
        example: Measurement,
        task: Sequence[Part],
    ) -> None:
        self._signals = {label: signal for item in instruments for label, signal in _named(item)}
        reach = reach_of(arm)
        limits = {item.label: float(item.limit) for item in instruments}
        self.parts: list[Part] = []
        for label, value in example.items():
            size, signal = value.size, self._signals[label]
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
        self._bound = np.concatenate([np.full(part.size, part.bound) for part in self.parts])
        bound = self._bound.astype(np.float32)
        self.space = Box(-bound, bound, dtype=np.float32)

    @property
    def names(self) -> list[str]:
        """Name of each component, with its unit: ``tip[x] (m)``."""
        return [name for part in self.parts for name in part.names]

    def vector(self, measurement: Measurement, task: FloatArray) -> Vector:
        """Return what the agent sees, within the bounds of the space."""
        values = []
        for label, value in measurement.items():
            signal = self._signals[label]
            if signal == "joint_angle":
                values += [np.cos(value), np.sin(value)]
            else:
                values.append(1e3 * value if signal == "strain" else value.ravel())
        seen = np.concatenate([*values, task])
        # Rounding to single precision must not carry a value over its bound.
        return np.clip(seen.astype(np.float32), self.space.low, self.space.high)


def exact_instruments(arm: Arm, extra: Sequence[str] = ()) -> list[Instrument]:
    """Return instruments without error, of all that an agent may want to know; and of ``extra``."""
    strain = ["strain"] if arm.gauges else []
    signals = ["joint_angle", "joint_rate", *strain, "tip", "tip_velocity", *extra]
    return [Instrument(signal) for signal in signals]


def reach_of(arm: Arm) -> float:
    """Return the length (m) of the straight arm."""
    return float(np.sum(arm.lengths))


def _named(item: Instrument) -> list[tuple[str, object]]:
    """Names in the measurement with the signal of each; a rate is one like any other."""
    rate = {"joint_angle": "joint_rate", "tip": "tip_velocity"}
    signals = [item.signal, rate.get(str(item.signal), "")]
    return list(zip(item.labels, signals, strict=False))
