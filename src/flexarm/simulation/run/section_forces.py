"""Section forces of the links at the samples of a run."""

from __future__ import annotations

from typing import NamedTuple

from flexarm.arm.actions.loads import loads_inboard
from flexarm.arm.arm import Arm
from flexarm.arm.stations import cuts_at
from flexarm.integrate.base import FloatArray, System
from flexarm.integrate.reactions import section_forces_many
from flexarm.kernels.layout import Stations
from flexarm.simulation.histories.loads import LoadHistory

#: Channels of the three section forces, in the order of the kernels.
SECTION_CHANNELS = ("axial_force", "shear_force", "bending_moment")


class CutSystem(NamedTuple):
    """Arm cut at one station of each link, with the loads inboard of these stations."""

    stations: Stations
    system: System


def cut_systems(arm: Arm, system: System, loads: LoadHistory, count: int) -> list[CutSystem]:
    """Cut the arm of a run at ``count`` stations of each link; return an empty list for 0."""
    found = []
    for cut in cuts_at(arm, count) if count else ():
        kept = loads_inboard(arm, loads.owners, loads.placed, cut.reach)
        drive = system.drive._replace(loads=kept)
        part = System(cut.sizes, cut.constants, drive, system.work)
        found.append(CutSystem(cut.stations, part))
    return found


def fill_sections(
    cuts: list[CutSystem],
    times: FloatArray,
    states: FloatArray,
    accelerations: FloatArray,
    root_accelerations: FloatArray,
    reactions: FloatArray,
    forces: FloatArray,
) -> None:
    """Compute the section forces (stations, samples, links, 3) from results of ``reactions_many``.

    ``accelerations``, ``root_accelerations`` and ``reactions`` are these results; the section
    forces are written to ``forces``.
    """
    for cut, values in zip(cuts, forces, strict=True):
        section_forces_many(
            cut.system,
            cut.stations,
            times,
            states,
            accelerations,
            root_accelerations,
            reactions,
            values,
        )


def section_channels(forces: FloatArray) -> dict[str, FloatArray]:
    """Return section forces (stations, samples, links, 3) by channel; empty without stations."""
    if not len(forces):
        return {}
    return {
        name: forces[..., part].transpose(1, 2, 0).copy()
        for part, name in enumerate(SECTION_CHANNELS)
    }
