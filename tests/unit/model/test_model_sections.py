"""Thin and thick walls of sections, presets, tables."""

import math
from fractions import Fraction

import numpy as np
import pytest

from flexarm.base.errors import ModelError
from flexarm.model import Box, Circle, Link, Rectangle, SectionTable, Tube
from flexarm.model.arm.links import MATERIALS


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
