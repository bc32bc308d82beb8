"""How much each coordinate may err: errors are measured in metres at the tip of the arm."""

from __future__ import annotations

import numpy as np

from flexarm.arm import Arm
from flexarm.integrate.base import FloatArray, Tolerance
from flexarm.kernels.articulated_body import forward_dynamics
from flexarm.kernels.layout import new_workspace, no_loads, run_time_sizes

#: A mode that hardly moves the tip still bends the link: its own amplitude counts this much.
_INTERIOR = 0.1
_POWER_ITERATIONS = 40


def tolerance_of(arm: Arm, state: FloatArray, absolute: float, relative: float) -> Tolerance:
    """Make the tolerance of a run that starts at ``state`` (2, n, 1 + m).

    A joint angle moves the tip by the outboard reach; a mode by its deflection there and its slope
    times the reach beyond. Rates are weighed as displacements at the mode's own frequency.
    """
    c = arm.assembly.constants
    n, m = c.S.shape
    reach = np.cumsum(c.length[::-1])[::-1]
    beyond = np.append(reach[1:], 0.0)
    unit = np.ones((2, n, 1 + m))
    unit[0, :, 0] = 1.0 / np.maximum(reach, 1e-3 * reach[0])
    real = c.w2 > 0.0
    # A body without mass, a lever or the motor's end of an elastic joint, has no modes.
    interior = _INTERIOR / np.sqrt(np.where(c.mass > 0.0, c.mass, 1.0))
    amplitude = np.abs(c.P) + np.abs(c.dP) * beyond[:, None] + interior[:, None]
    unit[0, :, 1:] = np.where(real, 1.0 / amplitude, 1.0)
    frequency = np.sqrt(np.where(real, c.w2, 1.0))
    unit[1, :, 1:] = unit[0, :, 1:] * frequency
    slowest = float(frequency[real].min()) if real.any() else 1.0
    unit[1, :, 0] = unit[0, :, 0] * slowest
    return Tolerance(absolute, relative, unit, fastest_frequency(arm, state))


def fastest_frequency(arm: Arm, state: FloatArray) -> float:
    """Estimate the highest frequency (rad/s) at a posture, from below, within a few per cent.

    Power iteration on the change of the accelerations by a change of the coordinates; at least 1.
    """
    c = arm.assembly.constants
    if not (np.any(c.w2) or np.any(c.joint_stiffness)):
        return 1.0
    sizes, work = run_time_sizes(c), new_workspace(c)
    n = c.mass.size
    no_torque, unloaded = np.zeros(n), no_loads(c)
    at_rest = np.stack([state[0], np.zeros_like(state[0])])

    def accelerations(coordinates: FloatArray) -> FloatArray:
        moved = np.stack([coordinates, np.zeros_like(coordinates)])
        forward_dynamics(sizes, c, moved, no_torque, unloaded, work)
        return work.acceleration.copy()

    origin = accelerations(at_rest[0])
    direction = np.zeros_like(origin)
    direction[:, 1:] = np.sqrt(c.w2)
    direction[:, 0] = np.sqrt(c.joint_stiffness)
    square = 0.0
    for _ in range(_POWER_ITERATIONS):
        # Small enough to stay linear, large enough to stand clear of rounding.
        direction *= 1e-6 / np.linalg.norm(direction)
        change = accelerations(at_rest[0] + direction) - origin
        change[c.free == 0.0, 0] = 0.0
        square = float(np.linalg.norm(change)) / 1e-6
        direction = change
    return max(1.0, float(np.sqrt(square)))
