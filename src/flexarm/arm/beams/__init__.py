"""Finite elements of one link: constants of the arm's dynamics from section properties."""

from flexarm.arm.beams.assembly import BeamTable
from flexarm.arm.beams.invariants import LinkConstants, link_constants, rigid_constants

__all__ = ["BeamTable", "LinkConstants", "link_constants", "rigid_constants"]
