"""Joints that friction holds at rest, in runs: which of them stick, and which way others slide.

Theory page "integration", below (I.4). A joint whose friction holds and whose rate is zero sticks,
unless the torque that it would transmit exceeds the breakaway torque. A sticking joint is locked by
an inertia beside which every other one vanishes: its acceleration is zero, and the inertia times
what the recursion computes for it is the torque that friction holds. A sliding joint has the
friction of its direction, until its rate crosses zero. So nothing jumps inside a step.

Which joints stick is a linear complementarity problem with bounds. Its matrix is a principal part
of the inverse of the mass matrix and so positive definite: changing the first joint that violates
its condition, again and again, ends at the only solution (Murty, Linear Algebra and its
Applications 7 (1974) 65-108).

The state alone decides, so that runs can pause, and states can be samples: rates of sticking
joints are exactly zero. The columns SMOOTHING_RATE, SLIDING, JOINT_ADDED, HELD_TORQUE and SLIP_TIME
of the constants of a run, which no other run uses, hold the decision.
"""

from __future__ import annotations

import math
from typing import Any

from flexarm.integrate.base import System
from flexarm.kernels.columns import (
    FREE,
    GEAR_RATIO,
    HELD_TORQUE,
    HOLDS,
    INERTIA,
    JOINT_ADDED,
    LENGTH,
    MASS,
    ROTOR_INERTIA,
    SLIDING,
    SLIP_TIME,
    SMOOTHING_RATE,
    TIP_INERTIA,
    TIP_MASS,
)
from flexarm.kernels.compilation.cache import apart, merged
from flexarm.kernels.compilation.numbers import real
from flexarm.kernels.forces.joint_law import breakaway
from flexarm.kernels.layout import Array

#: Argument of tanh whose value is 1 to the last bit: the sign of a sliding joint.
_SIGN = 40.0
#: Smoothing rate (rad/s) beside which every rate vanishes, so that SLIDING alone is the sign.
_NEVER = 1e300
#: Inertia of a locked joint, relative to that of the whole arm stretched out.
_LOCK = 1e20
#: Share of the breakaway torque by which a torque must exceed it to release the joint: a released
#: joint must not stick at once. Rounding errors of the torque are 1e-8 for stiff links.
SLACK = 1e-7
#: Largest number of changes at one instant. It is not reached: a joint that changes twice is rare.
_CHANGES = 64


@merged
def friction_holds(system: System, i: int) -> bool:
    """Return whether the friction of the joint of body i can hold it at rest."""
    c = system.constants
    most = real(breakaway(c, i, 0.0) + breakaway(c, i, 1.0))
    holds: bool = real(c.body[i, HOLDS] * c.body[i, FREE]) * most > 0.0
    return holds


@merged
def sticks(system: System, i: int) -> bool:
    """Return whether the joint of body i is locked."""
    locked: bool = real(system.constants.body[i, JOINT_ADDED]) > 0.0
    return locked


@merged
def _lock_inertia(system: System) -> float:
    """Return the inertia (kg m^2) of a locked joint."""
    c = system.constants
    length, mass, inertia = 0.0, 0.0, 0.0
    for i in range(len(system.sizes.bodies)):
        length += real(c.body[i, LENGTH])
        mass += real(c.body[i, MASS] + c.body[i, TIP_MASS])
        inertia += real(c.body[i, INERTIA] + c.body[i, TIP_INERTIA])
        ratio = real(c.body[i, GEAR_RATIO])
        inertia += ratio * ratio * real(c.body[i, ROTOR_INERTIA])
    return _LOCK * (inertia + mass * length * length)


@apart
def take_directions(system: System, state: Array) -> None:
    """Lock the joints that are at rest in a state (2, n, 1 + m), and set the sign of the others."""
    c = system.constants
    if len(system.sizes.joint_laws) > 0:
        lock = _lock_inertia(system)
        for i in range(len(system.sizes.bodies)):
            if not friction_holds(system, i):
                continue
            rate = real(state[1, i, 0])
            c.body[i, SMOOTHING_RATE] = _NEVER
            c.body[i, SLIDING] = 0.0
            c.body[i, JOINT_ADDED] = 0.0
            if rate != 0.0:
                c.body[i, SLIDING] = math.copysign(_SIGN, rate)
            else:
                c.body[i, JOINT_ADDED] = lock


@merged
def held_torque(system: System, i: int) -> Any:
    """Return the torque (N m) that a locked joint holds, after an evaluation of the dynamics."""
    return system.constants.body[i, JOINT_ADDED] * system.work.acceleration[i, 0]


@merged
def excess_torque(system: System, i: int, held: Any) -> Any:
    """Return by how much a torque (N m) exceeds the breakaway torque in its direction."""
    if real(held) < 0.0:
        return -held - breakaway(system.constants, i, 1.0)
    return held - breakaway(system.constants, i, 0.0)


@merged
def slips(system: System, i: int, held: float) -> bool:
    """Return whether a torque (N m) releases the joint of body i."""
    exceeds: bool = real(excess_torque(system, i, held)) > SLACK * abs(held)
    return exceeds


@apart
def watch_slips(system: System, t: float) -> None:
    """Set the time at which a locked joint slips, after an evaluation of the dynamics at t."""
    c = system.constants
    for i in range(len(system.sizes.bodies)):
        if sticks(system, i) and slips(system, i, real(held_torque(system, i))):
            c.body[i, SLIP_TIME] = min(real(c.body[i, SLIP_TIME]), t)


@merged
def begin_watch(system: System) -> None:
    """Forget the slips of the stages of the last step."""
    if len(system.sizes.joint_laws) > 0:
        for i in range(len(system.sizes.bodies)):
            if sticks(system, i):
                system.constants.body[i, SLIP_TIME] = math.inf


@apart
def _violation(system: System, state: Array) -> int:
    """Return the first body whose joint, at rest, slips though locked or turns back, or -1."""
    c = system.constants
    for i in range(len(system.sizes.bodies)):
        if real(state[1, i, 0]) != 0.0 or not friction_holds(system, i):
            continue
        if sticks(system, i):
            if slips(system, i, real(held_torque(system, i))):
                return i
        elif real(c.body[i, SLIDING]) * real(system.work.acceleration[i, 0]) < 0.0:
            return i
    return -1


@apart
def settle_next(system: System, state: Array, changes: int) -> bool:
    """Return whether the dynamics, evaluated last at a state, must be evaluated again.

    Call it after ``take_directions`` and each evaluation, with the number of ``changes`` so far.
    """
    c = system.constants
    if len(system.sizes.joint_laws) > 0:
        i = _violation(system, state)
        if i >= 0 and changes < _CHANGES:
            if sticks(system, i):
                c.body[i, SLIDING] = math.copysign(_SIGN, real(held_torque(system, i)))
                c.body[i, JOINT_ADDED] = 0.0
            else:
                c.body[i, SLIDING] = 0.0
                c.body[i, JOINT_ADDED] = _lock_inertia(system)
            return True
        for j in range(len(system.sizes.bodies)):
            if sticks(system, j):
                c.body[j, HELD_TORQUE] = held_torque(system, j)
    return False
