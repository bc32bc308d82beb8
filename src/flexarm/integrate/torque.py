"""Right-hand side of the integrators: torque and loads at a time, and accelerations."""

from __future__ import annotations

from typing import Any

from flexarm.integrate.base import System
from flexarm.integrate.sticking import settle_next, sticks, take_directions, watch_slips
from flexarm.kernels.compilation.cache import compiled, merged
from flexarm.kernels.layout import Array
from flexarm.kernels.recursion.articulated_body import solve_forward


@merged
def piece_of(breaks: Array, t: float, from_left: bool) -> int:
    """Return the piece that contains time t; at a break the earlier one if ``from_left``."""
    low = 0
    high = breaks.shape[0] - 1
    share = (t - breaks[0]) / (breaks[high] - breaks[0])
    if high > 1 and 0.0 < share < 1.0:  # most breaks are evenly spaced: no search
        place: int = min(int(share * high), high - 1)
        if breaks[place] < t < breaks[place + 1]:
            return place
    while high - low > 1:
        middle = (low + high) // 2
        if breaks[middle] < t or (breaks[middle] == t and not from_left):
            low = middle
        else:
            high = middle
    return low


@merged
def piece_after(breaks: Array, t: float, piece: int) -> int:
    """Return the piece that contains t, searching from an earlier ``piece``; left at a break."""
    while piece < breaks.shape[0] - 2 and breaks[piece + 1] < t:
        piece += 1
    return piece


@compiled
def torque_at(system: System, t: float, from_left: bool, torque: Array) -> None:
    """Evaluate the drive's torque (n,) at time t."""
    torque_in(system, piece_of(system.drive.breaks, t, from_left), t, torque)


@merged
def torque_in(system: System, k: int, t: float, torque: Array) -> None:
    """Evaluate the drive's torque (n,) at time t, which must be in piece k."""
    drive = system.drive
    x = t - drive.breaks[k]
    for i in range(len(system.sizes.bodies)):
        torque[i] = drive.coefficients[k, 0, i] + x * (
            drive.coefficients[k, 1, i]
            + x * (drive.coefficients[k, 2, i] + x * drive.coefficients[k, 3, i])
        )


@merged
def loads_at(system: System, t: float, from_left: bool) -> None:
    """Set the loads and the base acceleration at time t."""
    loads = system.drive.loads
    loads_in(system.drive, t, from_left, loads.value, loads.base_acceleration)


@merged
def loads_in(drive: Any, t: float, from_left: bool, force: Array, base: Array) -> None:
    """Write the loads (k, 3) and the base acceleration (2,) of a drive at time t.

    ``drive``: a ``Drive``, or a ``LaneDrive``, whose fields for loads are the same.
    """
    count = drive.amplitude.shape[0]
    k = piece_of(drive.factor_breaks, t, from_left)
    x = t - drive.factor_breaks[k]
    for j in range(drive.factor_coefficients.shape[2]):
        value = drive.factor_coefficients[k, 0, j] + x * (
            drive.factor_coefficients[k, 1, j]
            + x * (drive.factor_coefficients[k, 2, j] + x * drive.factor_coefficients[k, 3, j])
        )
        if j < count:
            for p in range(3):
                force[j, p] = drive.amplitude[j, p] * value
        else:
            base[j - count] = value


@merged
def drive_at(system: System, t: float, from_left: bool, torque: Array) -> None:
    """Set torque, loads and base acceleration at time t."""
    torque_in(system, piece_of(system.drive.breaks, t, from_left), t, torque)
    if system.drive.factor_coefficients.shape[2] > 0:
        loads_at(system, t, from_left)


@merged
def rates_of(
    system: System,
    t: float,
    from_left: bool,
    state: Array,
    torque: Array,
    stages: Array,
    stage: int,
) -> None:
    """Write the time derivative of a state (2, n, 1 + m) into ``stages[stage]``."""
    sizes, work = system.sizes, system.work
    drive_at(system, t, from_left, torque)
    solve_forward(sizes, system.constants, state, torque, system.drive.loads, work)
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            stages[stage, 0, i, j] = state[1, i, j]
            stages[stage, 1, i, j] = work.acceleration[i, j]
    if len(sizes.joint_laws) > 0:
        watch_slips(system, t)
        for i in range(len(sizes.bodies)):
            if sticks(system, i):
                stages[stage, 1, i, 0] = 0.0


@compiled
def slope_at(
    system: System,
    t: float,
    from_left: bool,
    state: Array,
    torque: Array,
    stages: Array,
    stage: int,
    settles: bool,
) -> int:
    """Call ``rates_of`` without inlining it, where compile time is more important than speed.

    Args:
        settles: whether to decide which joints stick; otherwise as in the last decision.

    Returns:
        Number of evaluations: one, and one for each joint whose decision was changed.
    """
    if settles:
        take_directions(system, state)
    evaluations = 1
    while True:
        rates_of(system, t, from_left, state, torque, stages, stage)
        if not settles or not settle_next(system, state, evaluations):
            return evaluations
        evaluations += 1
