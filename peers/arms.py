"""The motions that are compared: what every program is told, and nothing else."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

#: Samples of the tip per second, Hz; every step of every program divides the time between two.
RATE = 1000


@dataclass(frozen=True)
class Case:
    """A planar arm of equal section, straight and at rest at first, and what moves it. SI units."""

    name: str
    lengths: tuple[float, ...]
    flexural_rigidity: float
    axial_rigidity: float  # for programs whose beams stretch: enough not to count
    mass_per_length: float
    start: tuple[float, ...]  # angle of each link from world x
    gravity: float  # along -y
    duration: float
    segments: int  # what flexarm takes for each link, to be within 6e-6 m of the limit of many
    #: Joint torques at a time, each acting on its link and back on the tip of the one before.
    torque: Callable[[float], tuple[float, ...]]
    #: Times where the torque is not smooth.
    breaks: tuple[float, ...] = ()

    @property
    def samples(self) -> int:
        """Number of samples, the start included."""
        return round(self.duration * RATE) + 1

    @property
    def joint_angles(self) -> tuple[float, ...]:
        """Angle of each link from the one before."""
        return tuple(float(angle) for angle in np.diff(self.start, prepend=0.0))


def _sine_for_a_second(t: float) -> tuple[float, float]:
    wave = math.sin(2.0 * math.pi * t) if t <= 1.0 else 0.0
    return 4.0 * wave, 1.5 * wave


#: The arm of the paper's Table I in a horizontal plane, both motors driven by one sine wave.
TABLE_ONE = Case(
    name="Table I arm",
    lengths=(1.4142, 1.0),
    flexural_rigidity=105.0,
    axial_rigidity=1.68e7,  # of a steel rod with this mass
    mass_per_length=0.61732,
    start=(math.pi / 4, -math.pi / 4),
    gravity=0.0,
    duration=2.0,
    segments=8,
    torque=_sine_for_a_second,
    breaks=(1.0,),
)

#: A soft pendulum released from the horizontal; its tip bends away by a fifth of its length.
PENDULUM = Case(
    name="flexible pendulum",
    lengths=(1.0,),
    flexural_rigidity=2.0,
    axial_rigidity=2e6,
    mass_per_length=0.2,
    start=(0.0,),
    gravity=9.81,
    duration=0.8,
    segments=16,
    torque=lambda t: (0.0,),
)


def steps_per_sample(step: float) -> int:
    """Return how many steps of ``step`` seconds lead from one sample to the next."""
    count = round(1.0 / (RATE * step))
    if not math.isclose(count * step * RATE, 1.0, rel_tol=1e-9):
        raise ValueError(f"step must divide {1.0 / RATE} s, but is {step}.")
    return count


def distance(one: np.ndarray, other: np.ndarray) -> float:
    """Return the largest distance between two tip paths (samples, 2), in metres."""
    return float(np.max(np.linalg.norm(one - other, axis=1)))
