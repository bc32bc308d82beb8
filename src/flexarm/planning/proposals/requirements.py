"""Requirements of a controller: the task, the sensors, the computing power, the uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.arguments import (
    as_list,
    check_choice,
    check_each,
    check_kind,
    check_number,
    check_positive,
)
from flexarm.base.errors import InputError, Problem, shown
from flexarm.integrate.base import FloatArray
from flexarm.linear import modes

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
    """Validated arguments of `flexarm.design`.

    Attributes:
        arm: the arm of the model.
        task: one of ``TASKS``. sensors: some of ``SENSORS``. computing: one of ``COMPUTING``.
        payload, rigidity: largest relative errors of the payload and of the flexural rigidity.
        start, end: joint angles (joints,) rad, or positions of the tip (2,) m for the tasks
            "track" and "force"; equal for "hold".
        duration: of the motion, s; None for the default.
        torque_limit: (joints,) N m, or None.
        force: on the surface, N.
        disk_margin: required on all plants.
    """

    arm: Arm
    task: str
    sensors: frozenset[str]
    computing: str
    payload: float
    rigidity: float
    start: FloatArray
    end: FloatArray
    duration: float | None
    torque_limit: FloatArray | None
    force: float
    disk_margin: float

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
    arm: object,
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
    arm = check_kind("arm", arm, Arm)
    task = check_choice("task", task, TASKS)
    computing = check_choice("computing", computing, COMPUTING)
    if not arm.joints:
        raise InputError(Problem("arm", "must have a joint that is not fixed"))
    if task == "force" and arm.joints < 2:
        rule = "force is not supported for an arm with one joint"
        raise InputError(Problem("task", rule, hint="It cannot move along a surface."))
    read = _sensors(arm, task, sensors)
    payload = check_number(
        "payload_uncertainty", payload_uncertainty, lambda value: value >= 0.0, "be at least 0"
    )
    if payload and arm.spec.payload.mass == 0.0:
        hint = "Give the arm the payload that you expect."
        rule = "is not supported for an arm without payload"
        raise InputError(Problem("payload_uncertainty", rule, hint=hint))
    rule = f"be from 0 to {_HIGHEST_UNCERTAINTY:g}"
    rigidity = check_number(
        "rigidity_uncertainty",
        rigidity_uncertainty,
        lambda value: 0.0 <= value <= _HIGHEST_UNCERTAINTY,
        rule,
    )
    limit = None
    if torque_limit is not None:
        limit = check_each("torque_limit", torque_limit, arm.joints, positive=True)
        limit = np.broadcast_to(limit, (arm.joints,))
    begin, goal = _places(arm, task, start, end)
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
        check_number(
            "disk_margin",
            disk_margin,
            lambda margin: 0.0 < margin < 2.0,
            "be greater than 0 and less than 2",
        ),
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
        reach, count = float(np.sum(arm.lengths)), 2
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
