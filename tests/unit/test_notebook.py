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


def test_motion_shows_its_ends(arm: fa.Arm) -> None:
    motion = fa.line_motion(arm, (1.5, 0.5), (1.2, 0.8), 2.0, start_time=0.5)
    assert repr(motion) == (
        "<flexarm.TipMotion: line from start to end, quintic, 2 joints, 0.5 to 2.5 s>"
    )
    heads, start, end = cells(motion)
    assert heads == ["", "time (s)", "joint 1", "joint 2", "tip x (m)", "tip y (m)"]
    assert [start[0], start[1], *start[4:]] == ["start", "0.5", "1.5", "0.5"]
    assert [end[0], end[1], *end[4:]] == ["end", "2.5", "1.2", "0.8"]
    assert [float(text) for text in end[2:4]] == pytest.approx(motion.joint_angle(2.5), rel=1e-4)


def test_motions_of_motions_name_their_kind(arm: fa.Arm) -> None:
    motion = fa.joint_motion(arm, [0.0, 1.0], [1.0, 0.5], 1.0)
    assert repr(motion) == "<flexarm.JointMotion: quintic, 2 joints, 0 to 1 s>"
    smooth = fa.smoothed(motion, 0.25)
    assert repr(smooth) == (
        "<flexarm.SmoothedMotion: raised_cosine of 0.25 s, of a JointMotion, 2 joints, 0 to 1.25 s>"
    )
    assert repr(fa.shaped(motion, frequency_hz=2.0, damping_ratio=0.0)).startswith(
        "<flexarm.ShapedMotion: 3 impulses, of a JointMotion, 2 joints, 0 to 1.5 s"
    )
    assert repr(fa.rigid_torque(arm, motion)) == (
        "<flexarm.RigidTorque: 2 joints, of a JointMotion>"
    )


def test_long_records_are_short_in_consoles_and_tables_in_notebooks(arm: fa.Arm) -> None:
    link = fa.Link(length="125 cm", mass_per_length=0.6, flexural_rigidity=1.0)
    assert str(link) == repr(link)
    assert eval(repr(link), {"Link": fa.Link}) == link
    assert cells(link)[1:] == [
        ["length", "1.25", "m"],
        ["flexural_rigidity", "1", "N m^2"],
        ["mass_per_length", "0.6", "kg/m"],
    ]
    scenario = fa.load_scenario("examples/wipe_wall.yaml")
    assert repr(scenario) == (
        "Scenario(arm=ArmSpec(...), motion=LineMotionSpec(...), drive=JointPDDrive(...), "
        "contacts=(Contact(...),), run=RunSpec(...))"
    )
    rows = cells(scenario)
    assert ["arm.links[1].length", "0.7", "m"] in rows
    assert ["contacts[0].surface.kind", "wall", ""] in rows
    many = fa.Arm(links=[link] * 30).spec
    assert repr(many) == "ArmSpec(links=(Link(...), ... 30 in all))"
    assert cells(many)[-1] == ["... and 50 more", "", ""]


def test_controllers_show_their_parameters(arm: fa.Arm) -> None:
    law = fa.JointPD([100.0, 50.0], [5.0, 2.5], sample_time=0.002)
    assert repr(law) == (
        "<flexarm.JointPD: proportional [100, 50], derivative [5, 2.5], sample_time 0.002>"
    )
    assert cells(law)[1:] == [
        ["proportional", "[100, 50]", "N m/rad"],
        ["derivative", "[5, 2.5]", "N m s/rad"],
        ["sample_time", "0.002", "s"],
    ]
    assert repr(fa.Plant(arm)) == "<flexarm.Plant: 2 links at 0 s>"


def test_texts_of_users_are_escaped() -> None:
    row = ET.fromstring(html_table("<b>", ["a"], [["<script>\x1b"]])).find(".//td")
    assert row is not None
    assert row.text == r"<script>\x1b"
