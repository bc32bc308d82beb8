"""Feedback of a full state by constant gains, the law of many published controllers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

import flexarm as fa

if TYPE_CHECKING:
    import xarray as xr


class StateFeedback(fa.Controller):
    """Torque of one joint: a constant minus gains times signals, both in the unit of the torque.

    Args:
        signals: names of the measured signals, one number each.
        gains: one for each signal.
        constant: torque at zero signals (N m).
        sample_time: s.
    """

    def __init__(
        self, signals: Sequence[str], gains: Sequence[float], constant: float, sample_time: float
    ) -> None:
        self.signals, self.gains = tuple(signals), np.asarray(gains, dtype=float)
        self.constant, self.sample_time = constant, sample_time

    def requirements(self, arm: Any, reference: Any) -> fa.ControllerRequirements:
        return fa.ControllerRequirements(joints=1, measured=self.signals)

    def step(self, memory: Any, readings: Any, inputs: Any) -> tuple[Any, Any]:
        torque = self.constant
        for gain, signal in zip(self.gains, self.signals, strict=True):
            torque = torque - gain * readings[signal]
        return memory, torque

    def run(self, arm: fa.Arm, duration: float, rate: float) -> xr.Dataset:
        """Simulate an arm of one joint from rest at zero, with ideal instruments."""
        instruments = [fa.Instrument(signal) for signal in self.signals]
        hardware = fa.Hardware(instruments=instruments)
        return fa.simulate(arm, duration, controller=self, hardware=hardware, rate=rate)
