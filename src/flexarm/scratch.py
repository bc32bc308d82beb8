"""What one evaluation of the dynamics needs beside its arguments: entry points and buffers.

To allocate the arrays of a kernel and to find their types takes ten times as long as the kernel
itself. Both are kept from one call to the next.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from flexarm.assemble import Assembly, FloatArray, IntArray
from flexarm.kernels.articulated_body import forward_dynamics
from flexarm.kernels.cache import Entry
from flexarm.kernels.layout import ArmConstants, Sizes, new_workspace, run_time_sizes
from flexarm.kernels.newton_euler import inverse_dynamics
from flexarm.kernels.sensitivity import forward_jacobian

_FLOAT = np.dtype(np.float64)


class Entries(NamedTuple):
    """Sizes of an arm, and cached entry points into kernels for them."""

    sizes: Sizes
    forward: Entry  # forward_dynamics
    inverse: Entry  # inverse_dynamics
    jacobian: Entry  # forward_jacobian


_known: dict[tuple[int, ...], Entries] = {}


def entries_of(constants: ArmConstants) -> Entries:
    """Return the entry points for an arm, which all arms of the same sizes share.

    Their arrays have the same types: all are contiguous and may be written to.
    """
    sizes = run_time_sizes(constants)
    entries = Entries(
        sizes, Entry(forward_dynamics), Entry(inverse_dynamics), Entry(forward_jacobian)
    )
    return _known.setdefault(tuple(map(len, sizes)), entries)


def is_plain(value: object, shape: tuple[int, ...]) -> bool:
    """Return whether a value is an array of floats of a shape, which needs no conversion."""
    return type(value) is np.ndarray and value.dtype is _FLOAT and value.shape == shape


class Scratch:
    """Buffers for one evaluation: its three vectors as the kernels' arrays, and a workspace.

    Args:
        assembly: of the arm, n bodies of m modes.
        shape: of the array of the third vector, (n,) or (n, 1 + m).
        places: positions of the third vector's numbers in that array, flattened.

    Attributes:
        state: (2, n, 1 + m), of coordinates and rates. third: torques (n,) or accelerations
        (n, 1 + m). work: the workspace. more: further buffers of the caller.
    """

    __slots__ = ("_given", "_places", "more", "state", "third", "work")

    def __init__(self, assembly: Assembly, shape: tuple[int, ...], places: IntArray) -> None:
        n, width = assembly.bodies, 1 + assembly.modes
        rates, third = n * width, 2 * n * width
        self._given = np.zeros(third + int(np.prod(shape)))
        self.state = self._given[:third].reshape(2, n, width)
        self.third = self._given[third:].reshape(shape)
        q = assembly.coordinates
        self._places = _as_slice(q), _as_slice(q + rates), _as_slice(places + third)
        self.work = new_workspace(assembly.constants)
        self.more: Any = None

    def fill(self, q: FloatArray, qd: FloatArray, third: FloatArray) -> bool:
        """Place three vectors; return whether all their numbers are finite."""
        given, places = self._given, self._places
        given[places[0]] = q
        given[places[1]] = qd
        given[places[2]] = third
        return is_finite(given)


def _as_slice(places: IntArray) -> Any:
    """Return positions that follow each other as a slice, which is faster."""
    first = int(places[0]) if places.size else 0
    if np.array_equal(places, np.arange(first, first + places.size)):
        return slice(first, first + places.size)
    return places


def is_finite(array: FloatArray) -> bool:
    """Return whether all numbers are finite; sums or products of them would be faster, but warn."""
    return bool(np.count_nonzero(np.isfinite(array)) == array.size)
