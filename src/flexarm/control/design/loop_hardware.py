"""Motors and instruments in the model of a design: theory page "control-linear", section 5."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flexarm.base.errors import InputError, Problem
from flexarm.control.hardware.measurement import FloatArray, stride_and_delay
from flexarm.control.hardware.sampled_plant import (
    SampledPlant,
    Signal,
    delay_in_samples,
    sampled_plant,
)
from flexarm.model import Hardware, Instrument, Motors

#: Description of the argument ``hardware`` of controllers.
OF_DESIGN = (
    "Motors and instruments whose delays, lag and filtered rates are states of the design model; "
    "cannot be combined with ``delay``."
)
#: Reading of an instrument that derives the rate, and its signal.
_RATES = {"joint_rate": "joint_angle"}


def refuse_both(controller: Any) -> None:
    """Raise if a controller has both hardware and a delay, which is part of it."""
    if controller.hardware is not None and controller.delay:
        raise InputError(Problem("delay", "cannot be combined with hardware"))


class LoopHardware:
    """Motors and instruments of a loop, as states of its plant.

    Args:
        hardware: instruments and motors. measured: names of the readings of the controller.
        sample_time: s.

    Attributes:
        delayed: whole samples by which a torque acts late. lead: samples by which the nominal
            torque is requested early: delay and lag of the motors.
        signals: channels that the instruments of the readings measure.

    Raises:
        InputError: if there is no instrument of a reading, or it has its own sample time.
    """

    def __init__(self, hardware: Hardware, measured: Sequence[str], sample_time: float) -> None:
        motors = hardware.motors or Motors()
        self.delayed, part = delay_in_samples(motors.delay, sample_time)
        self.lead = self.delayed + part + motors.time_constant / sample_time
        self._all = motors
        self._motors = motors.replace(delay=part * sample_time)
        self._sample_time, self._measured = sample_time, measured
        self._instruments: list[Instrument] = []
        for name in measured:
            item = _instrument_of(hardware, name)
            if stride_and_delay(item, sample_time)[0] > 1:
                rule = "has instruments with their own sample_time, which is not supported"
                raise InputError(Problem("hardware", rule))
            if set(measured).isdisjoint(item.labels[1:]):  # its filter adds nothing
                item = item.replace(rate_cutoff=None, rate_name=None)
            if item not in self._instruments:
                self._instruments.append(item)
        self.signals = tuple(dict.fromkeys(str(item.signal) for item in self._instruments))

    def plant(
        self, A: FloatArray, B: FloatArray, rows: Mapping[str, FloatArray], whole: bool = False
    ) -> SampledPlant:
        """Sample an arm x' = A x + B (acting torque) with the hardware.

        Args:
            A, B: of the arm. rows: of C for the signals.
            whole: whether the whole samples of the delay of the motors are states, too; otherwise
                a controller predicts over them.

        The outputs are the readings in the order of the controller.
        """
        return self._ordered(A, B, rows, self._all if whole else self._motors)

    def nominal(self, sizes: Mapping[str, int]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the map of the signals and frames to the next frames and the readings.

        Args:
            sizes: number of components of each signal.

        Returns:
            For frames (f,), signals (s,) and readings (p,): (f + p, s) and (f + p, f), and the
            frames (f, s) of a constant signal.
        """
        count = sum(sizes.values())
        places = np.split(np.eye(count), np.cumsum(list(sizes.values()))[:-1])
        rows = dict(zip(sizes, places, strict=True))
        plant = self._ordered(np.zeros((count, count)), np.zeros((count, 0)), rows, None)
        both = np.vstack([plant.A[0][count:], plant.C[0]])
        frames = len(plant.A[0]) - count
        kept = np.eye(frames) - both[:frames, count:]
        settled = np.asarray(np.linalg.solve(kept, both[:frames, :count]), dtype=np.float64)
        return both[:, :count], both[:, count:], settled

    def _ordered(
        self, A: FloatArray, B: FloatArray, rows: Mapping[str, FloatArray], motors: Motors | None
    ) -> SampledPlant:
        readings = []
        for item in self._instruments:
            C = rows[str(item.signal)]
            readings.append((item, Signal(np.zeros(0), C, np.zeros((len(C), B.shape[1])))))
        plant = sampled_plant(A, B, readings, motors, self._sample_time)
        labels = [name for item, signal in readings for name in item.labels for _ in signal.C]
        order = [k for name in self._measured for k, label in enumerate(labels) if label == name]
        return plant._replace(C=[plant.C[0][order]])


def _instrument_of(hardware: Hardware, name: str) -> Instrument:
    """Return the instrument of a reading; an exact one if the hardware has no list of them."""
    if hardware.instruments is None:
        return Instrument(signal=name)
    for item in hardware.instruments:
        signals = zip(item.labels, (name, _RATES.get(name)), strict=False)
        if (name, str(item.signal)) in signals:
            return item
    rule = f"has no instrument of {name}, which the design measures"
    hint = "List the readings of the hardware in `measured`."
    raise InputError(Problem("hardware", rule, hint=hint))


def state_sizes(plant: SampledPlant, sizes: FloatArray, torque: FloatArray) -> FloatArray:
    """Return typical sizes of the states of a plant with hardware.

    Args:
        plant: the plant. sizes: of the states of the arm (n,). torque: (joints,) N m.
    """
    A, frames = plant.A[0], plant.frames
    of_motors = np.tile(torque, (frames - sizes.size) // torque.size)
    of_frames = np.abs(A[frames:, : sizes.size]) @ sizes
    for _ in range(of_frames.size):  # a late frame has the size of the one before
        before = np.abs(A[frames:, frames:]) @ of_frames
        of_frames = np.where(of_frames > 0.0, of_frames, before)
    of_frames = np.where(of_frames > 0.0, of_frames, 1.0)  # of a gauge that does not bend
    return np.concatenate([sizes, of_motors, of_frames])
