"""Contacts in lanes: forces, and step lengths at which no contact is skipped.

The motion of the points is computed for all lanes together. The surfaces, the contact law and the
rules of ``integrate.nearness`` branch on the state, so they are evaluated for one lane after
another.
"""

from __future__ import annotations

from flexarm.integrate.lanes.data import LaneMemory, LaneRuns
from flexarm.integrate.nearness import begin_branches, fix_branches, step_on
from flexarm.kernels.compilation.cache import apart, inner
from flexarm.kernels.compilation.packs import LANES, PackArray, fill_lane
from flexarm.kernels.forces.contact import (
    force_on_point,
    motion_of_point,
    place_bodies,
    push_back,
)
from flexarm.kernels.layout import ArmConstants, Contacts, Sizes


@inner
def contacts_of_lane(memory: LaneMemory, lane: int) -> Contacts:
    """Return the contacts of a lane, with its law and what it observes."""
    points, own = memory.loads.contacts, memory.contacts
    return Contacts(
        points.body, points.rows, points.shortening, own.law[lane], points.knots, own.seen[lane]
    )


@apart
def fill_contacts(runs: LaneRuns, memory: LaneMemory, lane: int, k: int, arm: int) -> None:
    """Copy the contacts of run k into a lane; ``arm``: row of its arm."""
    rows, points, own = runs.contacts, memory.loads.contacts, memory.contacts
    fill_lane(points.rows, lane, rows.rows, arm)
    fill_lane(points.shortening, lane, rows.shortening, arm)
    fill_lane(points.law, lane, rows.law, k)
    for i in range(own.law.shape[1]):
        for j in range(own.law.shape[2]):
            own.law[lane, i, j] = rows.law[k, i, j]
    begin_branches(contacts_of_lane(memory, lane), own.adaptive)


@apart
def touch_lanes(
    sizes: Sizes, constants: ArmConstants, memory: LaneMemory, state: PackArray
) -> None:
    """Subtract the contact forces of all lanes from the biases, as ``forces.contact.touch``."""
    points, motion, work = memory.loads.contacts, memory.contacts.motion, memory.work
    place_bodies(sizes, constants, state, work)
    for k in range(points.body.shape[0]):
        x, y, vx, vy = motion_of_point(sizes, points, k, state, work)
        motion[0] = x
        motion[1] = y
        motion[2] = vx
        motion[3] = vy
        for lane in range(LANES):
            if memory.run[lane] >= 0:
                one = motion.array[:, lane]
                own = contacts_of_lane(memory, lane)
                fx, fy = force_on_point(own, k, one[0], one[1], one[2], one[3])
                one[4] = fx
                one[5] = fy
        push_back(sizes, points, k, motion[4], motion[5], state, work)


@apart
def begin_contacts(runs: LaneRuns, memory: LaneMemory) -> None:
    """Make the last evaluation the start of a step in the lanes marked in ``accepted``."""
    for lane in range(LANES):
        if memory.accepted.array[0, lane] != 0.0:
            k, own = memory.run[lane], contacts_of_lane(memory, lane)
            step_on(own)
            fix_branches(own, runs.clock[k], runs.counts[k])
