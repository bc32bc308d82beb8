"""Link frequencies as published by De Luca and Siciliano."""

from __future__ import annotations

from functools import cache

import numpy as np
from matplotlib.figure import Figure

import flexarm as fa
from flexarm.view.plot.style import SERIES
from gallery.beam import FloatArray, wave_digits
from gallery.case import Case, Row, rounding_digits
from gallery.line_labels import label_lines
from gallery.references import reference

ELEMENTS = 32
PRINTED = "half a unit of the second printed decimal"
EXACT = (
    f"a mesh of {ELEMENTS} elements, error at most (βh)⁴/1440; where the heavy tip has most of "
    "the energy, the ten printed digits"
)
PRINTED_EXACT = 9.9  # ten digits are printed

PHYSICS = r"""
A two-link arm that is often cited has two equal links of 0.5 m, 0.2 kg/m and $EI$ = 1 N m². Its
link modes are those of clamped beams with lumped bodies at the tip. The first link carries elbow
motor, second link and payload (1.2 kg, 0.134 kg m² in all), the second the payload (0.1 kg,
0.0005 kg m²).

The package: `fa.Payload(mass=..., inertia=...)`, `fa.modes(arm)`.
"""


@cache
def modes(mass: float, inertia: float) -> tuple[fa.Arm, fa.Modes]:
    """One clamped link with a lumped tip, and its modes."""
    link = fa.Link(length=0.5, flexural_rigidity=1.0, mass_per_length=0.2, elements=ELEMENTS)
    arm = fa.Arm(links=[link], payload=fa.Payload(mass=mass, inertia=inertia))
    return arm, fa.modes(arm)


def hertz(case: dict[str, float]) -> FloatArray:
    """Frequencies of a case, Hz."""
    return modes(case["tip_mass"], case["tip_inertia"])[1].frequency_hz


def quantities() -> list[Row]:
    published, exact = reference("link_modes", "published"), reference("link_modes", "exact")
    rows = []
    for known in (published, exact):
        for case in known.values:
            for k, value in enumerate(case["hertz"]):
                law = wave_digits(2 * np.pi * value, 0.2, 0.5 / ELEMENTS)
                digits, reason = min(law, PRINTED_EXACT), EXACT
                if known is published:
                    digits, reason = rounding_digits(value, 2), PRINTED
                quantity = f"link {case['link']}, frequency {k + 1}"
                found = float(hertz(case)[k])
                rows.append(Row(quantity, "Hz", known.source, value, found, digits, reason))
    return rows


def draw(figure: Figure) -> None:
    panels = figure.subplots(1, 2)
    for case, axes in zip(reference("link_modes", "published").values, panels, strict=True):
        arm, found = modes(case["tip_mass"], case["tip_inertia"])
        for k in range(2):
            x, y = arm.shape(1e-6 * found.shapes[k], stations=80)[0].T
            label = f"{found.frequency_hz[k]:.3f} Hz (published {case['hertz'][k]:.2f})"
            axes.plot(x, y / np.max(np.abs(y)), color=SERIES[k], label=label)
        axes.set(xlabel="x [m]", ylabel="shape", ylim=(-0.2, 1.12), xlim=(0, 0.5))
        axes.set_title(f"Link {case['link']}")
    for axes in panels:
        label_lines(axes)


CASE = Case(
    name="link-modes",
    title="Published link frequencies",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Shapes of the two published modes of each link.",
    module="gallery/cases/link_modes.py",
)
