"""HTML of objects in notebooks: well-formed, with the numbers of the object."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
import pytest

import flexarm as fa
from flexarm.base.notebook import html_table


def cells(value: Any) -> list[list[str]]:
    """Return the texts of the rows of an object's table; fail if the HTML is malformed."""
    table = ET.fromstring(value._repr_html_())
    return [["".join(cell.itertext()) for cell in row] for row in table.iter("tr")]


@pytest.fixture(scope="module")
def arm() -> fa.Arm:
    link = fa.Link(length=1.25, flexural_rigidity=105.0, mass_per_length=0.6, elements=2)
    return fa.Arm(
        links=[link, fa.Link(length=1.0, mass_per_length=0.5, flexible=False)],
        payload=fa.Payload(mass=0.75),
    )


def test_arm_shows_its_links_and_its_payload(arm: fa.Arm) -> None:
    rows = cells(arm)
    assert rows[1] == ["link 1", "1.25", "105", "0.6", "4"]
    assert rows[2] == ["link 2", "1", "rigid", "0.5", "0"]
    assert rows[3][0] == "payload"
    assert rows[3][3] == "0.75 kg"


def test_property_that_varies_along_a_link_shows_its_range() -> None:
    table = fa.SectionTable(x=[0.0, 1.0], flexural_rigidity=[10.0, 5.0], mass_per_length=[1.0, 1.0])
    rows = cells(fa.Arm(links=[fa.Link(length=1.0, table=table)]))
    assert rows[1][2:4] == ["5 to 10", "1"]


def test_modes_show_every_frequency(arm: fa.Arm) -> None:
    found = fa.modes(arm, [0.0, 0.5])
    rows = cells(found)[1:]
    assert [float(row[1]) for row in rows] == pytest.approx(found.frequency_hz, rel=1e-4)


def test_equilibrium_shows_its_torques(arm: fa.Arm) -> None:
    rest = fa.equilibrium(arm, [0.0, 0.5], tip_force=(0.0, -1.0))
    rows = dict(cells(rest)[1:])
    assert rows["stable"] == "yes"
    assert float(rows["torque of joint 1 (N m)"]) == pytest.approx(rest.torque[0], rel=1e-4)


def test_linear_model_names_its_signals_and_units(arm: fa.Arm) -> None:
    model = fa.linearize(arm, np.zeros(arm.dof))
    rows = cells(model)[1:]
    assert [row[1] for row in rows] == [*model.inputs, *model.outputs, *model.states]
    assert rows[0] == ["input", model.inputs[0], "N m"]


def test_texts_of_users_are_escaped() -> None:
    row = ET.fromstring(html_table("<b>", ["a"], [["<script>\x1b"]])).find(".//td")
    assert row is not None
    assert row.text == r"<script>\x1b"
