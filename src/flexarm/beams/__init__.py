"""Finite elements of one link: plain numbers in, arrays out."""

from flexarm.beams.invariants import LinkConstants, link_constants, rigid_constants

__all__ = ["LinkConstants", "link_constants", "rigid_constants"]
