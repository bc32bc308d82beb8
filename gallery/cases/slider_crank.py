"""A flexible slider-crank at high speed: a closed loop in which the linear theory fails."""

from __future__ import annotations

import math
import warnings
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

import flexarm as fa
from flexarm.view.plot.style import BLUE, GREY, INK, VERMILLION
from gallery.beam import FloatArray
from gallery.case import Case, Row
from gallery.drawing import OURS, logarithmic_ticks
from gallery.line_labels import label_lines
from gallery.references import reference

if TYPE_CHECKING:
    import xarray as xr

CRANK, LENGTH, DIAMETER = 0.15, 0.3, 0.006  # m
MODULUS, DENSITY = 200e9, 7870.0
SPEED = 150.0  # rad/s
DURATION = 4.0 * math.pi / SPEED
SAMPLES = 1600
SEGMENTS = (1, 2, 4, 8)
FINEST = 8
CERTAIN = 6e-6
REASON = "the reference is certain to about 5e-6 of the length"

PHYSICS = r"""
A rigid crank of 0.15 m turns at 150 rad/s. It drives a coupler of 0.3 m, a round steel rod of 6 mm
with the modulus 200 GPa. The slider has half the mass of the coupler and moves along the $x$ axis.
The coupler starts straight and at rest relative to its root. The compared quantity is the distance
of its middle from the line between its ends, over its length.

The force along the coupler reaches 0.4 of its buckling load. The linear theory neglects the effect
of this force on bending: it overestimates the deflection by a factor of more than 2.

The reference comes from another program, with an extensible beam in absolute nodal coordinates.

The package: crank and coupler are an arm with the slider as its payload, the guide is
`fa.Closure(kind="line", link=2)`, and the motion of the crank is prescribed. The coupler has eight
segments of three modes in the second-order theory.
"""


def _angle(t: float) -> float:
    return SPEED * t


def slider_crank(segments: int, theory: str) -> fa.Arm:
    """Make the mechanism with a number of segments of the coupler."""
    area, moment = math.pi * DIAMETER**2 / 4, math.pi * DIAMETER**4 / 64
    mass = DENSITY * area
    coupler = fa.Link(
        length=LENGTH,
        flexural_rigidity=MODULUS * moment,
        mass_per_length=mass,
        elements=max(4, 2 * segments),
        segments=segments,
        modes=4 if segments == 1 else 3,
    )
    return fa.Arm(
        links=[fa.Link(length=CRANK, mass_per_length=mass, flexible=False), coupler],
        payload=fa.Payload(mass=mass * LENGTH / 2),
        closures=[fa.Closure(kind="line", link=2)],
        theory=theory,
    )


@cache
def run(segments: int, theory: str = "second_order") -> tuple[fa.Arm, xr.Dataset]:
    """Simulate two turns of the crank."""
    arm = slider_crank(segments, theory)
    rates = np.zeros(arm.dof)
    rates[arm.joint_index] = SPEED, -SPEED * (1.0 + CRANK / LENGTH)
    steady, zero = (partial(_constant, value) for value in (SPEED, 0.0))
    with warnings.catch_warnings():  # how far the linear theory is wrong is the subject
        warnings.simplefilter("ignore", fa.LargeDeflectionWarning)
        result = fa.simulate(
            arm,
            DURATION,
            prescribed={1: fa.PrescribedAngle(_angle, steady, zero)},
            initial=np.zeros(arm.dof),
            initial_rate=rates,
            rate=SAMPLES / DURATION,
            accuracy=1e-7,
        )
    return arm, result


def _constant(value: float, t: float) -> float:
    return value


@cache
def middle(segments: int, theory: str = "second_order") -> FloatArray:
    """Distance of the middle of the coupler from the line between its ends, over its length."""
    arm, result = run(segments, theory)
    distances = []
    for q in result.q.values:
        points = np.asarray(arm.shape(q, stations=3)[1])
        chord, half = points[2] - points[0], points[1] - points[0]
        cross = chord[0] * half[1] - chord[1] * half[0]
        distances.append(cross / np.linalg.norm(chord) / LENGTH)
    return np.array(distances)


def eighths(segments: int, theory: str = "second_order") -> FloatArray:
    """Deflections at eighths of the run, (8,)."""
    return middle(segments, theory)[SAMPLES // 8 :: SAMPLES // 8]


def quantities() -> list[Row]:
    known = reference("mechanisms", "slider_crank")
    digits = -math.log10(CERTAIN)
    rows = []
    for k, (theirs, ours) in enumerate(zip(known.values, eighths(FINEST), strict=True)):
        name = f"middle of the coupler at {k + 1}/8 of two turns"
        rows.append(Row(name, "1", known.source, theirs, float(ours), digits, REASON, scale=1.0))
    return rows


def draw(figure: Figure) -> None:
    left, right = figure.subplots(1, 2, width_ratios=[1.25, 1.0])
    times = 1e3 * run(FINEST)[1].time.values
    known = np.array(reference("mechanisms", "slider_crank").values)
    left.plot(times, middle(1, "linear"), color=VERMILLION, label="linear")
    left.plot(times, middle(FINEST), color=BLUE, label="second order")
    left.plot(times[SAMPLES // 8 :: SAMPLES // 8], known, **OURS, color=INK)
    left.set(xlabel="time [ms]", ylabel="middle / length", xlim=(0.0, times[-1]))
    left.set_title("Deflection of the coupler")
    label_lines(left)
    worst = [np.max(np.abs(eighths(k) - known)) for k in SEGMENTS]
    right.plot(SEGMENTS, worst, "o-", color=BLUE, markersize=3.6)
    right.axhline(5e-6, color=GREY, linewidth=0.7, linestyle=(0, (4, 2)))
    right.text(1, 5.6e-6, "certainty of the reference", fontsize=8, color=GREY)
    right.set(xlabel="segments", ylabel="largest difference / length", yscale="log")
    logarithmic_ticks(right, SEGMENTS)
    right.margins(x=0.06)
    right.set_title("Difference from the reference")


CASE = Case(
    name="slider-crank",
    title="Flexible slider-crank",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Left: deflection of the middle of the coupler during two turns; points are reference "
    "values. Right: largest difference from them against the number of segments.",
    module="gallery/cases/slider_crank.py",
)
