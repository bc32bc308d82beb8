"""State of an arm after a change of its parameters: momentum, rates and energy.

The coordinates do not change, because positions have no time to. The rates follow from the mass
matrices before and after, M and M+; theory page "arms that change", (V.1) to (V.4).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem
from flexarm.integrate.base import FloatArray

#: Eigenvalues of the change of the mass matrix below this fraction of the matrix are rounding.
_ROUNDING = 1e-12
#: Relative difference of two mode shapes that is rounding.
_SAME_SHAPE = 1e-9


class ChangedState(NamedTuple):
    """State after a change, and the change of the arm's mechanical energy."""

    state: FloatArray  # (2, n, 1 + m)
    energy: float  # J, after minus before


def check_same_coordinates(path: str, before: Arm, after: Arm) -> None:
    """Raise if two arms do not have the same coordinates.

    Raises:
        InputError: if the number of coordinates, bodies or a mode shape of a link differs.
    """
    rule = "be a number that may change during a run"
    sizes = [(arm.dof, arm.assembly.bodies, arm.assembly.has_bristles) for arm in (before, after)]
    if sizes[0] != sizes[1]:
        hint = "The change adds or removes coordinates, bristles or an eccentric payload."
        raise InputError(Problem("changes", rule, repr(path), hint))
    for one, other in zip(before.assembly.pieces, after.assembly.pieces, strict=True):
        old, new = one.shapes.basis, other.shapes.basis
        if np.abs(new - old).max(initial=0.0) > _SAME_SHAPE * np.abs(old).max(initial=0.0):
            hint = f"It changes the mode shapes of link {one.link + 1}."
            raise InputError(Problem("changes", rule, repr(path), hint))


def after_change(
    before: Arm,
    remaining: Arm,
    after: Arm,
    state: FloatArray,
    free: NDArray[np.intp],
    impulse: FloatArray | float,
) -> ChangedState:
    """Return the state of an arm after its parameters have changed at one instant.

    Inertia that is removed takes its momentum with it, (V.2). The momentum of the remaining arm
    and that of added mass are those of the arm afterwards: M+ qd+ = M qd + impulse, (V.1).

    Args:
        remaining: the arm ``before`` without the inertia that is removed.
        state: (2, n, 1 + m) before the change.
        free: indices of the coordinates whose motion is not prescribed.
        impulse: (dof,) generalised momentum of the added mass, or 0.
    """
    q, qd = before.unpadded(state)
    M, M_after = remaining.mass_matrix(q), after.mass_matrix(q)
    rates = qd.copy()
    if _difference(M, M_after).any():
        missing = M @ qd + impulse - M_after @ qd
        rates[free] += np.linalg.solve(M_after[np.ix_(free, free)], missing[free])
    energy = after.energy(q, rates).total - before.energy(q, qd).total
    changed = after.padded(np.stack([q, rates]))
    if after.assembly.has_bristles:  # their deflection remains, in proportion to ``root``
        old, new = (arm.assembly.constants.bristles[:, 1] for arm in (before, after))
        changed[1, :, -1] = state[1, :, -1] * new / np.where(old > 0.0, old, 1.0)
        # Half the square is the energy of the bristles.
        energy += 0.5 * float(np.sum(changed[1, :, -1] ** 2 - state[1, :, -1] ** 2))
    return ChangedState(changed, energy)


def removes_inertia(path: str, before: Arm, after: Arm, state: FloatArray) -> bool:
    """Return whether a change of the number at a path removes inertia from the arm.

    It does if the mass matrix M+ - M has negative eigenvalues only, unless the number is a
    position, which moves inertia.
    """
    if ".offset" in path:
        return False
    q = before.unpadded(state)[0]
    values = _difference(before.mass_matrix(q), after.mass_matrix(q))
    return bool(values.any() and values.max() <= 0.0)


def _difference(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return the eigenvalues of the change of a mass matrix, relative to it; rounding is zero."""
    scale = 1.0 / np.sqrt(np.diag(after))
    values = np.linalg.eigvalsh((after - before) * np.outer(scale, scale))
    found: FloatArray = np.where(np.abs(values) > _ROUNDING * len(values), values, 0.0)
    return found


def payload_impulse(arm: Arm, state: FloatArray, mass: float, velocity: FloatArray) -> FloatArray:
    """Return the generalised momentum (dof,) of a mass at the payload's centre of mass, (V.3).

    Args:
        state: (2, n, 1 + m). mass: kg. velocity: (2,) m/s, world axes.
    """
    q, offset = arm.unpadded(state)[0], np.array(arm.spec.payload.offset)
    angle = arm.tip(q)[2]
    lever = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ offset
    rows = np.array([arm.tip_velocity(q, unit) for unit in np.eye(arm.dof)])
    J = rows[:, :2] + np.outer(rows[:, 2], [-lever[1], lever[0]])
    found: FloatArray = mass * (J @ velocity)
    return found
