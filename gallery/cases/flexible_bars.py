"""Flexible four-bar and five-bar: closed loops of bending bars, beside another program."""

from __future__ import annotations

import math
import warnings
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from peers.closed_chain import FIVE_BAR, FOUR_BAR, mechanism

import flexarm as fa
from flexarm.view.plot.style import BLUE, GREY, INK, VERMILLION
from gallery.beam import FloatArray
from gallery.case import Case, Row
from gallery.drawing import OURS
from gallery.line_labels import label_lines
from gallery.references import reference

if TYPE_CHECKING:
    import xarray as xr

CASES = {"four-bar": FOUR_BAR, "five-bar": FIVE_BAR}
SEGMENTS, MODES = {"four-bar": 4, "five-bar": 16}, 3
SAMPLES = 200
#: Of the compared positions, m.
CERTAIN = 1e-5
REASON = "the reference is certain to 5e-6 m, and the segments converge to as much"

PHYSICS = r"""
Two closed loops of flexible bars move in a vertical plane. The crank of the four-bar starts with
12 rad/s; the five-bar, two bars on each of two feet, falls from rest, and its bars bend by up to
4 % of their length. The compared quantity is the position of the pin between coupler and rocker, or
between the two chains, at half a second and at the end.

The other program, Exudyn, has extensible cable elements in absolute nodal coordinates. Links do not
stretch: the numbers are extrapolated to an infinite axial stiffness, which changes them by 4e-5 m.
`peers/closed_chain.py` repeats them.

The package: `fa.Link(parent=0)` starts the second chain, `fa.Closure` pins the ends together, and
`fa.assembled` finds the angles at which they meet. The bars have four and 16 segments of three
modes in the second-order theory.
"""


@cache
def run(name: str) -> tuple[fa.Arm, xr.Dataset]:
    """Simulate a mechanism for a second."""
    arm, start = mechanism(CASES[name], SEGMENTS[name], MODES)
    with warnings.catch_warnings():  # how far segments bend is part of the comparison
        warnings.simplefilter("ignore", fa.LargeDeflectionWarning)
        result = fa.simulate(
            arm,
            CASES[name].duration,
            initial=start.q,
            initial_rate=start.qd,
            rate=SAMPLES,
            rtol=1e-7,
            integrator="kennedy_carpenter_5",
        )
    return arm, result


def eighths(name: str) -> FloatArray:
    """Positions of the pin after eighths of the run, (8, 2) m."""
    tips: FloatArray = run(name)[1].tip.values[SAMPLES // 8 :: SAMPLES // 8, :2]
    return tips


def quantities() -> list[Row]:
    known = reference("mechanisms", "bars")
    rows = []
    for name in CASES:
        for k in (3, 7):
            for axis, label in enumerate("xy"):
                rows.append(
                    Row(
                        f"{label} of the pin of the {name} after {(k + 1) / 8:g} s",
                        "m",
                        known.source,
                        known.values[name][k][axis],
                        float(eighths(name)[k, axis]),
                        -math.log10(CERTAIN),
                        REASON,
                        scale=1.0,
                    )
                )
    return rows


def draw(figure: Figure) -> None:
    for axes, name in zip(figure.subplots(1, 2), CASES, strict=True):
        arm, result = run(name)
        known = np.array(reference("mechanisms", "bars").values[name])
        for k, colour in ((0, GREY), (SAMPLES, VERMILLION)):
            shape = arm.shape(result.q.values[k], stations=9)
            for points in shape:
                axes.plot(*np.asarray(points).T, color=colour, linewidth=1.2)
        axes.plot(*result.tip.values[:, :2].T, color=BLUE, linewidth=0.9, label="pin")
        axes.plot(*known.T, **OURS, color=INK)
        axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
        axes.margins(0.05)
        axes.set_title(name.capitalize())
    label_lines(figure.axes[0])


CASE = Case(
    name="flexible-bars",
    title="Flexible four-bar and five-bar",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Paths of the pins (blue), with the bars at the start (grey) and at the end "
    "(red). Points are positions of the other program.",
    module="gallery/cases/flexible_bars.py",
)
