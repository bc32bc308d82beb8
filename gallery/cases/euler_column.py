"""A column under a load on its tip: when it buckles, and where it goes."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

import flexarm as fa
from flexarm.view.plot.style import BLUE, GREY, INK
from gallery.beam import FloatArray, unit_beam
from gallery.case import Case, Row, Source
from gallery.drawing import KNOWN, OURS
from gallery.references import reference

ELEMENTS, PIECES = 16, 32
TABLE = (40.0, 80.0)  # tip slopes of the rows, degrees
PICTURE = (20.0, 40.0, 60.0, 80.0, 100.0, 120.0, 140.0)

PHYSICS = r"""
An axial dead load $P$ acts on the tip of a clamped column. Below $P_c = \pi^2 EI/4L^2$ (Euler)
the straight column is stable; above it the column buckles to one side. Elliptic integrals give
the position of the tip: with the tip slope $\alpha$ and $k = \sin\alpha/2$,

$$ P/P_c = (2K(k)/\pi)^2, \qquad x/L = 2E(k)/K(k) - 1, \qquad y/L = 2k/K(k) . $$

The package: `arm.stiffness_matrix(q, tip_force=(-P, 0))` becomes singular at $P_c$ (second-order
theory). The buckled shapes use `segments=32` and `fa.equilibrium`, started from a bent shape. The
column rotates by up to 140 degrees here, while deflections stay small inside each of its pieces.
"""


def critical_load() -> float:
    """Load at which the straight column's stiffness is singular."""
    arm = unit_beam(ELEMENTS, theory="second_order")
    q = arm.rest([0.0])

    def lowest(load: float) -> float:
        stiffness = arm.stiffness_matrix(q, tip_force=(-load, 0.0))[1:, 1:]
        return float(np.linalg.eigvalsh(stiffness)[0])

    return float(brentq(lowest, 2.0, 3.0, xtol=1e-13))


def exact(slope: float) -> tuple[float, float, float]:
    """Load over EI / L^2 and tip (x, y) / L of the elastica at a tip slope (degrees)."""
    k = math.sin(math.radians(slope) / 2)
    K, E = float(ellipk(k * k)), float(ellipe(k * k))
    return K * K, 2 * E / K - 1, 2 * k / K


@cache
def buckled(slope: float) -> tuple[fa.Arm, FloatArray]:
    """Arm and equilibrium q under the load that belongs to a tip slope (degrees)."""
    arm = unit_beam(PIECES, segments=PIECES, theory="second_order")
    load = exact(slope)[0]
    # A circular arc of the same tip slope: near enough to be drawn to the bent equilibrium.
    piece = math.radians(slope) / PIECES
    length = 1 / PIECES
    node = np.array([[length * piece / 2, piece]])
    start = arm.from_nodal([0.0], [np.repeat(node, PIECES, axis=0)])
    return arm, fa.equilibrium(arm, tip_force=(-load, 0.0), start=start).q


def quantities() -> list[Row]:
    closed = reference("statics", "euler").source
    elastica: Source = reference("statics", "buckled_column").source
    rows = [
        Row(
            "critical load P L²/EI",
            "1",
            closed,
            math.pi**2 / 4,
            critical_load(),
            6.8,
            (
                f"a mesh of {ELEMENTS} elements: (π/2)⁴/(720 · {ELEMENTS}⁴), twice the error of a "
                f"frequency"
            ),
        )
    ]
    reason = (
        f"{PIECES} pieces in the second-order theory, whose error decreases as the cube of their"
        " length"
    )
    for slope in TABLE:
        arm, q = buckled(slope)
        _, x, y = exact(slope)
        tip = arm.tip(q)
        for name, known, found in (("x", x, tip[0]), ("y", y, tip[1])):
            quantity = f"buckled to a tip slope of {slope:g}°, tip {name}/L"
            row = Row(quantity, "1", elastica, known, float(found), 4.5, reason, scale=1.0)
            rows.append(row)
    return rows


def draw(figure: Figure) -> None:
    left, right = figure.subplots(1, 2, width_ratios=[1.0, 1.3])
    for slope in PICTURE:
        arm, q = buckled(slope)
        # Links draw along world x; the column stands.
        x, y = arm.shape(q, stations=4 * PIECES + 1)[0].T
        left.plot(y, x, color=BLUE)
        _, tip_x, tip_y = exact(slope)
        left.plot(tip_y, tip_x, **OURS, color=INK)
    left.plot([0, 0], [0, 1], color=GREY, linewidth=0.9, linestyle=(0, (4, 2)))
    left.set(aspect="equal", xlabel="$y/L$", ylabel="$x/L$", xlim=(-0.08, 0.92))
    left.set_title("Shape")
    left.grid(False)
    slopes = np.linspace(0.5, 150, 200)
    curves = np.array([exact(float(slope)) for slope in slopes])
    critical = math.pi**2 / 4
    right.plot(curves[:, 0] / critical, curves[:, 2], **KNOWN, label="elastica")
    loads = [exact(slope)[0] / critical for slope in PICTURE]
    tips = [float(arm.tip(q)[1]) for arm, q in (buckled(slope) for slope in PICTURE)]
    right.plot(loads, tips, **OURS, color=BLUE, label="flexarm")
    right.plot([0.5, 1], [0, 0], **KNOWN)
    right.plot([1, 3.2], [0, 0], color=GREY, linewidth=0.9, linestyle=(0, (4, 2)))
    right.set(xlabel="load $P/P_c$", ylabel="tip deflection $y/L$", xlim=(0.5, 3.2))
    right.set_title("Deflection")
    right.legend(loc="lower right", bbox_to_anchor=(1.0, 0.12))


CASE = Case(
    name="euler-column",
    title="Column under a tip load",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Left: the column under increasing loads; points are tips of the elastica. Right: "
    "the straight column is stable up to the critical load, then a bent one.",
    module="gallery/cases/euler_column.py",
)
