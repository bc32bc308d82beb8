"""Input shapers on a beam whose frequency is not the one that they were made for."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import brentq

import flexarm as fa
from flexarm.view.plot.style import BLUE, GREEN, INK, VERMILLION, legend_above
from gallery.case import Case, Row
from gallery.drawing import OURS
from gallery.references import reference

UNDAMPED, PRINTER = (
    reference("control", "shapers_undamped"),
    reference("control", "shapers_printer"),
)
COLOURS = {"zv": BLUE, "zvd": VERMILLION, "zvdd": GREEN, "ei": INK}

PHYSICS = r"""
Singer and Seering's shapers split a motion into delayed copies whose vibrations cancel. They need
the frequency; the more copies, the larger the error that they tolerate. A manufacturer of stages
and a firmware of printers print how large. Here a joint turns a beam by 0.6 degrees in 0.3 periods,
exactly along the shaped motion, and the vibration that is left is measured in a simulation of the
beam, and divided by that after the motion without shaping. The frequency that the shaper believes
is varied until 10 % or 5 % are left.

Both tables are for practice. The first is without damping, as the beam here, and rounded down to
whole percents. The second is called approximate in its source, and covers damping ratios from 0.05
to 0.2.

The package: `fa.shaped` with `frequency_hz=`, and `fa.simulate` with `prescribed=`.
"""


@cache
def beam() -> tuple[fa.Arm, float]:
    """Make a beam with one mode, and its period (s)."""
    link = fa.Link(length=1, flexural_rigidity=1, mass_per_length=1, elements=2, modes=1)
    arm = fa.Arm(links=[link])
    return arm, 1.0 / float(fa.modes(arm, joints="locked").frequency_hz[0])


def motion() -> Any:
    """Return the motion without shaping."""
    arm, period = beam()
    return fa.joint_motion(arm, [0.0], [0.01], 0.3 * period)


def amplitude(turn: Any) -> float:
    """Amplitude (m) of the vibration after a motion that the joint follows exactly."""
    arm, period = beam()
    end = turn.end_time + 0.02 * period
    result = fa.simulate(arm, end, prescribed={1: turn}, rtol=1e-9, atol=1e-14)
    last = result.isel(time=-1, link=0)
    rate = float(last.link_tip_deflection_rate) * period / (2 * np.pi)
    return float(np.hypot(float(last.link_tip_deflection), rate))


@cache
def left(method: str, ratio: float) -> float:
    """Vibration that is left, for a beam with this ratio of its frequency to the believed one."""
    arm, period = beam()
    shaped = fa.shaped(
        motion(), arm, method, frequency_hz=1.0 / (ratio * period), damping_ratio=0.0
    )
    return amplitude(shaped) / _unshaped()


@cache
def _unshaped() -> float:
    return amplitude(motion())


def tolerance(method: str, share: float) -> float:
    """Deviation of the frequency (%) upwards at which this share of the vibration is left."""
    # Beside the design frequency an extra-insensitive shaper leaves less than there.
    crossing = brentq(lambda ratio: left(method, ratio) - share, 1.02, 1.45, xtol=1e-4)
    return 100.0 * (float(crossing) - 1.0)


def quantities() -> list[Row]:
    rows = []
    for known, digits, reason in (
        (UNDAMPED, 1.1, "whole percents, rounded down"),
        (PRINTER, 0.5, "approximate values for damping ratios from 0.05 to 0.2; the beam has none"),
    ):
        for value in known.values:
            ours = tolerance(value["method"], value["left"])
            name = f"{value['method'].upper()}, deviation at {100 * value['left']:g} %"
            theirs = value["percent"]
            rows.append(Row(name, "%", known.source, theirs, ours, digits, reason))
    return rows


def draw(figure: Figure) -> None:
    axes = figure.subplots()
    ratios = np.linspace(0.6, 1.4, 801)
    for method, colour in COLOURS.items():
        curve = 100 * fa.shaper_sensitivity(ratios, method)
        axes.plot(100 * (ratios - 1), curve, color=colour, label=method.upper())
        points = [r for r in (0.75, 0.9, 1.1, 1.25) if left(method, r) < 0.25]
        simulated = [100 * left(method, r) for r in points]
        axes.plot([100 * (r - 1) for r in points], simulated, **OURS, color=colour)
    for value in UNDAMPED.values:
        axes.plot([-value["percent"], value["percent"]], [10, 10], "|", color=INK, markersize=10)
    axes.axhline(10, color=INK, linewidth=0.6, linestyle=":")
    axes.set(xlabel="deviation of the frequency [%]", ylabel="vibration left [%]")
    axes.set(xlim=(-40, 40), ylim=(0, 25))
    axes.set_title("Tolerance of input shapers")
    legend_above(axes)


CASE = Case(
    name="shaper-tolerance",
    title="Tolerance of input shapers",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Lines: `fa.shaper_sensitivity`. Points: simulated beams. Vertical strokes: the "
    "tolerances for 10 % that the first source prints.",
    module="gallery/cases/shaper_tolerance.py",
)
