"""Stable step length of Cowell's method, and the modes that it does not resolve.

Theory page "integration", below (I.8). ``stiff`` (n, 1 + m) is 1.0 for a mode that is integrated
by the trapezoidal rule, else 0.0. ``bounds`` (5,) contains the largest squared frequency
(rad^2/s^2) and the largest damping rate (1/s) found last, the step (s) for which they were found,
or infinity if no mode was stiff, and the first two for the straight posture alone.
"""

from __future__ import annotations

import math

import numpy as np

from flexarm.integrate.base import System
from flexarm.integrate.multistep.cowell_formulas import BETA, GAMMA, STIFF_BETA, STIFF_GAMMA
from flexarm.kernels.columns import FREE, JOINT_DAMPING, JOINT_STIFFNESS, MODE_DAMPING, W2
from flexarm.kernels.compilation.cache import apart, merged
from flexarm.kernels.compilation.numbers import real
from flexarm.kernels.layout import ArmConstants, Array
from flexarm.kernels.recursion.articulated_body import implicit_dynamics
from flexarm.kernels.recursion.fastest_vibration import modal_size
from flexarm.kernels.recursion.implicit_step import add_to_diagonal

#: Numerov's formula is stable for squared frequencies times h^2 of up to 6. The estimate of the
#: highest frequency is a lower bound, which requires a margin.
_STABLE = 5.0
#: The same limit (rad^2) for short spans with many restarts. The rate (I.6) at the end of a span,
#: which starts the next one, makes vibrations grow: by 2 per cent at most at this limit, by a fifth
#: to a half if it is about 4.
_RESTARTED = 1.5
#: Spans with fewer steps than this are short.
_LONG = 500.0
#: Largest h times damping rate of a coordinate, from the eigenvalues of (I.5) with (I.6).
_DAMPED = 1.3
#: Square of twice the damping ratio above which an unresolved mode decays quickly.
_DYING = 0.16
_ITERATIONS = 25
#: The frequencies change with the posture during a run. They are not computed again below this
#: fraction of the stability limit.
_NEAR = 0.5


@apart
def _largest(
    system: System, stiff: Array, of_damping: bool, state: Array, bent: float, rest: Array,
    direction: Array, unforced: Array, torque: Array,
) -> float:  # fmt: skip
    """Return a lower bound of the largest squared frequency, or damping rate, without stiff modes.

    The coordinates of the state are multiplied by ``bent``. The method is power iteration. It is
    necessary on fine meshes, where the residual inertia of (R.7) is so small that even the
    stiffness of slow modes causes a fast vibration of a joint against its link.
    """
    sizes, work = system.sizes, system.work
    c, force = system.constants, work.force
    for i in range(len(sizes.bodies)):
        torque[i] = 0.0
        for j in range(1 + len(sizes.modes)):
            rest[0, i, j] = bent * state[0, i, j]
            rest[1, i, j] = 0.0
            force[i, j] = 0.0
    implicit_dynamics(sizes, c, rest, force, torque, system.drive.loads, work)
    unit = modal_size(sizes, c)
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            unforced[i, j] = work.acceleration[i, j]
            direction[i, j] = 1.0 if j == 0 else unit
    square: float = 0.0
    for _ in range(_ITERATIONS):
        size: float = 0.0
        for i in range(len(sizes.bodies)):
            size += real(direction[i, 0]) ** 2
            for j in range(len(sizes.modes)):
                size += (real(direction[i, 1 + j]) / unit) ** 2
        square = math.sqrt(size)
        if square == 0.0:
            return 0.0
        for i in range(len(sizes.bodies)):
            pull = c.body[i, JOINT_DAMPING] if of_damping else c.body[i, JOINT_STIFFNESS]
            torque[i] = -c.body[i, FREE] * pull * direction[i, 0] / square
            for j in range(len(sizes.modes)):
                pull = c.mode[i, j, MODE_DAMPING] if of_damping else c.mode[i, j, W2]
                pull *= 1.0 - stiff[i, 1 + j]
                force[i, 1 + j] = -pull * direction[i, 1 + j] / square
        implicit_dynamics(sizes, c, rest, force, torque, system.drive.loads, work)
        for i in range(len(sizes.bodies)):
            for j in range(1 + len(sizes.modes)):
                direction[i, j] = work.acceleration[i, j] - unforced[i, j]
    return square


