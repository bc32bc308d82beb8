"""The cases, in the order of the gallery: written out, so that one place lists them all."""

from __future__ import annotations

from gallery.case import Case
from gallery.cases import (
    boom,
    cantilever,
    clamped_beam,
    elastica,
    euler_column,
    hub,
    link_modes,
    own_weight,
    payload,
    pendulum,
    rotary_inertia,
    rotating_beam,
    slewing,
    spin_up,
    two_link_frequencies,
    two_link_motion,
)

CASES: tuple[Case, ...] = (
    clamped_beam.CASE,
    hub.CASE,
    payload.CASE,
    rotary_inertia.CASE,
    link_modes.CASE,
    two_link_frequencies.CASE,
    rotating_beam.CASE,
    own_weight.CASE,
    euler_column.CASE,
    cantilever.CASE,
    elastica.CASE,
    slewing.CASE,
    spin_up.CASE,
    pendulum.CASE,
    two_link_motion.CASE,
    boom.CASE,
)
