"""Kernels of one arm, with the arrays that every call requires besides its states."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from flexarm.arm.assembly.assemble import Assembly, FloatArray, IntArray
from flexarm.kernels.columns import MULTIPLIER
from flexarm.kernels.compilation.cache import Entry
from flexarm.kernels.layout import (
    ArmConstants,
    Array,
    Loads,
    new_workspace,
    no_loads,
    run_time_sizes,
)
from flexarm.kernels.observation.observables import POSE_COLUMNS
from flexarm.kernels.recursion.articulated_body import forward_dynamics
from flexarm.kernels.recursion.newton_euler import inverse_dynamics

_Kernel = Callable[..., None]


class KernelView:
    """Sizes, constants, workspace and cached entry points of one arm, n bodies with m modes.

    Allocating the workspace and determining the types of its arrays takes ten times as long as a
    kernel, so keep a view for repeated calls. A view serves one thread. The number type of the
    workspace is complex for derivatives by complex perturbation.

    Attributes:
        sizes: loop lengths, as numbers at run time. constants: as given. loads: no loads, no
        contacts, a base at rest. work: workspace with results of the last call. shape: (n, 1 + m).
    """

    __slots__ = ("_entries", "constants", "loads", "shape", "sizes", "work")

    def __init__(self, constants: ArmConstants, dtype: Any = np.float64) -> None:
        self.constants, self.loads = constants, no_loads(constants)
        self.work = new_workspace(constants, dtype)
        self.shape = self.work.acceleration.shape
        self.sizes = run_time_sizes(constants)
        self._entries: dict[_Kernel, Entry] = {}

    def call(self, kernel: _Kernel, *arguments: Any) -> None:
        """Call a kernel with sizes, constants and ``arguments``."""
        entry = self._entries.get(kernel)
        if entry is None:
            entry = self._entries[kernel] = Entry(kernel)
        entry(self.sizes, self.constants, *arguments)

    def forward_dynamics(self, state: Array, torque: Array, loads: Loads | None = None) -> Array:
        """Return the accelerations (n, 1 + m) of a state under torques (n,), in the workspace."""
        self.call(forward_dynamics, state, torque, loads or self.loads, self.work)
        return self.work.acceleration

    def inverse_dynamics(
        self, state: Array, acceleration: Array, loads: Loads | None = None
    ) -> Array:
        """Return the generalised force (n, 1 + m) of a motion, in the workspace."""
        self.call(inverse_dynamics, state, acceleration, loads or self.loads, self.work)
        return self.work.force

    def set_closure_forces(self, forces: Array | float) -> None:
        """Set the multipliers (rows,) of closures that inverse dynamics use."""
        self.work.closure[:, MULTIPLIER] = forces

    def zeros(self, *leading: int) -> Array:
        """Return zeros (..., n, 1 + m) of the workspace's number type."""
        return np.zeros((*leading, *self.shape), dtype=self.work.body.dtype)

    def pose_arrays(self) -> tuple[Array, Array]:
        """Return arrays for the poses of the bodies (n, POSE_COLUMNS) and of the tip (6,)."""
        dtype = self.work.body.dtype
        return np.zeros((self.shape[0], POSE_COLUMNS), dtype=dtype), np.zeros(6, dtype=dtype)


T = TypeVar("T")
_FLOAT = np.dtype(np.float64)


def is_plain(value: object, shape: tuple[int, ...]) -> bool:
    """Return whether a value is a float array of the given shape, which needs no conversion."""
    return type(value) is np.ndarray and value.dtype is _FLOAT and value.shape == shape


class Pool(list[T]):
    """Free buffers of one kind. Each call takes its own, so that threads do not share any.

    The caller appends them again afterwards, but not with values that are not finite.
    """

    def __init__(self, new: Callable[[], T]) -> None:
        self._new = new

    def take(self) -> T:
        """Return free buffers, or new ones."""
        try:
            return self.pop()
        except IndexError:
            return self._new()


class Scratch(KernelView):
    """View of the kernels with buffers for the three vectors of one evaluation.

    ``state`` (2, n, 1 + m) are coordinates and rates, ``third`` torques (n,) or accelerations
    (n, 1 + m); ``places`` are the indices of the third vector's numbers in its flattened array.
    """

    __slots__ = ("_given", "_places", "state", "third")

    def __init__(self, assembly: Assembly, shape: tuple[int, ...], places: IntArray) -> None:
        super().__init__(assembly.constants)
        n, width = self.shape
        rates, third = n * width, 2 * n * width
        self._given = np.zeros(third + int(np.prod(shape)))
        self.state = self._given[:third].reshape(2, n, width)
        self.third = self._given[third:].reshape(shape)
        q = assembly.coordinates
        self._places = as_slice(q), as_slice(q + rates), as_slice(places + third)

    def fill(self, q: FloatArray, qd: FloatArray, third: FloatArray) -> bool:
        """Copy three vectors to the buffers; return whether all their numbers are finite."""
        given, places = self._given, self._places
        given[places[0]] = q
        given[places[1]] = qd
        given[places[2]] = third
        return is_finite(given)


def as_slice(places: IntArray) -> Any:
    """Return consecutive indices as a slice, which is faster."""
    first = int(places[0]) if places.size else 0
    if np.array_equal(places, np.arange(first, first + places.size)):
        return slice(first, first + places.size)
    return places


def is_finite(array: FloatArray) -> bool:
    """Return whether all numbers are finite, without the warnings that sums or products give."""
    return bool(np.count_nonzero(np.isfinite(array)) == array.size)
