"""Requirements on a controller, the validated arguments of `flexarm.design`: drive and case."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.arguments import (
    as_list,
    check_choice,
    check_each,
    check_kind,
    check_nonnegative,
    check_number,
    check_positive,
)
from flexarm.base.errors import InputError, Problem, raise_any, shown
from flexarm.control.analysis.margins import recommended_sample_time
from flexarm.integrate.base import FloatArray
from flexarm.linear import equilibrium, modes
from flexarm.model import Hardware, Instrument, Load, Motors
from flexarm.model.arm.spec import serial_only
from flexarm.model.hardware import instrument_faults
from flexarm.motion import inverse_kinematics, line_motion
from flexarm.simulation.loop.devices import torque_limits

TASKS = ("hold", "point_to_point", "track", "force")
SENSORS = ("joints", "gauges", "tip", "force")
COMPUTING = ("low", "medium", "high")
#: Default tip positions relative to the length of the arm: the paper's line, and a wall.
_LINE = {"track": ((0.83, 0.41), (0.41, 0.83)), "force": ((0.62, 0.2), (0.62, 0.33))}
#: Default motion of each joint, and angle of each joint after the first one, rad.
_TURN, _ELBOW = 0.5, 0.5
#: Default duration in periods of the lowest frequency, also while a posture is held, and that of an
#: arm without vibration, s.
_PERIODS, _HELD_PERIODS, _RIGID_DURATION = 2.5, 5.0, 2.0
_HIGHEST_UNCERTAINTY = 0.9
#: Error of the tip, relative to the reach or the path on a surface, of runs that failed.
MISSED = 0.05
#: Longest sample time of a candidate, s. It is a time of the computer, not of the arm.
_SAMPLE_TIME = 0.001
#: Longest delay of the hardware in sample times: the analysis of the loop has a state for each
#: joint and sample of it, and takes half a minute and 3 GB for 200 with one joint.
_MOST_DELAYED = 200


@dataclass(frozen=True, eq=False)
class Requirements:
    """Validated arguments of `flexarm.design`."""

    arm: Arm  # the arm of the model
    task: str  # one of ``TASKS``
    sensors: frozenset[str]  # some of ``SENSORS``
    computing: str  # one of ``COMPUTING``
    payload: float  # largest relative errors of the payload and of the flexural rigidity
    rigidity: float  # likewise
    #: joint angles (joints,) rad, or positions of the tip (2,) m for the tasks "track" and
    #: "force"; equal for "hold"
    start: FloatArray
    end: FloatArray  # likewise
    duration: float | None  # of the motion, s; None for the default
    hardware: Hardware  # of the machine, or of a typical drive
    typical: bool  # whether the hardware is assumed
    force: float  # on the surface, N
    disk_margin: float  # required on all plants

    @property
    def of_tip(self) -> bool:
        """Whether the motion is one of the tip along a line."""
        return self.task in _LINE

    @cached_property
    def lowest(self) -> float:
        """Lowest frequency (rad/s) with locked joints at the start; 0 for a rigid arm."""
        hertz = modes(self.arm, None if self.of_tip else self.start).frequency_hz
        return 2.0 * np.pi * float(min(hertz[hertz > 0.0], default=0.0))

    @property
    def period(self) -> float:
        """Period of that frequency, s; that of a rigid arm is set by the duration."""
        if self.lowest:
            return 2.0 * np.pi / self.lowest
        return (self.duration or _RIGID_DURATION) / _PERIODS

    @cached_property
    def sample_time(self) -> float:
        """Sample time of the candidates, s."""
        first = inverse_kinematics(self.arm, self.start) if self.of_tip else self.start
        longest = recommended_sample_time(self.arm, first)
        return _SAMPLE_TIME if longest is None else min(_SAMPLE_TIME, longest)

    @cached_property
    def postures(self) -> FloatArray:
        """Joint angles (k, joints) rad at the start, in the middle and at the end of the motion."""
        if self.task == "hold":
            return self.start[None]
        if not self.of_tip:
            return np.array([self.start, 0.5 * (self.start + self.end), self.end])
        line = line_motion(self.arm, self.start, self.end, 1.0)
        return np.array([line.joint_angle(t) for t in (0.0, 0.5, 1.0)])

    @cached_property
    def torque_limit(self) -> FloatArray | None:
        """Limits of the motors at rest (joints,) N m; None without."""
        limit = torque_limits(self.hardware, self.arm.n_joints)
        return limit if np.isfinite(limit).all() else None

    @property
    def delay(self) -> float:
        """Delay (s) of the loop by the hardware."""
        return delay_of(self.hardware)

    @property
    def rate_delay(self) -> float:
        """Delay (s) of feedback of the joint rates, by the hardware and its filter."""
        read = [item for item in self.hardware.instruments or () if "joint_rate" in item.labels]
        lags = (0.5 / (math.pi * item.rate_cutoff) for item in read if item.rate_cutoff)
        return self.delay + sum(lags)

    @property
    def farthest(self) -> float:
        """Largest error (m) of the tip of an accepted loop; with a force, the settled error."""
        force = self.task == "force"
        return MISSED * (float(np.hypot(*(self.end - self.start))) if force else self.arm.reach)

    @property
    def heavy(self) -> bool:
        """Whether gravity acts, so that loads cause lasting errors."""
        return any(self.arm.spec.gravity)

    @property
    def motion_time(self) -> float:
        """Duration of the motion, s."""
        periods = _HELD_PERIODS if self.task == "hold" else _PERIODS
        return self.duration or float(f"{periods * self.period:.2g}")


def requirements_of(
    arm: Arm,
    task: object,
    *,
    sensors: object,
    computing: object,
    payload_uncertainty: object,
    rigidity_uncertainty: object,
    start: object,
    end: object,
    duration: object,
    torque_limit: object,
    hardware: object,
    force: object,
    disk_margin: object,
) -> Requirements:
    """Validate the arguments of `flexarm.design`, and complete them with defaults."""
    task = check_choice("task", task, TASKS)
    computing = check_choice("computing", computing, COMPUTING)
    if not arm.n_joints:
        raise InputError(Problem("arm", "must have a joint that is not fixed"))
    serial_only(arm.spec, "the design of controllers")
    if task == "force" and arm.n_joints < 2:
        rule = "force is not supported for an arm with one joint"
        raise InputError(Problem("task", rule, hint="It cannot move along a surface."))
    machine = None
    if hardware is not None:
        machine = checked_hardware(arm, check_kind("hardware", hardware, Hardware), task)
    read = _sensors(arm, task, sensors, machine)
    payload = check_nonnegative("payload_uncertainty", payload_uncertainty)
    if payload and arm.spec.payload.mass == 0.0:
        hint = "Give the arm the payload that you expect."
        rule = "is not supported for an arm without payload"
        raise InputError(Problem("payload_uncertainty", rule, hint=hint))
    rule, most = f"be from 0 to {_HIGHEST_UNCERTAINTY:g}", _HIGHEST_UNCERTAINTY
    rigidity = check_number(
        "rigidity_uncertainty", rigidity_uncertainty, lambda value: 0.0 <= value <= most, rule
    )
    limit = None
    if torque_limit is not None:
        limit = check_each("torque_limit", torque_limit, arm.n_joints, positive=True)
    begin, goal = _places(arm, task, start, end)
    bounds = "be greater than 0 and less than 2"
    needs = Requirements(
        arm,
        task,
        read,
        computing,
        payload,
        rigidity,
        begin,
        goal,
        None if duration is None else check_positive("duration", duration, "s"),
        machine or Hardware(),
        machine is None,
        check_positive("force", force, "N"),
        check_number("disk_margin", disk_margin, lambda margin: 0.0 < margin < 2.0, bounds),
    )
    drive = machine or typical_hardware(arm, read, needs.sample_time, needs.force)
    longest = _MOST_DELAYED * needs.sample_time
    if delay_of(drive) > longest:
        rule = f"delay the loop by at most {longest:.3g} s ({_MOST_DELAYED} sample times)"
        raise InputError(Problem("hardware", rule, f"{delay_of(drive):.3g} s"))
    return replace(needs, hardware=with_torque_limit(arm, drive, limit))


def _sensors(arm: Arm, task: str, given: object, hardware: Hardware | None) -> frozenset[str]:
    """Return the names of the sensors; those of the joints always belong to them."""
    measured = None  # all sensors can be chosen
    if hardware is not None and hardware.instruments is not None:
        measured = readings_of(hardware)
    if given is None:
        if measured is not None:
            return frozenset(["joints", *(name for name in READINGS if READINGS[name] in measured)])
        usual = ["gauges"] * bool(arm.gauges) + ["force"] * (task == "force")
        return frozenset(["joints", *usual])
    listed = [given] if isinstance(given, str) else as_list(given)
    if listed is None:
        rule = f"be a list of names ({', '.join(SENSORS)})"
        raise InputError(Problem("sensors", rule, shown(given)))
    names = [check_choice("sensors", name, SENSORS) for name in listed]
    if "gauges" in names and not arm.gauges:
        raise InputError(Problem("sensors", "are gauges, but the arm has no gauges"))
    if "force" in names and task != "force":
        raise InputError(Problem("sensors", "are of a force, which requires the task 'force'"))
    for name in names:
        if measured is not None and READINGS.get(name, "joint_angle") not in measured:
            rule = f"contain {name}, but the hardware has no instrument of {READINGS[name]}"
            raise InputError(Problem("sensors", rule))
    return frozenset(["joints", *names])


def _places(arm: Arm, task: str, start: object, end: object) -> tuple[FloatArray, FloatArray]:
    """Return the start and the end of the motion."""
    if task == "hold" and end is not None:
        raise InputError(Problem("end", "is not supported with the task 'hold'"))
    if task in _LINE:
        reach, count = arm.reach, 2
        first, last = (reach * np.array(point) for point in _LINE[task])
        if arm.n_joints < 2:
            rule = "track requires an arm with two joints or more"
            hint = "The tip of an arm with one joint cannot follow a line: use point_to_point."
            raise InputError(Problem("task", rule, hint=hint))
    else:
        count = arm.n_joints
        first = np.array([0.0, *[_ELBOW] * (count - 1)])
        last = first + (_TURN if task == "point_to_point" else 0.0)
    begin = first if start is None else check_each("start", start, count=count)
    if start is not None and end is None:
        last = begin + (last - first)
    goal = last if end is None else check_each("end", end, count=count)
    begin, goal = (np.broadcast_to(place, (count,)) for place in (begin, goal))
    if task != "hold" and np.array_equal(begin, goal):
        raise InputError(Problem("end", "differ from start", shown(end)))
    return begin, goal


#: Bits of a typical encoder, and cutoff of the filter of its rates relative to the sampling
#: frequency.
_BITS, _CUTOFF = 17, 0.1
#: Noise of typical instruments of the tip, relative to the length of the arm, and of the force,
#: relative to that of the task.
_TIP_NOISE, _FORCE_NOISE = 5e-5, 4e-3
#: Readings by which each of the sensors of `flexarm.design` is recognised.
READINGS = {"gauges": "strain", "tip": "tip", "force": "contact_force"}


def typical_hardware(
    arm: Arm, sensors: frozenset[str], sample_time: float, force: float
) -> Hardware:
    """Return the hardware of a typical drive: encoders, filtered rates and one sample of delay."""
    encoder = Instrument(
        signal="joint_angle",
        resolution=float(f"{2.0 * math.pi / 2**_BITS:.4g}"),
        rate_cutoff=float(f"{_CUTOFF / sample_time:.3g}"),
    )
    noise = {"tip": _TIP_NOISE * arm.reach, "force": _FORCE_NOISE * force}
    others = [
        Instrument(signal=signal, noise=float(f"{noise.get(name, 0.0):.2g}"))
        for name, signal in READINGS.items()
        if name in sensors
    ]
    return Hardware(instruments=[encoder, *others], motors=Motors(delay=sample_time))


def checked_hardware(arm: Arm, hardware: Hardware, task: str) -> Hardware:
    """Return the hardware of a machine; InputError if it does not fit the arm or the task."""
    faults = instrument_faults(arm.spec, hardware, task == "force")
    raise_any([fault.problem("hardware") for fault in faults])
    if hardware.instruments is None:
        return hardware
    read = readings_of(hardware)
    if missing := [name for name in ("joint_angle", "joint_rate") if name not in read]:
        rule = f"must measure {' and '.join(missing)}"
        hint = "Give the instrument of joint_angle a rate_cutoff, which derives the rate."
        raise InputError(Problem("hardware", rule, hint=hint))
    return hardware


def readings_of(hardware: Hardware) -> set[str]:
    """Return the names of the readings of listed instruments."""
    return {name for item in hardware.instruments or () for name in item.labels}


def with_torque_limit(arm: Arm, hardware: Hardware, limit: FloatArray | None) -> Hardware:
    """Return hardware with the argument ``torque_limit`` (N m) as a limit of its motors."""
    if limit is None:
        return hardware
    if np.isfinite(torque_limits(hardware, arm.n_joints)).all():
        rule = "cannot be combined with hardware whose motors have limits"
        raise InputError(Problem("torque_limit", rule))
    each = [float(f"{value:.3g}") for value in np.broadcast_to(limit, (arm.n_joints,)).tolist()]
    return hardware.replace(motors=(hardware.motors or Motors()).replace(torque_limit=each))


def delay_of(hardware: Hardware) -> float:
    """Return the delay (s) of a loop by its hardware, without sampling and filters of rates."""
    motors = hardware.motors or Motors()
    readings = max((item.delay for item in hardware.instruments or ()), default=0.0)
    return motors.delay + motors.time_constant + readings


def quicker(hardware: Hardware, factor: float) -> Hardware:
    """Return hardware whose delays and lags, apart from filters of rates, are multiplied."""
    motors = hardware.motors or Motors()
    times = {"delay": factor * motors.delay, "time_constant": factor * motors.time_constant}
    items = hardware.instruments
    if items is not None:
        items = [item.replace(delay=factor * item.delay) for item in items]
    return hardware.replace(motors=motors.replace(**times), instruments=items)


def typical_text(hardware: Hardware) -> str:
    """Return a sentence about a typical drive."""
    encoder = (hardware.instruments or ())[0]
    delay = (hardware.motors or Motors()).delay
    return (
        f"A typical drive is assumed, because no hardware is given: encoders with {_BITS} bits, "
        f"rates through a filter of {encoder.rate_cutoff:.3g} Hz, and one sample "
        f"({1e3 * delay:.3g} ms) of delay. Give that of your machine as hardware."
    )


#: Depth of the tip in the surface of the force task, relative to the length of the arm, and the
#: relative damping times this length and the lowest frequency.
_SURFACE_DEPTH, _SURFACE_DAMPING = 3e-4, 9.0
#: Deflection of the tip under the disturbance of the task "hold", relative to the length of the
#: arm, if the joints did not move.
_DISTURBED = 0.01
#: Time before the motion in periods of the lowest frequency; with a force, which is zero at the
#: start; and time after the motion.
_BEFORE, _BEFORE_PRESSED, AFTER = 0.2, 2.0, 3.0
#: Time after the motion of the task "force", likewise: its tip moves slowly along the surface.
_AFTER_PRESSED = 20.0
#: Recorded samples in a period of the lowest frequency.
_RATE = 150.0


def rounded(values: FloatArray | Sequence[float], digits: int = 3) -> list[float]:
    """Return numbers rounded to significant digits, for files that people read."""
    return [float(f"{value:.{digits}g}") for value in np.asarray(values, dtype=float).tolist()]


def case_of(needs: Requirements) -> dict[str, Any]:
    """Return the content of a study without drives: the keys of a file, for all candidates."""
    content: dict[str, Any] = {"arm": needs.arm.spec, "motions": {needs.task: _motion(needs)}}
    if needs.task == "hold" and needs.lowest:
        # The disturbance is a push across the last link at the tip, for one period.
        arm, links = needs.arm, len(needs.arm.spec.links)
        still = equilibrium(arm, needs.start)
        angle = float(arm.tip(arm.rest(needs.start))[2])
        across = np.array([-np.sin(angle), np.cos(angle)])  # of the last link
        pushed = equilibrium(arm, needs.start, loads=[Load(links, tuple(across.tolist()))])
        compliance = np.hypot(*(arm.tip(pushed.q)[:2] - arm.tip(still.q)[:2]))
        force = rounded(across * _DISTURBED * arm.reach / compliance)
        before, period = _BEFORE * needs.period, needs.period
        times = rounded([before, before, before + period, before + period])
        factor = {"times": times, "values": [0.0, 1.0, 1.0, 0.0]}
        content["loads"] = [{"link": links, "force": force, "factor": factor}]
    if needs.task == "force":
        content["contacts"] = [_surface(needs)]
    content["hardware"] = needs.hardware
    content["plants"] = plants_of(needs)
    motion = content["motions"][needs.task]
    moved = motion.get("path", motion)
    end = moved["start_time"] + moved["duration"]
    periods = {"hold": 0.0, "force": _AFTER_PRESSED}.get(needs.task, AFTER)
    after = float(f"{periods * needs.period:.2g}")
    settling = float(f"{after * (1.0 - 1.0 / AFTER if needs.task == 'force' else 1.0 / AFTER):.2g}")
    (duration,), (rate,) = rounded([end + after], 6), rounded([_RATE / needs.period], 1)
    content["run"] = {"duration": duration, "rate": rate, "settling": settling}
    return content


def _motion(needs: Requirements) -> dict[str, Any]:
    start, end = rounded(needs.start, 6), rounded(needs.end, 6)
    periods = _BEFORE_PRESSED if needs.task == "force" else _BEFORE
    before = float(f"{periods * needs.period:.2g}")
    times = {"duration": needs.motion_time, "start_time": before}
    if not needs.of_tip:
        return {"kind": "joint", "start": start, "end": end, **times}
    line = {"kind": "line", "start": start, "end": end, **times}
    if needs.task == "track":
        return line
    return {"kind": "pressed", "path": line, "force": needs.force}


def _surface(needs: Requirements) -> dict[str, Any]:
    """Return the wall along the line of the tip; the base is on its free side."""
    along = needs.end - needs.start
    normal = np.array([-along[1], along[0]]) / np.hypot(*along)
    if normal @ needs.start > 0.0:  # it points away from the base
        normal = -normal
    reach = needs.arm.reach
    stiffness = needs.force / (_SURFACE_DEPTH * reach)
    damping = _SURFACE_DAMPING * needs.period / (2.0 * np.pi * reach)
    return {
        "surface": {
            "kind": "wall",
            "point": rounded(needs.start, 6),
            "normal": rounded(normal, 6),
        },
        "stiffness": rounded([stiffness], 2)[0],
        "damping": rounded([damping], 2)[0],
    }


def plants_of(needs: Requirements) -> dict[str, dict[str, Any]]:
    """Return plants at the limits of the uncertainty, named by it; the first is the model."""
    plants: dict[str, dict[str, Any]] = {"nominal": {}}
    heavy = {"payload_factor": 1.0 + needs.payload}
    light = {"payload_factor": max(0.0, 1.0 - needs.payload)}
    soft = {"flexural_rigidity_factor": 1.0 - needs.rigidity}
    stiff = {"flexural_rigidity_factor": 1.0 + needs.rigidity}
    if needs.payload and needs.rigidity:
        plants["heavy, soft"] = heavy | soft
        plants["light, stiff"] = light | stiff
        plants["heavy, stiff"] = heavy | stiff
        plants["light, soft"] = light | soft
    elif needs.payload:
        plants |= {"heavy": heavy, "light": light}
    elif needs.rigidity:
        plants |= {"soft": soft, "stiff": stiff}
    return plants
