"""Buffers that evaluations of the dynamics reuse from one call to the next."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from flexarm.arm.assembly.assemble import Assembly, FloatArray, IntArray
from flexarm.arm.assembly.kernel_view import KernelView

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
