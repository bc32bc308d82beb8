"""Grid of design postures, and interpolation between them."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.base.arguments import as_list
from flexarm.base.errors import InputError, Problem, check_array, shown
from flexarm.control.hardware.measurement import FloatArray


class PostureGrid:
    """Grid over some of the joint angles; the others are constant.

    Args:
        posture: (joints,) rad, of the angles that are constant.
        schedule: for each joint None, or its increasing angles in the grid; None for one posture.

    Attributes:
        postures: (k, joints) rad of all nodes.
        axes: for each joint with several angles, its place, its angles, and the distance of nodes.

    Raises:
        InputError: if angles do not increase, or ``schedule`` does not have one entry per joint.
    """

    def __init__(self, posture: FloatArray, schedule: Sequence[ArrayLike | None] | None) -> None:
        joints = len(posture)
        listed = [None] * joints if schedule is None else as_list(schedule)
        axes = listed or []
        if listed is None or len(axes) != joints:
            rule = f"have one entry for each of the {joints} joints"
            raise InputError(Problem("schedule", rule, shown(schedule)))
        values: list[list[float]] = []
        for k, axis in enumerate(axes):
            angles = posture[k : k + 1] if axis is None else axis
            found = check_array(f"schedule[{k}]", angles, (-1,))
            if found.size == 0 or np.any(np.diff(found) <= 0.0):
                rule = "be one or more angles in increasing order"
                raise InputError(Problem(f"schedule[{k}]", rule, shown(axis)))
            values.append(found.tolist())
        self.postures = np.array(list(product(*values)))
        strides = np.cumprod([1, *(len(v) for v in values[:0:-1])])[::-1]
        self.axes = [
            (k, v, int(stride))
            for k, (v, stride) in enumerate(zip(values, strides, strict=True))
            if len(v) > 1
        ]

    def weights(self, angle: FloatArray) -> list[tuple[int, float]]:
        """Return nodes and their weights: linear in each angle, constant outside the grid."""
        corners = [(0, 1.0)]
        for k, values, stride in self.axes:
            a = float(angle[k])
            i = min(max(bisect_right(values, a) - 1, 0), len(values) - 2)
            part = min(max((a - values[i]) / (values[i + 1] - values[i]), 0.0), 1.0)
            corners = [
                (node + (i + step) * stride, weight * share)
                for node, weight in corners
                for step, share in ((0, 1.0 - part), (1, part))
                if share > 0.0
            ]
        return corners


class Interpolated:
    """Arrays that are given at the nodes of a grid and interpolated together.

    Args:
        grid: the grid. nodes: the arrays of each node, of equal shapes.

    Attributes:
        values: (k, numbers) of all arrays, at each node. shapes: of the arrays.
        arrays: at the last posture, overwritten by ``at``.
    """

    def __init__(self, grid: PostureGrid, nodes: Sequence[Sequence[FloatArray]]) -> None:
        self.grid = grid
        self.values = np.array([np.concatenate([a.ravel() for a in node]) for node in nodes])
        self.shapes = [array.shape for array in nodes[0]]
        self._begin()

    def _begin(self) -> None:
        self._now = self.values[0].copy()
        self._at: list[tuple[int, float]] | None = None
        self.arrays: list[FloatArray] = []
        start = 0
        for shape in self.shapes:
            size = math.prod(shape)
            self.arrays.append(self._now[start : start + size].reshape(shape))
            start += size

    def __getstate__(self) -> tuple[Any, ...]:
        return self.grid, self.values, self.shapes

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        # Rebuild the arrays, because copies of them would not be views of the buffer of ``move``.
        self.grid, self.values, self.shapes = state
        self._begin()

    def at(self, angle: FloatArray) -> list[FloatArray]:
        """Return the arrays at a posture, which the next call overwrites."""
        corners = self.grid.weights(angle)
        if corners != self._at:
            self._at = corners
            first, weight = corners[0]
            np.multiply(self.values[first], weight, out=self._now)
            for node, weight in corners[1:]:
                self._now += weight * self.values[node]
        return self.arrays

    def first_at(self, angles: FloatArray) -> FloatArray:
        """Return the first array at postures (T, joints), with shape (T, ...)."""
        if len(self.values) == 1:
            return np.broadcast_to(self.arrays[0], (len(angles), *self.arrays[0].shape))
        return np.array([self.at(angle)[0].copy() for angle in angles])
