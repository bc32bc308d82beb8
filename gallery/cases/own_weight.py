"""A beam that hangs or stands under its own weight: gravity as stiffness, and buckling."""

from __future__ import annotations

import warnings
from functools import cache

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import brentq

import flexarm as fa
from flexarm.view.plot.style import BLUE, INK, VERMILLION
from gallery.beam import FloatArray, unit_beam
from gallery.case import Case, Row
from gallery.drawing import OURS
from gallery.line_labels import label_lines
from gallery.references import reference

ELEMENTS, ELEMENTS_OF_CURVES = 48, 12
SHOWN = {1.0: 3, 10.0: 3, 100.0: 3}
REASON = (
    f"a mesh of {ELEMENTS} elements, (βh)⁴/1440 without weight and up to 2e-7 for mode 1 at Γ = 100"
)

PHYSICS = r"""
A clamped beam hangs under its own weight, $\Gamma = \mu g L^3/EI$. The weight below a section
pulls on it, as in a string with some bending stiffness, and the frequencies rise. In a standing
beam the same term reduces the stiffness, and at $\Gamma = 7.837$ the beam buckles under its own
weight (Greenhill's mast).

Without foreshortening, gravity does no work when a hanging beam bends: the linear theory gives
$\lambda_1 = 3.516$ for every weight, hanging or standing. This is wrong. Arms that carry weight
along their links need `theory="second_order"`.

The package: `gravity=(0, -g)`, the link pointing down or up, `fa.modes`; `squared_frequency`
passes through zero at buckling.
"""


@cache
def squared(weight: float, theory: str = "second_order", elements: int = ELEMENTS) -> FloatArray:
    """Squared frequencies of the hanging (weight > 0) or standing beam."""
    arm = unit_beam(elements, weight=abs(weight), theory=theory)
    angle = -np.pi / 2 if weight >= 0 else np.pi / 2
    with warnings.catch_warnings():
        if theory == "linear":  # it neglects the weight, which is shown here
            warnings.simplefilter("ignore", fa.LargeDeflectionWarning)
        return fa.modes(arm, [angle]).squared_frequency


def buckling_weight() -> float:
    """Weight at which the standing beam loses its stiffness."""
    return float(brentq(lambda weight: squared(-weight, elements=24)[0], 7.0, 8.5, xtol=1e-12))


def quantities() -> list[Row]:
    known, mast = reference("gravity", "hanging"), reference("gravity", "buckling")
    rest = reference("beams", "clamped")
    rows = []
    for case in known.values:
        for k in range(SHOWN.get(case["weight"], 0)):
            digits = (8.3, 7.0, 6.2)[k] if case["weight"] <= 10 else (7.0, 6.8, 6.2)[k]
            found = float(np.sqrt(squared(case["weight"])[k]))
            name = f"hanging, Γ = {case['weight']:g}, λ of mode {k + 1}"
            rows.append(Row(name, "1", known.source, case["lambda"][k], found, digits, REASON))
    rows.append(
        Row(
            "hanging, Γ = 10, λ of mode 1 in the linear theory",
            "1",
            rest.source,
            rest.values["lambda"][0],
            float(np.sqrt(squared(10.0, "linear")[0])),
            8.5,
            (
                "the linear theory wrongly neglects the weight and gives the frequency of the "
                "beam without it"
            ),
        )
    )
    rows.append(
        Row(
            "standing, Γ at which it buckles",
            "1",
            mast.source,
            mast.values,
            buckling_weight(),
            6.5,
            (
                "a mesh of 24 elements; frequencies and buckling loads have errors of the fourth "
                "power of its length"
            ),
        )
    )
    return rows


def draw(figure: Figure) -> None:
    left, right = figure.subplots(1, 2, width_ratios=[1.2, 1.0])
    weights = np.linspace(-9, 20, 59)
    for theory, colour in (("second_order", BLUE), ("linear", VERMILLION)):
        values = [squared(float(w), theory, ELEMENTS_OF_CURVES)[0] for w in weights]
        left.plot(weights, values, color=colour, label=theory.replace("_", " "))
    known = reference("gravity", "hanging").values
    inside = [case for case in known if case["weight"] <= 20]
    x = [case["weight"] for case in inside]
    left.plot(x, [case["lambda"][0] ** 2 for case in inside], **OURS, color=INK)
    left.plot(-reference("gravity", "buckling").values, 0.0, **OURS, color=INK)
    left.annotate("buckles", (-7.84, 0), (-7.6, -4.2), fontsize=8)
    left.axhline(0, color=INK, linewidth=0.6)
    left.axvline(0, color=INK, linewidth=0.6)
    left.set(title="First frequency", xlabel="weight $\\Gamma$", ylabel="$\\lambda_1^2$")
    left.text(-0.6, 38.0, "standing", ha="right", fontsize=8)
    left.text(0.6, 38.0, "hanging", fontsize=8)
    left.set_ylim(-6.0, 46.0)
    heavy = np.linspace(0, 100, 26)
    for k in range(3):
        ratio = [squared(float(w), elements=ELEMENTS_OF_CURVES)[k] for w in heavy]
        right.plot(heavy, np.sqrt(ratio), color=BLUE, label=f"mode {k + 1}")
        right.plot([c["weight"] for c in known], [c["lambda"][k] for c in known], **OURS, color=INK)
    right.set(xlabel="weight $\\Gamma$", ylabel="$\\lambda$", ylim=(0, 85))
    right.margins(x=0.03)
    right.set_title("Hanging")
    for axes in (left, right):
        label_lines(axes)


CASE = Case(
    name="own-weight",
    title="Beam under its own weight",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Left: squared first frequency of a standing (left half) and a hanging beam; it is "
    "zero where the mast buckles. Right: the first three frequencies of the hanging beam. "
    "Points: reference values.",
    module="gallery/cases/own_weight.py",
)
