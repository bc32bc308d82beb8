"""Every cross-section against integrals over its shape."""

from typing import get_args

import numpy as np
import pytest

from flexarm.model import Box, Circle, Link, Rectangle, Tube
from flexarm.model.arm.links import MATERIALS, Section
from unit.model.model_strategies import SECTIONS

#: Kinds of the sections of files.
KINDS = {record.model_fields["kind"].default for record in get_args(get_args(Section)[0])}
#: An example of each kind, and the total width of its material at heights y above its middle.
EXAMPLES = {
    "rectangle": (Rectangle(width=0.02, height=0.05), lambda y: rectangle(y, 0.02, 0.05)),
    "circle": (Circle(diameter=0.04), lambda y: ellipse(y, 0.04, 0.04)),
    "tube": (
        Tube(outer_diameter=0.04, thickness=0.003),
        lambda y: ellipse(y, 0.04, 0.04) - ellipse(y, 0.034, 0.034),
    ),
    "box": (
        Box(width=0.03, height=0.05, thickness=0.004),
        lambda y: rectangle(y, 0.03, 0.05) - rectangle(y, 0.022, 0.042),
    ),
}

every = pytest.mark.parametrize("kind", EXAMPLES)


def rectangle(y, width, height):
    """Return the width of a full rectangle at heights y, and zero beyond it."""
    return np.where(abs(y) < height / 2, width, 0.0)


def ellipse(y, width, height):
    """Return the width of a full ellipse at heights y, and zero beyond it."""
    return width * np.sqrt(np.maximum(1 - (2 * y / height) ** 2, 0))


def strips(kind):
    """Return the section, and height, thickness and width of horizontal strips of it."""
    section, width = EXAMPLES[kind]
    edges = np.linspace(-section.depth / 2, section.depth / 2, 100_001)
    y = (edges[1:] + edges[:-1]) / 2
    return section, y, np.diff(edges), width(y)


def test_every_section_has_an_example():
    assert set(EXAMPLES) == KINDS, "add it to EXAMPLES"
    assert set(SECTIONS) == KINDS, "add it to SECTIONS of model_strategies.py"


@every
def test_area_and_second_moment_are_those_of_the_shape(kind):
    section, y, thickness, width = strips(kind)
    # The strips resolve the corners of the box to 1e-5 of its depth; round sections are closer.
    assert section.area == pytest.approx(np.sum(thickness * width), rel=1e-4)
    assert section.second_moment == pytest.approx(np.sum(thickness * width * y**2), rel=1e-4)
    # Bending has no axial force only if the axis goes through the centroid.
    assert abs(np.sum(thickness * width * y)) < 1e-6 * section.area * section.depth


@every
def test_depth_is_the_extent_of_the_shape(kind):
    section, width = EXAMPLES[kind]
    within, beyond = (part * section.depth / 2 * np.array([-1.0, 1.0]) for part in (0.999, 1.001))
    assert np.all(width(within) > 0.0)
    assert np.all(width(beyond) == 0.0)


@every
def test_shear_coefficient_is_below_that_of_mean_stresses(kind):
    """No stress has less energy than its mean over each strip, by Jourawski."""
    section, y, thickness, width = strips(kind)
    moment = np.cumsum(thickness * width * y)  # of the area below each strip
    energy = np.sum(thickness * moment**2 / width)
    bound = np.sum(thickness * width * y**2) ** 2 / (np.sum(thickness * width) * energy)
    # The rectangle attains the bound, which the strips give to 1e-4.
    assert 0.5 * bound < section.shear_coefficient < bound * (1 + 1e-4)


@every
def test_link_has_its_mass_and_stiffness(kind):
    section, steel = EXAMPLES[kind][0], MATERIALS["steel"]
    link = Link(length=1.0, material="steel", section=section, element="timoshenko")
    beam = link.beam()
    assert beam.mass_per_length == (pytest.approx(steel.density * section.area),) * 2
    stiffness = steel.youngs_modulus * section.second_moment
    assert beam.flexural_rigidity == (pytest.approx(stiffness),) * 2
    shear = section.shear_coefficient * steel.shear_modulus * section.area
    assert beam.shear_rigidity == (pytest.approx(shear),) * 2
