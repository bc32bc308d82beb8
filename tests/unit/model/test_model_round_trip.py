"""Written records are read back equal, from files, JSON and pickles."""

import pickle

import pytest
from hypothesis import HealthCheck, given, settings
from model_strategies import arm_specs, mechanism_specs, scenarios

from flexarm.base.errors import InputError
from flexarm.model import (
    ArmSpec,
    Joint,
    Link,
    Scenario,
    file_text,
    load_arm_spec,
    load_scenario,
    save_arm_spec,
)

relaxed = settings(
    max_examples=40,
    deadline=None,  # the time to draw and read an arm depends on the load of the machine
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@relaxed
@given(spec=arm_specs())
def test_arm_file_is_read_back_equal(spec, tmp_path):
    save_arm_spec(spec, tmp_path / "arm.yaml")
    assert load_arm_spec(tmp_path / "arm.yaml") == spec


@relaxed
@given(spec=mechanism_specs())
def test_file_of_a_mechanism_is_read_back_equal(spec, tmp_path):
    save_arm_spec(spec, tmp_path / "arm.yaml")
    read = load_arm_spec(tmp_path / "arm.yaml")
    assert read == spec
    assert ArmSpec.model_validate_json(spec.model_dump_json()) == spec
    assert (read.parents, read.features) == (spec.parents, spec.features)


@relaxed
@given(scenario=scenarios())
def test_scenario_file_is_read_back_equal(scenario, tmp_path):
    (tmp_path / "run.yaml").write_text(file_text(scenario), encoding="utf-8")
    assert load_scenario(tmp_path / "run.yaml") == scenario
    assert load_arm_spec(tmp_path / "run.yaml") == scenario.arm


@pytest.mark.thorough
@relaxed
@given(scenario=scenarios())
def test_json_and_pickle_are_read_back_equal(scenario):
    assert Scenario.model_validate_json(scenario.model_dump_json()) == scenario
    assert pickle.loads(pickle.dumps(scenario)) == scenario
    assert hash(scenario) == hash(scenario.replace())


LINK = Link(length=1.5, flexural_rigidity=70e9, mass_per_length=1e-5)


def test_file_omits_defaults(tmp_path):
    save_arm_spec(
        ArmSpec(links=[LINK], joints=[Joint(mass=0.0)], gravity=[0, -9.81]), tmp_path / "a"
    )
    assert (tmp_path / "a").read_text() == (
        "flexarm: 1\n"
        "arm:\n"
        "  links:\n"
        "  - {length: 1.5, flexural_rigidity: 70000000000.0, mass_per_length: 1.0e-05}\n"
        "  joints:\n"
        "  - {}\n"
        "  gravity: [0.0, -9.81]\n"
    )


def test_preset_materials_keep_their_name(tmp_path):
    section = {"kind": "circle", "diameter": 0.01}
    save_arm_spec(
        ArmSpec(links=[Link(length=1, material="steel", section=section)]), tmp_path / "arm.yaml"
    )
    text = (tmp_path / "arm.yaml").read_text()
    assert "material: steel" in text
    assert "kind: circle" in text  # a default, but the section cannot be read without it


def test_saving_replaces_a_file_in_one_step(tmp_path):
    target = tmp_path / "arm.yaml"
    target.write_text("old")
    target.chmod(0o640)
    (tmp_path / "link.yaml").symlink_to(target)
    save_arm_spec(ArmSpec(links=[LINK]), tmp_path / "link.yaml")
    assert load_arm_spec(target).links == (LINK,)
    assert target.stat().st_mode & 0o777 == 0o640
    assert (tmp_path / "link.yaml").is_symlink()
    assert {path.name for path in tmp_path.iterdir()} == {"arm.yaml", "link.yaml"}


def test_failed_saving_leaves_no_files(tmp_path):
    (tmp_path / "arm.yaml").mkdir()
    with pytest.raises(InputError, match=r"arm\.yaml: the file could not be written: "):
        save_arm_spec(ArmSpec(links=[LINK]), tmp_path / "arm.yaml")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="the file could not be written: "):
        save_arm_spec(ArmSpec(links=[LINK]), tmp_path / "file" / "arm.yaml")
    assert {path.name for path in tmp_path.iterdir()} == {"arm.yaml", "file"}


def test_missing_folders_are_created(tmp_path):
    save_arm_spec(ArmSpec(links=[LINK]), tmp_path / "a" / "b" / "arm.yaml")
    assert load_arm_spec(tmp_path / "a" / "b" / "arm.yaml").links == (LINK,)
