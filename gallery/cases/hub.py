"""Frequencies of a beam on a pinned hub: between those of the pinned and the clamped beam."""

from __future__ import annotations

from functools import cache

import numpy as np
from matplotlib.figure import Figure

from flexarm.view.plot.style import GREY, SERIES, legend_above
from gallery.beam import FloatArray, frequencies, mesh_digits, mesh_reason, unit_beam
from gallery.case import Case, Row
from gallery.drawing import KNOWN, OURS
from gallery.references import reference

ELEMENTS = 64
TABLE = {0.0: 3, 0.1: 3, 10.0: 2}  # modes shown of each hub inertia

PHYSICS = r"""
The root of a beam rotates with a hub of inertia $J = \eta\,\mu L^3$ on a free joint. With
$\eta = 0$ it is the pinned-free beam. With increasing $\eta$ the hub restrains the root more,
until the beam is clamped.

These two sets of frequencies are the most important ones for control. The free-joint frequencies
are the poles and the clamped ones are the zeros from motor torque to joint angle, and they
interlace.

The package: `fa.Joint(hub_inertia=...)` and `fa.modes(arm, joints="free")`; the rigid rotation
comes first and is omitted.
"""


@cache
def beta(hub: float) -> FloatArray:
    """Numbers beta L of the beam on a hub."""
    return np.sqrt(frequencies(unit_beam(ELEMENTS, hub=hub), joints="free"))


def quantities() -> list[Row]:
    known = reference("beams", "hub")
    return [
        Row(
            f"hub inertia η = {case['hub']:g}, βL of mode {k + 1}",
            "1",
            known.source,
            exact,
            float(beta(case["hub"])[k]),
            mesh_digits(exact, ELEMENTS, power=1),
            mesh_reason(ELEMENTS),
        )
        for case in known.values
        for k, exact in enumerate(case["beta_L"][: TABLE.get(case["hub"], 0)])
    ]


def draw(figure: Figure) -> None:
    axes = figure.subplots()
    hubs = np.geomspace(2e-4, 200, 60)
    found = np.array([beta(float(hub))[:3] for hub in hubs])
    known = [case for case in reference("beams", "hub").values if case["hub"] > 0]
    clamped = np.sqrt(reference("beams", "clamped").values["lambda"])
    for k in range(3):
        axes.plot(hubs, found[:, k], color=SERIES[k], label=f"mode {k + 1}")
        exact = [case["beta_L"][k] for case in known]
        style = {**OURS, "color": KNOWN["color"], "markersize": 3.2}
        axes.plot([case["hub"] for case in known], exact, **style)
    for k, value in enumerate(clamped[:4]):
        axes.axhline(value, color=GREY, linewidth=0.7, linestyle=(0, (4, 2)), zorder=0)
        axes.text(230, value, f"clamped {k + 1}", va="center", fontsize=8, color=GREY)
    axes.plot([], [], **{**OURS, "color": KNOWN["color"]}, label="known")
    axes.set(xscale="log", xlabel="hub inertia $\\eta = J/\\mu L^3$", ylabel="$\\beta L$")
    axes.set_ylim(1.5, 11.6)
    axes.grid(False)
    axes.set_title("Frequencies with the joint free")
    legend_above(axes)


CASE = Case(
    name="hub",
    title="Beam on a hub",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Frequencies with the joint free decrease from those of the pinned beam (left) to "
    "those of the clamped one (right), and never cross them.",
    module="gallery/cases/hub.py",
)
