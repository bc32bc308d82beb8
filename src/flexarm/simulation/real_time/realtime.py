"""`realtime`: a plant and a controller against the clock, in one process or in two."""

from __future__ import annotations

import copy
import gc
import math
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.observe import channels_of
from flexarm.base.arguments import check_count, check_kind, check_mapping, check_positive
from flexarm.base.errors import (
    FlexarmError,
    FlexarmWarning,
    InputError,
    Problem,
    SimulationError,
    check_array,
    public_call,
    raise_any,
    shown,
    warn_caller,
)
from flexarm.base.late import xr
from flexarm.base.processes import single_threaded_algebra
from flexarm.control.contract.base import (
    Controller,
    Reference,
    check_controller,
    check_reference,
    requirements_of,
)
from flexarm.control.hardware.measurement import Measurement
from flexarm.model import Link
from flexarm.model.quantities import Flag, Positive
from flexarm.simulation.calls.plant import Plant
from flexarm.simulation.calls.result import make_result
from flexarm.simulation.loop.control_loop import sampled_reference
from flexarm.simulation.real_time.partners import (
    END,
    OTHER_TIME,
    REFERENCE,
    START,
    Address,
    Clock,
    Datagrams,
    Head,
    Layout,
    OwnController,
    Packet,
    Partner,
    PartnerError,
    SampleTimes,
    SentReference,
    UdpController,
    WrongPacketError,
    add_samples,
    check_address,
    head_of,
    new_token,
    packed_head,
    reference_values,
    torque_layout,
    updated,
)

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
        self._torque = np.zeros(plant.arm.n_joints)
        self._begin = self._heard = 0.0

    def run(self, samples: int) -> xr.Dataset:
        """Run for a number of samples."""
        if self._paced:  # the first step of a process loads compiled functions
            with warnings.catch_warnings(), suppress(FlexarmError):  # the plant repeats them
                warnings.simplefilter("ignore")
                copy.deepcopy(self._plant).step(np.zeros(self._plant.arm.n_joints))
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
        applied = np.array([*self._torques[:steps], self._torque]).reshape(steps + 1, arm.n_joints)
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
        shown = {name: channels[name] for name in _CHANNELS if name in channels}
        run = make_result(arm, at, shown | {"torque": applied}, attributes)
        return add_samples(run, at[:-1], self._readings[:steps], times)


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
        """Answer packets until the plant ends the run."""
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
            hint, foreign = "Start the plant, or increase timeout.", self._counts["packets_foreign"]
            if foreign:
                hint += f" {foreign} packets of other programs or earlier runs were ignored."
            raise PartnerError(f"no packet at {self._address} for {self._timeout:g} s.", hint)
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


#: Difference of two times, relative to them, that is rounding.
_ROUNDING = 1e-9
#: Distance of two joint angles (rad) at which a controller starts with a jump.
_FAR = 0.01
#: Largest number of values of a reading.
_LARGEST = 1000


