"""Constants of an arm as functions of several of its numbers, for filters that estimate them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import InputError, Problem, problems_of, shown
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.kernels.layout import ArmConstants
from flexarm.linear.step_derivatives.formulas import constants_at
from flexarm.model.paths import number_at, with_number

#: Relative change of a number (absolute if it is zero) for which formula and assembly must agree.
_PROBE = 1e-3
#: Relative tolerance of constants that are equal: rounding of eigenvectors, far below ``_PROBE``.
_SAME = 1e-7


class FreeParameters:
    """Constants of an arm for changed values of some of its numbers, with exact derivatives.

    Args:
        arm: the arm.
        paths: numbers of joints, payload, gravity, damping, and rigidities of whole links.
        name: name of the argument, for messages.

    Attributes:
        values: of the arm (p,).

    Raises:
        InputError: if a path is not that of a number, or the number changes mode shapes, points or
            coordinates of the arm.
    """

    def __init__(self, arm: Arm, paths: Sequence[str], name: str = "parameters") -> None:
        problems = [p for path in paths for p in problems_of(_check, arm, path, name)]
        if problems:
            raise InputError(*problems)
        self._arm, self._paths = arm, tuple(paths)
        self.values = np.array([number_at(name, arm.spec, path) for path in paths])
        self._exact = _complex(arm.assembly.constants)
        self._by = [self._slope(k) for k in range(len(paths))]
        # All numbers change at once, each by another fraction, so that products are noticed.
        moved = np.where(self.values, 0.1 * self.values, _PROBE) * (1.0 + np.arange(len(paths)))
        self._affine = _same(self._by_formula(moved), self._linear(moved))

    def at(
        self, changes: FloatArray | None = None
    ) -> tuple[ArmConstants, tuple[ArmConstants, ...]]:
        """Return the complex constants for changes (p,) of the numbers, by default zero.

        The second value has, for each number, the constants with its imaginary step ``STEP``.
        """
        changes = np.zeros(self.values.size) if changes is None else changes
        if not self._affine:
            steps = 1j * STEP * np.eye(len(self._paths))
            moved = tuple(self._by_formula(changes + step) for step in steps)
            return self._by_formula(changes), moved
        plain = self._linear(changes)
        return plain, tuple(
            ArmConstants(
                *(c if d is None else c + 1j * STEP * d for c, d in zip(plain, by, strict=True))
            )
            for by in self._by
        )

    def _linear(self, changes: FloatArray) -> ArmConstants:
        found = list(self._exact)
        for change, by in zip(changes, self._by, strict=True):
            if change:
                for k, slope in enumerate(by):
                    if slope is not None:
                        found[k] = found[k] + change * slope
        return ArmConstants(*found)

    def _by_formula(self, changes: Any) -> ArmConstants:
        values = dict(zip(self._paths, self.values + changes, strict=True))
        return constants_at(self._arm, values, complex)[0]

    def _slope(self, place: int) -> list[FloatArray | None]:
        """Return the derivatives of the arrays of constants, None for those that are zero."""
        step = np.zeros(len(self._paths), dtype=complex)
        step[place] = 1j * STEP
        slopes = [np.imag(array) / STEP for array in self._by_formula(step)]
        return [slope if np.any(slope) else None for slope in slopes]


def _check(arm: Arm, path: str, name: str) -> None:
    """Raise unless the constants depend on a number by formulas that leave all points unchanged.

    Raises:
        InputError: as in ``FreeParameters``.
    """
    value = number_at(name, arm.spec, path)
    other = value * (1.0 + _PROBE) if value else _PROBE
    changed = Arm(with_number(arm.spec, path, other))
    found, rows = constants_at(arm, {path: other}, float)
    before, gauges = arm.assembly.constants, constants_at(arm, {}, float)[1]
    moved = rows - gauges, found.length - before.length, found.S - before.S
    alike = all(np.array_equal(one, two) for one, two in zip(before, found, strict=True))
    # Without an effect here, a number is a place of a gauge; q and qd do not contain bristles.
    if ".bristle_" in path or (alike and not np.any(rows - gauges)):
        rule = "have an effect on the model of a filter"
        raise InputError(Problem(name, rule, shown(path)))
    if _same(changed.assembly.constants, found) and not any(np.any(part) for part in moved):
        return
    rule = (
        "be a number of the joints, the payload, gravity, damping or the rigidity of a whole link"
    )
    hint = "" if value else "It is 0 in this arm, so that the equations may omit its terms."
    raise InputError(Problem(name, rule, shown(path), hint))


def _same(one: ArmConstants, other: ArmConstants) -> bool:
    return all(
        a.shape == b.shape and np.all(np.abs(a - b) <= _SAME * _largest(a))
        for a, b in zip(one, other, strict=True)
    )


def _largest(array: FloatArray) -> FloatArray:
    """Return the largest magnitude of each column, which is one kind of number."""
    found: FloatArray = np.max(np.abs(array), axis=tuple(range(array.ndim - 1)), initial=0.0)
    return found


def _complex(constants: ArmConstants) -> ArmConstants:
    return ArmConstants(*(array.astype(complex) for array in constants))
