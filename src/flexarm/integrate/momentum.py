"""Momentum of a mechanism on which nothing external acts, kept at steps and samples.

Runge-Kutta methods do not conserve momentum, because it is not linear in coordinates and rates. The
correction with the least kinetic energy is a rigid motion of the whole mechanism, which the three
rates of the free base describe; theory page "mechanisms", (M.9).
"""

from __future__ import annotations

from typing import Any

from flexarm.integrate.base import System
from flexarm.integrate.closures import close_state
from flexarm.integrate.memory import KEPT, MOMENTUM_W, MOMENTUM_X, MOMENTUM_Y, Memory
from flexarm.kernels.columns import IS_FREE, MULTIPLIER
from flexarm.kernels.compilation.cache import apart, merged
from flexarm.kernels.compilation.numbers import real
from flexarm.kernels.layout import Array
from flexarm.kernels.recursion.newton_euler import inverse_dynamics


@merged
def is_alone(system: System) -> bool:
    """Return whether nothing external acts on a mechanism whose base is free."""
    drive = system.drive
    acting = drive.loads.body.shape[0] + drive.loads.contacts.body.shape[0]
    acting += drive.factor_coefficients.shape[2]
    return bool(acting == 0 and real(system.constants.arm[IS_FREE]) > 0.0)


@merged
def _along_base(system: System, state: Array, acceleration: Array) -> Any:
    """Return the forces on the coordinates of the base of accelerations of a mechanism at rest."""
    loads, work = system.drive.loads, system.work
    inverse_dynamics(system.sizes, system.constants, state, acceleration, loads, work)
    return work.force[0, 0], work.force[1, 0], work.force[2, 0]


@apart
def keep_momentum(system: System, memory: Memory, state: Array) -> None:
    """Correct the rates of the base in a state (2, n, 1 + m) to the momentum at the first call."""
    sizes, clock = system.sizes, memory.clock
    rates = memory.spare
    for c in range(len(sizes.closures)):  # their forces cancel
        system.work.closure[c, MULTIPLIER] = 0.0
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            rates[i, j] = state[1, i, j]
            state[1, i, j] = 0.0
    x, y = state[0, 0, 0], state[0, 1, 0]
    px, py, turn = _along_base(system, state, rates)
    turn += x * py - y * px  # about the origin of the world
    unit = system.work.acceleration  # scratch
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            unit[i, j] = 0.0
    unit[0, 0] = 1.0
    mass, _, _ = _along_base(system, state, unit)
    unit[0, 0] = 0.0
    unit[2, 0] = 1.0
    ax, ay, inertia = _along_base(system, state, unit)
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            state[1, i, j] = rates[i, j]
    if clock[KEPT] == 0.0:
        clock[KEPT] = 1.0
        clock[MOMENTUM_X] = real(px)
        clock[MOMENTUM_Y] = real(py)
        clock[MOMENTUM_W] = real(turn)
        return
    # Missing momentum: in x and y, and about the origin of the base.
    dx = clock[MOMENTUM_X] - px
    dy = clock[MOMENTUM_Y] - py
    about = clock[MOMENTUM_W] - turn - x * dy + y * dx
    spin = (about - (ax * dx + ay * dy) / mass) / (inertia - (ax * ax + ay * ay) / mass)
    state[1, 2, 0] += spin
    state[1, 0, 0] += (dx - ax * spin) / mass
    state[1, 1, 0] += (dy - ay * spin) / mass


@merged
def keep_sample(system: System, memory: Memory, sample: Array, alone: bool) -> None:
    """Move a sample inside a step onto closures, and to the momentum of a mechanism ``alone``."""
    if len(system.sizes.closures) > 0:
        close_state(
            system.sizes, system.constants, sample, memory.torque, system.drive.loads, system.work
        )
    if alone:
        keep_momentum(system, memory, sample)
