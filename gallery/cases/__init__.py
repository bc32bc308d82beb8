"""The pages and their cases, in the order of the gallery, in one list."""

from __future__ import annotations

from gallery.case import Case, Page
from gallery.cases import (
    boom,
    cantilever,
    cart,
    clamped_beam,
    cooperating_arms,
    crane,
    elastica,
    euler_column,
    flexible_bars,
    flying_spaghetti,
    four_bar,
    free_flyer,
    hub,
    link_modes,
    own_weight,
    payload,
    pendulum,
    rotary_inertia,
    rotating_beam,
    slewing,
    slider_crank,
    spin_up,
    two_link_frequencies,
    two_link_motion,
)

PAGES: tuple[Page, ...] = (
    Page(
        "beam-frequencies",
        "Frequencies of beams",
        (clamped_beam.CASE, hub.CASE, payload.CASE, rotary_inertia.CASE, link_modes.CASE),
    ),
    Page(
        "arm-frequencies",
        "Frequencies of arms, and of beams that spin or hang",
        (two_link_frequencies.CASE, rotating_beam.CASE, own_weight.CASE),
    ),
    Page(
        "statics",
        "Deflection and buckling",
        (euler_column.CASE, cantilever.CASE, elastica.CASE),
    ),
    Page(
        "motion",
        "Motion",
        (slewing.CASE, spin_up.CASE, pendulum.CASE, two_link_motion.CASE, boom.CASE),
    ),
    Page(
        "mechanisms",
        "Mechanisms",
        (
            four_bar.CASE,
            slider_crank.CASE,
            flexible_bars.CASE,
            cooperating_arms.CASE,
            crane.CASE,
            cart.CASE,
            free_flyer.CASE,
            flying_spaghetti.CASE,
        ),
    ),
)

#: Every case, in the order of the pages.
CASES: tuple[Case, ...] = tuple(case for page in PAGES for case in page.cases)
