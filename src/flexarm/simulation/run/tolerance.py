"""Error tolerances of the coordinates, and the relative tolerance for an error that a user accepts.

Tolerances are measured by displacements of the tip of the arm.

One relative tolerance suits all methods. That of order 8, which most arms get, then errs far less,
because its steps are limited by stability: 18 undamped links under a step of force err by 0.01 to
0.05 of the request. That of order 5, which stiff arms get, adds the errors of all steps where
vibrations have no damping: on the same links by 0.7 of the request in the median, by 4 at most.
A run whose joints turn far or whose vibrations last is therefore compared with another one.
"""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import once_per_arm
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.integrate.base import FloatArray, Tolerance
from flexarm.kernels.layout import ArmConstants
from flexarm.kernels.recursion.fastest_vibration import fastest_vibrations
from flexarm.simulation.histories.loads import constants_with

#: Weight of a mode's own amplitude: a mode that hardly moves the tip still bends the link.
_INTERIOR = 0.1
#: Default relative tolerance: tip errors are near 1e-6 of the reach over the durations of the
#: examples. The default absolute tolerance is this share of it, times the reach.
RTOL, _SHARE = 1e-7, 1e-2
#: Factor from the default tolerances to those of the second run through impacts on joint stops.
TIGHT = 1e-5

#: The frequency of each arm that was computed last, with its posture.
_frequencies: WeakKeyDictionary[Arm, tuple[bytes, float]] = WeakKeyDictionary()


def absolute_tolerance(arm: Arm, atol: float | None, rtol: float) -> tuple[float, float]:
    """Return the absolute tolerance of a run as a fraction of a length, and this length (m).

    By default it is a hundredth of the relative one, and the length is the reach of the arm. Runs
    of arms of different sizes then have one fraction, and step control is free of units.
    """
    return (_SHARE * rtol, reach_of(arm)) if atol is None else (atol, 1.0)


def tolerance_of(
    arm: Arm, state: FloatArray, relative: float, absolute: float, scale: float, horizon: float
) -> Tolerance:
    """Return the tolerance of a run that starts at ``state`` (2, n, 1 + m).

    A joint angle moves the tip by the outboard reach; a mode moves it by its tip deflection and by
    its tip slope times the reach beyond. Rates are scaled to displacements by the mode's own
    frequency, those of joints by the lowest one or, without any, by the duration.
    """
    tolerance = Tolerance(absolute, relative, tip_units(arm), 0.0, scale)
    return for_arm(tolerance, arm, state, horizon)


def for_arm(tolerance: Tolerance, arm: Arm, state: FloatArray, horizon: float) -> Tolerance:
    """Return a tolerance with the units and the highest frequency of another arm or state."""
    fastest = max(fastest_frequency(arm, state), 1.0 / horizon)
    return tolerance._replace(unit=tip_units(arm, tolerance.scale, horizon), fastest=fastest)


@once_per_arm
def reach_of(arm: Arm) -> float:
    """Return the distance (m) from the base to the tip of the straight arm."""
    return 1.0 / scale_over_reach(arm.assembly.constants, tip_units(arm))


def joint_units(constants: ArmConstants) -> FloatArray:
    """Return joint coordinates (n,) that displace the tip by about the reach: 1 rad, or the reach.

    The latter of joints and bases that slide, m.
    """
    if not constants.slides.any():
        return np.ones(constants.slides.size)
    return np.where(constants.slides > 0.0, reaches(constants)[0].max(), 1.0)


def scale_over_reach(constants: ArmConstants, unit: FloatArray) -> float:
    """Return ``Tolerance.scale`` over the reach, from ``Tolerance.unit``."""
    return float((unit[0, :, 0] / joint_units(constants)).min())


def tip_units(arm: Arm, scale: float = 1.0, horizon: float = 1.0) -> FloatArray:
    """Return coordinates and rates (2, n, 1 + m) per displacement of the tip by ``scale`` (m)."""
    unit = scale * _unit(arm)
    if not arm.assembly.constants.w2.any():
        unit[1, :, 0] = unit[0, :, 0] / horizon
    return unit


@once_per_arm
def _unit(arm: Arm) -> FloatArray:
    """Return coordinates and rates (2, n, 1 + m) per metre of tip displacement."""
    c = arm.assembly.constants
    n, m = c.S.shape
    reach, beyond = reaches(c)
    unit = np.ones((2, n, 1 + m))
    unit[0, :, 0] = 1.0 / np.maximum(reach, 1e-3 * reach.max())
    unit[0, c.slides > 0.0, 0] = 1.0
    real = c.w2 > 0.0
    # A massless body (a lever, or the motor side of an elastic joint) has no modes.
    interior = _INTERIOR / np.sqrt(np.where(c.mass > 0.0, c.mass, 1.0))
    amplitude = np.abs(c.P) + np.abs(c.dP) * beyond[:, None] + interior[:, None]
    unit[0, :, 1:] = np.where(real, 1.0 / amplitude, 1.0)
    frequency = np.sqrt(np.where(real, c.w2, 1.0))
    unit[1, :, 1:] = unit[0, :, 1:] * frequency
    if real.any():
        unit[1, :, 0] = unit[0, :, 0] * float(frequency[real].min())
    if arm.assembly.has_bristles:  # a deflection has the tolerance of the joint angle
        root = c.bristles[:, 1]
        unit[0, :, -1] = np.inf
        unit[1, :, -1] = np.where(root > 0.0, root * unit[0, :, 0], np.inf)
    return unit


