"""Dual numbers as a number type of the kernels: a value and its derivatives in eight directions.

A kernel that is called with ``Duals`` arrays computes values and derivatives together, by the chain
rule at every operation. The values are those of the kernel over float64. Comparisons, ``max``,
``min`` and ``abs`` decide by the values, and ``x.real`` is the value, so that step control and
other decisions are constants of the differentiation. The derivatives are one vector
(``packs.PACK``), so that eight directions cost little more than one.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexarm.kernels.compilation.cache import before_compiling
from flexarm.kernels.compilation.library import Blocks
from flexarm.kernels.compilation.packs import LANES

#: Number of directions of a dual number.
DIRECTIONS = LANES
#: ``Duals`` in a kernel, where they act as arrays.
DualArray = Any


class Duals(Blocks):
    """Array of dual numbers; the last axis of ``array`` is the value, then the derivatives."""

    width = 1 + DIRECTIONS

    @classmethod
    def of(cls, value: NDArray[Any], slopes: NDArray[Any] | None = None) -> Duals:
        """Return dual numbers; ``slopes`` (k, *shape of value): k <= ``DIRECTIONS`` derivatives."""
        duals = cls.zeros(*value.shape)
        duals.array[..., 0] = value
        if slopes is not None:
            duals.array[..., 1 : 1 + len(slopes)] = np.moveaxis(slopes, 0, -1)
        return duals

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape without the axis of value and derivatives."""
        return self.array.shape[:-1]

    @property
    def value(self) -> NDArray[np.float64]:
        """The values."""
        return self.array[..., 0]

    @property
    def slopes(self) -> NDArray[np.float64]:
        """The derivatives (directions, *shape)."""
        return np.moveaxis(self.array[..., 1:], -1, 0)

    def copy(self) -> Duals:
        """Return a copy."""
        return Duals(self.array.copy())


def zeros_like(array: Any, *shape: int) -> Any:
    """Return zeros of the number type of ``array``: an array, or ``Duals``."""
    if isinstance(array, Duals):
        return Duals.zeros(*shape)
    return np.zeros(shape, dtype=array.dtype)


@before_compiling
def _declare_duals() -> None:
    import_module("flexarm.kernels.compilation.dual_types")
