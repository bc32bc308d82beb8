"""Packets between a plant and a controller: rows of doubles.

A packet contains doubles (IEEE 754, 8 bytes each, little-endian)::

    sequence number, time (s), values

The plant sends its readings, then, with a reference, its angles, rates and accelerations. The
controller answers with the sequence number and the time of the packet, and the torques (N m).
Sequence numbers count the samples from 0. The number -1, from either side, ends the run; values
after it are ignored and may be missing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from typing import NamedTuple

import numpy as np

from flexarm.assembly.assemble import FloatArray
from flexarm.control.base import Reference

#: Sequence number of the packet that ends a run.
END = -1
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
_HEAD = 2


class Packet(NamedTuple):
    """Content of a packet.

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
        return _DOUBLE.itemsize * (_HEAD + sum(map(prod, self.shapes.values())))

    def __str__(self) -> str:
        sizes = [f"{name} ({prod(shape)})" for name, shape in self.shapes.items()]
        return ", ".join(["sequence number", "time", *sizes])

    def packed(self, packet: Packet) -> bytes:
        """Return the bytes of a packet."""
        values = [np.ravel(packet.values[name]) for name in self.shapes]
        return np.concatenate([packet[:_HEAD], *values]).astype(_DOUBLE).tobytes()

    def unpacked(self, data: bytes) -> Packet:
        """Return the packet of bytes.

        Raises:
            WrongPacketError: if their number is not that of the layout, or the sequence number is
                not a whole number.
        """
        head = np.frombuffer(data[: _DOUBLE.itemsize], _DOUBLE)
        if len(data) % _DOUBLE.itemsize == 0 and head.size and head[0] == END:
            return Packet(END, 0.0, {})
        if len(data) != self.size:
            raise WrongPacketError(
                f"has {len(data)} bytes instead of {self.size}: {self}, 8 bytes each"
            )
        row = np.frombuffer(data, _DOUBLE).astype(np.float64)
        if not (row[0] == np.rint(row[0]) and row[0] >= 0):
            raise WrongPacketError(f"has the sequence number {row[0]:g}")
        values, first = {}, _HEAD
        for name, shape in self.shapes.items():
            values[name] = row[first : first + prod(shape)].reshape(shape)
            first += prod(shape)
        return Packet(int(row[0]), float(row[1]), values)


def end_packet(time: float) -> bytes:
    """Return the packet that ends a run."""
    return Layout({}).packed(Packet(END, time, {}))


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
