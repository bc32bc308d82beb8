"""Memory of a run for the page: the arguments of the kernels, as `simulate` itself makes them.

A run of Python is stopped before its first compiled step. The arrays of that call become the memory
of the page, under the names of their fields, such as ``memory.state`` or ``system.constants.body``;
nothing about an arm, an integrator or a controller is computed a second time.
"""

from __future__ import annotations

import base64
import copy
import math
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import flexarm as fa
from flexarm.arm.stations import place_stations
from flexarm.integrate.base import Progress
from flexarm.integrate.explicit_runge_kutta.explicit import advance_explicit
from flexarm.integrate.sampled_law import REFUSED, SampledLaw, sampled_explicit
from flexarm.kernels.layout import compile_time_sizes
from flexarm.kernels.observation.observables import POSE_COLUMNS, poses
from flexarm.kernels.observation.shapes import axis_points
from flexarm.simulation.loop import programmed_samples
from flexarm.simulation.loop.programmed_samples import ProgrammedSamples, _reference

#: Kernels of the page by the names of their exported functions.
KERNELS: dict[str, Callable[..., Any]] = {
    "advance": advance_explicit,
    "sampled": sampled_explicit,
    "poses": poses,
    "axis": axis_points,
}
#: Arguments of these kernels that the page uses by name.
_NAMES = {
    "advance": ("system", "tolerance", "record", "memory", "until", "most_steps"),
    "sampled": ("system", "tolerance", "record", "memory", "until", "most_steps", "law"),
    "poses": ("system.sizes", "system.constants", "drawn", "poses", "tip"),
    "axis": ("system.sizes", "drawn", "poses", "bodies", "x", "rows", "shortening", "points"),
}
#: Points of the axis that the page draws for each link.
STATIONS = 24
#: Steps in one call: as many as a step of the run can need.
_MOST_STEPS = 10_000


class _Captured(BaseException):
    """Ends a run whose memory has been captured; no handler of exceptions of a run catches it."""


