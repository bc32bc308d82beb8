"""Frequencies of a beam with a mass and a rotary inertia at its tip."""

from __future__ import annotations

from functools import cache

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from flexarm.view.plot.style import BLUE, INK, VERMILLION, legend_above
from gallery.beam import FloatArray, frequencies, mesh_digits, mesh_reason, unit_beam
from gallery.case import Case, Row
from gallery.drawing import OURS
from gallery.line_labels import label_lines
from gallery.references import reference

ELEMENTS = 64

PHYSICS = r"""
A rigid body at the tip has mass $m$ and rotary inertia $J$ about the tip, in units of $\mu L$ and
$\mu L^3$ of the beam. The mass reduces every frequency. The inertia clamps the slope of the tip
in all modes except the lowest.

The package: `fa.Payload(mass=..., inertia=...)`, joint locked, or free with a hub.
"""

#: Hub (None: clamped), tip mass, tip inertia and number of modes of the rows.
TABLE: tuple[tuple[float | None, float, float, int], ...] = (
    (None, 1.0, 0.0, 3),
    (None, 100.0, 0.0, 1),
    (None, 1.0, 0.1, 3),
    (0.1, 0.5, 0.01, 3),
    (1.0, 1.0, 0.1, 1),
)


@cache
def beta(hub: float | None, mass: float, inertia: float) -> FloatArray:
    """Numbers beta L of the loaded beam, clamped or on a free hub."""
    arm = unit_beam(ELEMENTS, hub=hub or 0.0, tip_mass=mass, tip_inertia=inertia)
    return np.sqrt(frequencies(arm, joints="locked" if hub is None else "free"))


def quantities() -> list[Row]:
    rows = []
    for hub, mass, inertia, modes in TABLE:
        known = reference("beams", "payload" if hub is None else "hub_and_payload")
        exact = next(
            case["beta_L"]
            for case in known.values
            if (case.get("hub"), case["tip_mass"], case["tip_inertia"]) == (hub, mass, inertia)
        )
        root = "clamped" if hub is None else f"hub {hub:g}"
        rows += [
            Row(
                f"{root}, tip mass {mass:g}, tip inertia {inertia:g}, βL of mode {k + 1}",
                "1",
                known.source,
                exact[k],
                float(beta(hub, mass, inertia)[k]),
                mesh_digits(exact[k], ELEMENTS, power=1),
                mesh_reason(ELEMENTS) + ", or less if lumped bodies have much of the energy",
            )
            for k in range(modes)
        ]
    return rows


def draw(figure: Figure) -> None:
    axes = figure.subplots()
    masses = np.geomspace(0.02, 200, 50)
    known = reference("beams", "payload").values
    for inertia, colour in ((0.0, BLUE), (0.1, VERMILLION)):
        found = np.array([beta(None, float(mass), inertia)[:3] for mass in masses])
        for k in range(3):
            axes.plot(masses, found[:, k], color=colour, label=f"mode {k + 1}")
        for case in known:
            if case["tip_inertia"] == inertia and case["tip_mass"] > 0:
                x = [case["tip_mass"]] * 3
                axes.plot(x, case["beta_L"][:3], **{**OURS, "markersize": 3.2}, color=INK)
    axes.set(xscale="log", xlabel="tip mass $m/\\mu L$", ylabel="$\\beta L$", ylim=(0, 8.8))
    axes.set_title("Frequencies of a clamped beam")
    label_lines(axes)
    shown = [Line2D([], [], color=colour) for colour in (BLUE, VERMILLION)]
    known = Line2D([], [], **OURS, color=INK)
    legend_above(axes, [*shown, known], ["tip inertia 0", "tip inertia 0.1", "known"])


CASE = Case(
    name="payload",
    title="Beam with a payload",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="With a heavy tip the first mode is that of a mass on a spring. The higher modes "
    "are those of a beam with a fixed tip: pinned without tip inertia, clamped with it.",
    module="gallery/cases/payload.py",
)
