"""Observables of states: channels of results, and outputs of linear models.

Complex states give complex values, from which linear models derive their exact outputs.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import cache
from typing import NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.kernels.forces.contact import ENERGY, FORCE, GAP, look_many
from flexarm.kernels.layout import LOOK_COLUMNS, Contacts
from flexarm.kernels.observation.observables import POSE_COLUMNS, observe_many, poses_many

_ENERGIES = {"kinetic_energy", "strain_energy", "gravity_energy"}
#: Number of samples processed together, which bounds the scratch memory of long runs.
_CHUNK = 4096


class Observed(NamedTuple):
    """Quantities of states from which the channels follow."""

    poses: FloatArray  # (samples, n, 16)
    tips: FloatArray  # (samples, 6)
    energy: FloatArray  # (samples, 3)
    strains: FloatArray | None  # (samples, gauges)


def channels_of(
    arm: Arm, states: FloatArray, names: Collection[str] | None = None
) -> dict[str, FloatArray]:
    """Compute all or some channels from states (samples, 2, n, 1 + m), if these suffice."""
    if len(states) <= _CHUNK:
        return _chunk(arm, states, names)
    chunks = [_chunk(arm, states[k : k + _CHUNK], names) for k in range(0, len(states), _CHUNK)]
    return {name: np.concatenate([chunk[name] for chunk in chunks]) for name in chunks[0]}


def tips_of(arm: Arm, states: FloatArray) -> FloatArray:
    """Return position (m) and angle (rad) of the last tip, and their rates: (samples, 6)."""
    return _observed(arm, states)[1]


def poses_of(arm: Arm, states: FloatArray) -> FloatArray:
    """Return the poses of all bodies (samples, n, 16), see ``kernels.observation.observables``."""
    return _observed(arm, states, energies=False)[0]


def contact_values(
    arm: Arm, contacts: Contacts, states: FloatArray, kernels: KernelView | None = None
) -> FloatArray:
    """Return contact quantities of states (samples, 2, n, 1 + m): (samples, contacts, 9).

    The columns are named in ``kernels.forces.contact``: position and velocity of the point, force
    on it, gap, curvature, energy. ``contacts`` come from ``place_contacts``. Reusing a view of the
    kernels saves time.
    """
    view = kernels or KernelView(arm.assembly.constants, states.dtype)
    values = np.zeros((len(states), contacts.body.size, LOOK_COLUMNS), dtype=states.dtype)
    view.call(look_many, contacts, states, view.work, values)
    return values


def contact_forces(
    arm: Arm, contacts: Contacts, states: FloatArray, kernels: KernelView | None = None
) -> FloatArray:
    """Return the forces (samples, contacts, 2) of contacts on the arm, N, world axes."""
    return contact_values(arm, contacts, states, kernels)[..., FORCE : FORCE + 2]


def contact_channels(arm: Arm, placed: Contacts, states: FloatArray) -> dict[str, FloatArray]:
    """Return the channels of contacts at states (samples, 2, n, 1 + m); empty without contacts."""
    if not placed.body.size:
        return {}
    values = contact_values(arm, placed, states)
    return {
        "contact_force": values[..., FORCE : FORCE + 2].copy(),
        "contact_gap": values[..., GAP].copy(),
        "contact_energy": values[..., ENERGY].copy(),
    }


def bristle_channel(arm: Arm, states: FloatArray) -> dict[str, FloatArray]:
    """Return the channel of bristles at states (samples, 2, n, 1 + m) of a run; empty without."""
    if not arm.assembly.has_bristles:
        return {}
    joints = arm.assembly.joint_body
    root = arm.assembly.constants.bristles[joints, 1]
    return {"bristle_deflection": states[:, 1, joints, -1] / np.where(root > 0.0, root, 1.0)}


def _observed(
    arm: Arm, states: FloatArray, energies: bool = True
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return poses (samples, n, 16), tips (samples, 6) and energies (samples, 3).

    Without ``energies``, they are zero.
    """
    count, constants = len(states), arm.assembly.run_constants
    states = np.ascontiguousarray(states)  # one compilation serves all
    poses = np.empty((count, arm.assembly.bodies, POSE_COLUMNS), dtype=states.dtype)
    tips = np.empty((count, 6), dtype=states.dtype)
    energy = np.zeros((count, 3), dtype=states.dtype)
    sizes = arm.assembly.sizes
    if energies:
        observe_many(sizes, constants, states, poses, tips, energy)
    else:
        poses_many(sizes, constants, states, poses, tips)
    return poses, tips, energy