@dataclass
class Image:
    """Arguments of the kernels of one run.

    ``calls``: arguments by kernel. ``arrays``: all arrays by the names of their fields.
    """

    calls: dict[str, tuple[Any, ...]]
    arrays: dict[str, NDArray[Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, arguments in self.calls.items():
            for label, argument in zip(_NAMES[name], arguments, strict=True):
                for place, leaf in _leaves(label, argument):
                    if isinstance(leaf, np.ndarray):
                        self.arrays.setdefault(place, leaf)

    def numbers(self) -> dict[str, NDArray[np.float64]]:
        """Return the arguments that are numbers and no arrays, by their names."""
        return {
            place: np.array(leaf, dtype=float)
            for name, arguments in self.calls.items()
            for label, argument in zip(_NAMES[name], arguments, strict=True)
            for place, leaf in _leaves(label, argument)
            if not isinstance(leaf, np.ndarray)
        }


def captured(arm: fa.Arm, duration: float, **arguments: Any) -> Image:
    """Return the memory of ``fa.simulate(arm, duration, **arguments)`` before its first step.

    The simulated arm is ``plant`` if that is given. A controller must be one whose law can run as a
    program, and have no memory.
    """
    first: list[tuple[Any, ...]] = []
    laws: list[SampledLaw] = []
    looped = arguments.get("controller") is not None

    def stop(progress: Progress, kernel: Any, *passed: Any) -> Any:
        if not first:
            system, tolerance, memory, until, _ = passed
            first.append(copy.deepcopy((system, tolerance, progress.method, memory, until)))
        if looped:
            return enter(progress, kernel, *passed)
        raise _Captured

    def stop_loop(samples: ProgrammedSamples) -> Any:
        laws.append(_law_from_start(samples))
        raise _Captured

    enter = Progress.enter
    with (
        _replaced(Progress, "enter", stop),
        _replaced(ProgrammedSamples, "advance", stop_loop),
        _replaced(programmed_samples, "_WORTH", 1),  # a program also for few samples
        suppress(_Captured),
    ):
        fa.simulate(arm, duration, integrator="dormand_prince_8", progress=False, **arguments)
    if looped and not laws:
        raise ValueError("the law of the controller does not run as a program")
    system, *rest = first[0]
    memory = rest[2]
    memory.samples[...] = 0.0  # not initialized
    call = {"sampled" if looped else "advance": (system, *rest, _MOST_STEPS, *laws)}
    return Image({**call, **_drawing(arguments.get("plant") or arm, system, memory)})


def _law_from_start(samples: ProgrammedSamples) -> SampledLaw:
    """Return the law of a run for all samples from the first one, at time zero."""
    loop, program = samples._loop, samples._program
    if program.memory.size or program.noted.size or samples._planned[1].size:
        raise ValueError("the law of the controller has a memory, or hardware")
    count = math.ceil(loop.end / loop.sample_time * (1.0 - 1e-12))
    times = np.arange(count) * loop.sample_time
    inputs = samples._plan(loop.controller, _reference(loop), times)
    # Of the numbers of the sample at which the law was recorded, only the constants remain.
    for places in (program.code[:, 1], program.readings, program.inputs):
        program.numbers[places] = 0.0
    commands, counts = np.zeros((count, loop.run.arm.n_joints)), np.array([0, count, 0, REFUSED])
    span = np.array([loop.sample_time, loop.end])
    # Without bodies at compile time, the kernels of its terms are not on the page.
    model = program.model._replace(sizes=compile_time_sizes(program.model.constants))
    if program.model.acceleration.size:
        raise ValueError("the law of the controller has a model")
    program = program._replace(model=model)
    sensors = samples._sensors
    rows = inputs, np.zeros((count, 0)), commands, np.zeros((count, 0))
    return SampledLaw(program, *sensors, *rows, counts, samples._small, span)


@contextmanager
def _replaced(owner: Any, name: str, value: Any) -> Iterator[None]:
    before = getattr(owner, name)
    setattr(owner, name, value)
    try:
        yield
    finally:
        setattr(owner, name, before)


def _drawing(arm: fa.Arm, system: Any, memory: Any) -> dict[str, tuple[Any, ...]]:
    """Return the arguments of the kernels that compute the drawn axis."""
    placed = place_stations(arm, STATIONS)
    drawn, body_poses = np.zeros_like(memory.state), np.zeros((memory.state.shape[1], POSE_COLUMNS))
    points = np.zeros((len(placed.x), 2))
    shapes = placed.body, placed.x, placed.rows, placed.shortening
    return {
        "poses": (system.sizes, system.constants, drawn, body_poses, np.zeros(6)),
        "axis": (system.sizes, drawn, body_poses, *shapes, points),
    }


def _leaves(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the arrays and numbers of an argument with their names, in the order of the ABI."""
    if hasattr(value, "_fields"):
        for key, part in zip(value._fields, value, strict=True):
            yield from _leaves(f"{name}.{key}", part)
    elif not isinstance(value, tuple):  # of no numbers: a size at compile time
        yield name, value


# Encoding --------------------------------------------------------------------------------------


def encoded(image: Image) -> dict[str, Any]:
    """Return the memory of a run for the page.

    Keys: ``arrays`` (name: [address, type, shape]), ``tables`` (kernel: address of its arguments),
    ``addresses`` (addresses of addresses, all relative to the start of the memory), ``numbers``
    (name: address of a number), ``size`` in bytes, and ``data`` (base64 of the deflated memory).
    """
    places: dict[int, int] = {}
    arrays: dict[str, tuple[int, str, list[int]]] = {}
    pieces: list[bytes] = []
    size = 0

    def put(content: bytes) -> int:
        nonlocal size
        place = size
        padded = content + bytes(-len(content) % 8)
        pieces.append(padded)
        size += len(padded)
        return place

    for name, array in image.arrays.items():
        if not array.flags.c_contiguous:
            raise ValueError(f"{name} is not contiguous")
        if id(array) not in places:
            places[id(array)] = put(array.tobytes())
        arrays[name] = places[id(array)], array.dtype.str[1:], list(array.shape)
    tables, numbers, addresses = {}, {}, []
    for kernel, arguments in image.calls.items():
        slots: list[bytes] = []
        relative, named = [], {}
        for label, argument in zip(_NAMES[kernel], arguments, strict=True):
            for name, leaf in _leaves(label, argument):
                if isinstance(leaf, np.ndarray):
                    relative.append(len(slots) + 4)
                    shape = leaf.size, leaf.itemsize, places[id(leaf)], *leaf.shape, *leaf.strides
                    slots += [int(word).to_bytes(8, "little") for word in (0, 0, *shape)]
                else:
                    named[name] = len(slots)
                    slots.append(_word(leaf))
        tables[kernel] = begin = put(b"".join(slots))
        addresses += [begin + 8 * slot for slot in relative]
        numbers |= {name: begin + 8 * slot for name, slot in named.items()}
    packed = base64.b64encode(zlib.compress(b"".join(pieces), 9)).decode()
    return {
        "arrays": arrays,
        "tables": tables,
        "numbers": numbers,
        "addresses": addresses,
        "size": size,
        "data": packed,
    }


def _word(number: Any) -> bytes:
    """Return a number as 8 bytes, as the table of a kernel contains it."""
    kind = np.float64 if isinstance(number, float | np.floating) else np.int64
    return bytes(np.array(number, dtype=kind).tobytes())
