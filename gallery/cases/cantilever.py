"""Small static deflections: every load on a cantilever, and the arm of Table I sagging."""

from __future__ import annotations

from functools import cache

import numpy as np
from matplotlib.figure import Figure

import flexarm as fa
from flexarm.view.plot.style import INK, SERIES, legend_above
from gallery.beam import FloatArray
from gallery.case import Case, Row
from gallery.drawing import OURS
from gallery.line_labels import label_lines
from gallery.references import reference
from gallery.two_link import two_link_arm

L, EI = 2.0, 7.0
FORCE, MOMENT, SPREAD = 0.3, 0.2, 0.5  # N, N m, N/m
STATION = 1.4  # inside an element of the mesh
ELEMENTS = 4
REASON = "cubic elements are exact at the nodes for any load: only rounding errors"
PRINTED = "all printed decimals; the elements are exact at the nodes"

PHYSICS = r"""
Textbook deflections of a cantilever of length $L = 2$ m and $EI = 7$ N m²: a force or a moment at
the tip, a force inside, and a distributed force. Between nodes cubic elements are approximate.
*At* the nodes they are exact for every load and any mesh.

The second example is the two-link arm of Table I, straight and horizontal with its joints locked,
sagging under its own weight (linear: forces of the straight arm, $g = 9.81$ m/s²).

The package: `fa.equilibrium(arm, angles, loads=[fa.Load(...)])` and `arm.nodal(q)`; the sag from
`arm.stiffness_matrix` and `arm.bias_force` at the straight arm.
"""


def _loads() -> dict[str, tuple[fa.Load, float, float]]:
    """Each load with the tip deflection and slope that it causes."""
    a = STATION
    return {
        "tip force": (
            fa.Load(link=1, force=(0.0, FORCE)),
            FORCE * L**3 / (3 * EI),
            FORCE * L**2 / (2 * EI),
        ),
        "tip moment": (
            fa.Load(link=1, moment=MOMENT),
            MOMENT * L**2 / (2 * EI),
            MOMENT * L / EI,
        ),
        "distributed force": (
            fa.Load(link=1, force=(0.0, SPREAD), spread=(0.0, L)),
            SPREAD * L**4 / (8 * EI),
            SPREAD * L**3 / (6 * EI),
        ),
        "force at 0.7 L": (
            fa.Load(link=1, force=(0.0, FORCE), station=a),
            FORCE * a**2 * (3 * L - a) / (6 * EI),
            FORCE * a**2 / (2 * EI),
        ),
    }


FORMULAS = {
    "tip force": ("PL³/3EI", "PL²/2EI"),
    "tip moment": ("ML²/2EI", "ML/EI"),
    "distributed force": ("wL⁴/8EI", "wL³/6EI"),
    "force at 0.7 L": ("Pa²(3L-a)/6EI", "Pa²/2EI"),
}


@cache
def deflected(name: str) -> tuple[fa.Arm, FloatArray]:
    """The cantilever and its equilibrium q under one of the loads."""
    link = fa.Link(length=L, flexural_rigidity=EI, mass_per_length=1.0, elements=ELEMENTS)
    arm = fa.Arm(links=[link])
    return arm, fa.equilibrium(arm, loads=[_loads()[name][0]]).q


@cache
def sag() -> tuple[float, float, float]:
    """Sag and slope at the elbow and sag at the tip of the two-link arm (m, rad, m), linear."""
    arm = two_link_arm(ELEMENTS, gravity=(0.0, -9.81))
    straight, rest = arm.rest([0.0, 0.0]), np.zeros(arm.dof)
    elastic = np.setdiff1d(np.arange(arm.dof), arm.joint_index)
    # Strain energy alone: the arm without gravity.
    stiffness = two_link_arm(ELEMENTS).stiffness_matrix(straight)[np.ix_(elastic, elastic)]
    weight = arm.bias_force(straight, rest)[elastic]
    q = straight.copy()
    q[elastic] = np.linalg.solve(stiffness, -weight)
    (elbow, slope), (own, _) = (nodes[-1] for nodes in arm.nodal(q))
    return -float(elbow), -float(slope), -float(elbow + slope * arm.lengths[1] + own)


def quantities() -> list[Row]:
    source = reference("statics", "cantilever").source
    rows = []
    for name, (_, deflection, slope) in _loads().items():
        arm, q = deflected(name)
        found = arm.nodal(q)[0][-1]
        for formula, unit, known, ours in zip(
            FORMULAS[name], ("m", "rad"), (deflection, slope), found, strict=True
        ):
            quantity = f"{name}, {formula}"
            rows.append(Row(quantity, unit, source, known, float(ours), 13.0, REASON))
    sagging = reference("statics", "two_link_sag")
    names = ("elbow_sag", "elbow_slope", "tip_sag")
    for key, unit, ours in zip(names, ("m", "rad", "m"), sag(), strict=True):
        quantity = f"arm of Table I, {key.replace('_', ' ')}"
        rows.append(Row(quantity, unit, sagging.source, sagging.values[key], ours, 9.0, PRINTED))
    return rows


def draw(figure: Figure) -> None:
    axes = figure.subplots()
    for name, colour in zip(_loads(), SERIES, strict=False):
        arm, q = deflected(name)
        points = arm.shape(q, stations=60)[0]
        axes.plot(points[:, 0], 1e3 * points[:, 1], color=colour, label=name)
        axes.plot(L, 1e3 * _loads()[name][1], **OURS, color=INK)
    known = axes.plot([], [], **OURS, color=INK)
    axes.set(xlabel="x [m]", ylabel="deflection [mm]", xlim=(0, 1.02 * L))
    axes.set_title("Deflection")
    label_lines(axes)
    legend_above(axes, known, ["formula"])


CASE = Case(
    name="cantilever",
    title="Cantilever, small deflection",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="The cantilever under four loads, four elements.",
    module="gallery/cases/cantilever.py",
)
