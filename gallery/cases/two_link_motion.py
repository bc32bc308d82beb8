"""Motion of the two-link arm of Table I under torques, against converged histories."""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

import flexarm as fa
from flexarm.view.plot.style import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, VERMILLION
from gallery.beam import FloatArray
from gallery.case import Case, Row, distance_digits
from gallery.drawing import KNOWN
from gallery.line_labels import label_lines
from gallery.references import history, reference
from gallery.two_link import LENGTHS, two_link_arm

if TYPE_CHECKING:
    import xarray as xr

RATE, DURATION = 100.0, 2.0
REACH = sum(LENGTHS)

#: Models by name: theory, elements on the links, further fields of both links.
MODELS: dict[str, tuple[str, int | tuple[int, int], dict[str, Any]]] = {
    "linear, 2 + 1 elements": ("linear", (2, 1), {}),
    "linear, 16 + 16 elements": ("linear", 16, {"modes": 12}),
    "second order": ("second_order", 16, {"modes": 8}),
    "2 segments": ("second_order", 4, {"segments": 2}),
    "4 segments": ("second_order", 8, {"segments": 4}),
    "8 segments": ("second_order", 16, {"segments": 8, "modes": 3}),
}
COLOURS = dict(zip(MODELS, (ORANGE, VERMILLION, PURPLE, SKY, BLUE, GREEN), strict=True))

#: Largest distance of the tip from the reference that is accepted, m, and why.
ACCEPTED = {
    ("linear, 2 + 1 elements", "paper"): (
        2e-11,
        (
            "the tolerance of the integrator, rtol = 1e-10, over 2 s; the reference is accurate to "
            "1e-11 m"
        ),
    ),
    ("linear, 16 + 16 elements", "linear_fine"): (
        4e-7,
        "12 of the 32 shapes of each link are kept",
    ),
    ("second order", "exact"): (
        2e-5,
        (
            "second-order theory over whole links: terms of third order in a deflection of 5 % are "
            "neglected"
        ),
    ),
    ("2 segments", "exact"): (
        3e-5,
        "two segments of two elements; the error of the mesh also contributes",
    ),
    ("4 segments", "exact"): (7e-6, "four segments of two elements"),
    ("8 segments", "exact"): (
        1e-6,
        "eight segments of two elements, three shapes each; the reference is accurate to 2e-7 m",
    ),
}

PHYSICS = r"""
The arm of Table I moves in a horizontal plane. It starts at rest with straight links at 45 and -45
degrees. For one second it is driven by $\tau_1 = 4\sin 2\pi t$ and $\tau_2 = 1.5\sin 2\pi t$ N m,
and for another second it moves freely. Links bend by 5 % of their length.

The references are the converged solutions of the paper's theory, on its own mesh and on a fine
one, and the motion of geometrically exact links. The compared quantity is the largest distance
between tips in two seconds, relative to the reach of 2.41 m.

The paper's theory itself differs from the exact arm by 0.4 mm; no mesh reduces this error.
Foreshortening reduces it to 14 micrometres, and segments remove the rest.

The package: `fa.simulate` with a torque function; `theory` and `segments` as in the table.
"""


def torque(t: float) -> list[float]:
    """Joint torques, N m."""
    swing = math.sin(2 * math.pi * t) if t <= 1.0 else 0.0
    return [4.0 * swing, 1.5 * swing]


@cache
def run(model: str) -> tuple[fa.Arm, xr.Dataset]:
    """Simulate one of the models."""
    theory, elements, fields = MODELS[model]
    arm = two_link_arm(elements, theory=theory, **fields)
    tight = model == "linear, 2 + 1 elements"  # compared with a reference to 1e-11 m
    result = fa.simulate(
        arm,
        DURATION,
        torque=torque,
        initial=arm.rest([np.pi / 4, -np.pi / 2]),
        rate=RATE,
        rtol=1e-10 if tight else 1e-7,
        atol=1e-12 if tight else 1e-9,
    )
    return arm, result


def known_tip(file: str) -> FloatArray:
    """Tip of a reference, (samples, 2)."""
    columns = history(f"two_link_{file}")
    return np.stack([columns["tipx"], columns["tipy"]], axis=1)


def distances(model: str, file: str) -> FloatArray:
    """Distance of the tip from a reference, (samples,) m."""
    return np.asarray(np.hypot(*(run(model)[1].tip.values - known_tip(file)).T))


def quantities() -> list[Row]:
    sources = {
        "paper": reference("two_link", "paper_motion").source,
        "linear_fine": reference("two_link", "fine_motion").source,
        "exact": reference("two_link", "exact_motion").source,
    }
    words = {"paper": "the same", "linear_fine": "the same, converged", "exact": "exact"}
    rows = []
    for (model, file), (accepted, reason) in ACCEPTED.items():
        name = "linear_paper" if file == "paper" else file
        found = float(np.max(distances(model, name)))
        digits = distance_digits(accepted, REACH)
        why = f"within {accepted:g} m: {reason}"
        quantity = f"{model}, tip against {words[file]}"
        rows.append(Row(quantity, "m", sources[file], 0.0, found, digits, why, scale=REACH))
    shortfall = float(np.max(np.hypot(*(known_tip("linear_fine") - known_tip("exact")).T)))
    found = float(np.max(distances("linear, 16 + 16 elements", "exact")))
    row = Row(
        "linear theory, its distance from exact",
        "m",
        sources["exact"],
        shortfall,
        found,
        3.3,
        (
            "the quantity is the difference of the two references, that is the error of the linear"
            " theory; it is computed to 4e-7 m"
        ),
    )
    return [*rows, row]


def draw(figure: Figure) -> None:
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.35])
    arm, result = run("8 segments")
    for q in result.q.values[:: round(0.2 * RATE)]:
        for points in arm.shape(q, stations=33):
            left.plot(*points.T, color=BLUE, linewidth=0.9, alpha=0.75)
        left.plot(*arm.shape(q, stations=2)[1, 0], "o", color=INK, markersize=1.8)
    left.plot(*known_tip("exact").T, **KNOWN)
    left.plot(0, 0, "o", color=INK, markersize=3.5, markerfacecolor="white")
    left.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", xlim=(-0.08, 2.0))
    left.set_title("Motion")
    left.grid(False)
    t = result.time.values
    for model, colour in COLOURS.items():
        own = np.maximum.accumulate(distances(model, "exact"))
        right.plot(t[1:], own[1:], color=colour, label=model)
    right.axhline(2e-7, color=GREY, linewidth=0.7, linestyle=(0, (4, 2)))
    right.text(1.98, 1.3e-7, "certainty of the reference", fontsize=8, color=GREY, ha="right")
    right.set(yscale="log", xlabel="time [s]", ylabel="largest tip error so far [m]")
    right.set(xlim=(0, DURATION), ylim=(1e-8, 1e-3))
    right.set_title("Error")
    label_lines(right)


CASE = Case(
    name="two-link-motion",
    title="Two-link arm, motion",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Left: the arm every 0.2 s and the path of the exact tip. Right: largest distance "
    "from the exact tip so far.",
    module="gallery/cases/two_link_motion.py",
    size=(6.6, 3.5),
)
