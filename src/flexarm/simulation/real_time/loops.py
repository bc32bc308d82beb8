"""The loop of a plant against the clock or in lockstep, and that of a controller over UDP."""

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
from flexarm.control.contract.base import Controller, Reference
from flexarm.control.hardware.measurement import Measurement
from flexarm.simulation.calls.plant import Plant
from flexarm.simulation.calls.result import make_result
from flexarm.simulation.real_time.packets import (
    END,
    OTHER_TIME,
    REFERENCE,
    START,
    Address,
    Datagrams,
    Head,
    Layout,
    Packet,
    SentReference,
    WrongPacketError,
    head_of,
    new_token,
    packed_head,
    reference_values,
    torque_layout,
)
from flexarm.simulation.real_time.partners import (
    Clock,
    Partner,
    PartnerError,
    SampleTimes,
    add_samples,
    updated,
)

if TYPE_CHECKING:
    import xarray as xr

#: Recorded channels. They depend on the coordinates only, so changes of the arm do not matter.
_CHANNELS = (
    *("joint_angle", "joint_rate", "link_tip_deflection", "tip", "tip_velocity"),
    *("q", "qd"),
)
#: Largest number of requests for a run that are remembered.
_REQUESTS = 64


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


class ControllerLoop:
    """A controller that listens at an address.

    A packet of the past cannot contain a token that was drawn now. The run therefore begins with
    the first packet that has a token with which a request was answered, and its sender is the
    plant.

    Args:
        received: layout of the packets of the plant.
        reference: of the controller; a `SentReference` receives the values of each packet.
        timeout: time (s) without a packet after which the run fails.
    """

    def __init__(
        self,
        controller: Controller,
        address: Address,
        received: Layout,
        reference: Reference | None,
        clock: Clock,
        timeout: float,
    ) -> None:
        self._controller, self._address, self._received = controller, address, received
        self._reference = reference
        self._clock, self._timeout = clock, timeout
        self._datagrams = Datagrams(address, listen=True)
        self._readings: list[Measurement] = []
        self._torques: list[FloatArray] = []
        self._samples: list[float] = []
        self._times = SampleTimes()
        self._last, self._answer = -1, b""
        self._tokens: dict[float, float] = {}  # those drawn here, by those of requests
        self._token: float | None = None  # of the run
        self._until = 0.0  # at which the run fails without a packet
        names = ("lost", "repeated", "discarded", "foreign")
        self._counts = {f"packets_{name}": 0 for name in names}

    def run(self) -> xr.Dataset:
        """Answer packets until the plant ends the run.

        Raises:
            SimulationError: if the controller fails, a packet is wrong, or the plant is silent;
                its ``result`` is the result so far.
        """
        self._controller.reset()
        self._until = self._clock.now() + self._timeout
        try:
            while self._next():
                pass
        except PartnerError as error:
            failure = SimulationError(self._time, error.reason, error.hint)
            failure.result = self._result(str(failure))
            raise failure from error.__cause__
        finally:
            if self._token is not None:
                self._datagrams.send(packed_head(self._token, END, self._time))
            self._datagrams.close()
        return self._result("")

    def _next(self) -> bool:
        """Answer the next packet; return whether the run continues."""
        data = self._datagrams.receive(self._until - self._clock.now())
        started = self._clock.now()
        head = None if data is None else head_of(data)
        if data is not None and head is not None and self._is_of_the_run(head):
            if head.number == END:
                return False
            self._answer_packet(data, started)
            self._until = self._clock.now() + self._timeout
        elif started >= self._until:
            raise PartnerError(*self._silence())
        return True

    def _is_of_the_run(self, head: Head) -> bool:
        """Return whether a packet is of the run, which it may begin; grant a requested run."""
        if self._token is None and head.token in self._tokens.values():
            self._token = head.token
            self._datagrams.hold()
        if head.token == self._token:
            return True
        if self._token is None and head.number == START:
            if head.token not in self._tokens and len(self._tokens) == _REQUESTS:
                del self._tokens[next(iter(self._tokens))]
            token = self._tokens.setdefault(head.token, new_token())
            self._datagrams.send(packed_head(head.token, START, token))
        elif head.token not in self._tokens:  # else a repeated request
            self._counts["packets_foreign"] += 1
        return False

    def _silence(self) -> tuple[str, str]:
        """Return reason and hint of a run without packets."""
        hint = "Start the plant, or increase timeout."
        foreign = self._counts["packets_foreign"]
        if foreign:
            hint += f" {foreign} packets of other programs or earlier runs were ignored."
        return f"no packet at {self._address} for {self._timeout:g} s.", hint

    def _answer_packet(self, data: bytes, started: float) -> None:
        """Answer a packet of the run, unless it is older than another one."""
        try:
            packet = self._received.unpacked(data)
        except WrongPacketError as error:
            raise PartnerError(f"a packet at {self._address} {error}") from None
        if packet.number == self._last:  # the answer was lost, or is on its way
            self._datagrams.send(self._answer)
            self._counts["packets_repeated"] += 1
        elif packet.number < self._last:
            self._counts["packets_discarded"] += 1
        else:
            self._update(packet, started)

    def _update(self, packet: Packet, started: float) -> None:
        """Compute and send the torque for a new packet."""
        h, k = self._controller.sample_time, packet.number
        if abs(packet.time - k * h) > OTHER_TIME * h:
            reason = (
                f"packet {k} has the time {packet.time:.6g} s, but the controller with its sample "
                f"time of {h:g} s expects {k * h:.6g} s"
            )
            raise PartnerError(reason)
        readings = {n: v for n, v in packet.values.items() if n not in REFERENCE}
        measurement = Measurement(**readings)
        if isinstance(self._reference, SentReference):
            self._reference.values = packet.values
        joints = self._torques[0].size if self._torques else -1
        torque = updated(self._controller, packet.time, measurement, self._reference, joints)
        layout = torque_layout(torque.size)
        assert self._token is not None
        self._answer = layout.packed(Packet(k, packet.time, {"torque": torque}), self._token)
        self._datagrams.send(self._answer)
        self._counts["packets_lost"] += k - self._last - 1
        self._last = k
        self._samples.append(packet.time)
        self._readings.append(measurement)
        self._torques.append(torque)
        ended = self._clock.now()
        self._times.add(started, ended, ended, k * h)

    @property
    def _time(self) -> float:
        return self._samples[-1] if self._samples else 0.0

    def _result(self, failure: str) -> xr.Dataset:
        """Return readings, torques and times of the samples."""
        import xarray as xr

        torque = np.array(self._torques).reshape(len(self._torques), -1 if self._torques else 0)
        labels = {"units": "N m", "long_name": "torque requested by the controller"}
        run = xr.Dataset({"torque_command": (("tick", "joint"), torque, labels)})
        run.attrs = {
            "controller": type(self._controller).__name__,
            "sample_time": float(self._controller.sample_time),
            **self._counts,
            "timing": self._times.table(),
            "failure": failure,
        }
        return add_samples(run, np.array(self._samples), self._readings, self._times)
