"""Tables of gains over the posture, which exported code interpolates in loops."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import reduce
from typing import Any

import casadi
import numpy as np

from flexarm.bridges.c_code.laws.long_memory import LongMemory
from flexarm.control.design.posture_grid import Interpolated


class GainTable(LongMemory):
    """Gains at the nodes of a grid of postures. The view is the gains at a posture.

    Args:
        path: attributes from the outermost controller to the one with the table.
        table: the table.

    Attributes:
        ends: (2, joints) rad, the first and the last posture of the grid.
    """

    size = 0

    def __init__(self, path: list[str], table: Interpolated) -> None:
        self._path = path
        self._shapes, self.ends = table._shapes, table._grid.postures[[0, -1]]
        self._grids = [np.array(values) for _, values, _ in table._grid._axes]
        self._joints = [joint for joint, _, _ in table._grid._axes]
        # The last joint of the grid changes fastest, in CasADi the first one. The grid of places,
        # 0, 1, 2 and so on, is searched by a division instead of a loop.
        places = [list(range(len(values))) for values in reversed(self._grids)]
        search = {"lookup_mode": ["exact"] * len(places)}
        self._lookup = casadi.interpolant("gains", "linear", places, table._values.ravel(), search)

    def trace(self, mine: Any, array: Callable[..., Any]) -> None:
        """See `LongMemory.trace`."""
        owner = reduce(getattr, self._path, mine)
        sizes = [int(np.prod(shape)) for shape in self._shapes]
        parts = np.split(array("view", sum(sizes)), np.cumsum(sizes)[:-1])
        arrays = [part.reshape(shape) for part, shape in zip(parts, self._shapes, strict=True)]
        owner._arrays = _Gains(arrays)
        if hasattr(owner, "_link"):
            owner._link()

    def stored(self, mine: Any) -> list[Any]:
        """Return the angles of the joints in the grid."""
        angle = reduce(getattr, self._path, mine)._arrays.angle
        return [angle[joint] for joint in self._joints]

    def _advance(
        self, call: Callable[..., dict[str, Any]], memory: Any
    ) -> tuple[dict[str, Any], Any]:
        none = casadi.MX.zeros(self._lookup.numel_out())
        angles = casadi.vertsplit(call(none, "stored")["stored"])
        pairs = zip(angles, self._grids, strict=True)
        places = [_place(angle, values) for angle, values in pairs]
        return call(self._lookup(casadi.vertcat(*reversed(places)))), memory


class _Gains:
    """Gains at a posture, instead of `Interpolated`."""

    def __init__(self, arrays: list[Any]) -> None:
        self.arrays = arrays

    def move(self, angle: Any) -> None:
        self.angle = angle


def _place(angle: Any, values: Any) -> Any:
    """Return the place of an angle in a grid, such as 1.5 between the second and the third."""
    parts = (angle - values[:-1]) / np.diff(values)
    return casadi.sum1(casadi.fmax(0.0, casadi.fmin(1.0, parts)))


def gain_table(controller: Any) -> GainTable | None:
    """Return the table of gains of a controller, or of a controller inside it; None without."""
    for depth, one in enumerate(around(controller)):
        table = getattr(one, "_arrays", None)
        if isinstance(table, Interpolated) and table._grid._axes:
            return GainTable(["inner"] * depth, table)
    return None


def around(controller: Any) -> Iterator[Any]:
    """Iterate over a controller, the controller inside it, and so on."""
    while controller is not None:
        yield controller
        controller = getattr(controller, "inner", None)
