"""Contacts in scenario files: errors with their place, and the created objects."""

import pytest

import flexarm as fa
from flexarm.cases.scenario.scenario import prepare
from flexarm.model import load_scenario

HEAD = """flexarm: 1
arm: {links: [{length: 1.0, mass_per_length: 1.0, flexible: false}]}
run: {duration: 0.1, rate: 100}
contacts:
"""


def written(tmp_path, contacts):
    path = tmp_path / "scenario.yaml"
    path.write_text(HEAD + contacts, encoding="utf-8")
    return path


def test_every_kind_becomes_a_contact(tmp_path):
    text = """
  - surface: {kind: wall, point: [0, 2], normal: [0, -1]}
    stiffness: 1000
  - surface: {kind: round, center: [0, 0], radius: 3, inside: true}
    {stiffness: 2e3}
  - surface: {kind: table, x: [0, 1, 2], y: [-1, -1, -1.5]}
    stiffness: 3.0e+3
    station: 0.5
    exponent: 1.5
""".replace("    {stiffness: 2e3}", "    stiffness: 2.0e+3\n    damping: 0.5\n    friction: 0.1")
    prepared = prepare(load_scenario(written(tmp_path, text)))
    wall, room, table = prepared.options["contacts"]
    assert isinstance(wall.surface, fa.Wall)
    assert room.surface.inside
    assert (room.damping, room.friction, room.friction_speed) == (0.5, 0.1, 1e-3)
    assert (table.station, table.exponent, table.stiffness) == (0.5, 1.5, 3000.0)
    result = prepared.run()
    assert result.contact_gap.values[0, :2] == pytest.approx([2.0, 2.0])
    assert 0.9 < result.contact_gap.values[0, 2] < 1.0  # a spline rises before it falls
    assert "contacts" in result.attrs["scenario"]


@pytest.mark.parametrize(
    ("text", "stated"),
    [
        ("  - {surface: {kind: wal, point: [0, 0], normal: [0, 1]}, stiffness: 1}", "surface.kind"),
        ("  - {surface: {kind: wall, point: [0, 0], normal: [0, 0]}, stiffness: 1}",
         r"contacts\[0\].surface.normal must have a length greater than 0"),
        ("  - {surface: {kind: wall, point: [0, 0], normal: [0, 1]}, stiffness: 0}",
         r"contacts\[0\].stiffness must be greater than 0"),
        ("  - {surface: {kind: wall, point: [0, 0], normal: [0, 1]}, stiffness: 1, link: 3}",
         r"contacts\[0\].link must be the number of a link, 1 to 1"),
        ("  - {surface: {kind: wall, point: [0, 0], normal: [0, 1]}, stiffness: 1, station: 3}",
         r"contacts\[0\].station must be at most 1"),
        ("  - {surface: {kind: table, x: [0, 1], y: [0, 1]}, stiffness: 1}",
         r"contacts\[0\].surface.x must have at least three points"),
        ("  - {surface: {kind: table, x: [0, 1, 1], y: [0, 1, 1]}, stiffness: 1}",
         r"contacts\[0\].surface.x\[2\] must differ from the previous"),
        ("  - {stiffness: 1, surface: {kind: table, x: [0,2,2,0], y: [0,1,0,2], closed: true}}",
         r"surface.x and y are a polygon that crosses itself after the points \[0\] and \[2\]"),
        ("  - {surface: {kind: round, center: [0, 0], radius: 1}, stifness: 1}", "stiffness"),
    ],
)  # fmt: skip
def test_wrong_contacts_are_rejected_with_their_line(tmp_path, text, stated):
    path = written(tmp_path, text)
    with pytest.raises(fa.ModelError, match=stated) as reported:
        load_scenario(path)
    assert str(reported.value).startswith(f"{path}:5")


def test_multistep_method_is_rejected_at_its_line(tmp_path):
    text = "  - {surface: {kind: wall, point: [0, 0], normal: [0, 1]}, stiffness: 1}\n"
    path = written(tmp_path, text)
    path.write_text(path.read_text().replace("rate: 100}", "rate: 100, integrator: cowell_4}"))
    with pytest.raises(fa.InputError, match=r"scenario\.yaml:3: run\.integrator must be one of"):
        fa.run_scenario(path)
