"""Packs of eight float64 as a number type of the kernels, for eight runs at once.

A kernel that is called with ``Packs`` arrays instead of arrays of numbers computes all lanes
together: one operation is one vector instruction, or a few on processors with narrow vectors. No
operation combines lanes, so that a lane does not depend on the others.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexarm.kernels.compilation.cache import KernelIntrinsic, before_compiling
from flexarm.kernels.compilation.library import Blocks

#: Number of lanes of a pack.
LANES = 8
#: ``Packs`` in a kernel, where they act as arrays.
PackArray = Any


class Packs(Blocks):
    """Array whose last axis is the lanes; ``packs[i, j]`` is a pack in a kernel."""

    width = LANES

    @classmethod
    def of(cls, array: NDArray[np.float64]) -> Packs:
        """Return packs whose lanes all have the numbers of an array."""
        return cls(np.repeat(array[..., None], LANES, axis=-1))


@before_compiling
def _declare_packs() -> None:
    import_module("flexarm.kernels.compilation.pack_types")


#: ``chosen(mask, first, second)``: the pack ``first`` in lanes in which ``mask`` is positive,
#: otherwise ``second``.
chosen: Any = KernelIntrinsic("pack_types", "chosen")
#: ``fill_lane(packs, lane, rows, row)`` copies ``rows[row]`` into a lane of ``packs``; an array of
#: numbers is left as it is.
fill_lane: Any = KernelIntrinsic("pack_types", "fill_lane")
