"""Thick beams: rotary inertia of the sections, and shear."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from flexarm.view.plot.style import INK, SERIES, legend_above
from gallery.beam import FloatArray, frequencies, mesh_digits, mesh_reason, unit_beam
from gallery.case import Case, Row
from gallery.drawing import OURS
from gallery.references import Reference, reference

ELEMENTS = 64
#: EI / kGA over the squared radius of gyration: 2 (1 + 0.3) / (5/6).
SHEAR = 3.12
#: Modes shown of (root, slenderness).
TABLE = {("clamped", 10.0): 4, ("clamped", 100.0): 2, ("pinned", 10.0): 3}

PHYSICS = r"""
A slender beam only bends. In a thick beam the rotary inertia of the sections matters
(*Rayleigh's* beam), and so does shear (*Timoshenko's* beam). Both reduce the frequencies, those
of higher modes most. With the radius of gyration $r = \sqrt{I/A}$ the *slenderness* is $L/r$: 10
is the limit of beam theory, 100 is a typical robot link.

Here $\rho I = \mu r^2$ and, for the shear coefficient 5/6 and Poisson's ratio 0.3,
$EI/kGA = 3.12\,r^2$.

The package: `rotary_inertia_per_length=...` on a link, and `element="timoshenko"` with
`shear_rigidity=...`.
"""


@cache
def lambdas(root: str, slenderness: float, kind: str) -> FloatArray:
    """Frequencies of the thick beam, kind "rayleigh" or "timoshenko"."""
    radius_squared = slenderness**-2
    fields: dict[str, Any] = {"rotary_inertia_per_length": radius_squared}
    if kind == "timoshenko":
        fields |= {"element": "timoshenko", "shear_rigidity": 1 / (SHEAR * radius_squared)}
    return frequencies(
        unit_beam(ELEMENTS, **fields), joints="locked" if root == "clamped" else "free"
    )


def _slender_beta(root: str, mode: int) -> float:
    """beta L of the slender beam, which decides what a mesh gives."""
    if root == "clamped":
        return float(np.sqrt(reference("beams", "clamped").values["lambda"][mode]))
    return float(reference("beams", "hub").values[0]["beta_L"][mode])


def shear_digits(frequency: float) -> float:
    """Digits that elements with shear give.

    They miss as much as elements that only bend, lambda^2 h^4 / 1440 of lambda with L = EI = mu =
    1, and up to seven times more where shear dominates; theory page "beams", section 9.
    """
    return -math.log10(8.0 * frequency**2 / ELEMENTS**4 / 1440.0)


def quantities() -> list[Row]:
    rows = []
    for kind in ("rayleigh", "timoshenko"):
        known: Reference = reference("beams", kind)
        for case in known.values:
            root, slenderness = case["root"], case["slenderness"]
            for k in range(TABLE.get((root, slenderness), 0)):
                slender = _slender_beta(root, k)
                if kind == "rayleigh":
                    digits, reason = mesh_digits(slender, ELEMENTS), mesh_reason(ELEMENTS)
                else:
                    digits = shear_digits(case["lambda"][k])
                    reason = (
                        f"with shear, a mesh of {ELEMENTS} elements gives λ too high by up to "
                        "λ² h⁴/180, with L = EI = μ = 1"
                    )
                rows.append(
                    Row(
                        f"{kind.capitalize()}, {root}, L/r = {slenderness:g}, λ of mode {k + 1}",
                        "1",
                        known.source,
                        case["lambda"][k],
                        float(lambdas(root, slenderness, kind)[k]),
                        digits,
                        reason,
                    )
                )
    return rows


def draw(figure: Figure) -> None:
    axes = figure.subplots()
    slenderness = np.geomspace(8, 250, 24)
    slender = reference("beams", "clamped").values["lambda"]
    styles = {"rayleigh": (0, (4, 2)), "timoshenko": "solid"}
    for kind, style in styles.items():
        found = np.array([lambdas("clamped", float(s), kind)[:3] for s in slenderness])
        for k in range(3):
            axes.plot(
                slenderness,
                found[:, k] / slender[k],
                color=SERIES[k],
                linewidth=1.2,
                linestyle=style,
            )
            if kind == "timoshenko":
                start = slenderness[0], found[0, k] / slender[k]
                axes.annotate(
                    f"mode {k + 1}",
                    start,
                    (-4, 0),
                    textcoords="offset points",
                    fontsize=8,
                    color=SERIES[k],
                    ha="right",
                    va="center",
                )
        for case in reference("beams", kind).values:
            if case["root"] == "clamped":
                for k in range(3):
                    ratio = case["lambda"][k] / slender[k]
                    axes.plot(case["slenderness"], ratio, **OURS, color=SERIES[k])
    axes.set(xscale="log", xlabel="slenderness $L/r$", ylabel="relative $\\lambda$")
    axes.set_xticks([10, 20, 50, 100, 200], ["10", "20", "50", "100", "200"], minor=False)
    axes.minorticks_off()
    axes.set(xlim=(5.9, 250), ylim=(0.4, 1.02))
    axes.set_title("Frequency over that of a slender beam")
    lines = [Line2D([], [], color=INK, linestyle=style) for style in styles.values()]
    known = Line2D([], [], **OURS, color=INK)
    legend_above(axes, [*lines, known], ["rotary inertia", "rotary inertia and shear", "known"])


CASE = Case(
    name="rotary-inertia",
    title="Thick beam",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Clamped beam: reduction of the frequencies by rotary inertia only (dashed) and "
    "together with shear (solid). Points: reference values.",
    module="gallery/cases/rotary_inertia.py",
)
