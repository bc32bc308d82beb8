"""Vibration of the two-link arm of Table I about a posture."""

from __future__ import annotations

from functools import cache

import numpy as np
from matplotlib.figure import Figure
from scipy.linalg import eigh

from flexarm.view.plot.style import INK, SERIES
from gallery.beam import FloatArray, wave_digits
from gallery.case import Case, Row
from gallery.drawing import OURS
from gallery.references import reference
from gallery.two_link import LENGTHS, ROD, two_link_arm

ELEMENTS = (48, 34)  # elements of nearly the same length on both links
SHOWN = 2
LOCKED, FREE = "locked", "free"
LONGEST = max(L / n for L, n in zip(LENGTHS, ELEMENTS, strict=True))  # element, m
PRINTED = 9.4  # at least nine and a half digits are printed
REASON = (
    f"the error of a mesh of {ELEMENTS[0]} + {ELEMENTS[1]} elements, at most (βh)⁴/1440; at the"
    " lowest frequencies, the number of printed digits"
)
MESH_REASON = "both values are for the same mesh, so that all eleven printed digits agree"

PHYSICS = r"""
The arm of Table I consists of two steel rods of 1.4142 m and 1 m, with $EI$ = 105 N m² and
0.61732 kg/m, without lumped masses. It vibrates about a posture with straight links. The elbow has
an angle, and each joint is locked or free. Both links bend together, so this case tests the
coupling of the links.

The second part uses the mesh of the paper, two elements + one. Its fourth frequency has an error
of a quarter. This is a property of the mesh, which a second program must reproduce.

The package: `arm.mass_matrix(q)` and `arm.stiffness_matrix(q)` without the rows of locked joints
(`fa.modes` locks or frees all).
"""


@cache
def omega(elements: tuple[int, int], elbow_deg: float, first: str, second: str) -> FloatArray:
    """Frequencies (rad/s), rigid-body modes left out."""
    arm = two_link_arm(elements)
    q = arm.rest([0.0, np.radians(elbow_deg)])
    states = (first, second)
    locked = [place for place, how in zip(arm.joint_index, states, strict=True) if how == LOCKED]
    kept = np.setdiff1d(np.arange(arm.dof), locked)
    part = np.ix_(kept, kept)
    M, K = arm.mass_matrix(q)[part], arm.stiffness_matrix(q)[part]
    shift = (
        100.0  # of the size of the lowest squared frequency: it keeps the digits of the low ones
    )
    inverse = eigh(M, K + shift * M, eigvals_only=True)[::-1]
    squared = 1 / inverse - shift
    return np.asarray(np.sqrt(squared[states.count(FREE) :]))


def quantities() -> list[Row]:
    exact, mesh = reference("two_link", "exact"), reference("two_link", "paper_mesh")
    rows = []
    for case in exact.values:
        how = (case["first"], case["second"])
        found = omega(ELEMENTS, case["elbow_deg"], *how)
        for k in range(SHOWN):
            quantity = f"elbow {case['elbow_deg']:g}°, joints {how[0]} and {how[1]}, ω{'₁₂'[k]}"
            theirs = case["omega"][k]
            law = wave_digits(theirs, ROD["mass_per_length"] / ROD["flexural_rigidity"], LONGEST)
            digits = min(law, PRINTED)
            row = Row(quantity, "rad/s", exact.source, theirs, float(found[k]), digits, REASON)
            rows.append(row)
    for how, values in mesh.values.items():
        found = omega((2, 1), 90.0, how, how)
        for k, theirs in enumerate(values):
            quantity = f"2 + 1 elements, elbow 90°, joints {how}, ω{'₁₂₃₄₅'[k]}"
            ours = float(found[k])
            rows.append(Row(quantity, "rad/s", mesh.source, theirs, ours, 9.8, MESH_REASON))
    return rows


def draw(figure: Figure) -> None:
    axes = figure.subplots(1, 2, sharey=True)
    angles = np.linspace(0, 180, 25)
    ways = [(LOCKED, LOCKED), (FREE, LOCKED), (LOCKED, FREE), (FREE, FREE)]
    for k, own in enumerate(axes):
        for how, colour in zip(ways, SERIES, strict=False):
            found = [omega((8, 6), float(angle), *how)[k] for angle in angles]
            own.plot(angles, found, color=colour, label=" + ".join(how))
        for case in reference("two_link", "exact").values:
            own.plot(case["elbow_deg"], case["omega"][k], **OURS, color=INK, clip_on=False)
        own.set(xlabel="elbow angle [deg]", yscale="log")
        own.set_xticks([0, 45, 90, 135, 180])
        own.set_title(f"Mode {k + 1}")
    axes[0].set_ylabel("$\\omega$ [rad/s]")
    figure.legend(*axes[1].get_legend_handles_labels(), loc="outside upper right", ncols=4)


CASE = Case(
    name="two-link-frequencies",
    title="Two-link arm, frequencies",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="First and second frequency over the elbow angle; the legend gives shoulder + "
    "elbow. Points: reference values.",
    module="gallery/cases/two_link_frequencies.py",
)
