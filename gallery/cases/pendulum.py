"""A flexible pendulum falls: large rotations, vibration and gravity at once."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

import flexarm as fa
from flexarm.view.plot.style import BLUE, GREY, INK, VERMILLION
from gallery.beam import FloatArray
from gallery.case import Case, Row, distance_digits
from gallery.drawing import OURS, logarithmic_ticks
from gallery.line_labels import label_lines
from gallery.references import reference

if TYPE_CHECKING:
    import xarray as xr

LENGTH, GRAVITY = 1.0, 9.81
SEGMENTS = (1, 2, 4, 8)
FINEST = 8
ACCEPTED = 4e-6  # m
RATE = 500.0
REASON = (
    f"within {ACCEPTED:g} m: {FINEST} segments of two elements, and 1e-6 m of the reference itself"
)
ENERGY_REASON = "the tolerance of the integrator, rtol = 1e-8"

PHYSICS = r"""
A beam of 1 m ($EI = 2$ N m², $\mu = 0.2$ kg/m) on a free pin is released straight and horizontal.
It falls, bends behind its root, and vibrates under gravity and inertia forces that rotate with
it. All terms of the equations contribute.

The reference is the geometrically exact, inextensible and unshearable beam. The angle of its
tangent is a polynomial along the beam. This method has nothing in common with floating frames and
finite elements.

The package: second-order theory and `segments=k` of two elements each; energy is conserved to the
tolerance of the integrator.
"""


@cache
def run(segments: int, theory: str = "second_order") -> tuple[fa.Arm, xr.Dataset]:
    """Let go the pendulum of a number of segments."""
    modes = 3 if segments > 1 else 2
    link = fa.Link(
        length=LENGTH,
        flexural_rigidity=2.0,
        mass_per_length=0.2,
        elements=2 * segments,
        segments=segments,
        modes=modes,
    )
    arm = fa.Arm(links=[link], gravity=(0.0, -GRAVITY), theory=theory)
    return arm, fa.simulate(arm, 0.8, rate=RATE, rtol=1e-8, atol=1e-10)


def tips(segments: int, theory: str = "second_order") -> FloatArray:
    """Tip (x, y) at the times of the reference, (times, 2)."""
    times = [case["t"] for case in reference("pendulum", "falling").values]
    result = run(segments, theory)[1]
    return np.asarray(result.tip.sel(time=times, method="nearest").values)


def quantities() -> list[Row]:
    known = reference("pendulum", "falling")
    digits = distance_digits(ACCEPTED, LENGTH)
    rows = []
    for case, found in zip(known.values, tips(FINEST), strict=True):
        for axis, theirs, ours in zip("xy", case["tip"], found, strict=True):
            quantity = f"tip {axis} at {case['t']:g} s"
            row = Row(
                quantity, "m", known.source, theirs, float(ours), digits, REASON, scale=LENGTH
            )
            rows.append(row)
    result = run(FINEST)[1]
    energy = (result.kinetic_energy + result.strain_energy + result.gravity_energy).values
    worst = float(energy[np.argmax(np.abs(energy - energy[0]))])
    fall = float(result.kinetic_energy.max())
    conserved = reference("pendulum", "energy").source
    row = Row(
        "energy, furthest from its start",
        "J",
        conserved,
        float(energy[0]),
        worst,
        10.0,
        ENERGY_REASON,
        scale=fall,
    )
    return [*rows, row]


def draw(figure: Figure) -> None:
    left, right = figure.subplots(1, 2, width_ratios=[1.25, 1.0])
    arm, result = run(FINEST)
    tip = result.tip.values
    left.plot(*tip.T, color=GREY, linewidth=0.8)
    for q in result.q.values[:: round(0.05 * RATE)]:
        left.plot(*arm.shape(q, stations=41)[0].T, color=BLUE, linewidth=1.0)
    known = reference("pendulum", "falling").values
    left.plot(*np.array([case["tip"] for case in known]).T, **OURS, color=INK)
    left.plot(0, 0, "o", color=INK, markersize=3, markerfacecolor="white")
    left.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", xlim=(-1.06, 1.06), ylim=(-1.06, 0.1))
    left.set_xticks([-1, -0.5, 0, 0.5, 1])
    left.set_title("Motion")
    left.grid(False)
    exact = np.array([case["tip"] for case in known])
    for theory, colour in (("linear", VERMILLION), ("second_order", BLUE)):
        worst = [np.max(np.hypot(*(tips(k, theory) - exact).T)) for k in SEGMENTS]
        label = theory.replace("_", " ")
        right.plot(SEGMENTS, worst, "o-", color=colour, markersize=3.6, label=label)
    right.axhline(1e-6, color=GREY, linewidth=0.7, linestyle=(0, (4, 2)))
    right.text(1, 1.15e-6, "certainty of the reference", fontsize=8, color=GREY)
    right.set(xlabel="segments", ylabel="largest tip error [m]", yscale="log")
    logarithmic_ticks(right, SEGMENTS)
    right.margins(x=0.06)
    right.set_title("Error")
    label_lines(right)


CASE = Case(
    name="pendulum",
    title="Falling flexible pendulum",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Left: the pendulum every 50 ms, eight segments; points are tips of the exact beam. "
    "Right: error at those points against the number of segments.",
    module="gallery/cases/pendulum.py",
)
