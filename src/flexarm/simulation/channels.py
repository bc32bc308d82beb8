"""Channels of a run, computed from its samples."""

from __future__ import annotations

from collections.abc import Collection

from flexarm.engine.section_forces import section_channels
from flexarm.engine.stepping import Run
from flexarm.integrate.base import FloatArray
from flexarm.observe import channels_of, contact_channels


def channels_of_run(
    run: Run, given: FloatArray, names: Collection[str] | None = None
) -> dict[str, FloatArray]:
    """Compute the channels of a run at the samples filled so far.

    Args:
        given: (samples, joints) torques, N m, or accelerations of prescribed joints, rad/s^2.
        names: the required channels; others may be missing. None: all channels.
    """
    count = run.progress.sample
    times, states = run.sample_times[:count], run.samples[:count]
    channels = channels_of(run.arm, states)
    if names is not None and not run.prescribed and {*channels, "torque"}.issuperset(names):
        return channels | {"torque": given}
    motor, force, moment, inside = run.reactions(times, channels["link_angle"], given)
    channels |= {"torque": motor, "joint_force": force, "joint_moment": moment}
    channels |= section_channels(inside)
    return channels | contact_channels(run.arm, run.loads.placed.contacts, states)
