"""Candidates for a task: requirements, kinds of controllers, the settings to try, and margins."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.arguments import (
    as_list,
    check_choice,
    check_each,
    check_nonnegative,
    check_number,
    check_positive,
)
from flexarm.base.errors import FlexarmError, FlexarmWarning, InputError, Problem, shown
from flexarm.cases.scenario.references import Followed, motion_of
from flexarm.cases.scenario.scenario import prepare
from flexarm.control.analysis.margins import (
    loop_at,
    loop_margins,
    recommended_sample_time,
    without_friction,
)
from flexarm.control.design.arm_scales import NOISE
from flexarm.control.design.rigid_model import RigidModel
from flexarm.control.laws.task_controller import HybridForce, Impedance
from flexarm.integrate.base import FloatArray
from flexarm.linear import modes
from flexarm.model import Scenario
from flexarm.model.arm.spec import serial_only
from flexarm.model.checks import checked_arguments
from flexarm.motion import inverse_kinematics

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
    torque_limit: FloatArray | None  # (joints,) N m, or None
    force: float  # on the surface, N
    disk_margin: float  # required on all plants

    @property
    def of_tip(self) -> bool:
        """Whether the motion is one of the tip along a line."""
        return self.task in _LINE

    @cached_property
    def lowest(self) -> float:
        """Lowest frequency (rad/s) with locked joints at the start; 0 for a rigid arm."""
        found = modes(self.arm, None if self.of_tip else self.start).frequency_hz
        found = found[found > 0.0]
        return float(2.0 * np.pi * found[0]) if found.size else 0.0

    @property
    def period(self) -> float:
        """Period of that frequency, s; that of a rigid arm is set by the duration."""
        if self.lowest:
            return 2.0 * np.pi / self.lowest
        return (self.duration or _RIGID_DURATION) / _PERIODS

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
    force: object,
    disk_margin: object,
) -> Requirements:
    """Validate the arguments of `flexarm.design`, and complete them with defaults."""
    task = check_choice("task", task, TASKS)
    computing = check_choice("computing", computing, COMPUTING)
    if not arm.joints:
        raise InputError(Problem("arm", "must have a joint that is not fixed"))
    serial_only(arm.spec, "the design of controllers")
    if task == "force" and arm.joints < 2:
        rule = "force is not supported for an arm with one joint"
        raise InputError(Problem("task", rule, hint="It cannot move along a surface."))
    read = _sensors(arm, task, sensors)
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
        limit = check_each("torque_limit", torque_limit, arm.joints, positive=True)
        limit = np.broadcast_to(limit, (arm.joints,))
    begin, goal = _places(arm, task, start, end)
    bounds = "be greater than 0 and less than 2"
    return Requirements(
        arm,
        task,
        read,
        computing,
        payload,
        rigidity,
        begin,
        goal,
        None if duration is None else check_positive("duration", duration, "s"),
        limit,
        check_positive("force", force, "N"),
        check_number("disk_margin", disk_margin, lambda margin: 0.0 < margin < 2.0, bounds),
    )


def _sensors(arm: Arm, task: str, given: object) -> frozenset[str]:
    """Return the names of the sensors; those of the joints always belong to them."""
    if given is None:
        found = ["gauges"] * bool(arm.gauges) + ["force"] * (task == "force")
        return frozenset(["joints", *found])
    listed = [given] if isinstance(given, str) else as_list(given)
    if listed is None:
        rule = f"be a list of names ({', '.join(SENSORS)})"
        raise InputError(Problem("sensors", rule, shown(given)))
    names = [check_choice("sensors", name, SENSORS) for name in listed]
    if "gauges" in names and not arm.gauges:
        raise InputError(Problem("sensors", "are gauges, but the arm has no gauges"))
    if "force" in names and task != "force":
        raise InputError(Problem("sensors", "are of a force, which requires the task 'force'"))
    return frozenset(["joints", *names])


def _places(arm: Arm, task: str, start: object, end: object) -> tuple[FloatArray, FloatArray]:
    """Return the start and the end of the motion."""
    if task == "hold" and end is not None:
        raise InputError(Problem("end", "is not supported with the task 'hold'"))
    if task in _LINE:
        reach, count = arm.reach, 2
        first, last = (reach * np.array(point) for point in _LINE[task])
        if arm.joints < 2:
            rule = "track requires an arm with two joints or more"
            hint = "The tip of an arm with one joint cannot follow a line: use point_to_point."
            raise InputError(Problem("task", rule, hint=hint))
    else:
        count = arm.joints
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


def rounded(values: FloatArray | Sequence[float], digits: int = 3) -> list[float]:
    """Return numbers rounded to significant digits, for files that people read."""
    return [float(f"{value:.{digits}g}") for value in np.asarray(values, dtype=float).tolist()]


Drive = dict[str, Any]

#: Longest sample time of a candidate, s; that of MPC, whose optimisation needs more time. They are
#: times of the computer, not of the arm.
_SAMPLE_TIME, _SLOW_SAMPLE_TIME = 0.001, 0.002
#: Frequencies of the joint loops, relative to the lowest frequency with locked joints, and their
#: damping ratios. Loops above half of that frequency bend the links more than they move them.
_BANDWIDTHS, _DAMPINGS = (0.15, 0.25, 0.4, 0.6, 1.0, 1.5, 2.5), (0.7, 1.2)
#: Frequencies and damping ratios of the joint loops inside strain feedback, which are stiff.
_INNER, _INNER_DAMPING, _STRAIN_DAMPING = (1.0, 2.0, 3.0), 1.0, (0.3, 0.6)
#: Crossover frequencies of loop shaping, relative to the same frequency.
_CROSSOVERS = (0.4, 0.7, 1.1, 1.6)
#: Acceptable deviations of the tip, relative to the length of the arm, and of the rates, relative
#: to the lowest frequency; noise of a measured tip, and acceptable integral of its error times that
#: frequency, relative to the length.
_TIP, _RATE, _TIP_NOISE, _TIP_INTEGRAL = 0.004, 0.0064, 4e-4, 3e-4
#: Acceptable angular accelerations relative to the square of that frequency: less than the default,
#: because the designs must be stable with the uncertain payload, too.
_BRISK = 0.04
#: Least rigidity uncertainty of the designs: the model of a real arm is never exact.
_SOME = 0.1
#: Bandwidths of force loops relative to the lowest frequency with locked joints.
_FORCE = (0.4, 0.8, 1.4)
#: Factors of the default damping of the tip, which is too high for some surfaces.
_SOFTER = (1.0, 0.3, 0.1)
#: Angle (rad) by which a joint must move so that a design is scheduled over it.
_SCHEDULED = 0.3


class Candidate(NamedTuple):
    """A kind of controller for a task, the reason, and the settings to try."""

    name: str
    reason: str
    drives: tuple[Drive, ...]


def candidates_of(needs: Requirements) -> list[Candidate]:
    """Return at most three candidates for a task."""
    return list(_of_force(needs) if needs.task == "force" else _of_position(needs))[:3]


def _of_position(needs: Requirements) -> Iterator[Candidate]:
    """Yield the candidates without contact, the most capable one first."""
    seen, model = needs.sensors, needs.computing != "low"
    if model and {"gauges", "tip"} & seen:
        measured = "the tip" if "tip" in seen else "strain gauges"
        reason = f"It estimates the bending of the links from {measured} and corrects it."
        yield Candidate("LQG", reason, tuple(_quadratic(needs, "lqg")))
        if needs.computing == "high" and needs.torque_limit is not None:
            reason = "As LQG, and it plans with the limits of the torques."
            yield Candidate("MPC", reason, tuple(_quadratic(needs, "mpc")))
    if "gauges" in seen:
        reason = (
            "A joint loop with damping by strain gauges needs a filter with one state for each "
            "mode only."
        )
        yield Candidate("integral resonant", reason, tuple(_resonant(needs)))
    if model and not {"gauges", "tip"} & seen:
        reason = (
            "H-infinity loop shaping of the joints has a guaranteed margin, and damps the links "
            "through the joints."
        )
        yield Candidate("loop shaping", reason, tuple(_shaping(needs)))
    reason = "The simplest loop of the joints, along the joint angles of the bent arm."
    settings = product(_BANDWIDTHS, _DAMPINGS)
    yield Candidate("joint PD", reason, tuple(_joint_pd(needs, *pair) for pair in settings))


def _of_force(needs: Requirements) -> Iterator[Candidate]:
    """Yield the candidates for a force on a surface."""
    bandwidths = [float(f"{factor * _frequency(needs):.2g}") for factor in _FORCE]
    if "force" in needs.sensors:
        normal = "It controls the measured force normal to the surface and the position along it."
        soft = "A soft spring and damper at the tip, with integral feedback of the force."
        for name, reason, kind in (
            ("hybrid force", normal, HybridForce),
            ("impedance with force", soft, Impedance),
        ):
            drives = tuple(
                _damped(needs, kind, factor) | {"force_integral": bandwidth}
                for factor, bandwidth in product(_SOFTER, bandwidths)
            )
            yield Candidate(name, reason, drives)
    reason = "A soft spring and damper at the tip, which needs no force sensor."
    drives = tuple(_damped(needs, Impedance, factor) for factor in _SOFTER)
    yield Candidate("impedance", reason, drives)


def _damped(needs: Requirements, kind: type[HybridForce] | type[Impedance], factor: float) -> Drive:
    """Return a force controller with its default damping times a factor."""
    sample_time = sample_time_of(needs)
    usual = vars(kind(needs.arm, sample_time=sample_time))
    damping: Drive = {
        name: rounded([factor * usual[name]])[0]
        for name in ("normal_damping", "tangent_damping")
        if name in usual
    }
    return {"kind": kind.name, **damping, "sample_time": sample_time}


def postures_of(needs: Requirements) -> FloatArray:
    """Return the joint angles (k, joints) rad at the start and, if they differ, at the end."""
    if needs.task == "hold":
        return needs.start[None]
    if not needs.of_tip:
        return np.array([needs.start, needs.end])
    return np.array([inverse_kinematics(needs.arm, place) for place in (needs.start, needs.end)])


def sample_time_of(needs: Requirements) -> float:
    """Return the sample time of the candidates, s."""
    longest = recommended_sample_time(needs.arm, postures_of(needs)[0])
    return _SAMPLE_TIME if longest is None else min(_SAMPLE_TIME, longest)


def _frequency(needs: Requirements) -> float:
    """Return the lowest frequency with locked joints, or that of the motion of a rigid arm."""
    return 2.0 * np.pi / needs.period


def _inertia(needs: Requirements) -> FloatArray:
    """Return the largest inertia (joints,) about each joint at the two postures, kg m^2."""
    rigid = RigidModel(needs.arm)
    each = np.array([np.diag(rigid.mass_matrix(at)) for at in postures_of(needs)])
    return np.asarray(each.max(axis=0))


def _joint_pd(needs: Requirements, factor: float, damping: float) -> Drive:
    inertia, omega = _inertia(needs), factor * _frequency(needs)
    return {
        "kind": "joint_pd",
        "proportional": rounded(inertia * omega**2),
        "derivative": rounded(2.0 * damping * omega * inertia),
        "sample_time": sample_time_of(needs),
    }


def _resonant(needs: Requirements) -> Iterator[Drive]:
    middle = rounded(postures_of(needs).mean(axis=0))
    for factor, damping in product(_INNER, _STRAIN_DAMPING):
        yield {
            "kind": "integral_resonant_control",
            "damping_ratio": damping,
            "posture": middle,
            "inner": _joint_pd(needs, factor, _INNER_DAMPING),
        }


def _shaping(needs: Requirements) -> Iterator[Drive]:
    damped = all(link.damping is not None for link in needs.arm.spec.links if link.flexible)
    for factor in _CROSSOVERS:
        yield {
            "kind": "loop_shaping",
            "bandwidth": float(f"{factor * _frequency(needs):.3g}"),
            "rigidity_uncertainty": max(_SOME, needs.rigidity) if damped else 0.0,
            **_designs(needs),
            "sample_time": sample_time_of(needs),
        }


def _quadratic(needs: Requirements, kind: str) -> Iterator[Drive]:
    """Yield settings of LQG and MPC, in increasing order of lost performance."""
    reach = needs.arm.reach
    omega = _frequency(needs)
    tip, rate, noise, integral = rounded(
        [_TIP * reach, _RATE * omega, _TIP_NOISE * reach, _TIP_INTEGRAL * reach / omega], 2
    )
    measured = dict(NOISE)
    if "gauges" not in needs.sensors:
        del measured["strain"]
    common: Drive = {
        "acceptable": {"tip": tip, "joint_rate": rate},
        "acceptable_torque": rounded(_BRISK * omega**2 * _inertia(needs)),
    }
    if "tip" in needs.sensors:
        measured["tip"] = noise
        common["integral"] = {"tip": integral}
    common |= {"measured": measured, **_designs(needs), "sample_time": sample_time_of(needs)}
    if needs.torque_limit is not None:
        common["torque_limit"] = rounded(needs.torque_limit)
    if kind == "mpc":
        common["sample_time"] = max(common["sample_time"], _SLOW_SAMPLE_TIME)
    least = max(_SOME, needs.rigidity)
    tried = [(least, 0.0), (max(0.3, least), 0.0), (max(0.3, least), 1.0), (1.0, 1.0)]
    for unsure, recovery in dict.fromkeys(tried):
        yield {"kind": kind, "rigidity_uncertainty": unsure, "recovery": recovery, **common}


def _designs(needs: Requirements) -> Drive:
    """Return the posture of a design, and its schedule over the joints that matter most."""
    # Without gravity the dynamics do not depend on the angle of the first joint, but the direction
    # of the tip does. The grid has at most two dimensions.
    first, last = postures_of(needs)[[0, -1]]
    middle = rounded((first + last) / 2.0)
    turned = np.abs(last - first)
    tip = "tip" in needs.sensors
    if not (tip or any(needs.arm.spec.gravity)):
        turned[0] = 0.0
    most = np.argsort(-turned)[: 2 if tip else 1]
    scheduled = [int(joint) for joint in most if turned[joint] >= _SCHEDULED]
    if not scheduled:
        return {"posture": middle}
    schedule: list[Any] = [None] * len(middle)
    for joint in scheduled:
        low, high = sorted((float(first[joint]), float(last[joint])))
        schedule[joint] = rounded(np.linspace(low, high, 3))
    return {"posture": middle, "schedule": schedule}


#: Margins in tables: name in `loop_margins`, the worst of several values.
_MARGINS = {
    "disk_margin": np.min,
    "gain_margin": np.min,
    "phase_margin": np.min,
    "delay_margin": np.min,
    "growth": np.max,
}


class Assessed(NamedTuple):
    """A drive with its worst margins over plants and postures."""

    drive: Drive  # as in a file
    margins: dict[str, float]  # by name, see ``_MARGINS``; SI units
    states: int  # numbers that the controller keeps between samples

    @property
    def stable(self) -> bool:
        """Whether the loop is stable on all plants at all postures."""
        return self.margins["growth"] <= 0.0

    def value(self, disk_margin: float) -> tuple[bool, float, float]:
        """Return the value by which settings are compared; larger is better.

        Settings with the required margin come first, and among them the fastest decay; of the
        others, the largest margin.
        """
        margins = self.margins
        enough = bool(self.stable and margins["disk_margin"] >= disk_margin)
        return enough, -margins["growth"] if enough else margins["disk_margin"], -margins["growth"]


class Loops:
    """Loops of drives with the plants of a study, in ``postures`` (k, joints) rad of its motion.

    ``error`` is the text of the last error of a design, or empty.
    """

    def __init__(
        self,
        content: Mapping[str, Any],
        plants: Mapping[str, Arm],
        postures: FloatArray,
        drive: Drive,
    ) -> None:
        self._content, self._plants, self._postures = content, plants, postures
        scenario = scenario_of(content, drive)  # all drives share its motion
        self._arm = Arm(scenario.arm)
        self._motion = motion_of(self._arm, scenario)
        self._followed: dict[str | None, Followed] = {}
        self.error = ""

    def assess(self, drive: Drive) -> Assessed:
        """Return the margins of a drive; FlexarmError if it cannot be designed for the arm."""
        scenario = scenario_of(self._content, drive)
        kind = scenario.drive.reference_kind
        known = self._followed.get(kind)
        prepared = prepare(scenario, motion=self._motion, followed=known, arm=self._arm)
        self._followed[kind] = prepared.followed
        controller = prepared.options["controller"]
        hardware, contacts = prepared.options.get("hardware"), scenario.contacts
        around: dict[str, Any] = {"hardware": hardware}
        places: Any = self._postures
        reference: Any = prepared.followed.motion if contacts else None
        if contacts:
            around |= {"contacts": contacts, "reference": reference}
            places = [reference.start_time, reference.end_time]
        found = loop_margins(controller, self._plants, places, **around)
        margins = {name: float(worst(found[name].values)) for name, worst in _MARGINS.items()}
        ratio = found["damping_ratio"].values
        decay = ratio * found["pole_frequency"].values
        vibrates = ratio < 1.0 - 1e-9
        margins["damping_ratio"] = (
            float(ratio[vibrates][np.argmin(decay[vibrates])]) if vibrates.any() else 1.0
        )
        start = reference.start_time if contacts else 0.0
        at = (
            next(iter(self._plants.values())),
            self._postures[0],
            hardware,
            without_friction(contacts),
            reference,
            start,
        )
        return Assessed(drive, margins, len(loop_at(controller, *at).controller.A))

    def best(self, candidate: Candidate, disk_margin: float) -> Assessed | None:
        """Return the best setting of a candidate; None, and ``error``, if none can be designed."""
        found = []
        with warnings.catch_warnings():  # the table shows what they warn of
            warnings.simplefilter("ignore", FlexarmWarning)
            for drive in candidate.drives:
                try:
                    found.append(self.assess(drive))
                except FlexarmError as error:  # no solution of a Riccati equation, no equilibrium
                    self.error = str(error)
        return max(found, key=lambda one: one.value(disk_margin), default=None)


def scenario_of(content: Mapping[str, Any], drive: Drive) -> Scenario:
    """Return the scenario of a drive, with the keys of a study that has one motion."""
    shared = {
        name: content[name] for name in ("arm", "loads", "contacts", "hardware") if name in content
    }
    (motion,) = content["motions"].values()
    run = {name: value for name, value in content["run"].items() if name != "settling"}
    return checked_arguments(Scenario, **shared, motion=motion, drive=drive, run=run)
