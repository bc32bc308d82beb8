"""Frequencies of a space manipulator: a flexible link between two free bodies."""

from __future__ import annotations

from functools import cache

import numpy as np
from matplotlib.figure import Figure

import flexarm as fa
from flexarm.view.plot.style import BLUE, INK
from gallery.beam import FloatArray, mesh_digits, mesh_reason
from gallery.case import Case, Row
from gallery.drawing import OURS
from gallery.line_labels import label_lines
from gallery.references import reference

LENGTH, MASS_PER_LENGTH, RIGIDITY = 3.372, 2.82, 100.6
RATIO = 5.18  # of each end's mass to that of the link
ELEMENTS, MODES = 32, 4

PHYSICS = r"""
A link of 3.372 m ($EI = 100.6$ N m², $\mu = 2.82$ kg/m) connects two point masses, each 5.18 times
as heavy as the link: a space manipulator that floats freely, with its spacecraft and a payload. The
masses hold the ends almost at rest, so the frequencies are little above those of a beam on two
hinges, 5.18 rad/s, 20.7 rad/s and so on. The three rigid motions have the frequency zero.

The reference is the characteristic equation of a free beam with two masses.

The package: `fa.Base(mass=..., free=("x", "y", "angle"))`, a fixed joint, and the second mass as
payload; `fa.modes`.
"""


@cache
def frequencies(ratio: float) -> FloatArray:
    """Lowest frequencies (rad/s) for a ratio of masses, without the three rigid motions."""
    mass = ratio * MASS_PER_LENGTH * LENGTH
    link = fa.Link(
        length=LENGTH,
        flexural_rigidity=RIGIDITY,
        mass_per_length=MASS_PER_LENGTH,
        elements=ELEMENTS,
    )
    arm = fa.Arm(
        links=[link],
        joints=[fa.Joint(fixed=True)],
        base=fa.Base(mass=mass, free=("x", "y", "angle")),
        payload=fa.Payload(mass=mass),
    )
    return np.asarray(2 * np.pi * fa.modes(arm).frequency_hz)[3 : 3 + MODES]


def quantities() -> list[Row]:
    known = reference("mechanisms", "free_flyer")
    scale = (MASS_PER_LENGTH / RIGIDITY) ** 0.25 * LENGTH
    return [
        Row(
            f"frequency of mode {k + 1}",
            "rad/s",
            known.source,
            theirs,
            float(ours),
            mesh_digits(scale * theirs**0.5, ELEMENTS),
            mesh_reason(ELEMENTS),
        )
        for k, (theirs, ours) in enumerate(zip(known.values, frequencies(RATIO), strict=True))
    ]


def draw(figure: Figure) -> None:
    axes = figure.subplots()
    ratios = np.geomspace(0.02, 9.0, 40)
    curves = np.array([frequencies(float(ratio)) for ratio in ratios])
    for k in range(MODES):
        axes.plot(ratios, curves[:, k], color=BLUE, label=f"mode {k + 1}")
    known = reference("mechanisms", "free_flyer").values
    axes.plot([RATIO] * MODES, known, **OURS, color=INK)
    axes.set(xscale="log", xlabel="mass at each end / mass of the link", ylabel="frequency [rad/s]")
    axes.set_title("Frequencies of a free link with masses at its ends")
    label_lines(axes)


CASE = Case(
    name="free-flyer",
    title="Space manipulator",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="The frequencies decrease from those of a free beam, at the left, to those of a beam "
    "on two hinges, at the right. Points: closed form.",
    module="gallery/cases/free_flyer.py",
)
