"""Numbers with units, in files and in Python."""

import math
import subprocess
import sys

import jsonschema
import pytest
import yaml

import flexarm as fa
from flexarm.base.errors import ModelError
from flexarm.model import json_schema, load_arm_spec, load_scenario
from flexarm.model.checks import Record, descriptions_of
from flexarm.model.file_format.files import load_document, save_arm_spec
from flexarm.model.file_format.yaml_text import change_of, changed
from flexarm.model.units import factor_to, unit_of

ARM = """\
flexarm: 1
arm:
  gravity: [0, -981 cm/s^2]
  links:
    - length: 667 mm
      material: {density: 2.7 g/cm^3, youngs_modulus: 70 GPa}
      section: {kind: tube, outer_diameter: 2 cm, thickness: 500 µm}
      gauges: [{station: 10 mm, distance: 1e-2}]
    - {length: 1 ft, flexural_rigidity: 1.4e6 N mm2, mass_per_length: 162 g/m}
  joints:
    - {hub_inertia: 10 kg cm^2, rotor_inertia: 4500 g·mm², gear_ratio: 100, stiffness: 16 kNm/rad}
    - {fixed: true, rest_angle: 90 deg}
  payload: {mass: 250 g, offset: [30 mm, 0]}
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text(ARM, encoding="utf-8")
    return path


def test_file_with_units_is_the_arm_in_si_units(file, tmp_path):
    spec = load_arm_spec(file)
    first, second = spec.links
    assert spec.gravity == (0.0, -9.81)
    assert first.length == 0.667
    assert (first.material.density, first.material.youngs_modulus) == (2700.0, 70e9)
    assert (first.section.outer_diameter, first.section.thickness) == (0.02, 500e-6)
    assert (first.gauges[0].station, first.gauges[0].distance) == (0.01, 0.01)
    assert (second.length, second.flexural_rigidity, second.mass_per_length) == (0.3048, 1.4, 0.162)
    assert (spec.joints[0].hub_inertia, spec.joints[0].stiffness) == (1e-3, 16e3)
    assert spec.joints[0].rotor_inertia == pytest.approx(4.5e-6, rel=1e-15)  # rounded once
    assert spec.joints[1].rest_angle == math.pi / 2
    assert (spec.payload.mass, spec.payload.offset) == (0.25, (0.03, 0.0))
    save_arm_spec(spec, tmp_path / "saved.yaml")
    assert "mm" not in (tmp_path / "saved.yaml").read_text()
    assert load_arm_spec(tmp_path / "saved.yaml") == spec


@pytest.mark.thorough
def test_schema_accepts_numbers_with_units(file):
    content = yaml.safe_load(file.read_text())
    jsonschema.validate(content, json_schema("arm"))
    content["arm"]["links"][0]["length"] = "long"
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(content, json_schema("arm"))
    content["arm"]["links"][0]["length"] = -1
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(content, json_schema("arm"))


def test_scenario_with_units(tmp_path):
    path = tmp_path / "run.yaml"
    path.write_text(
        "flexarm: 1\narm:\n  links: [{length: 1, flexural_rigidity: 1, mass_per_length: 1}]\n"
        "motion: {kind: joint, start: [0], end: [90°], duration: 400 ms}\n"
        "initial: {joint_rate: [60 rpm]}\n"
        "loads: [{link: 1, force: [1 kN, 0]}]\n"
        "run: {duration: 0.5 min, rate: 1 kHz}\n",
        encoding="utf-8",
    )
    scenario = load_scenario(path)
    assert (scenario.run.duration, scenario.run.rate) == (30.0, 1000.0)
    assert (scenario.motion.end, scenario.motion.duration) == ((math.pi / 2,), 0.4)
    assert scenario.initial.joint_rate == pytest.approx((2.0 * math.pi,), rel=1e-15)
    assert scenario.loads[0].force == (1000.0, 0.0)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("70 GPa", "length must be a length, got 70 GPa."),
        ("70 mmm", "length must be a length, got 70 mmm. The unit mmm is not known."),
        ("-70 mm", "length must be greater than 0, got -0.07."),
        ("70", "length must be a number, got '70'. Write the bare number, in SI units."),
        ("1,5 m", "length must be a number, got '1,5 m'. Write the bare number, in SI units."),
        (
            "9**9**9 m",
            "length must be a number, got '9**9**9 m'. Write the bare number, in SI units.",
        ),
    ],
)
def test_wrong_units_name_key_and_line(file, value, message):
    file.write_text(ARM.replace("667 mm", f"'{value}'"), encoding="utf-8")
    with pytest.raises(ModelError) as caught:
        load_arm_spec(file)
    assert str(caught.value) == f"{file}:5: arm.links[0].{message}"


def test_values_of_the_command_line_accept_units(file):
    change = change_of("--set", "arm.links[0].length=1200 mm")
    assert load_arm_spec(changed(load_document(file), [change])).links[0].length == 1.2


@pytest.mark.parametrize(
    ("unit", "to"), [("Hz", "rad/s"), ("rpm", "Hz"), ("N m", "N m/rad"), ("rad", "m")]
)
def test_angles_are_no_numbers(unit, to):
    assert factor_to(unit, to) == ""


def _records(kind=Record):
    for derived in kind.__subclasses__():
        yield derived
        yield from _records(derived)


def test_unit_of_every_field_is_a_unit():
    units = {
        unit_of(text)
        for kind in _records()
        if kind.__module__.startswith("flexarm.")
        for text in descriptions_of(kind).values()
    } - {""}
    assert {"m", "rad", "kg/s^0.5", "rad/s per 1/m"} <= units
    for unit in units:
        assert factor_to(unit.replace(" per 1/", " "), unit) == 1.0


@pytest.mark.thorough
def test_pint_is_imported_when_a_number_has_a_unit():
    code = (
        "import sys, flexarm as fa\n"
        "fa.Link(length=1.0, flexural_rigidity=1.0, mass_per_length=1.0)\n"
        "assert 'pint' not in sys.modules\n"
        "fa.Link(length='1 m', flexural_rigidity=1.0, mass_per_length=1.0)\n"
        "assert 'pint' in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_records_of_python_accept_units():
    assert fa.Joint(
        limits=fa.JointLimits(lower="-90 deg", upper="0.25 rev", stiffness=1.0)
    ).limits == (fa.JointLimits(lower=-math.pi / 2, upper=math.pi / 2, stiffness=1.0))
