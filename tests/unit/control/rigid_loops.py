"""Rigid arms for tests of controllers whose theory has no bending."""

import numpy as np

import flexarm as fa
from arms import chain


def rigid_arm(payload=0.0, **options):
    """Return two rigid links, which hang under gravity by default."""
    joints = [0.05, {"hub_inertia": 0.03, "mass": 0.2}]
    options = {"joints": joints, "gravity": (0.0, -9.81), **options}
    bars = {"mass_per_length": [1.0, 0.8], "flexible": False}
    return chain((0.8, 0.6), payload=fa.Payload(mass=payload), **bars, **options)


class Swing:
    """A reference without an end, in which each joint swings at two frequencies."""

    amplitude = np.array([[0.5, 0.3], [0.4, 0.5]])
    frequency = np.array([[1.7, 4.1], [2.9, 5.3]])  # rad/s, joints by terms

    def _terms(self, t, level):
        phase = self.frequency * t + level * np.pi / 2
        return np.sum(self.amplitude * self.frequency**level * np.sin(phase), axis=1)

    def joint_angle(self, t):
        return self._terms(t, 0)

    def joint_rate(self, t):
        return self._terms(t, 1)

    def joint_acceleration(self, t):
        return self._terms(t, 2)


def errors(result, reference):
    """Return angle and rate errors (samples, joints) of a run, at its recorded times."""
    times = result.time.values
    angle = np.array([reference.joint_angle(t) for t in times])
    rate = np.array([reference.joint_rate(t) for t in times])
    return result.joint_angle.values - angle, result.joint_rate.values - rate
