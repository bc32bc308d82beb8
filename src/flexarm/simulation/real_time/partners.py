"""The controller of a plant, in the same process or over UDP; its packets, clock and samples.

A packet contains doubles (IEEE 754, 8 bytes each, little-endian)::

    token, sequence number, time (s), values

The plant sends its readings, then, with a reference, its angles, rates and accelerations. The
controller answers with the token, the sequence number and the time of the packet, and the torques
(N m). Sequence numbers count the samples from 0. The number -1, from either side, ends the run;
values after it are ignored and may be missing.

The token keeps packets of other programs and of earlier runs apart. The plant draws a token and
requests a run with it, in a packet with the number -2. The controller answers with the same token
and number and, in place of the time, a token that it has drawn: that of the run, in all packets
that follow. A controller whose run has begun ignores requests. Both sides ignore every packet with
another token, and the plant every answer with another number or time.
"""

from __future__ import annotations

import math
import re
import secrets
import select
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from math import prod
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import InputError, Problem, check_array, shown
from flexarm.base.late import xr
from flexarm.control.contract.base import Controller, Reference
from flexarm.control.hardware.measurement import Measurement, readings_by_name
from flexarm.simulation.calls.result import add_readings

#: Sequence numbers of the packets that end a run, and that request and grant one.
END, START = -1, -2
#: Values of a reference in a packet: names, and the methods of `Reference`.
REFERENCE = {f"reference_{name}": f"joint_{name}" for name in ("angle", "rate", "acceleration")}
#: Difference between the time of a packet and that of its sample, relative to the sample time,
#: from which the sample times of both sides differ.
OTHER_TIME = 0.01
_DOUBLE = np.dtype("<f8")
#: Numbers before the values, and bits of a token, which a double contains exactly.
HEAD, TOKEN_BITS = 3, 48
#: Longest time (s) for which `select` waits.
_DAY = 86400.0
#: Longest datagram that is read; longer ones are truncated and have a wrong length.
_LONGEST = 65535
_ADDRESS = re.compile(r"([^\s:]+):(\d{1,5})")


class Head(NamedTuple):
    """First numbers of a packet: the token, the sequence number, and the time (s)."""

    token: float
    number: float
    time: float


class Packet(NamedTuple):
    """Content of a packet without its token."""

    number: int  # sequence number
    time: float  # s
    values: Mapping[str, FloatArray]  # arrays by name


class WrongPacketError(ValueError):
    """The bytes received are not a packet of the layout."""


@dataclass(frozen=True)
class Layout:
    """Layout of packets: the shape of each value, in the order of the packet."""

    shapes: Mapping[str, tuple[int, ...]]

    @property
    def size(self) -> int:
        """Number of bytes."""
        return _DOUBLE.itemsize * (HEAD + sum(map(prod, self.shapes.values())))

    def __str__(self) -> str:
        sizes = [f"{name} ({prod(shape)})" for name, shape in self.shapes.items()]
        return ", ".join(["token", "sequence number", "time", *sizes])

    def packed(self, packet: Packet, token: float) -> bytes:
        """Return the bytes of a packet."""
        values = [np.ravel(packet.values[name]) for name in self.shapes]
        return np.concatenate([[token, *packet[:2]], *values]).astype(_DOUBLE).tobytes()

    def unpacked(self, data: bytes) -> Packet:
        """Return the packet of bytes with a token of this run."""
        if len(data) != self.size:
            text = f"has {len(data)} bytes instead of {self.size}: {self}, 8 bytes each"
            raise WrongPacketError(text)
        row = np.frombuffer(data, _DOUBLE).astype(np.float64)
        number, time = row[1:HEAD]
        if not (number == np.rint(number) and number >= 0):
            raise WrongPacketError(f"has the sequence number {number:g}")
        values, first = {}, HEAD
        for name, shape in self.shapes.items():
            values[name] = row[first : first + prod(shape)].reshape(shape)
            first += prod(shape)
        return Packet(int(number), float(time), values)


