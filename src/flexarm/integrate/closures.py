"""Projection of the end of a step onto the closures of a mechanism.

Theory page "mechanisms", (M.17), (M.18). Positions and rates move by the least amount in the norm
of the operator of the method: the mass matrix, or that of an implicit step. In the norm of the mass
matrix, a correction would move the fastest vibrations, whose forces an implicit step does not
resolve.
"""

from __future__ import annotations

from flexarm.integrate.base import System
from flexarm.integrate.memory import EVALUATIONS, Memory
from flexarm.kernels.columns import GAP, GAP_RATE
from flexarm.kernels.compilation.cache import apart, merged
from flexarm.kernels.compilation.numbers import real
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Workspace
from flexarm.kernels.recursion.articulated_body import forward_dynamics
from flexarm.kernels.recursion.closures import ROW_ANGLE, closure_gaps, closure_response, solve_rows

#: Most rounds of a projection. All have one matrix, so that each multiplies gaps by the distance of
#: its posture (rad). Rounds end when gaps no longer decrease, or after a decrease by so much that
#: only rounding errors are left.
_ROUNDS, _DONE = 12, 1e-6
#: Least pivot over the largest diagonal entry: 1e-10 is reached about 1e-5 rad before a singular
#: posture.
_DEPENDENT = 1e-10


@merged
def _largest(sizes: Sizes, work: Workspace, column: int) -> float:
    largest = 0.0
    rows = work.closure
    for c in range(len(sizes.closures)):
        largest = max(largest, abs(real(rows[c, column])))
    return largest


@merged
def _move(
    sizes: Sizes, constants: ArmConstants, state: Array, level: int, column: int, work: Workspace
) -> None:
    """Correct coordinates (level 0) or rates (1) by the gaps or their rates."""
    solve_rows(sizes, work, column)
    closure_response(sizes, constants, work)
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            state[level, i, j] += work.acceleration[i, j]


@apart
def close_state(
    sizes: Sizes, constants: ArmConstants, state: Array, torque: Array, loads: Loads,
    work: Workspace,
) -> None:  # fmt: skip
    """Move a state (2, n, 1 + m) onto the closures: positions first, then rates.

    ``torque`` (n,) and ``loads`` do not matter. ``constants`` may be those of an implicit step.
    """
    forward_dynamics(sizes, constants, state, torque, loads, work)
    _close(sizes, constants, state, work)


@merged
def _close(sizes: Sizes, constants: ArmConstants, state: Array, work: Workspace) -> None:
    """Move a state onto the closures with the operator of the last evaluation, close to it."""
    closure_gaps(sizes, constants, state, work)
    for level in range(2):
        column = GAP if level == 0 else GAP_RATE
        gap = _largest(sizes, work, column)
        for _ in range(_ROUNDS):
            _move(sizes, constants, state, level, column, work)
            closure_gaps(sizes, constants, state, work)
            before = gap
            gap = _largest(sizes, work, column)
            if not gap < 0.5 * before or gap < _DONE * before:
                break


@merged
def independence(system: System) -> float:
    """Return how independent closures are, after an evaluation at a posture: from 0 to 1.

    It is the least pivot of J M^-1 J' beside the largest diagonal entry, of an angle beside its
    own. It falls as the square of the distance (rad) from a posture in which they depend on each
    other.
    """
    work = system.work
    largest = 0.0
    least = 1.0
    for c in range(len(system.sizes.closures)):
        whole = real(work.reaction[c, c])
        for d in range(c):
            whole += real(work.reaction[c, d]) ** 2 * real(work.reaction[d, d])
        if system.sizes.ends[c, 0] == ROW_ANGLE:
            least = min(least, real(work.reaction[c, c]) / whole)
        else:
            largest = max(largest, whole)
    for c in range(len(system.sizes.closures)):
        if system.sizes.ends[c, 0] != ROW_ANGLE:
            least = min(least, real(work.reaction[c, c]) / largest)
    return least


@merged
def closures_depend(system: System) -> bool:
    """Return whether closures depend on each other, after an evaluation at a posture."""
    return not independence(system) > _DEPENDENT


@apart
def close_step(system: System, constants: ArmConstants, memory: Memory) -> None:
    """Move the end ``memory.new`` of an accepted step onto the closures.

    The last stage of the step was at or near its end, and has left its operator.
    """
    _close(system.sizes, constants, memory.new, system.work)
    memory.counts[EVALUATIONS] += 2  # which take as long
