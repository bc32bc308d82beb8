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
    flexible_panel,
    flying_spaghetti,
    four_bar,
    free_flyer,
    hub,
    laboratory_arm,
    link_modes,
    own_weight,
    payload,
    pendulum,
    rotary_inertia,
    rotating_beam,
    shaper_tolerance,
    slewing,
    slider_crank,
    spin_up,
    two_link_frequencies,
    two_link_motion,
)

CONTROL = """
Controllers that were published with numbers, on the published arm. The reference values are those
that the source prints; where they differ by more than their last digit, the reason says why.

No text with both the numbers of the arm and of its results could be had of Cannon and Schmitz
(1984), Bayo (1987), Singer and Seering (1990), Wang and Vidyasagar (1991), De Luca and Siciliano
(1993), Kwon and Book (1994), Tokhi and Azad, Luo and Guo (1997), Moallem et al. (1997), Benosman
and Le Vey (2004), Sasaki et al. (2012), Moradi et al. (2013) and Quanser's flexible link, so they
are left out.
"""

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
    Page(
        "control",
        "Published controllers",
        (laboratory_arm.CASE, flexible_panel.CASE, shaper_tolerance.CASE),
        CONTROL,
    ),
)

#: Every case, in the order of the pages.
CASES: tuple[Case, ...] = tuple(case for page in PAGES for case in page.cases)