def _chunk(arm: Arm, states: FloatArray, names: Collection[str] | None) -> dict[str, FloatArray]:
    strains = arm.strains(states) if arm.gauges else None
    observed = Observed(*_observed(arm, states, with_energies(names)), strains)
    return named_channels(arm, states, observed, names)


def with_energies(names: Collection[str] | None) -> bool:
    """Return whether channels require energies, whose computation takes most of the time."""
    return names is None or not _ENERGIES.isdisjoint(names)


def named_channels(
    arm: Arm, states: FloatArray, observed: Observed, names: Collection[str] | None
) -> dict[str, FloatArray]:
    """Return channels of states (samples, 2, n, 1 + m) from their observed quantities."""
    assembly = arm.assembly
    poses, tips, energy, strains = observed
    joints, links = assembly.joint_body, assembly.link_body
    bent = cache(lambda: _link_tips(arm, poses))
    channels: dict[str, Callable[[], FloatArray]] = {
        "joint_angle": lambda: states[:, 0, joints, 0],
        "joint_rate": lambda: states[:, 1, joints, 0],
        "joint_twist": lambda: _twists(arm, arm.unpadded(states[:, 0])),
        "link_angle": lambda: poses[:, links, 2],
        "link_rate": lambda: poses[:, links, 5],
        "link_tip_deflection": lambda: bent()[:, :, 0],
        "link_tip_slope": lambda: bent()[:, :, 1],
        "link_tip_deflection_rate": lambda: bent()[:, :, 2],
        "link_tip_slope_rate": lambda: bent()[:, :, 3],
        "tip": lambda: tips[:, :2],
        "tip_velocity": lambda: tips[:, 3:5],
        "tip_angle": lambda: tips[:, 2],
        "tip_angle_rate": lambda: tips[:, 5],
        "kinetic_energy": lambda: energy[:, 0],
        "strain_energy": lambda: energy[:, 1],
        "gravity_energy": lambda: energy[:, 2],
        "q": lambda: arm.unpadded(states[:, 0]),
        "qd": lambda: arm.unpadded(states[:, 1]),
    }
    if assembly.base:
        channels["base_position"] = lambda: _base_motion(arm, states[:, 0])
        channels["base_velocity"] = lambda: _base_motion(arm, states[:, 1])
    if strains is not None:
        channels["strain"] = lambda: strains
    # Return copies, because a view of one column would keep the pose array of a chunk alive.
    wanted = channels if names is None else channels.keys() & set(names)
    return {name: np.array(value()) for name, value in channels.items() if name in wanted}


def _base_motion(arm: Arm, coordinates: FloatArray) -> FloatArray:
    """Return x, y and angle of the base (samples, 3), or their rates from (samples, n, ...)."""
    # Coordinates that are not free are zero.
    motion = np.zeros((len(coordinates), 3), dtype=coordinates.dtype)
    for name, body, _ in arm.assembly.base:
        motion[:, ("x", "y", "angle").index(name)] = coordinates[:, body, 0]
    return motion


def _twists(arm: Arm, q: FloatArray) -> FloatArray:
    """Return the twist of each joint's spring (samples, joints), rad; zero without a spring."""
    twists = np.zeros((len(q), arm.n_joints), dtype=q.dtype)
    for k, seat in enumerate(arm.assembly.seats):
        if seat.twist is not None:
            twists[:, k] = q[:, seat.twist]
    return twists


def _link_tips(arm: Arm, poses: FloatArray) -> FloatArray:
    """Return deflection and slope of each link's tip from its root tangent, and their rates."""
    # The shape is (samples, links, 4). For a link in one piece they are those of the body. For
    # several pieces the slopes are added, and the deflection is the distance of the tip from the
    # line of the root tangent.
    assembly = arm.assembly
    bent = np.empty((len(poses), arm.n_links, 4), dtype=poses.dtype)
    for i in range(arm.n_links):
        pieces = assembly.pieces_of(i)
        first, last = pieces[0].body, pieces[-1].body
        if first == last:
            bent[:, i] = poses[:, first, 6:10]
            continue
        root = poses[:, first, :6]
        end = poses[:, last, 10:]
        angle = poses[:, last, 2] + poses[:, last, 7] - root[:, 2]
        rate = poses[:, last, 5] + poses[:, last, 9] - root[:, 5]
        x, y = (end[:, :2] - root[:, :2]).T
        vx, vy = (end[:, 3:5] - root[:, 3:5]).T
        cosine, sine = np.cos(root[:, 2]), np.sin(root[:, 2])
        along = cosine * x + sine * y
        deflection = cosine * y - sine * x
        deflection_rate = cosine * vy - sine * vx - root[:, 5] * along
        bent[:, i] = np.stack([deflection, angle, deflection_rate, rate], axis=1)
    return bent