def reaches(constants: ArmConstants) -> tuple[FloatArray, FloatArray]:
    """Return how far the straight bodies reach from the root and from the tip of each, (n,) m."""
    beyond = np.zeros(constants.length.size)
    reach = constants.length.copy()
    for i in reversed(range(beyond.size)):
        reach[i] += beyond[i]
        carrier = int(constants.parent[i])
        if carrier >= 0:
            beyond[carrier] = max(beyond[carrier], np.hypot(*constants.place[i]) + reach[i])
    return reach, beyond


def fastest_frequency(arm: Arm, state: FloatArray) -> float:
    """Estimate the highest frequency (rad/s) at a posture, from below, within a few per cent.

    It is zero for an arm that cannot vibrate or stick. A run that starts at the same posture as the
    previous run of the arm reuses its frequency.
    """
    posture = state[0].tobytes()
    known = _frequencies.get(arm)
    if known is None or known[0] != posture:
        known = _frequencies[arm] = posture, float(fastest_frequencies(arm, state[None])[0])
    return known[1]


def fastest_frequencies(arm: Arm, states: FloatArray, least: float = 0.0) -> FloatArray:
    """Return ``fastest_frequency`` (k,), or ``least``, at postures of states (k, 2, n, 1 + m).

    Friction that holds counts as a spring of its torque per radian: without it, the shortest step
    to an event of a rigid arm would depend on the duration of the run.
    """
    c = arm.assembly.constants
    least = max(least, _sticking_frequency(arm))
    found = np.zeros(len(states))
    if np.any(c.w2) or np.any(c.joint_stiffness):
        kernels, torque = KernelView(c), np.zeros(c.mass.size)
        moved, change = kernels.zeros(2), kernels.zeros(2)
        work = kernels.loads, kernels.work, moved, change, torque
        kernels.call(fastest_vibrations, states, *work, found)
    return np.maximum(found, least)


@once_per_arm
def _sticking_frequency(arm: Arm) -> float:
    c = arm.assembly.constants
    level = (c.friction[:, 0] + c.friction[:, 1]) * c.free * c.holds
    return float(_fastest_decay(c, level) ** 0.5)


@once_per_arm
def friction_rate(arm: Arm, prescribed: tuple[int, ...] = ()) -> float:
    """Return the rate (1/s) at which friction stops the joint that it stops fastest.

    It is that of small motions of one joint from rest, with straight links and all joint angles
    zero; 0 without friction of a joint that is free.
    """
    c = constants_with(arm, prescribed)
    coulomb, rise, _, smoothing, viscous, more_coulomb, more_viscous = c.friction.T
    slope = (coulomb + rise + 0.5 * more_coulomb) / smoothing + viscous + 0.5 * more_viscous
    # Friction that holds does not settle: runs lock a joint that sticks.
    return _fastest_decay(c, slope * c.free * (1.0 - c.holds))


@once_per_arm
def damping_rate(arm: Arm, prescribed: tuple[int, ...] = ()) -> float:
    """Return the rate (1/s) at which viscous damping stops the joint that it stops fastest."""
    c = constants_with(arm, prescribed)
    return _fastest_decay(c, c.joint_damping * c.free * (1.0 - c.holds))


def _fastest_decay(c: ArmConstants, slope: FloatArray) -> float:
    """Return the largest rate (1/s) of single joints under torques of ``slope`` (n,) per rate."""
    if not slope.any():
        return 0.0
    kernels, torque, rates = KernelView(c), np.zeros(c.mass.size), [0.0]
    state = kernels.zeros(2)
    still = kernels.forward_dynamics(state, torque)[:, 0].copy()
    for i in np.flatnonzero(slope):
        torque[i] = 1.0
        rates.append(float(slope[i] * (kernels.forward_dynamics(state, torque)[i, 0] - still[i])))
        torque[i] = 0.0
    return max(rates)


#: Error of the tip over the reach that a run may have without settings: a hundredth of a line in a
#: plot.
_DEFAULT = 1e-5
#: Least smoothing rate of friction, relative to that of the Stribeck effect, over the relative
#: tolerance: below, it is less than the rate errors of implicit steps.
SMOOTH = 1e3
#: Request over the relative tolerance of steps and of functions of time.
_DIVISOR = 100.0
#: Least relative tolerance that rounding errors allow, and the largest at which estimated errors of
#: steps mean anything.
LEAST, _LARGEST = 1e-13, 3e-2
#: Exponent of the ratio of two tolerances by which the difference of their runs becomes the error
#: of the finer one: errors at tolerances with a ratio of 10 differ by 2 or more in nine of ten.
_POWER = 0.3


def default_request(arm: Arm) -> float | None:
    """Return the error over the reach that a run without settings may have.

    It is smaller for a joint whose friction is smoothed over low rates, so that errors of rates do
    not let it slide where it should stick. None if the default tolerances decide: for an arm
    without free joints, whose vibration is the whole motion, and adds the errors of all steps.
    """
    if not arm.n_joints:
        return None
    rubs = [joint.friction for joint in arm.spec.joints if joint.friction is not None]
    smooth = [one.smoothing_rate / one.stribeck_rate for one in rubs if one.smoothing_rate]
    return min([_DEFAULT, *(ratio * _DIVISOR / SMOOTH for ratio in smooth)])


def tolerance_of_request(request: float) -> float:
    """Return the relative tolerance of a request."""
    return min(max(float(f"{request / _DIVISOR:.12g}"), LEAST), _LARGEST)


def share_of_finer(ratio: float) -> float:
    """Return the error of the finer of two runs over their difference, from the tolerances."""
    return float(ratio**-_POWER)
