"""From sampled states to the channels of a result."""

from __future__ import annotations

import numpy as np

from flexarm.arm import Arm
from flexarm.integrate.base import FloatArray
from flexarm.kernels.layout import run_time_sizes
from flexarm.kernels.observables import POSE_COLUMNS, observe_many

#: Samples looked at in one go: bounds the scratch memory of long runs.
_CHUNK = 4096


def channels_of(arm: Arm, states: FloatArray) -> dict[str, FloatArray]:
    """Compute every channel but the torque from states (samples, 2, n, 1 + m)."""
    chunks = [_chunk(arm, states[k : k + _CHUNK]) for k in range(0, len(states), _CHUNK)]
    return {name: np.concatenate([chunk[name] for chunk in chunks]) for name in chunks[0]}


def _chunk(arm: Arm, states: FloatArray) -> dict[str, FloatArray]:
    assembly = arm.assembly
    count = len(states)
    poses = np.zeros((count, assembly.bodies, POSE_COLUMNS))
    tips = np.zeros((count, 6))
    energy = np.zeros((count, 3))
    constants = assembly.constants
    observe_many(run_time_sizes(constants), constants, states, poses, tips, energy)
    link = poses[:, assembly.link_body]
    q, qd = arm.unpadded(states[:, 0]), arm.unpadded(states[:, 1])
    channels = {
        "joint_angle": q[:, assembly.joint_index],
        "joint_rate": qd[:, assembly.joint_index],
        "link_angle": link[:, :, 2],
        "link_rate": link[:, :, 5],
        "link_tip_deflection": link[:, :, 6],
        "link_tip_slope": link[:, :, 7],
        "link_tip_deflection_rate": link[:, :, 8],
        "link_tip_slope_rate": link[:, :, 9],
        "tip": tips[:, :2],
        "tip_velocity": tips[:, 3:5],
        "tip_angle": tips[:, 2],
        "tip_angle_rate": tips[:, 5],
        "kinetic_energy": energy[:, 0],
        "strain_energy": energy[:, 1],
        "gravity_energy": energy[:, 2],
        "q": q,
        "qd": qd,
    }
    if arm.gauges:
        channels["strain"] = arm.strains(states)
    # Copies, not views: the pose array of a chunk must not stay alive behind a column of it.
    return {name: np.array(values) for name, values in channels.items()}
