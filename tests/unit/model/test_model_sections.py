"""Thin and thick walls of sections, presets, tables."""

import math
from fractions import Fraction

import numpy as np
import pytest

from flexarm.base.errors import ModelError
from flexarm.model import (
    MATERIALS,
    Box,
    Circle,
    Link,
    Material,
    Rectangle,
    SectionTable,
    Tube,
)


def test_thin_walls_are_accurate():
    thickness = 1e-9
    fourth_powers = float(1 - (1 - 2 * Fraction(thickness)) ** 4)  # of outer and inner size
    box = Box(width=1.0, height=1.0, thickness=thickness)
    tube = Tube(outer_diameter=1.0, thickness=thickness)
    # A few roundings; a difference of fourth powers as floats would lose 8 of the 16 digits.
    assert box.second_moment == pytest.approx(fourth_powers / 12, rel=1e-15)
    assert tube.second_moment == pytest.approx(math.pi * fourth_powers / 64, rel=1e-15)


def test_thickest_wall_is_nearly_solid():
    tube, solid = Tube(outer_diameter=0.1, thickness=0.0499999), Circle(diameter=0.1)
    assert tube.area == pytest.approx(solid.area, rel=1e-11)  # the hole has (2e-6)^2 of the area
    box, full = Box(width=0.1, height=0.2, thickness=0.0499999), Rectangle(width=0.1, height=0.2)
    assert box.second_moment == pytest.approx(full.second_moment, rel=1e-5)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Tube(outer_diameter=0.1, thickness=0.05),
            (
                "Tube: thickness must be less than 0.05 (half of outer_diameter), got 0.05. "
                "The wall fills the section."
            ),
        ),
        (
            lambda: Box(width=0.1, height=0.04, thickness=0.03),
            (
                "Box: thickness must be less than 0.02 (half of height), got 0.03. The wall "
                "fills the section."
            ),
        ),
        (
            lambda: Rectangle(width=20.0, height=5000.0),
            (
                "Rectangle: height must be between 1e-9 and 1000, got 5000. "
                "Dimensions are in metres."
            ),
        ),
        (lambda: Circle(diameter=0), "Circle: diameter must be greater than 0, got 0."),
        (
            lambda: Circle(radius=1),
            (
                "Circle: diameter is missing.\n"
                "Circle: radius is not a known key. Known: kind, diameter."
            ),
        ),
        (
            lambda: Material(density=-1, youngs_modulus="70 mm"),
            (
                "Material: density must be greater than 0, got -1.\n"
                "Material: youngs_modulus must be a modulus, got 70 mm."
            ),
        ),
    ],
)
def test_impossible_sections_are_rejected_with_the_reason(make, message):
    with pytest.raises(ModelError) as caught:
        make()
    assert str(caught.value) == message


def test_preset_materials_are_found_by_name():
    section = Circle(diameter=0.01)
    for name, material in MATERIALS.items():
        assert Link(length=1, material=name, section=section).material == material
    # Textbook orders of magnitude: steel is denser than water and three times as stiff as
    # aluminium.
    assert MATERIALS["steel"].youngs_modulus == 3 * MATERIALS["aluminium"].youngs_modulus
    with pytest.raises(ModelError, match=r"got 'aluminum'\. Did you mean 'aluminium'\?"):
        Link(length=1, material="aluminum", section=section)


def test_table_accepts_arrays_and_stores_tuples():
    table = SectionTable(
        x=np.linspace(0, 1, 3),
        flexural_rigidity=np.float32([3, 2, 1]),
        mass_per_length=[np.float64(2.0), 1, np.int32(1)],
    )
    assert table.x == (0.0, 0.5, 1.0)
    values = (*table.x, *table.flexural_rigidity, *table.mass_per_length)
    assert {type(value) for value in values} == {float}
    assert table.rotary_inertia_per_length is None


@pytest.mark.parametrize(
    ("columns", "messages"),
    [
        (
            {"x": [0], "flexural_rigidity": None, "mass_per_length": [1]},
            ["x must have at least two points, the root and the tip, got 1."],
        ),
        (
            {"x": [0.1, 0.5, 1.0]},
            ["x[0] must be 0, got 0.1. A table starts at the root of the link."],
        ),
        (
            {"x": [0, 0.5, 0.5]},
            ["x[2] must be greater than the previous point (0.5), got 0.5."],
        ),
        (
            {"x": [0, 1, 2, 3], "rotary_inertia_per_length": [1, 2]},
            [
                "flexural_rigidity must have length 4, one value for each point of x, got 3.",
                "mass_per_length must have length 4, one value for each point of x, got 3.",
                (
                    "rotary_inertia_per_length must have length 4, one value for each point of "
                    "x, got 2."
                ),
            ],
        ),
        (
            {"mass_per_length": [1, -1, math.inf], "flexural_rigidity": [1, 0, 1]},
            [
                "flexural_rigidity[1] must be greater than 0, got 0.",
                "mass_per_length[1] must be at least 0, got -1.",
                "mass_per_length[2] must be a finite number, got inf.",
            ],
        ),
        ({"x": {0, 1, 2}}, ["x must be a list, got {0, 1, 2}."]),
    ],
)
def test_wrong_tables_are_rejected_with_every_reason(columns, messages):
    right = {"x": [0, 1, 2], "flexural_rigidity": [1, 1, 1], "mass_per_length": [1, 1, 1]}
    with pytest.raises(ModelError) as caught:
        SectionTable(**{**right, **columns})
    assert str(caught.value).splitlines() == [f"SectionTable: {text}" for text in messages]


def test_key_that_is_not_text_is_rejected_with_missing_dimensions():
    # Such a key ends the validation before missing fields are reported.
    with pytest.raises(ModelError) as caught:
        Box(**{"width": 0.01, "thickness": 0.001, "\ud800": 1})
    assert len(caught.value.problems) == 1
