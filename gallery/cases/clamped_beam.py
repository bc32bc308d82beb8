"""Frequencies of the plain beam: clamped, free, and on meshes of one and two elements."""

from __future__ import annotations

from functools import cache

import numpy as np
from matplotlib.figure import Figure

import flexarm as fa
from flexarm.view.plot.style import SERIES, legend_above
from gallery.beam import FloatArray, frequencies, mesh_digits, mesh_reason, unit_beam
from gallery.case import Case, Row
from gallery.drawing import OURS, logarithmic_ticks
from gallery.line_labels import label_lines
from gallery.references import reference

ELEMENTS = 64
MESHES = (2, 4, 8, 16, 32, 64)
#: Mass of the rigid link that carries the free beam, against 1: it changes the thirteenth digit.
CARRIER = 1e-13

PHYSICS = r"""
A uniform beam of length $L$, bending stiffness $EI$ and mass per length $\mu$ vibrates with
frequencies $\omega$ that depend only on its end conditions:
$\lambda = (\beta L)^2 = \omega L^2 \sqrt{\mu/EI}$.

- *Clamped-free*: one link with its joint locked.
- *Free-free*: an arm always has a base joint. A rigid link with almost no mass allows the root of
  the beam to move across. With both joints free nothing constrains the beam, and the first two
  modes are rigid-body modes of frequency zero.
- *One and two elements*: the frequencies of the mesh itself, not of the beam. A cubic Hermite
  element with exact mass and stiffness matrices gives them to rounding.

The frequencies of a mesh are too high by $(\beta h)^4/1440$ of their value, where $h$ is the
length of an element.
"""


@cache
def mesh_frequencies(elements: int) -> FloatArray:
    """First frequencies of the clamped beam on a mesh."""
    return frequencies(unit_beam(elements))


def free_free() -> FloatArray:
    """First numbers beta L of the free-free beam."""
    carrier = fa.Link(length=1, mass_per_length=CARRIER, flexible=False)
    beam = unit_beam(ELEMENTS).spec.links[0]
    arm = fa.Arm(links=[carrier, beam])
    return np.sqrt(frequencies(arm, joints="free"))


def quantities() -> list[Row]:
    clamped, free, meshes = (reference("beams", g) for g in ("clamped", "free", "hermite_mesh"))
    mesh = mesh_reason(ELEMENTS)
    rows = [
        Row(
            f"clamped-free, λ of mode {k + 1}",
            "1",
            clamped.source,
            exact,
            float(mesh_frequencies(ELEMENTS)[k]),
            mesh_digits(np.sqrt(exact), ELEMENTS),
            mesh,
        )
        for k, exact in enumerate(clamped.values["lambda"])
    ]
    rows += [
        Row(
            f"free-free, βL of mode {k + 1}",
            "1",
            free.source,
            exact,
            float(found),
            mesh_digits(exact, ELEMENTS, power=1),
            mesh,
        )
        for k, (exact, found) in enumerate(zip(free.values["beta_L"], free_free(), strict=False))
    ]
    for count, values in meshes.values.items():
        rows += [
            Row(
                f"clamped-free, {count} element{'s' * (count != '1')}, λ of mode {k + 1}",
                "1",
                meshes.source,
                exact,
                float(mesh_frequencies(int(count))[k]),
                10.5,
                "all ten printed decimals",
            )
            for k, exact in enumerate(values)
        ]
    return rows


def draw(figure: Figure) -> None:
    left, right = figure.subplots(1, 2)
    arm = unit_beam(ELEMENTS)
    shapes = fa.modes(arm).shapes
    for k in range(4):
        # Small enough that the tip's own angle does not turn the picture.
        points = arm.shape(1e-6 * shapes[k], stations=101)[0]
        across = points[:, 1] / points[-1, 1]
        left.plot(points[:, 0], across, color=SERIES[k], label=f"mode {k + 1}")
    left.set(xlabel="$x/L$", ylabel="shape, 1 at the tip", xlim=(0, 1))
    left.set_title("Clamped beam")
    exact = np.array(reference("beams", "clamped").values["lambda"])
    n = np.array(MESHES)
    for k in range(4):
        errors = [mesh_frequencies(count)[k] / exact[k] - 1 for count in MESHES]
        law = (np.sqrt(exact[k]) / n) ** 4 / 1440
        first = k == 0
        right.plot(n, errors, **OURS, color=SERIES[k], label="flexarm" if first else None)
        label = "$(\\beta h)^4/1440$" if first else None
        right.plot(n, law, color=SERIES[k], linewidth=0.9, label=label)
    right.set(xlabel="elements", ylabel="relative error of $\\lambda$", yscale="log")
    logarithmic_ticks(right, MESHES)
    right.margins(x=0.04)
    right.set_title("Error")
    legend_above(right)
    label_lines(left)


CASE = Case(
    name="clamped-beam",
    title="Beam, clamped or free",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Left: the first four shapes of the clamped beam. Right: the error of their "
    "frequencies decreases with the fourth power of the element length, as predicted.",
    module="gallery/cases/clamped_beam.py",
)
