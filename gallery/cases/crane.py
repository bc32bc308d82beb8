"""A crane luffs its flexible boom under a hanging load."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import CubicSpline

import flexarm as fa
from flexarm.view.plot.style import AGES, BLUE, GREY, INK, VERMILLION
from gallery.beam import FloatArray
from gallery.case import Case, Row, distance_digits
from gallery.drawing import KNOWN, OURS
from gallery.line_labels import label_lines
from gallery.references import reference

if TYPE_CHECKING:
    import xarray as xr

BOOM, ROPE, LOAD = 6.0, 2.5, 200.0  # m, m, kg
START = (0.6, -np.pi / 2 - 0.8)  # the rope hangs 0.2 rad from the vertical
TORQUE = 14_000.0  # N m, more than boom and load weigh
DURATION, RATE = 2.0, 200.0
TIMES = (0.5, 1.0, 1.5, 2.0)
REASON = "the tolerance of both integrations, 1e-9"

PHYSICS = r"""
A boom of 6 m ($EI = 2\cdot10^6$ N m², 30 kg/m) carries a load of 200 kg on a rigid rope of 2.5 m
and 0.5 kg/m. A constant torque of 14 kN m lifts the boom from 34° while the load swings from 11°
beside the vertical.

The reference knows no recursion: it adds up the energies of material points of the links,
differentiates them automatically, solves dense equations, and integrates these with another
Runge-Kutta method. Boom and rope have the same shape functions in both, so that the numbers must
agree to the tolerance.

The package: `fa.Link(flexible=False)` as a rope, which may swing to any angle.
"""


def crane() -> fa.Arm:
    """Make boom and rope."""
    boom = fa.Link(length=BOOM, flexural_rigidity=2e6, mass_per_length=30.0, elements=1)
    rope = fa.Link(length=ROPE, mass_per_length=0.5, flexible=False)
    return fa.Arm(links=[boom, rope], payload=fa.Payload(mass=LOAD), gravity=(0.0, -9.81))


def torque(t: float) -> list[float]:
    """Return the torques of the joints (N m)."""
    return [TORQUE, 0.0]


@cache
def run() -> tuple[fa.Arm, xr.Dataset]:
    """Lift the boom."""
    arm = crane()
    options = {"initial": arm.rest(START), "torque": torque, "rate": RATE}
    return arm, fa.simulate(arm, DURATION, rtol=1e-10, atol=1e-12, **options)


def at_times(result: xr.Dataset, values: FloatArray) -> FloatArray:
    """Return values at the times of the reference."""
    return np.asarray(CubicSpline(result.time.values, values)(TIMES))


def quantities() -> list[Row]:
    known = reference("mechanisms", "crane")
    _, result = run()
    angles, loads = at_times(result, result.joint_angle.values), at_times(result, result.tip.values)
    rows = []
    for k, (t, case) in enumerate(zip(TIMES, known.values, strict=True)):
        digits = distance_digits(1e-7, BOOM)
        pairs = zip("xy", case["tip"], loads[k], strict=True)
        for axis, theirs, ours in pairs:
            row = Row(
                f"load {axis} at {t:g} s", "m", known.source, theirs, float(ours), digits, REASON
            )
            rows.append(row)
        swing = Row(
            f"angle of the rope at {t:g} s",
            "rad",
            known.source,
            case["joint_angle"][1],
            float(angles[k, 1]),
            7.0,
            REASON,
        )
        rows.append(swing)
    return rows


def draw(figure: Figure) -> None:
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.25])
    arm, result = run()
    chosen = np.linspace(0, len(result.time) - 1, 7).round().astype(int)
    for age, q in zip(np.linspace(0.0, 1.0, 7), result.q.values[chosen], strict=True):
        boom, rope = (np.asarray(points).T for points in arm.shape(q, stations=9))
        left.plot(*boom, color=AGES(age), linewidth=1.3)
        left.plot(*rope, color=AGES(age), linewidth=0.6)
        left.plot(*rope[:, -1], "o", color=AGES(age), markersize=4)
    left.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", xmargin=0.06)
    left.set_title("Motion")
    left.grid(False)
    known = reference("mechanisms", "crane").values
    for k, (name, colour) in enumerate((("load x", VERMILLION), ("load y", BLUE))):
        right.plot(result.time, result.tip.values[:, k], **{**KNOWN, "color": colour}, label=name)
        right.plot(TIMES, [case["tip"][k] for case in known], **OURS, color=INK)
    right.axhline(0.0, color=GREY, linewidth=0.6)
    right.set(xlabel="time [s]", ylabel="position [m]")
    right.set_title("Load")
    label_lines(right)


CASE = Case(
    name="crane",
    title="Crane with a hanging load",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Left: boom, rope and load at seven times, early ones light. Right: "
    "position of the load; points are reference values.",
    module="gallery/cases/crane.py",
)