def head_of(data: bytes) -> Head | None:
    """Return the head of a packet of any layout; None for bytes that are too short."""
    size = HEAD * _DOUBLE.itemsize
    return Head(*np.frombuffer(data[:size], _DOUBLE).tolist()) if len(data) >= size else None


def packed_head(token: float, number: int, time: float) -> bytes:
    """Return the bytes of a packet without values."""
    return Layout({}).packed(Packet(number, time, {}), token)


def new_token() -> float:
    """Return a random token, a whole number greater than zero."""
    return float(1 + secrets.randbits(TOKEN_BITS))


def torque_layout(joints: int) -> Layout:
    """Return the layout of a controller's answers."""
    return Layout({"torque": (joints,)})


def reference_values(reference: Reference | None, t: float) -> dict[str, FloatArray]:
    """Return the values of a reference in a packet, by name; none without a reference."""
    if reference is None:
        return {}
    return {n: np.asarray(getattr(reference, method)(t)) for n, method in REFERENCE.items()}


def _sent(name: str) -> Callable[[Any, float], FloatArray]:
    return lambda self, t: self.values[name]


class SentReference:
    """Reference whose values are those of the last packet; zero before the first one."""

    def __init__(self, joints: int) -> None:
        self.values: Mapping[str, FloatArray] = dict.fromkeys(REFERENCE, np.zeros(joints))

    joint_angle, joint_rate, joint_acceleration = map(_sent, REFERENCE)  # in their order


