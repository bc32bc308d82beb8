"""Readings of accelerometers and gyroscopes, and joint accelerations, at the samples of a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexarm.arm.actions import marker, place_loads
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.arm.observe import poses_of
from flexarm.integrate.base import FloatArray
from flexarm.kernels.observation.point_motion import MOTION_COLUMNS, point_motions
from flexarm.model import InertialSensor
from flexarm.simulation.calls.preparation import situation_of
from flexarm.simulation.calls.run import simulate
from flexarm.simulation.run.progress import Meter
from flexarm.simulation.run.settings import relative_tolerance

#: Time before a sample (relative) at which its torque is taken.
_BEFORE = 1e-9
#: Column of the rate of a body's root tangent in the poses.
_RATE = 5


def inertial_channels(
    arm: Arm,
    sensors: Sequence[InertialSensor],
    q: FloatArray,
    qd: FloatArray,
    duration: float,
    **arguments: Any,
) -> dict[str, FloatArray]:
    """Compute readings of sensors from the coordinates and rates (samples, dof) of a run.

    ``duration`` (s) and ``arguments`` are those of ``simulate``, without a controller and with a
    base at rest. The torque at a sample is that just before it.

    Returns:
        Channels ``joint_acceleration`` (samples, joints) rad/s^2, ``acceleration`` (samples,
        sensors) m/s^2 minus gravity, along the axis of each sensor, and ``angular_rate`` (samples,
        sensors) rad/s. Sensors turn with the section of the link.
    """
    situation = situation_of(simulate, arm, duration, None, arguments)
    run = situation.new_run(Meter("reading", False))
    history = situation.history_of(run)(relative_tolerance(situation.settings, arm))
    states = run.samples[:] = arm.padded(np.stack([q, qd], axis=1))
    accelerations = run.accelerations(history.at(run.sample_times * (1.0 - _BEFORE)))
    points = [marker(sensor.link, sensor.station) for sensor in sensors]
    stations = place_loads(arm, points, what="InertialSensor")
    motions = np.zeros((len(states), len(sensors), MOTION_COLUMNS))
    kernels = KernelView(arm.assembly.constants)
    buffers = kernels.work, *kernels.pose_arrays()
    for state, acceleration, motion in zip(states, accelerations, motions, strict=True):
        kernels.call(point_motions, state, acceleration, kernels.loads, stations, *buffers, motion)
    # Rotation of the sections from the root tangents of their bodies, and its rate.
    slope, slope_rate = np.einsum("slkm,km->lsk", states[:, :, stations.body, 1:], stations.slopes)
    axis = slope + [sensor.angle for sensor in sensors]
    along, across = motions[..., 6], motions[..., 7]
    return {
        "joint_acceleration": accelerations[:, arm.assembly.joint_body, 0],
        "acceleration": np.cos(axis) * along + np.sin(axis) * across,
        "angular_rate": poses_of(arm, states)[:, stations.body, _RATE] + slope_rate,
    }
