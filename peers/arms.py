"""The motions that are compared: the only input of every program."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

#: When the motors are switched off, s.
TORQUE_ENDS = 1.0


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
    #: Joint torques' amplitudes, N m: a sine of 1 Hz for one second, then nothing. Each acts on its
    #: link and back on the tip of the one before.
    amplitude: tuple[float, ...]
    #: Samples of the tip per second, Hz; every step of every program divides the time between two.
    rate: int = 1000

    def wave(self, t: float) -> float:
        """Return the share of their amplitude that the torques have at a time."""
        return math.sin(2.0 * math.pi * t) if t <= TORQUE_ENDS else 0.0

    def torque(self, t: float) -> tuple[float, ...]:
        """Return the joint torques at a time, N m."""
        wave = self.wave(t)
        return tuple(value * wave for value in self.amplitude)

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times where the torque is not smooth, s."""
        return (TORQUE_ENDS,) if any(self.amplitude) else ()

    @property
    def samples(self) -> int:
        """Number of samples, the start included."""
        return round(self.duration * self.rate) + 1

    @property
    def joint_angles(self) -> tuple[float, ...]:
        """Angle of each link from the one before."""
        return tuple(float(angle) for angle in np.diff(self.start, prepend=0.0))


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
    amplitude=(4.0, 1.5),
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
    amplitude=(0.0,),
)


def steps_per_sample(case: Case, step: float) -> int:
    """Return how many steps of ``step`` seconds lead from one sample to the next."""
    count = round(1.0 / (case.rate * step))
    if not math.isclose(count * step * case.rate, 1.0, rel_tol=1e-9):
        raise ValueError(f"step must divide {1.0 / case.rate} s, but is {step}.")
    return count


def distance(one: np.ndarray, other: np.ndarray) -> float:
    """Return the largest distance between two tip paths (samples, 2), in metres."""
    return float(np.max(np.linalg.norm(one - other, axis=1)))