class Address(NamedTuple):
    """Host and port at which a controller listens."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


def check_address(name: str, value: object) -> Address:
    """Return the address of a text such as ``"127.0.0.1:5005"``."""
    found = _ADDRESS.fullmatch(value) if isinstance(value, str) else None
    if found is None or not 0 < int(found[2]) < 65536:
        rule = "be an object or an address such as '127.0.0.1:5005'"
        raise InputError(Problem(name, rule, shown(value)))
    try:
        return Address(socket.gethostbyname(found[1]), int(found[2]))
    except OSError:
        raise InputError(Problem(name, "contain a known host", shown(value))) from None


class Datagrams:
    """Datagrams to and from a partner, or with ``listen`` to the last sender until `hold`."""

    def __init__(self, address: Address, listen: bool) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._listens = listen
        self._partner: tuple[Any, ...] | None = None
        try:
            (self._socket.bind if listen else self._socket.connect)(address)
        except OSError as error:
            self._socket.close()
            name, what = ("plant", "listen") if listen else ("controller", "send")
            rule = f"be an address at which this computer can {what} ({error.strerror})"
            raise InputError(Problem(name, rule, str(address))) from None

    def send(self, data: bytes) -> None:
        """Send a datagram; one that cannot be delivered is lost."""
        with suppress(OSError):
            if self._partner is None:
                self._socket.send(data)
            else:
                self._socket.sendto(data, self._partner)

    def hold(self) -> None:
        """Exchange datagrams with the last sender alone."""
        assert self._partner is not None
        self._socket.connect(self._partner)
        self._listens, self._partner = False, None

    def receive(self, seconds: float) -> bytes | None:
        """Return the next datagram, or None if there is none within a time, s, or one was lost."""
        # `select` waits for microseconds; the time limit of a socket is in milliseconds.
        ready, _, _ = select.select([self._socket], [], [], min(max(seconds, 0.0), _DAY))
        if not ready:
            return None
        try:
            data, sender = self._socket.recvfrom(_LONGEST)
        except OSError:  # a datagram sent before was refused: the partner does not listen
            return None
        if self._listens:
            self._partner = sender
        return data

    def close(self) -> None:
        """Release the address."""
        self._socket.close()


#: Time (s) before an instant at which sleeping ends and the clock is read until the instant is
#: there, because operating systems wake a program late by 50 to 100 us.
_SPIN = 2e-4
_PERCENTILES = (50.0, 99.0, 99.9)
#: Times of samples: the variable, the attribute of `SampleTimes`, and the meaning.
_TIMES = {
    "sample_start": ("started", "start of the sample on the clock"),
    "sample_late": ("late", "start of the sample after its planned time"),
    "sample_answer": ("answered", "time from the start of the sample to its torque"),
    "sample_busy": ("busy", "time from the start of the sample to the end of its work"),
}
#: Time (s) after which an unanswered packet is sent again, and for which the last one is.
_AGAIN, _FAREWELL = 0.05, 0.5


class Clock:
    """Monotonic clock of the computer, s."""

    def now(self) -> float:
        """Return the time, s."""
        return time.perf_counter()

    def wait_until(self, instant: float) -> None:
        """Return at an instant, or at once if it is over."""
        left = instant - self.now() - _SPIN
        if left > 0.0:
            time.sleep(left)
        while self.now() < instant:
            pass


@dataclass
class SampleTimes:
    """Times of the samples of a run, s."""

    #: at which samples started, from the first one
    started: list[float] = field(default_factory=list)
    #: how long after its planned time a sample started; empty without a plan
    late: list[float] = field(default_factory=list)
    #: from the start of a sample to its torque; NaN if the clock starts with it
    answered: list[float] = field(default_factory=list)
    #: from the start of a sample to the end of its work
    busy: list[float] = field(default_factory=list)
    _first: float = 0.0

    def add(self, started: float, answered: float, ended: float, planned: float | None) -> None:
        """Add a sample."""
        if not self.started:
            self._first = started
        self.started.append(started - self._first)
        if planned is not None:
            self.late.append(self.started[-1] - planned)
        self.answered.append(answered - started)
        self.busy.append(ended - started)

    def missed(self, sample_time: float) -> int:
        """Return the number of samples whose work ended after the planned time of the next."""
        pairs = zip(self.late, self.busy, strict=False)
        return sum(late + busy > sample_time for late, busy in pairs)

    def table(self) -> str:
        """Return means, percentiles and largest values in microseconds, as lines of text."""
        heads = ["mean", *(f"{p:g} %" for p in _PERCENTILES), "largest"]
        lines = [f"{'µs':<10}" + "".join(f"{head:>11}" for head in heads)]
        rows: dict[str, Sequence[float] | FloatArray] = {"period": np.diff(self.started)}
        rows |= {"late": self.late, "answer": self.answered, "busy": self.busy}
        for name, values in rows.items():
            x = 1e6 * np.asarray(values)
            x = x[np.isfinite(x)]
            if x.size:
                shown = [np.mean(x), *np.percentile(x, _PERCENTILES), np.max(x)]
                lines.append(f"{name:<10}" + "".join(f"{value:>11.1f}" for value in shown))
        return "\n".join(lines)


def add_samples(
    run: xr.Dataset, ticks: FloatArray, readings: Sequence[Measurement], times: SampleTimes
) -> xr.Dataset:
    """Return a result with readings and times of its samples, at times ``ticks`` (samples,), s."""
    for name, (attribute, meaning) in _TIMES.items():
        values = np.array(getattr(times, attribute)[: len(ticks)])
        if values.size:
            run[name] = ("tick", values, {"units": "s", "long_name": meaning})
    return add_readings(run, ticks, readings_by_name(readings))


class PartnerError(Exception):
    """The other side failed, with ``reason`` and ``hint`` as in `SimulationError`."""

    def __init__(self, reason: str, hint: str = "") -> None:
        super().__init__(reason, hint)
        self.reason, self.hint = reason, hint


class OwnController:
    """Controller in this process, which is always in time."""

    def __init__(self, controller: Controller, reference: Reference | None, joints: int) -> None:
        self.name, self.counts = type(controller).__name__, dict[str, int]()
        self._controller, self._reference, self._joints = controller, reference, joints
        controller.reset()

    def answer(self, packet: Packet, seconds: float, repeat: bool) -> FloatArray | None:
        """Return the torques (joints,) for the values of a sample, N m."""
        measurement = Measurement(**packet.values)
        return updated(self._controller, packet.time, measurement, self._reference, self._joints)

    def close(self, time: float) -> None:
        """Do nothing."""


def updated(
    law: Controller, t: float, readings: Measurement, reference: Reference | None, joints: int
) -> FloatArray:
    """Return the torques (joints,) of a controller; any number of them if ``joints`` is -1."""
    try:
        torque: Any = law.update(t, readings, reference)
    except Exception as error:
        reason = f"the controller failed with {type(error).__name__}: {error}"
        raise PartnerError(reason) from error
    try:
        return check_array("torque", torque, (joints,))
    except InputError as error:
        reason = f"the controller returned an unusable value: {error.at('controller')}"
        raise PartnerError(reason) from None


class UdpController:
    """Controller in another process.

    The first sample is also the handshake: the request for a run is repeated with its packet until
    the controller answers the packet, because a controller may be restarted in between.
    """

    def __init__(self, address: Address, sent: Layout, joints: int, clock: Clock) -> None:
        self.name = str(address)
        self.counts = {"packets_repeated": 0, "packets_discarded": 0, "packets_foreign": 0}
        self._sent, self._answers, self._clock = sent, torque_layout(joints), clock
        self._datagrams, self._ended = Datagrams(address, listen=False), False
        # Tokens of the request, and of the run, which the controller draws.
        self._request, self._token = new_token(), math.nan
        self._begun = False

    def answer(self, packet: Packet, seconds: float, repeat: bool) -> FloatArray | None:
        """Send a packet, and perhaps ``repeat`` it; return the torques that answer it in time."""
        answer = self._exchange(packet, seconds, repeat)
        if answer is None:
            return None
        if answer.number == END:
            self._ended = True
            reason = f"the controller at {self.name} ended the run."
            raise PartnerError(reason, "See the output of the other program.")
        self._begun = True
        try:
            return check_array("torque", answer.values["torque"], answer.values["torque"].shape)
        except InputError as error:
            reason = f"the controller at {self.name} sent an unusable value: {error}"
            raise PartnerError(reason) from None

    def _exchange(self, packet: Packet, seconds: float, repeat: bool) -> Packet | None:
        """Send a packet; return its answer, or the packet that ends the run."""
        now = self._clock.now()
        until, again = now + seconds, now + _AGAIN
        self._send(packet)
        while now < until:
            data = self._datagrams.receive((min(until, again) if repeat else until) - now)
            now = self._clock.now()
            answer = None if data is None else self._read(data, packet)
            if answer is not None:
                return answer
            if repeat and now >= again:
                self._send(packet)
                self.counts["packets_repeated"] += 1
                again = now + _AGAIN
        return None

    def _send(self, packet: Packet) -> None:
        """Send a packet in the run, and the request for a run before its first answer."""
        if packet.number == END:
            self._datagrams.send(packed_head(self._token, END, packet.time))
            return
        if not self._begun:
            request = packet._replace(number=START)
            self._datagrams.send(self._sent.packed(request, self._request))
        if not math.isnan(self._token):
            self._datagrams.send(self._sent.packed(packet, self._token))

    def _read(self, data: bytes, packet: Packet) -> Packet | None:
        """Return the packet of bytes if it answers a packet or ends the run."""
        head = head_of(data)
        if head is not None and (head.token, head.number) == (self._request, START):
            if not self._begun and head.time != self._token:
                self._token = head.time
                self._datagrams.send(self._sent.packed(packet, self._token))
        elif head is None or head.token != self._token:
            self.counts["packets_foreign"] += 1
        elif head.number == END:
            return Packet(END, head.time, {})
        elif (head.number, head.time) != (packet.number, packet.time):
            self.counts["packets_discarded"] += 1
        else:
            try:
                return self._answers.unpacked(data)
            except WrongPacketError as error:
                raise PartnerError(f"a packet from {self.name} {error}") from None
        return None

    def close(self, time: float) -> None:
        """Send the packet that ends the run until the controller returns one."""
        if not (self._ended or math.isnan(self._token)):
            with suppress(PartnerError):
                self._exchange(Packet(END, time, {}), _FAREWELL, repeat=True)
        self._datagrams.close()


#: Controller, as a plant calls it.
Partner = OwnController | UdpController
