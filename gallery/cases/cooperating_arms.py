"""Two flexible arms carry one payload: a closed loop with three degrees of freedom."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

import flexarm as fa
from flexarm.view.plot.style import AGES, BLUE, GREY, INK, VERMILLION
from gallery.case import Case, Row, distance_digits
from gallery.drawing import KNOWN, OURS
from gallery.line_labels import label_lines
from gallery.references import reference

if TYPE_CHECKING:
    import xarray as xr

LENGTHS, ROOTS = (0.6, 0.5), (-0.4, 0.4)  # m
#: Joint angles at the start, from the triangles of both arms with the payload at (0.1, 0.8) m.
GRASP = (0.1, 0.8)
TORQUES = (3.0, 1.0, 2.0, -1.0)  # N m
DURATION, RATE = 0.2, 2000.0
TIMES = (0.05, 0.1, 0.15, 0.2)
REASON = "the tolerance of both integrations, 1e-9"

PHYSICS = r"""
Two arms of two flexible links each (0.6 and 0.5 m, $EI = 20$ N m², 0.5 kg/m) hold a payload of 0.8
kg, which is rigidly connected to the tips of both: a weld closes the loop. Constant torques act on
all four joints against gravity.

The reference knows no recursion: it adds up the energies of material points of the links and the
payload, differentiates them automatically, solves dense equations with multipliers for the weld,
and integrates them with another Runge-Kutta method. The shape functions are the same, so that the
numbers must agree to the tolerance.

The package: `fa.Closure(kind="weld")`; the channel `closure_force` is the force with which the arms
press on each other.
"""


def posture() -> tuple[list[float], float]:
    """Return the joint angles (4,) of the grasp, and the angle of the first tip from the second."""
    angles = []
    for root, elbow in zip(ROOTS, (-1.0, 1.0), strict=True):
        x, y = GRASP[0] - root, GRASP[1]
        a, b = LENGTHS
        bend = elbow * np.arccos((x * x + y * y - a * a - b * b) / (2.0 * a * b))
        first = np.arctan2(y, x) - np.arctan2(b * np.sin(bend), a + b * np.cos(bend))
        angles += [float(first), float(bend)]
    return angles, angles[0] + angles[1] - angles[2] - angles[3]


def arms() -> fa.Arm:
    """Make both arms with the payload between them."""
    upper, lower = (
        fa.Link(length=length, flexural_rigidity=20.0, mass_per_length=0.5, elements=1)
        for length in LENGTHS
    )
    joints = [fa.Joint(offset=(ROOTS[0], 0.0)), fa.Joint()]
    joints += [fa.Joint(offset=(ROOTS[1], 0.0)), fa.Joint()]
    return fa.Arm(
        links=[upper, lower, upper.replace(parent=0), lower],
        joints=joints,
        payload=fa.Payload(mass=0.8, inertia=0.01),
        closures=[fa.Closure(kind="weld", link=2, to_link=4, angle=posture()[1])],
        gravity=(0.0, -9.81),
    )


def torque(t: float) -> list[float]:
    """Return the torques of the joints (N m)."""
    return list(TORQUES)


@cache
def run() -> tuple[fa.Arm, xr.Dataset]:
    """Move the payload."""
    arm = arms()
    options = {"initial": arm.rest(posture()[0]), "torque": torque, "rate": RATE}
    return arm, fa.simulate(arm, DURATION, rtol=1e-10, atol=1e-12, **options)


def quantities() -> list[Row]:
    known = reference("mechanisms", "cooperating_arms")
    _, result = run()
    rows = []
    for t, case in zip(TIMES, known.values, strict=True):
        k = round(t * RATE)
        tip, force = result.tip.values[k], result.closure_force.values[k]
        digits = distance_digits(1e-8, sum(LENGTHS))
        for axis, theirs, ours in zip("xy", case["tip"], tip, strict=True):
            name = f"payload {axis} at {t:g} s"
            rows.append(Row(name, "m", known.source, theirs, float(ours), digits, REASON))
        largest = max(abs(value) for value in case["closure_force"])
        for axis, theirs, ours in zip("xy", case["closure_force"], force, strict=False):
            name = f"force {axis} at {t:g} s"
            row = Row(name, "N", known.source, theirs, float(ours), 5.0, REASON, scale=largest)
            rows.append(row)
    return rows


def draw(figure: Figure) -> None:
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.25])
    arm, result = run()
    chosen = np.linspace(0, len(result.time) - 1, 5).round().astype(int)
    for age, q in zip(np.linspace(0.0, 1.0, 5), result.q.values[chosen], strict=True):
        for points in arm.shape(q, stations=9):
            left.plot(*np.asarray(points).T, color=AGES(age), linewidth=1.2)
        left.plot(*arm.tip(q)[:2], "o", color=AGES(age), markersize=5)
    left.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", xmargin=0.06)
    left.set_title("Motion")
    left.grid(False)
    known = reference("mechanisms", "cooperating_arms").values
    for k, (name, colour) in enumerate((("force x", VERMILLION), ("force y", BLUE))):
        force = result.closure_force.values[:, k]
        right.plot(result.time, force, **{**KNOWN, "color": colour}, label=name)
        right.plot(TIMES, [case["closure_force"][k] for case in known], **OURS, color=INK)
    right.axhline(0.0, color=GREY, linewidth=0.6)
    right.set(xlabel="time [s]", ylabel="force between the arms [N]")
    right.set_title("Weld")
    label_lines(right)


CASE = Case(
    name="cooperating-arms",
    title="Two arms with one payload",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Left: both arms and the payload at five times, early ones light. Right: "
    "force of the first arm's weld; points are reference values.",
    module="gallery/cases/cooperating_arms.py",
)
