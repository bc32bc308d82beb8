"""Error tolerances of the coordinates, measured in metres at the tip of the arm."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from flexarm.arm import Arm
from flexarm.assembly.kernel_view import KernelView
from flexarm.histories.prescribed import constants_with
from flexarm.integrate.base import FloatArray, Tolerance
from flexarm.kernels.layout import ArmConstants
from flexarm.kernels.recursion.fastest_vibration import fastest_vibrations

#: Weight of a mode's own amplitude: a mode that hardly moves the tip still bends the link.
_INTERIOR = 0.1
#: Factor from the default tolerances to those of the second run through impacts on joint stops.
TIGHT = 1e-5

#: ``Tolerance.unit`` of each arm, its ``friction_rate`` by prescribed joints, and the frequency
#: computed last, with its posture.
_units: WeakKeyDictionary[Arm, FloatArray] = WeakKeyDictionary()
_friction: WeakKeyDictionary[Arm, dict[tuple[int, ...], float]] = WeakKeyDictionary()
_frequencies: WeakKeyDictionary[Arm, tuple[bytes, float]] = WeakKeyDictionary()


def tolerance_of(arm: Arm, state: FloatArray, absolute: float, relative: float) -> Tolerance:
    """Return the tolerance of a run that starts at ``state`` (2, n, 1 + m).

    A joint angle moves the tip by the outboard reach; a mode moves it by its tip deflection and by
    its tip slope times the reach beyond. Rates are scaled to displacements by the mode's own
    frequency.
    """
    return Tolerance(absolute, relative, tip_units(arm), fastest_frequency(arm, state))


def tip_units(arm: Arm) -> FloatArray:
    """Return ``Tolerance.unit`` of an arm, a copy."""
    unit = _units.get(arm)
    if unit is None:
        unit = _units[arm] = _unit(arm)
    return unit.copy()


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
    if arm.assembly.has_bristles:  # a deflection has the tolerance of the joint angle
        root = c.bristles[:, 1]
        unit[0, :, -1] = np.inf
        unit[1, :, -1] = np.where(root > 0.0, root * unit[0, :, 0], np.inf)
    return unit


def fastest_frequency(arm: Arm, state: FloatArray) -> float:
    """Estimate the highest frequency (rad/s) at a posture, from below, within a few per cent.

    The result is at least 1 rad/s. A run that starts at the same posture as the previous run of
    the arm reuses its frequency.
    """
    posture = state[0].tobytes()
    known = _frequencies.get(arm)
    if known is None or known[0] != posture:
        frequency = float(fastest_frequencies(arm, state[None])[0])
        known = _frequencies[arm] = posture, frequency
    return known[1]


def fastest_frequencies(arm: Arm, states: FloatArray) -> FloatArray:
    """Return ``fastest_frequency`` (k,) at the postures of states (k, 2, n, 1 + m)."""
    c = arm.assembly.constants
    found = np.ones(len(states))
    if np.any(c.w2) or np.any(c.joint_stiffness):
        kernels, torque = KernelView(c), np.zeros(c.mass.size)
        moved, change = kernels.zeros(2), kernels.zeros(2)
        kernels.call(
            fastest_vibrations, states, kernels.loads, kernels.work, moved, change, torque, found
        )
    return found


def friction_rate(arm: Arm, prescribed: tuple[int, ...] = ()) -> float:
    """Return the rate (1/s) at which friction stops the joint that it stops fastest.

    It is that of small motions of one joint from rest, with straight links and all joint angles
    zero; 0 without friction of a joint that is free.

    Args:
        prescribed: joints, by number from 1, whose motion is prescribed.
    """
    rates = _friction.setdefault(arm, {})
    if prescribed not in rates:
        rates[prescribed] = _friction_rate(constants_with(arm, prescribed))
    return rates[prescribed]


def _friction_rate(c: ArmConstants) -> float:
    coulomb, rise, _, smoothing, viscous, more_coulomb, more_viscous = c.friction.T
    slope = (coulomb + rise + 0.5 * more_coulomb) / smoothing + viscous + 0.5 * more_viscous
    kernels, torque, rates = KernelView(c), np.zeros(c.mass.size), [0.0]
    state = kernels.zeros(2)
    still = kernels.forward_dynamics(state, torque)[:, 0].copy()
    # Friction that holds does not settle: runs lock a joint that sticks.
    for i in np.flatnonzero(slope * c.free * (1.0 - c.holds)):
        torque[i] = 1.0
        rates.append(float(slope[i] * (kernels.forward_dynamics(state, torque)[i, 0] - still[i])))
        torque[i] = 0.0
    return max(rates)
