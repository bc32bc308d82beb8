"""A plant against the clock, or in lockstep with its controller."""

from __future__ import annotations

import copy
import math
import warnings
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.observe import channels_of
from flexarm.base.errors import FlexarmError, SimulationError
from flexarm.control.contract.base import Reference
from flexarm.control.hardware.measurement import Measurement
from flexarm.simulation.calls.plant import Plant
from flexarm.simulation.calls.result import make_result
from flexarm.simulation.real_time.clock import Clock, SampleTimes
from flexarm.simulation.real_time.packets import Packet, reference_values
from flexarm.simulation.real_time.partners import Partner, PartnerError
from flexarm.simulation.real_time.records import add_samples

if TYPE_CHECKING:
    import xarray as xr

#: Recorded channels. They depend on the coordinates only, so changes of the arm do not matter.
_CHANNELS = (
    *("joint_angle", "joint_rate", "link_tip_deflection", "tip", "tip_velocity"),
    *("q", "qd"),
)


class PlantLoop:
    """A plant with its controller.

    Args:
        plant: at time zero.
        reference: whose values are sent with the readings; None to send none.
        paced: whether samples wait for the clock; else the plant waits for its controller.
        within: time (s) for an answer, after which the last torque is held. timeout: time (s)
            without an answer after which the run fails.
    """

    def __init__(
        self,
        plant: Plant,
        partner: Partner,
        reference: Reference | None,
        clock: Clock,
        paced: bool,
        within: float,
        timeout: float,
    ) -> None:
        self._plant, self._partner, self._reference = plant, partner, reference
        self._clock, self._paced, self._within, self._timeout = clock, paced, within, timeout
        self._states = [(plant.q, plant.qd)]
        self._readings: list[Measurement] = []
        self._torques: list[FloatArray] = []
        self._times, self._held = SampleTimes(), 0
        self._torque = np.zeros(plant.arm.joints)
        self._begin = self._heard = 0.0

    def run(self, samples: int) -> xr.Dataset:
        """Run for a number of samples.

        Raises:
            SimulationError: if the plant or the controller fails, or the controller is silent;
                its ``result`` is the result so far.
        """
        if self._paced:
            _step_a_copy(self._plant)
        self._begin = self._heard = self._clock.now()
        try:
            for k in range(samples):
                self._sample(k)
        except PartnerError as error:
            state = self._plant.q, self._plant.qd
            failure = SimulationError(self._plant.time, error.reason, error.hint, state)
            failure.result = self._result(str(failure))
            raise failure from error.__cause__
        except SimulationError as error:
            error.result = self._result(str(error))
            raise
        finally:
            self._partner.close(self._plant.time)
        return self._result("")

    def _sample(self, k: int) -> None:
        """Run sample k: send the readings, wait for the torque, step."""
        plant, clock, times = self._plant, self._clock, self._times
        h = plant.sample_time
        if self._paced:
            clock.wait_until(self._begin + k * h)
        started, measurement = clock.now(), plant.measurement
        torque = self._answer(k, measurement)
        answered = clock.now()
        if self._paced and k == 0:  # the clock starts with the first answer, which has no delay
            self._begin, started, answered = answered, answered, math.nan
        self._readings.append(measurement)
        self._torques.append(torque)
        plant.step(torque)
        self._states.append((plant.q, plant.qd))
        times.add(started, answered, clock.now(), k * h if self._paced else None)

    def _answer(self, k: int, measurement: Measurement) -> FloatArray:
        """Return the torque of sample k; the last one if the answer is late."""
        t = self._plant.time
        packet = Packet(k, t, {**measurement, **reference_values(self._reference, t)})
        patient = not self._paced or k == 0
        seconds = self._timeout if patient else self._within
        torque = self._partner.answer(packet, seconds, repeat=patient)
        now = self._clock.now()
        if torque is not None:
            self._torque, self._heard = torque, now
            return torque
        if now - self._heard >= self._timeout:
            reason = f"no answer from {self._partner.name} for {self._timeout:g} s."
            raise PartnerError(reason, "Start the controller, or increase timeout.")
        self._held += 1
        return self._torque

    def _result(self, failure: str) -> xr.Dataset:
        """Return what was computed."""
        plant, arm, times = self._plant, self._plant.arm, self._times
        steps = len(self._states) - 1
        at = np.arange(steps + 1, dtype=np.float64) * plant.sample_time
        states = arm.padded(np.array(self._states))
        channels = channels_of(arm, states, _CHANNELS)
        applied = np.array([*self._torques[:steps], self._torque]).reshape(steps + 1, arm.joints)
        attributes: dict[str, Any] = {
            "controller": self._partner.name,
            "sample_time": plant.sample_time,
            "paced": int(self._paced),
            "missed_deadlines": times.missed(plant.sample_time),
            "torques_held": self._held,
            **self._partner.counts,
            "timing": times.table(),
            "failure": failure,
            "warning": plant.warning,
        }
        run = make_result(
            arm,
            at,
            {name: channels[name] for name in _CHANNELS if name in channels} | {"torque": applied},
            attributes,
        )
        return add_samples(run, at[:-1], self._readings[:steps], times)


def _step_a_copy(plant: Plant) -> None:
    """Step a copy of a plant, because the first step of a process loads compiled functions."""
    with warnings.catch_warnings(), suppress(FlexarmError):  # the step of the plant repeats them
        warnings.simplefilter("ignore")
        copy.deepcopy(plant).step(np.zeros(plant.arm.joints))
