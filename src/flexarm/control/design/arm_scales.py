"""Units of length, time and force of an arm, and the default requirements made from them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import coordinate_sizes
from flexarm.base.errors import InputError, Problem, shown
from flexarm.base.late import linalg
from flexarm.control.design.linear_design import (
    CHORD,
    DISTURBANCES,
    DesignRequirements,
    check_names,
)
from flexarm.control.design.nominal import chord_matrix
from flexarm.control.hardware.measurement import FloatArray
from flexarm.linear.models.state_space import CHANNEL_OUTPUTS
from flexarm.linear.vibration.modal import lowest_frequency
from flexarm.model.checks import Record
from flexarm.model.drives.base import parameters_of
from flexarm.model.drives.linear import LQGParameters
from flexarm.model.paths import unit_at
from flexarm.model.units import unit_of

#: Outputs that can be measured, because their nominal values are computed.
MEASURED = ("joint_angle", "joint_rate", "strain", "tip")
#: Default acceptable deviations: of angles (rad), of the tip relative to the reach, of rates
#: relative to `typical_rate`; those of sliding joints also relative to the reach. They are those of
#: docs/performance/measure_robustness.py, for whose arm they are round numbers: 10 mrad, 10 mm and
#: 0.2 rad/s.
_ANGLE, TIP, _RATE = 0.01, 0.004, 0.032
#: Outputs that can be integrated, and their default acceptable integrals times `typical_rate`: rad,
#: and a fraction of the reach.
_INTEGRATED = {"joint_angle": 0.0126, "tip": 0.0026, CHORD: 0.0126}
#: Outputs that can have acceptable deviations: all except contacts, which a design excludes.
_ACCEPTABLE = tuple(name for name in CHANNEL_OUTPUTS if not name.startswith("contact_"))
#: Angular acceleration of the rigid model under `typical_torque`, relative to the square of
#: `typical_rate`; for sliding joints also relative to the reach.
_BRISK = 0.25
#: Angle (rad) in a sample time at `typical_rate`: the largest, and that of a rigid arm, whose time
#: scale is that of its loop.
_FASTEST, RIGID = 0.08, 0.0064
#: Largest angle (rad) in a sample time at a bandwidth: the hold delays the loop by half of it.
_TURNED = 1.0
#: Default bandwidth of robust loops of the joints, relative to `typical_rate`.
BANDWIDTH = 1.25
#: Default noise of encoders (rad; of sliding joints relative to the reach) and gauges (strain).
NOISE = {"joint_angle": 1e-4, "strain": 2e-5}


def joint_sizes(arm: Arm) -> float | FloatArray:
    """Return the unit of default joint motions: one radian, or the reach (m) for sliding joints.

    Of shape (joints,); 1.0 if all joints turn.
    """
    sizes = coordinate_sizes(arm)[arm.joint_index]
    return 1.0 if np.all(sizes == 1.0) else sizes


def typical_rate(arm: Arm, sample_time: float) -> float:
    """Return the joint rate (rad/s) that default requirements of controllers are relative to.

    It is `lowest_frequency`, but at most 0.08 rad in a ``sample_time`` (s), so that the default
    requirements suit the loop; 0.0064 rad in a sample time for a rigid arm.
    """
    lowest = lowest_frequency(arm)
    return min(lowest, _FASTEST / sample_time) if np.isfinite(lowest) else RIGID / sample_time


def check_sample_time(arm: Arm, sample_time: float, bandwidth: ArrayLike | None = None) -> None:
    """Raise if a sample time (s) is too long for the arm, or for a bandwidth (rad/s).

    With fewer than four samples in a period, a vibration of the lowest mode is neither observed nor
    damped between the samples, although the sampled loop is stable.
    """
    lowest = lowest_frequency(arm)
    longest = 0.5 * math.pi / lowest if math.isfinite(lowest) else math.inf
    if sample_time > longest:
        rule = f"be at most {longest:.3g} s for this arm"
        hint = "That is a quarter of the lowest period of the straight arm with locked joints."
        raise InputError(Problem("sample_time", rule, f"{sample_time:g} s", hint))
    fastest = float(np.max(np.asarray(0.0 if bandwidth is None else bandwidth)))
    if fastest * sample_time > _TURNED:
        rule = f"be at most {_TURNED / sample_time:.4g} rad/s"
        hint = f"Reduce the bandwidth, or the sample_time of {sample_time:g} s."
        raise InputError(Problem("bandwidth", rule, f"{fastest:g} rad/s", hint))


def typical_torque(arm: Arm, posture: ArrayLike | None, rate: float) -> FloatArray:
    """Return the torques (joints,) N m that accelerate each joint at ``typical_rate`` (rad/s).

    By a quarter of its square, for the rigid model in a posture (joints,) rad; zero by default. The
    base and the other joints are at rest, without closures. Forces (N) of sliding joints accelerate
    them by as much times the reach.
    """
    return np.asarray(_BRISK * rate**2 * rigid_inertias(arm, posture) * joint_sizes(arm))


def rigid_inertias(arm: Arm, posture: ArrayLike | None = None) -> FloatArray:
    """Return the inertias (joints,) kg m^2, or kg, of the rigid arm about its joints.

    In a posture (joints,) rad; straight by default.
    """
    at = np.zeros(arm.n_joints) if posture is None else np.asarray(posture, dtype=np.float64)
    rigid = arm.rigid()
    return np.asarray(np.diag(rigid.mass_matrix(rigid.rest(at)))[rigid.joint_index])


def design_requirements(
    arm: Arm, given: LQGParameters, acceptable: Mapping[str, ArrayLike] | None, rate: float
) -> DesignRequirements:
    """Return the requirements of a linear controller, with default values for missing ones."""
    measured, disturbance, integral = given.measured, given.disturbance, given.integral
    reach, sizes = arm.reach, joint_sizes(arm)
    if acceptable is None:
        joints = {"joint_angle": _ANGLE * sizes, "joint_rate": _RATE * rate * sizes}
        acceptable = joints | {"tip": TIP * reach}
    torque = given.acceptable_torque
    if torque is None:
        torque = typical_torque(arm, given.posture, rate)
    if measured is None:
        instruments = getattr(getattr(given, "hardware", None), "instruments", None)
        gauged = bool(arm.gauges)
        if instruments is not None:
            gauged &= any(item.signal == "strain" for item in instruments)
        measured = {"joint_angle": NOISE["joint_angle"] * sizes}
        measured |= {"strain": NOISE["strain"]} if gauged else {}
    if disturbance is None:
        disturbance = {"torque": 0.1 * torque, "tip_force": 0.2 * np.max(torque * sizes) / reach}
    if integral is None or integral is False:
        integral = {}
    elif integral is True or isinstance(integral, str):
        name = "joint_angle" if integral is True else integral
        size = (reach if name == "tip" else sizes) / rate
        integral = {name: size * _INTEGRATED.get(name, np.nan)}
    checked = check_names("integral", integral, tuple(_INTEGRATED), arm)
    if len(checked) > 1:
        raise InputError(Problem("integral", "name a single output", shown(integral)))
    seen = check_names("measured", measured, MEASURED, arm)
    if "tip" in checked and "tip" not in seen:
        raise InputError(Problem("measured", "must contain the tip to integrate it"))
    if CHORD in checked and not {"joint_angle", "strain"} <= seen.keys():
        rule = f"must contain joint_angle and strain to integrate {CHORD}"
        raise InputError(Problem("measured", rule))
    chords = chord_matrix(arm) if CHORD in checked else None
    acceptable = check_names("acceptable", acceptable, _ACCEPTABLE, arm)
    disturbance = check_names("disturbance", disturbance, DISTURBANCES, arm)
    more = rate, given.recovery, given.rigidity_uncertainty
    return DesignRequirements(acceptable, torque, seen, disturbance, checked, *more, chords)


#: Exponents of rate, length and force in each unit. Electrical units have no scale in an arm.
_UNITS = {
    "s": (-1.0, 0.0, 0.0),
    "Hz": (1.0, 0.0, 0.0),
    "m": (0.0, 1.0, 0.0),
    "N": (0.0, 0.0, 1.0),
    "kg": (-2.0, -1.0, 1.0),
    "Pa": (0.0, -2.0, 1.0),
    "J": (0.0, 1.0, 1.0),
}
#: A division, or a unit and its exponent.
_WORD = re.compile(r"/|per\b|[A-Za-z]+(?:\^-?\d+(?:\.\d+)?)?")
#: Scale of a number that is zero, relative to its typical size on the arm.
_OF_ZERO = 0.1
#: Angle (rad) in the delay of a loop at `slow_rate`, for a joint that turns the rigid arm.
_LATE = 0.1
#: Largest default cutoff, relative to the sampling frequency.
_CUTOFF = 0.005


class ArmScales(NamedTuple):
    """Angular frequency (rad/s), length (m) and force (N) of an arm."""

    rate: float
    length: float
    force: float

    def size(self, unit: str) -> float:
        """Return the typical size of a number with a unit such as ``N s/m``; 1 for angles."""
        size, sign, over = 1.0, 1.0, 1.0
        for word in _WORD.findall(unit):
            if word in ("/", "per"):  # "rad/s per 1/m": all after "per" is divided
                over = -1.0 if word == "per" else over
                sign = -1.0 if word == "/" else 1.0
                continue
            name, _, power = word.partition("^")
            exponent = over * sign * float(power or 1.0)
            scales = zip(self, _UNITS.get(name, (0.0, 0.0, 0.0)), strict=True)
            size *= math.prod(scale ** (exponent * each) for scale, each in scales)
            if name == "Hz":
                size /= (2.0 * math.pi) ** exponent
        return size


def slow_rate(arm: Arm, sample_time: float, delay: float = 0.0) -> float:
    """Return the lowest angular frequency (rad/s) of the straight arm with locked joints.

    At most 0.0064 rad in a ``sample_time`` (s), because a stiff arm may press on a stiff surface.
    With a ``delay`` of the loop (s), at most 0.1 rad in it times the least inertia that a torque
    turns in this time, relative to that of the rigid arm.
    """
    rate = min(lowest_frequency(arm), RIGID / sample_time)
    if delay == 0.0:
        return rate
    near = near_inertias(arm, np.zeros((1, arm.n_joints)), delay)
    return min(rate, _LATE / delay * float(np.min(near / rigid_inertias(arm))))


def near_inertias(arm: Arm, postures: FloatArray, time: float) -> FloatArray:
    """Return the least inertias (joints,) kg m^2 that torques turn in a ``time`` (s).

    Of postures (k, joints) rad, by the modes with at most two periods in this time. All modes would
    turn less, the more elements there are.
    """
    moved = []
    for angles in postures:
        q = arm.rest(angles)
        squares, shapes = linalg.eigh(arm.stiffness_matrix(q), arm.mass_matrix(q))
        slow = squares <= (4.0 * np.pi / time) ** 2
        moved.append(np.sum(shapes[arm.joint_index][:, slow] ** 2, axis=1))
    return np.asarray(1.0 / np.max(moved, axis=0))


def arm_scales(arm: Arm, rate: float) -> ArmScales:
    """Return the units of an arm with an angular frequency (rad/s).

    The force at the reach accelerates the rigid arm by a quarter of the square of the frequency.
    """
    length = arm.reach
    torques = typical_torque(arm, None, rate)
    if not torques.size:  # no joint is free
        c = arm.assembly.constants
        torques = np.array([np.sum(c.mass + c.tip_mass) * (0.5 * length * rate) ** 2])
    return ArmScales(rate, length, float(np.max(torques * joint_sizes(arm))) / length)


def size_of_zero(arm: Arm, record: Record, path: str, rate: float | None = None) -> float:
    """Return a change of a number of a record that is large on an arm, from the number's unit.

    ``rate`` is the scale of frequencies; by default the lowest one with locked joints. A rigid arm
    has none, but is linear in numbers with a time, such as damping; within backlash it is zero.
    """
    lowest = lowest_frequency(arm) if rate is None else rate
    scales = arm_scales(arm, lowest if 0.0 < lowest < np.inf else 1.0)
    return _OF_ZERO * scales.size(unit_at(record, path))


def set_defaults(controller: Any, shares: Mapping[str, float], scales: ArmScales) -> None:
    """Replace parameters that are None by shares of their typical sizes on an arm."""
    declared = parameters_of(type(controller))
    for name, share in shares.items():
        if getattr(controller, name) is None:
            unit = unit_of(declared[name].description)
            setattr(controller, name, share * scales.size(unit))


def default_cutoff(arm: Arm, sample_time: float) -> float:
    """Return half of the lowest frequency with locked joints (Hz), with a limit by the loop."""
    return min(lowest_frequency(arm) / (4.0 * math.pi), _CUTOFF / sample_time)