@merged
def _stable_step(square: float, rate: float, stable: float) -> float:
    """Return the longest h with h^2 square / stable + h rate / _DAMPED <= 1; zero: no limit."""
    half = 0.5 * rate / _DAMPED
    root = math.sqrt(half * half + square / stable)
    return 1.0 / (half + root) if half + root > 0.0 else 0.0


@apart
def longest_step(
    system: System, state: Array, rest: Array, known: Array, torque: Array, stiff: Array,
    bounds: Array, h: float, span: float,
) -> float:  # fmt: skip
    """Find the modes that are stiff at steps of h; return h, or a shorter stable step.

    ``span`` (s) is the duration of the steps. The straight posture is also checked, because the arm
    may reach it and straight arms vibrate fastest. ``rest`` and ``known`` (2, n, 1 + m) and
    ``torque`` are scratch.
    """
    sizes = system.sizes
    c = system.constants
    found_for = math.inf
    damped = 0.0
    for i in range(len(sizes.bodies)):
        stiff[i, 0] = 0.0
        damped = max(damped, real(c.body[i, JOINT_DAMPING]))
        for j in range(len(sizes.modes)):
            dying = (
                c.mode[i, j, MODE_DAMPING] * c.mode[i, j, MODE_DAMPING] > _DYING * c.mode[i, j, W2]
            )
            part = h * h * c.mode[i, j, W2] / _STABLE + h * c.mode[i, j, MODE_DAMPING] / _DAMPED
            stiff[i, 1 + j] = 1.0 if dying and part > 1.0 else 0.0
            if stiff[i, 1 + j] != 0.0:
                found_for = h
            else:
                damped = max(damped, real(c.mode[i, j, MODE_DAMPING]))
    part = h * h * bounds[0] / _RESTARTED + h * bounds[1] / _DAMPED
    if bounds[2] == found_for and part < _NEAR:
        return h
    # Typed constants: with literals, the compiler would build each callee for every value.
    damping = bool(np.bool_(True))
    stiffness = bool(np.bool_(False))
    straight_too = bounds[2] != found_for  # otherwise computed for an earlier span
    bounds[2] = found_for
    for k in range(2):
        if k == 0 and not straight_too:
            continue
        bounds[0] = _largest(
            system, stiff, stiffness, state, float(k), rest, known[0], known[1], torque
        )
        bounds[1] = 0.0
        if damped > 0.0:
            bounds[1] = _largest(
                system, stiff, damping, state, float(k), rest, known[0], known[1], torque
            )
        if k == 0:
            bounds[3] = bounds[0]
            bounds[4] = bounds[1]
    bounds[0] = max(bounds[0], bounds[3])
    bounds[1] = max(bounds[1], bounds[4])
    longest = _stable_step(bounds[0], bounds[1], _STABLE)
    if span < _LONG * min(h, longest):
        longest = _stable_step(bounds[0], bounds[1], _RESTARTED)
    # ``longest`` is zero without a limit, and NaN for a state that is not finite: keep h.
    return min(h, longest) if longest > 0.0 else h


@apart
def soften(system: System, softened: ArmConstants, stiff: Array, h: float) -> None:
    """Add the implicit parts of springs, bending and damping at steps of h to the mass matrix."""
    sizes = system.sizes
    c, added = system.constants, system.work.force
    for i in range(len(sizes.bodies)):
        for j in range(1 + len(sizes.modes)):
            damping = c.body[i, JOINT_DAMPING] if j == 0 else c.mode[i, j - 1, MODE_DAMPING]
            stiffness = c.body[i, JOINT_STIFFNESS] if j == 0 else c.mode[i, j - 1, W2]
            beta = BETA
            gamma = GAMMA
            if stiff[i, j] != 0.0:
                beta = STIFF_BETA
                gamma = STIFF_GAMMA
            added[i, j] = h * gamma * damping + h * h * beta * stiffness
    add_to_diagonal(sizes, c, added, softened)
