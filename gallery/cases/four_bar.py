"""A rigid four-bar turns under gravity: a closed loop with one degree of freedom."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import CubicSpline

import flexarm as fa
from flexarm.view.plot.style import BLUE, GREY, INK, VERMILLION
from gallery.beam import FloatArray
from gallery.case import Case, Row, distance_digits
from gallery.drawing import KNOWN, OURS
from gallery.line_labels import label_lines
from gallery.references import reference

if TYPE_CHECKING:
    import xarray as xr

CRANK, COUPLER, ROCKER, GROUND = 0.3, 0.9, 0.7, 1.0  # m
GRAVITY, START_RATE = 9.81, 9.0
RATE = 2000.0
#: Coupler and rocker at the start: the crank lies along the ground, and the loop is a triangle.
START = (0.0, 0.8725738534323366, 1.7451477068646734)
TURNS = (1.0, -3.0 / 7.0, -3.0 / 7.0)  # rates of the links there, for a crank at 1 rad/s
REASON = "the tolerance of the integrator, rtol = 1e-10"
GAP_REASON = "every step ends on the closure; samples inside a step are interpolated"

PHYSICS = r"""
Three rigid rods and the ground form a closed loop, which turns under gravity without a motor. The
loop has one degree of freedom. A triangle gives the angles of coupler and rocker at any angle of
the crank, and the energy equation $\tfrac12I(\varphi)\,\dot\varphi^2 + U(\varphi) = E$ gives the
time.

The package has three joint angles and a pin between the tips of coupler and rocker. The gap of
this pin is one of the rows: it shows that the loop remains closed.

The package: `fa.Link(parent=0)` for the rocker, and `fa.Closure(link=2, to_link=3)`.
"""


def four_bar() -> fa.Arm:
    """Make the four-bar: crank with coupler, and a rocker on the ground."""
    rods = [(CRANK, 1.0, None), (COUPLER, 0.8, None), (ROCKER, 0.6, 0)]
    links = [
        fa.Link(length=length, mass_per_length=mass, flexible=False, parent=parent)
        for length, mass, parent in rods
    ]
    joints = [fa.Joint(), fa.Joint(), fa.Joint(offset=(GROUND, 0.0))]
    closures = [fa.Closure(link=2, to_link=3)]
    return fa.Arm(links=links, joints=joints, closures=closures, gravity=(0.0, -GRAVITY))


def relative(angles: tuple[float, float, float]) -> FloatArray:
    """Return joint angles or rates (3,) from those of the links."""
    crank, coupler, rocker = angles
    return np.array([crank, coupler - crank, rocker])


@cache
def run() -> tuple[fa.Arm, xr.Dataset]:
    """Simulate one turn of the crank."""
    arm = four_bar()
    duration = reference("mechanisms", "four_bar").values[-1]["t"]
    rates = START_RATE * relative(TURNS)
    result = fa.simulate(
        arm,
        duration,
        initial=relative(START),
        initial_rate=rates,
        rate=RATE,
        rtol=1e-10,
        atol=1e-12,
    )
    return arm, result


def quantities() -> list[Row]:
    known = reference("mechanisms", "four_bar")
    arm, result = run()
    angles = CubicSpline(result.time.values, result.link_angle.values)
    rows = []
    for case in known.values:
        found = angles(case["t"])
        for k, name in enumerate(("crank", "coupler", "rocker")):
            quantity = f"angle of the {name} at {case['t']:.6f} s"
            rows.append(
                Row(quantity, "rad", known.source, case[name], float(found[k]), 9.0, REASON)
            )
    gap = max(float(np.max(np.abs(arm.closure_gaps(q)))) for q in result.q.values)
    digits = distance_digits(1e-9, GROUND)
    name = "largest gap of the pin"
    rows.append(Row(name, "m", known.source, 0.0, gap, digits, GAP_REASON, scale=GROUND))
    return rows


def draw(figure: Figure) -> None:
    left, right = figure.subplots(1, 2, width_ratios=[1.25, 1.0])
    arm, result = run()
    for q in result.q.values[:: round(0.04 * RATE)]:
        crank, coupler, rocker = (np.asarray(points).T for points in arm.shape(q, stations=2))
        left.plot(*crank, color=VERMILLION, linewidth=1.0)
        left.plot(*coupler, color=BLUE, linewidth=1.0)
        left.plot(*rocker, color=GREY, linewidth=1.0)
    left.plot([0.0, GROUND], [0.0, 0.0], "o", color=INK, markersize=3, markerfacecolor="white")
    left.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    left.set_title("Motion")
    left.grid(False)
    known = reference("mechanisms", "four_bar").values
    turned = result.link_angle.values
    for k, (name, colour) in enumerate(
        (("crank", VERMILLION), ("coupler", BLUE), ("rocker", GREY))
    ):
        right.plot(result.time, turned[:, k], **{**KNOWN, "color": colour}, label=name)
        right.plot([c["t"] for c in known], [c[name] for c in known], **OURS, color=INK)
    right.set(xlabel="time [s]", ylabel="angle [rad]")
    right.set_title("Angles of the links")
    label_lines(right)


CASE = Case(
    name="four-bar",
    title="Four-bar",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Left: crank (vermilion), coupler (blue) and rocker (grey) every 40 ms. Right: angles "
    "of the links over one turn; points are reference values.",
    module="gallery/cases/four_bar.py",
)