@public_call
def realtime(
    plant: Plant | str,
    controller: Controller | str,
    duration: Positive | None = None,
    reference: Reference | None = None,
    *,
    readings: Mapping[str, int] | None = None,
    clock: Flag = True,
    answer_within: Positive | None = None,
    timeout: Positive = 5.0,
) -> xr.Dataset:
    """Run a plant or a controller against the clock, also with the other one in another process.

    An address, ``"127.0.0.1:5005"``, in place of the plant or of the controller, is that at which
    the controller listens for UDP packets. Both processes give the same one.

    Args:
        plant: the plant, at time zero, in its own state: a warning reports a reference that starts
            at other joint angles; or the address at which this process, the controller,
            listens.
        controller: the controller; or the address at which it listens.
        duration: s, rounded to whole samples. The plant determines the end of a run.
        reference: motion that the controller follows. A plant sends its values to another process;
            without ``reference``, a controller uses those that it receives.
        readings: names and sizes of the values in the packets of a plant in another process, such
            as ``{"joint_angle": 2, "joint_rate": 2}``.
        clock: whether each sample of the plant waits for its time. Without the clock (lockstep),
            the plant waits for the controller only, and sends packets again until they are
            answered: the result is that of ``simulate``, whatever the delays and losses.
        answer_within: time (s) from the start of a sample in which an answer over UDP is expected;
            at most the sample time, half of it by default. After it, the last torque is held, and
            the answer is discarded.
        timeout: s, without an answer, or without a packet, after which the run fails. The first
            sample waits so long for the controller to start; then the clock starts.

    Returns:
        Result with one sample per sample time. ``sample_late``, ``sample_answer`` and
        ``sample_busy`` (tick) are its times on the clock, s; the attribute ``timing`` is a table of
        their percentiles. A plant starts its clock with the first answer, so the first value of
        ``sample_answer`` is NaN. ``missed_deadlines`` counts the samples that were not ready at the
        next sample time, ``torques_held`` those without an answer in time. A plant that is late
        does not skip samples: it catches up. Over UDP, ``packets_repeated`` counts the packets that
        the plant sent again, or that the controller answered again; ``packets_discarded`` the
        answers with another number or time than the sample, or the packets that reached the
        controller after a newer one; ``packets_lost``, of the controller only, the samples without
        a packet before that of a later one; ``packets_foreign`` the packets of other programs and
        of earlier runs, which are ignored.

    Raises:
        InputError: if an argument has the wrong kind or value, the sample times differ, or the
            controller needs a reading that the plant, or ``readings``, does not have.
        SimulationError: if the plant or the controller fails, the other process ends the run or is
            silent, or a packet has the wrong length. ``result`` is the result so far.

    Packets are rows of little-endian doubles: token, sequence number, time (s), values. The plant
    sends its readings, then the angles, rates and accelerations of the reference; the controller
    answers with the same token, number and time, and the torques (N m). The number -1 ends the run.
    The plant requests a run with the number -2 and a random token; the controller answers with the
    same token and number, and in place of the time with the token of the run, also random.
    """
    if reference is not None:
        check_reference(reference)
    if isinstance(plant, str):
        loop = _controller_loop(plant, controller, duration, reference, readings, timeout)
        with _undisturbed(clock):
            return loop.run()
    check_kind("plant", plant, Plant, "a Plant or an address such as '127.0.0.1:5005'")
    if readings is not None:
        rule = "is only for a controller whose plant is in another process"
        raise InputError(Problem("readings", rule))
    h = plant.sample_time
    samples = _samples(plant, duration)
    within = 0.5 * h
    if answer_within is not None:
        within = answer_within
        if within > h:
            rule = f"be at most the sample time ({h:g} s)"
            raise InputError(Problem("answer_within", rule, shown(answer_within)))
        if not clock:
            raise InputError(Problem("answer_within", "cannot be combined with clock=False"))
    now = Clock()
    motion = sampled_reference(reference, h, samples * h)
    if motion is not None:
        _warn_of_another_start(plant, motion)
    partner = _partner(plant, controller, motion, now)
    sent = motion if isinstance(controller, str) else None
    with _undisturbed(clock):
        return PlantLoop(plant, partner, sent, now, clock, within, timeout).run(samples)


def _warn_of_another_start(plant: Plant, reference: Reference) -> None:
    """Warn if the reference starts at other joint angles than the plant, which keeps its state."""
    own, wanted = plant.q[plant.arm.joint_index], np.asarray(reference.joint_angle(0.0))
    if wanted.shape == own.shape and np.abs(wanted - own).max() > _FAR:
        angles = np.array2string(wanted, separator=", ", precision=4)
        warn_caller(
            f"realtime: the reference starts {np.abs(wanted - own).max():.3g} rad from the joint "
            "angles of the plant, and the controller jumps there; "
            f"plant.reset(arm.rest({angles})) starts the plant with the motion",
            FlexarmWarning,
        )


def _samples(plant: Plant, duration: float | None) -> int:
    """Return the number of samples of a plant at time zero."""
    if plant.time != 0.0:
        hint = "Call plant.reset(initial) first."
        raise InputError(Problem("plant", "be at time zero", f"{plant.time:.6g} s", hint))
    if duration is None:
        raise InputError(Problem("duration", "is required with a plant"))
    h = plant.sample_time
    samples = check_count("duration / plant.sample_time", round(duration / h), 1, 10**8)
    if samples * h > plant.duration * (1.0 + _ROUNDING):
        rule = f"be at most that of the plant ({plant.duration:g} s)"
        raise InputError(Problem("duration", rule, shown(duration)))
    return samples


