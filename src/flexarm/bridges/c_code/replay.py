"""Torques of a controller for recorded readings."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.bridges.c_code.laws.gain_table import around, gain_table
from flexarm.bridges.c_code.laws.traced_controller import TracedController, nominal_values
from flexarm.bridges.c_code.pressed_run import PressedRun, pressed_values
from flexarm.control.design.nominal import strain_matrix
from flexarm.control.hardware.measurement import Measurement
from flexarm.control.laws import LQG
from flexarm.control.laws.force.task_controller import TaskController
from flexarm.control.laws.vibration.strain_damping import StrainDamping
from flexarm.motion import Motion, joint_motion

#: Angle (rad) by which the joints of the reference turn.
_TURN = 0.1
#: Mean speed (rad/s) of the reference through a grid of postures.
_SPEED = 1.0
#: Strain of a reference that computes its own bending.
_STRAIN = 1e-3


def replay(
    arm: Arm, traced: TracedController, readings: dict[str, FloatArray]
) -> tuple[dict[str, FloatArray], FloatArray]:
    """Update a controller with recorded readings, along a motion of all joints.

    The motion passes the grid of postures of a controller with a schedule, and the recorded angles
    are moved with it.

    Returns:
        The inputs of the exported function (samples, size) by name, and the torques (samples,
        joints).
    """
    mine: Any = deepcopy(traced.controller)
    mine.reset()
    planner = deepcopy(mine)  # of the nominal motion; a second call would advance that of ``mine``
    h, count = traced.sample_time, len(readings["joint_angle"])
    start = readings["joint_angle"][0]
    table = gain_table(mine)
    reference: Any = joint_motion(arm, start, start + _TURN, count * h)
    if table:
        reference = SlowRun(arm, table.ends, count * h)
    damping = next((one for one in around(planner) if isinstance(one, StrainDamping)), None)
    if damping is not None:
        reference = BentRun(arm, reference)
    presses = isinstance(mine, TaskController)
    if presses:
        reference = PressedRun(reference, mine, count)
    rows, torques = [], []
    for k, t in enumerate(np.arange(count) * h):
        row = {name: values[k] for name, values in readings.items()}
        if table:
            row["joint_angle"] = row["joint_angle"] - start + reference.joint_angle(float(t))
        given = Measurement(**row)
        torques.append(np.array(mine.update(float(t), given, reference), dtype=np.float64))
        row["reference_angle"] = reference.joint_angle(float(t))
        row["reference_rate"] = reference.joint_rate(float(t))
        row["reference_acceleration"] = reference.joint_acceleration(float(t))
        if damping is not None:
            row["strain_correction"] = damping.strain_correction(float(t), reference)
        if presses:
            row |= pressed_values(planner, float(t), reference)
        if isinstance(planner, LQG):
            nominal = planner._motion.at(float(t), row["joint_angle"], reference)
            row |= nominal_values(planner, nominal)
        function = _feedforward(mine)
        if function is not None:
            row["feedforward"] = np.asarray(function(float(t) + 0.5 * h))
        rows.append(row)
    inputs = {name: np.array([np.ravel(row[name]) for row in rows]) for name in rows[0]}
    return inputs, np.array(torques)


class SlowRun:
    """Reference that passes a grid of postures in few samples, at the torques of a slow motion.

    Args:
        arm: the arm. ends: (2, joints) rad, the first and the last posture of the grid.
        duration: s, from before the first posture until after the last one.
    """

    vectorized = True

    def __init__(self, arm: Arm, ends: FloatArray, duration: float) -> None:
        first, last = ends[0] - _TURN, ends[1] + _TURN
        self.duration = self.end_time = duration
        self._motion = joint_motion(arm, first, last, np.max(last - first) / _SPEED)
        self._ratio = self._motion.duration / duration

    def joint_angle(self, t: FloatArray) -> FloatArray:
        """Return the joint angles, rad."""
        return self._motion.joint_angle(self._ratio * t)

    def joint_rate(self, t: FloatArray) -> FloatArray:
        """Return the joint rates of the slow motion, rad/s."""
        return self._motion.joint_rate(self._ratio * t)

    def joint_acceleration(self, t: FloatArray) -> FloatArray:
        """Return the joint accelerations of the slow motion, rad/s^2."""
        return self._motion.joint_acceleration(self._ratio * t)


class BentRun:
    """Reference that computes its own bending: a motion of the joints, and links that vibrate."""

    def __init__(self, arm: Arm, motion: Motion) -> None:
        self._arm, self._motion = arm, motion
        self.joint_angle, self.joint_rate = motion.joint_angle, motion.joint_rate
        self.joint_acceleration = motion.joint_acceleration
        self._size = _STRAIN / np.abs(strain_matrix(arm)).max()

    def coordinates(self, times: FloatArray) -> list[FloatArray]:
        """Return q (T, dof) at times (T,), s; rates and accelerations are not used."""
        phase = 2.0 * np.pi * times / self._motion.duration
        q = self._size * np.sin(phase[:, None] + np.arange(self._arm.dof))
        q[:, self._arm.joint_index] = self._motion.joint_angle(times)
        return [q]


def _feedforward(controller: Any) -> Any:
    """Return the feedforward function of a controller or of the controller inside it."""
    found = (getattr(one, "feedforward", None) for one in around(controller))
    return next((one for one in found if one is not None), None)
