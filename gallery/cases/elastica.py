"""Large static deflection: segments of a link against the elastica."""

from __future__ import annotations

from functools import cache

import numpy as np
from matplotlib.figure import Figure

import flexarm as fa
from flexarm.arm.bending import one_warning
from flexarm.view.plot.style import BLUE, INK, VERMILLION
from gallery.beam import FloatArray, unit_beam
from gallery.case import Case, Row, Source
from gallery.drawing import OURS, logarithmic_ticks
from gallery.line_labels import label_lines
from gallery.references import reference

PIECES = (4, 8, 16, 32, 64)
FINEST = 64
THEORIES = {"linear": (VERMILLION, 2.0), "second_order": (BLUE, 3.0)}
SHOWN_LOADS = (0.5, 1.0, 2.0, 5.0, 10.0)
FINE_REASON = (
    f"{FINEST} pieces in the second-order theory; their error decreases as the cube of their "
    "length, from 8e-3 with 4 at α = 5"
)
ORDER_REASON = "the next power of the length in the error affects the observed order"

PHYSICS = r"""
A cantilever bends under a dead force across its tip, $\alpha = PL^2/EI$. At $\alpha = 5$ the tip
moves sideways by 71 % of the length. No theory of small deflections is valid for the whole link,
but every one is valid for a short piece of it. `segments=k` divides a link into a chain of $k$
rigidly joined pieces, each with its own floating frame. Rotations between the pieces are finite,
and with increasing $k$ the chain converges to the exact elastica, in either theory. The paper's
linear pieces converge with the square of the length of a piece, second-order pieces with its
cube.

The package: `fa.Link(..., segments=k)` and `fa.equilibrium(arm, tip_force=(0, P))`.
"""


@cache
def bent(load: float, pieces: int, theory: str) -> tuple[fa.Arm, FloatArray]:
    """Arm of a number of segments and its equilibrium q."""
    arm = unit_beam(pieces, segments=pieces, theory=theory)
    with one_warning():  # the errors are what the case shows
        return arm, fa.equilibrium(arm, tip_force=(0.0, load)).q


def tip(load: float, pieces: int, theory: str) -> tuple[float, float, float]:
    """Deflection and draw-in over L, and slope (rad) of the tip."""
    arm, q = bent(load, pieces, theory)
    x, y, slope = arm.tip(q)
    return float(y), float(1 - x), float(slope)


def errors(theory: str, case: dict[str, float]) -> FloatArray:
    """Error of the deflection with each number of segments."""
    found = [tip(case["load"], count, theory)[0] for count in PIECES]
    return np.array(found) - case["deflection"]


def quantities() -> list[Row]:
    known = reference("statics", "bisshopp_drucker")
    rows = []
    for case in known.values:
        found = tip(case["load"], FINEST, "second_order")
        digits = 6.8 if case["load"] == 1.0 else 5.7
        for name, ours in zip(("deflection", "draw_in", "slope"), found, strict=True):
            quantity = f"α = {case['load']:g}, {name.replace('_', '-')} of the tip"
            unit = "rad" if name == "slope" else "1"
            row = Row(
                quantity, unit, known.source, case[name], ours, digits, FINE_REASON, scale=1.0
            )
            rows.append(row)
    order = Source("convergence", "Order of convergence of the theory used in each segment.")
    for theory, (_, power) in THEORIES.items():
        last = np.abs(errors(theory, known.values[1]))[-2:]
        found_order = float(np.log2(last[0] / last[1]))
        quantity = f"α = 5, order in segment length, {theory.replace('_', ' ')}"
        rows.append(Row(quantity, "1", order, power, found_order, 1.8, ORDER_REASON))
    return rows


def draw(figure: Figure) -> None:
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.2])
    for load in SHOWN_LOADS:
        arm, q = bent(load, 16, "second_order")
        x, y = arm.shape(q, stations=161)[0].T
        left.plot(x, y, color=BLUE)
        left.text(x[-1] + 0.03, y[-1], f"{load:g}", fontsize=8, va="center")
    for case in reference("statics", "bisshopp_drucker").values:
        left.plot(1 - case["draw_in"], case["deflection"], **OURS, color=INK)
    left.set(aspect="equal", xlabel="$x/L$", ylabel="$y/L$", xlim=(0, 1.12), ylim=(-0.02, 0.9))
    left.set_title("Shape, by load $\\alpha$")
    left.grid(False)
    case = reference("statics", "bisshopp_drucker").values[1]
    k = np.array(PIECES)
    for theory, (colour, power) in THEORIES.items():
        found = np.abs(errors(theory, case))
        right.plot(k, found, **OURS, color=colour, label="_")
        law = found[-1] * (k / k[-1]) ** -power
        right.plot(
            k,
            law,
            color=colour,
            linewidth=0.9,
            label=f"{theory.replace('_', ' ')}, $k^{{-{power:g}}}$",
        )
    right.set(xlabel="segments $k$", ylabel="error of $v/L$ at $\\alpha = 5$", yscale="log")
    logarithmic_ticks(right, PIECES)
    right.margins(x=0.05)
    right.set_title("Error of the tip")
    label_lines(right)


CASE = Case(
    name="elastica",
    title="Cantilever, large deflection",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Left: the cantilever in sixteen second-order segments under increasing loads; "
    "points are reference values of the tip. Right: error against the number of "
    "segments.",
    module="gallery/cases/elastica.py",
)
