"""Packets between a plant and a controller: rows of doubles.

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

import re
import secrets
import select
import socket
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import prod
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import InputError, Problem, shown
from flexarm.control.contract.base import Reference

#: Sequence numbers of the packets that end a run, and that request and grant one.
END, START = -1, -2
#: Values of a reference in a packet: names, and the methods of `Reference`.
REFERENCE = {
    "reference_angle": "joint_angle",
    "reference_rate": "joint_rate",
    "reference_acceleration": "joint_acceleration",
}
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
    """Content of a packet without its token.

    Attributes:
        number: sequence number.
        time: s.
        values: arrays by name.
    """

    number: int
    time: float
    values: Mapping[str, FloatArray]


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
        """Return the packet of bytes with a token of this run.

        Raises:
            WrongPacketError: if their number is not that of the layout, or the sequence number is
                not a whole number.
        """
        if len(data) != self.size:
            raise WrongPacketError(
                f"has {len(data)} bytes instead of {self.size}: {self}, 8 bytes each"
            )
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


class SentReference:
    """Reference whose values are those of the last packet; zero before the first one."""

    def __init__(self, joints: int) -> None:
        self.values: Mapping[str, FloatArray] = dict.fromkeys(REFERENCE, np.zeros(joints))

    def joint_angle(self, t: float) -> FloatArray:
        """Return the angles (joints,) of the packet, rad."""
        return self.values["reference_angle"]

    def joint_rate(self, t: float) -> FloatArray:
        """Return the rates (joints,) of the packet, rad/s."""
        return self.values["reference_rate"]

    def joint_acceleration(self, t: float) -> FloatArray:
        """Return the accelerations (joints,) of the packet, rad/s^2."""
        return self.values["reference_acceleration"]


class Address(NamedTuple):
    """Host and port at which a controller listens."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


def check_address(name: str, value: object) -> Address:
    """Return the address of a text such as ``"127.0.0.1:5005"``.

    Raises:
        InputError: if the text is not a host and a port, or the host has no address.
    """
    found = _ADDRESS.fullmatch(value) if isinstance(value, str) else None
    if found is None or not 0 < int(found[2]) < 65536:
        rule = "be an object or an address such as '127.0.0.1:5005'"
        raise InputError(Problem(name, rule, shown(value)))
    try:
        return Address(socket.gethostbyname(found[1]), int(found[2]))
    except OSError:
        raise InputError(Problem(name, "contain a known host", shown(value))) from None


class Datagrams:
    """Datagrams to and from a partner.

    Args:
        address: of the partner; with ``listen``, of this side, whose datagrams go to the last
            sender until `hold` is called.

    Raises:
        InputError: if this side cannot listen at the address.
    """

    def __init__(self, address: Address, listen: bool) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._listens = listen
        self._partner: tuple[Any, ...] | None = None
        try:
            (self._socket.bind if listen else self._socket.connect)(address)
        except OSError as error:
            self._socket.close()
            what = "listen" if listen else "send"
            rule = f"be an address at which this computer can {what} ({error.strerror})"
            raise InputError(
                Problem("plant" if listen else "controller", rule, str(address))
            ) from None

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
