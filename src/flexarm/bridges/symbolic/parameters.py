"""Constants of an arm as functions of parameters, which are identified by paths in its file.

The formulas are those of `constants_at`. A number of a link that changes the mode shapes has none
and is rejected.

Each formula is verified numerically: the parameter is multiplied by four, and the constants from
the formula are compared with those of an arm with the changed number.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.coordinates import check_joint
from flexarm.arm.stations import place_gauges
from flexarm.base.arguments import check_list_of
from flexarm.base.errors import InputError, Problem, shown
from flexarm.bridges.symbolic.kernel_calls import KernelCalls
from flexarm.linear.statics.gaps import warn_of_bristles
from flexarm.linear.step_derivatives.parameters import constants_at
from flexarm.model.paths import number_at, number_paths, with_number

#: Relative tolerance for rounding between formula and arm. Both start from the same numbers, and a
#: factor of four is exact in binary, but the computation of sections rounds.
_ROUNDING = 1e-9
_MOST_LISTED = 12


class ParametricArm:
    """Arm whose constants are functions of parameters, with prescribed joints by number.

    ``nominal`` (k,) are the values of the parameters in the arm. A path must have an exact formula.
    """

    def __init__(self, arm: Arm, paths: Sequence[str], prescribed: Sequence[int]) -> None:
        self.arm = arm
        self.paths = tuple(check_list_of("parameters", paths, str))
        names = [f"parameters[{k}]" for k in range(len(self.paths))]
        self.nominal = np.array(
            [number_at(name, arm.spec, path) for name, path in zip(names, self.paths, strict=True)]
        )
        for k, path in enumerate(self.paths):
            if path in self.paths[:k]:
                raise InputError(Problem(names[k], f"repeats {path}"))
            if not _is_exact(arm, path):
                raise _not_exact(names[k], arm, path)
        self._free = _free(arm, prescribed)
        warn_of_bristles(arm, "the exported model")

    def at(self, values: Sequence[Any]) -> KernelCalls:
        """Return the kernels for values of the parameters, `Scalar` objects or numbers."""
        given = dict(zip(self.paths, values, strict=True))
        constants, rows = constants_at(self.arm, given)
        bodies = place_gauges(self.arm, self.arm.gauges)[1]
        return KernelCalls(self.arm, constants, bodies, rows, self._free)


def _is_exact(arm: Arm, path: str) -> bool:
    """Return whether the constants by formula equal those of an arm with another value."""
    value = number_at("", arm.spec, path)
    for other in (4.0 * value, 0.25 * value) if value else (0.25, -0.25):
        try:
            changed = Arm(with_number(arm.spec, path, other))
        except InputError:  # the model limits this number on one side
            continue
        constants, rows = constants_at(arm, {path: other})
        places = arm.assembly.coordinates, changed.assembly.coordinates
        exact = (*changed.assembly.constants, place_gauges(changed, changed.gauges)[0])
        return np.array_equal(*places) and all(
            _agree(found.astype(np.float64), expected)
            for found, expected in zip((*constants, rows), exact, strict=True)
        )
    return False


def _agree(found: FloatArray, expected: FloatArray) -> bool:
    if found.shape != expected.shape:
        return False
    difference = np.abs(found - expected)
    # Scale by the column, which has one unit, because small entries may be rounding of larger ones.
    scale = np.abs(expected)
    if expected.ndim > 1:
        scale = scale.max(axis=tuple(range(expected.ndim - 1)), initial=0.0)
    return bool(np.all(difference <= _ROUNDING * scale))


def _not_exact(name: str, arm: Arm, path: str) -> InputError:
    rule = "be a parameter whose effect on the equations has a closed form"
    if number_at(name, arm.spec, path) == 0.0:
        hint = "It is 0 in this arm: the equations omit its terms, or no other value is valid."
        return InputError(Problem(name, rule, shown(path), hint))
    root = path.partition(".")[0]
    near = [p for p in number_paths(arm.spec) if p.partition(".")[0] == root]
    possible = [p for p in near[:64] if _is_exact(arm, p)]
    listed = ", ".join(possible[:_MOST_LISTED]) or "none"
    hint = (
        f"It changes the form of the modes of a link, or moves a gauge. Possible for {root}: "
        f"{listed}. For other values create another Arm."
    )
    return InputError(Problem(name, rule, shown(path), hint))


def _free(arm: Arm, prescribed: Sequence[int]) -> FloatArray:
    """Return which joints are free, (n,) by bodies: 1, or 0 if prescribed or fixed."""
    free = arm.assembly.constants.free.copy()
    for k, joint in enumerate(check_list_of("prescribed", prescribed, int)):
        free[arm.assembly.joint_body[check_joint(arm, f"prescribed[{k}]", joint)]] = 0.0
    return free
