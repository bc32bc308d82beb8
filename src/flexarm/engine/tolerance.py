"""Error tolerances of the coordinates, measured in metres at the tip of the arm."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from flexarm.arm import Arm
from flexarm.assembly.kernel_view import KernelView
from flexarm.integrate.base import FloatArray, Tolerance

#: Weight of a mode's own amplitude: a mode that hardly moves the tip still bends the link.
_INTERIOR = 0.1
_POWER_ITERATIONS = 40

#: ``Tolerance.unit`` of each arm, and the frequency computed last, with its posture.
_units: WeakKeyDictionary[Arm, FloatArray] = WeakKeyDictionary()
_frequencies: WeakKeyDictionary[Arm, tuple[bytes, float]] = WeakKeyDictionary()


def tolerance_of(arm: Arm, state: FloatArray, absolute: float, relative: float) -> Tolerance:
    """Return the tolerance of a run that starts at ``state`` (2, n, 1 + m).

    A joint angle moves the tip by the outboard reach; a mode moves it by its tip deflection and by
    its tip slope times the reach beyond. Rates are scaled to displacements by the mode's own
    frequency.
    """
    unit = _units.get(arm)
    if unit is None:
        unit = _units[arm] = _unit(arm)
    return Tolerance(absolute, relative, unit.copy(), fastest_frequency(arm, state))


def _unit(arm: Arm) -> FloatArray:
    """Return coordinates and rates (2, n, 1 + m) per metre of tip displacement."""
    c = arm.assembly.constants
    n, m = c.S.shape
    reach = np.cumsum(c.length[::-1])[::-1]
    beyond = np.append(reach[1:], 0.0)
    unit = np.ones((2, n, 1 + m))
    unit[0, :, 0] = 1.0 / np.maximum(reach, 1e-3 * reach[0])
    real = c.w2 > 0.0
    # A massless body (a lever, or the motor side of an elastic joint) has no modes.
    interior = _INTERIOR / np.sqrt(np.where(c.mass > 0.0, c.mass, 1.0))
    amplitude = np.abs(c.P) + np.abs(c.dP) * beyond[:, None] + interior[:, None]
    unit[0, :, 1:] = np.where(real, 1.0 / amplitude, 1.0)
    frequency = np.sqrt(np.where(real, c.w2, 1.0))
    unit[1, :, 1:] = unit[0, :, 1:] * frequency
    slowest = float(frequency[real].min()) if real.any() else 1.0
    unit[1, :, 0] = unit[0, :, 0] * slowest
    return unit


def fastest_frequency(arm: Arm, state: FloatArray) -> float:
    """Estimate the highest frequency (rad/s) at a posture, from below, within a few per cent.

    The result is at least 1 rad/s. A run that starts at the same posture as the previous run of
    the arm reuses its frequency.
    """
    c = arm.assembly.constants
    if not (np.any(c.w2) or np.any(c.joint_stiffness)):
        return 1.0
    posture = state[0].tobytes()
    known = _frequencies.get(arm)
    if known is None or known[0] != posture:
        known = _frequencies[arm] = posture, _power_iteration(arm, state)
    return known[1]


def _power_iteration(arm: Arm, state: FloatArray) -> float:
    """Estimate the highest frequency by power iteration on the stiffness of the accelerations."""
    c = arm.assembly.constants
    kernels, no_torque = KernelView(c), np.zeros(c.mass.size)
    at_rest = np.zeros_like(state)
    at_rest[0] = state[0]
    moved, origin = at_rest.copy(), kernels.forward_dynamics(at_rest, no_torque).copy()
    direction = np.zeros_like(origin)
    direction[:, 1:] = np.sqrt(c.w2)
    direction[:, 0] = np.sqrt(c.joint_stiffness)
    flat, fixed = direction.reshape(-1), np.flatnonzero(c.free == 0.0)
    # Compute the norm as np.linalg.norm does, without the overhead of its checks.
    length = np.sqrt(flat.dot(flat))
    for _ in range(_POWER_ITERATIONS):
        # The displacement is small enough to stay linear and large compared with rounding.
        direction *= 1e-6 / length
        np.add(at_rest[0], direction, out=moved[0])
        np.subtract(kernels.forward_dynamics(moved, no_torque), origin, out=direction)
        if fixed.size:
            direction[fixed, 0] = 0.0
        length = np.sqrt(flat.dot(flat))
    return max(1.0, float(np.sqrt(length / 1e-6)))
