"""A free flexible link tumbles in the plane: the problem known as the flying spaghetti."""

from __future__ import annotations

import math
import warnings
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

import flexarm as fa
from flexarm.view.plot.style import AGES, BLUE, GREY, INK
from gallery.beam import FloatArray
from gallery.case import Case, Row, distance_digits
from gallery.drawing import OURS, logarithmic_ticks
from gallery.references import reference

if TYPE_CHECKING:
    import xarray as xr

LENGTH = 10.0  # m
DURATION, RATE = 2.5, 40.0
START = (6.0, 0.0, math.atan2(8.0, -6.0))  # place and angle of the root
SEGMENTS = (8, 16, 32)
FINEST = 32
ACCEPTED, EXTENSIBLE = 1.5e-3, 4e-3  # m
POINTS = ("root", "middle", "tip")
REASON = f"within {ACCEPTED:g} m: {FINEST} segments, and 1e-3 m of the reference itself"
EXTENSIBLE_REASON = (
    f"within {EXTENSIBLE:g} m: the reference is extensible and shearable, the link is not"
)

PHYSICS = r"""
A beam of 10 m ($EI = 100$ N m², $\mu = 1$ kg/m, rotary inertia of the sections 10 kg m) floats
freely, straight from (6, 0) to (0, 8) m and at rest. For 2.5 s a force of 8 N along $x$ and a
moment of -80 N m act on its lower end. It flies to the right, tumbles, and bends until its ends are
2.1 m apart.

The published beam is extensible and shearable. The link of the package is neither. Two references
separate the model from the method: the geometrically exact beam that is inextensible and
unshearable, and the published one. The two differ by 2 to 3 mm, the effect of extension and
shear; flexarm agrees with the first within the accuracy of that reference.

The package: `fa.Base(free=("x", "y", "angle"))` without mass, a fixed joint, `fa.Load` at station
0, the second-order theory and `segments=k` of two elements each.
"""


@cache
def run(segments: int) -> tuple[fa.Arm, xr.Dataset]:
    """Throw the link with a number of segments."""
    link = fa.Link(
        length=LENGTH,
        flexural_rigidity=100.0,
        mass_per_length=1.0,
        rotary_inertia_per_length=10.0,
        elements=2 * segments,
        segments=segments,
        modes=3,
    )
    arm = fa.Arm(
        links=[link],
        joints=[fa.Joint(fixed=True)],
        base=fa.Base(free=("x", "y", "angle")),
        theory="second_order",
    )
    start = np.zeros(arm.dof)
    start[:3] = START
    push = fa.Load(link=1, station=0.0, force=(8.0, 0.0), moment=-80.0)
    with warnings.catch_warnings():  # segments bend by a third of their length
        warnings.simplefilter("ignore", fa.LargeDeflectionWarning)
        return arm, fa.simulate(
            arm, DURATION, initial=start, loads=[push], rate=RATE, accuracy=1e-5
        )


def points(segments: int) -> FloatArray:
    """Root, middle and tip (m) at the end, (3, 2)."""
    arm, result = run(segments)
    return np.asarray(arm.shape(result.q.values[-1], stations=3)[0])


def known_points(group: str) -> FloatArray:
    """The same of a reference."""
    values = reference("mechanisms", group).values
    return np.array([values[name] for name in POINTS])


def quantities() -> list[Row]:
    rows = []
    for group, accepted, reason in (
        ("spaghetti", ACCEPTED, REASON),
        ("extensible_spaghetti", EXTENSIBLE, EXTENSIBLE_REASON),
    ):
        source = reference("mechanisms", group).source
        label = "exact" if group == "spaghetti" else "extensible"
        digits = distance_digits(accepted, LENGTH)
        for name, theirs, ours in zip(POINTS, known_points(group), points(FINEST), strict=True):
            for axis, known, found in zip("xy", theirs, ours, strict=True):
                quantity = f"against {label}, {name} {axis} at 2.5 s"
                rows.append(
                    Row(
                        quantity,
                        "m",
                        source,
                        float(known),
                        float(found),
                        digits,
                        reason,
                        scale=LENGTH,
                    )
                )
    return rows


def draw(figure: Figure) -> None:
    left, right = figure.subplots(1, 2, width_ratios=[1.25, 1.0])
    arm, result = run(FINEST)
    samples = result.q.values[:: round(0.25 * RATE)]
    for k, q in enumerate(samples):
        shape = np.asarray(arm.shape(q, stations=97)[0]).T
        left.plot(*shape, color=AGES(k / (len(samples) - 1)), linewidth=1.0)
    left.plot(*known_points("extensible_spaghetti").T, **OURS, color=INK)
    left.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    left.set_title("Motion")
    left.grid(False)
    exact = known_points("spaghetti")
    worst = [np.max(np.hypot(*(points(k) - exact).T)) for k in SEGMENTS]
    right.plot(SEGMENTS, worst, "o-", color=BLUE, markersize=3.6)
    right.axhline(1e-3, color=GREY, linewidth=0.7, linestyle=(0, (4, 2)))
    right.text(SEGMENTS[0], 1.1e-3, "certainty of the reference", fontsize=8, color=GREY)
    right.set(xlabel="segments", ylabel="largest distance from exact [m]", yscale="log")
    logarithmic_ticks(right, SEGMENTS)
    right.margins(x=0.06)
    right.set_title("Error")


CASE = Case(
    name="flying-spaghetti",
    title="Flying spaghetti",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Left: the link every 0.25 s, from light to dark; points are root, middle and tip of "
    "the published beam at 2.5 s. Right: largest distance from the exact beam against the number "
    "of segments.",
    module="gallery/cases/flying_spaghetti.py",
)