def _partner(
    plant: Plant, controller: Controller | str, reference: Reference | None, clock: Clock
) -> Partner:
    """Return the controller of a plant."""
    joints = plant.arm.n_joints
    shapes = {name: values.shape for name, values in plant.measurement.items()}
    if isinstance(controller, str):
        motion = dict.fromkeys(REFERENCE, (joints,)) if reference is not None else {}
        address = check_address("controller", controller)
        for name, values in reference_values(reference, 0.0).items():
            check_array(f"reference.{REFERENCE[name]}(0.0)", values, (joints,))
        return UdpController(address, Layout(shapes | motion), joints, clock)
    check_controller("controller", controller)
    needed = requirements_of(controller, plant.arm, reference)
    problems = _missing("plant", "measure", controller, needed.measured, shapes)
    h = plant.sample_time
    if abs(controller.sample_time - h) > _ROUNDING * h:
        rule = f"equal that of the plant ({h:g} s)"
        problems.append(Problem("controller.sample_time", rule, shown(controller.sample_time)))
    if needed.joints not in (None, joints):
        problems.append(Problem("controller", f"be for {joints} joints", shown(needed.joints)))
    raise_any(problems)
    return OwnController(controller, reference, joints)


def _missing(
    place: str, verb: str, controller: Controller, read: Sequence[str], names: Collection[str]
) -> list[Problem]:
    """Return a problem for each required reading that is not among names."""
    kind = type(controller).__name__
    lacking = [name for name in read if name not in names]
    return [Problem(place, f"does not {verb} {name}, which {kind} reads") for name in lacking]


def _controller_loop(
    plant: str,
    controller: Controller | str,
    duration: float | None,
    reference: Reference | None,
    readings: Mapping[str, int] | None,
    timeout: float,
) -> ControllerLoop:
    """Return the loop of a controller whose plant is in another process."""
    address = check_address("plant", plant)
    if isinstance(controller, str):
        raise InputError(Problem("plant and controller", "are both addresses"))
    check_controller("controller", controller)
    check_positive("controller.sample_time", controller.sample_time)
    if duration is not None:
        raise InputError(Problem("duration", "is determined by the plant in the other process"))
    if readings is None:
        hint = "Such as readings={'joint_angle': 2, 'joint_rate': 2}, in the order of the packet."
        rule = "is required for a plant in another process"
        raise InputError(Problem("readings", rule, hint=hint))
    sizes = {
        str(name): (check_count(f"readings[{name!r}]", size, 0, _LARGEST),)
        for name, size in check_mapping("readings", readings, "names and sizes").items()
    }
    sent = [name for name in REFERENCE if name in sizes]
    if reference is None and len(sent) == len(REFERENCE):
        reference = SentReference(*sizes[sent[0]])
    arm = getattr(controller, "arm", None)
    if not isinstance(arm, Arm):  # only the other process has the arm of the plant
        link = Link(length=1.0, flexible=False, mass_per_length=1.0)
        arm = Arm(links=[link] * max(1, sizes.get("joint_angle", (1,))[0]))
    needed = requirements_of(controller, arm, reference)
    problems = _missing("readings", "contain", controller, needed.measured, sizes)
    if 0 < len(sent) < len(REFERENCE):
        rule = f"contain all of {', '.join(REFERENCE)}, or none"
        problems.append(Problem("readings", rule, ", ".join(sent)))
    raise_any(problems)
    return ControllerLoop(controller, address, Layout(sizes), reference, Clock(), timeout)


@contextmanager
def _undisturbed(paced: bool) -> Iterator[None]:
    """Suspend what takes milliseconds at times: the garbage collection, and threads of algebra."""
    enabled = gc.isenabled()
    if paced:
        gc.disable()
    try:
        with single_threaded_algebra():
            yield
    finally:
        if enabled:
            gc.enable()
