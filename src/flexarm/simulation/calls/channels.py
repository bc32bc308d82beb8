"""Channels of a run, computed from its samples."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from flexarm.arm.observe import bristle_channel, channels_of, contact_channels
from flexarm.integrate.base import FloatArray
from flexarm.simulation.run.section_forces import section_channels
from flexarm.simulation.run.stepping import Run

#: Channels of contacts, and all channels that need more than states and torques.
BY_CONTACTS = {"contact_force", "contact_gap", "contact_energy"}
BY_FORCES = BY_CONTACTS | {
    *("joint_force", "joint_moment", "axial_force", "shear_force", "bending_moment"),
}


def channels_of_run(
    run: Run, given: FloatArray, names: Collection[str] | None = None
) -> dict[str, FloatArray]:
    """Compute the channels of a run at the samples filled so far.

    Args:
        given: (samples, joints) torques, N m, or accelerations of prescribed joints, rad/s^2.
        names: the required channels; others may be missing. None: all channels.
    """
    found = [_channels_of_span(part, given[samples], names) for samples, part in run.parts()]
    if len(found) == 1:
        return found[0]
    return {name: np.concatenate([one[name] for one in found]) for name in found[0]}


def _channels_of_span(
    run: Run, given: FloatArray, names: Collection[str] | None
) -> dict[str, FloatArray]:
    count = run.progress.sample
    times, states = run.sample_times[:count], run.samples[:count]
    if names is not None and not run.prescribed and not BY_FORCES.intersection(names):
        found = channels_of(run.arm, states, names) | bristle_channel(run.arm, states)
        return found | {"torque": given}
    channels = channels_of(run.arm, states) | bristle_channel(run.arm, states)
    motor, force, moment, inside = run.reactions(times, channels["link_angle"], given)
    channels |= {"torque": motor, "joint_force": force, "joint_moment": moment}
    channels |= section_channels(inside)
    return channels | contact_channels(run.arm, run.loads.placed.contacts, states)
