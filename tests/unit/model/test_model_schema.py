"""The JSON schema agrees with the accepted values."""

import json
import re

from flexarm.model import ArmSpec, Link, Scenario, json_schema


def test_schema_has_every_key_with_a_description():
    schema = json_schema("scenario")
    assert list(schema["properties"]) == ["flexarm", *Scenario.model_fields]
    assert schema["required"] == ["flexarm", "arm"]  # so that it matches arm files too
    definitions = schema["$defs"]
    assert list(definitions["Link"]["properties"]) == list(Link.model_fields)
    assert list(definitions["ArmSpec"]["properties"]) == list(ArmSpec.model_fields)
    for name, definition in definitions.items():
        assert definition["additionalProperties"] is False, name
        for key, entry in definition["properties"].items():
            assert key == "kind" or "description" in entry, (name, key)


def test_schema_has_the_limits_that_editors_can_check():
    link = json_schema("arm")["$defs"]["Link"]["properties"]
    assert (link["elements"]["minimum"], link["elements"]["maximum"]) == (1, 256)
    assert link["length"]["exclusiveMinimum"] == 0
    arm = json_schema("arm")["$defs"]["ArmSpec"]["properties"]
    assert (arm["links"]["minItems"], arm["links"]["maxItems"]) == (1, 256)
    assert arm["theory"]["enum"] == ["linear", "second_order"]
    # Pydantic writes keys of its own if it cannot express a limit; editors do not know them.
    assert not re.search(r'"(gt|ge|lt|le|min_length|max_length)":', json.dumps(json_schema()))


def test_kind_is_required_where_a_file_must_give_it():
    definitions = json_schema()["$defs"]
    kinds = {name for name, entry in definitions.items() if "kind" in entry["properties"]}
    chosen = {"FilterSpec", "Joint", "Closure"}  # a choice with a default, not that of a union
    assert all("kind" not in definitions[name].get("required", ()) for name in chosen)
    kinds -= chosen
    assert {"Tube", "ModalDamping", "LineMotionSpec", "TorqueDrive", "NoDrive"} <= kinds
    assert all("kind" in definitions[name]["required"] for name in kinds)


def test_arm_may_be_a_mapping_or_the_name_of_a_file():
    for kind in ("arm", "scenario"):
        options = json_schema(kind)["properties"]["arm"]["anyOf"]
        assert [option.get("$ref", option.get("type")) for option in options] == [
            "#/$defs/ArmSpec",
            "string",
        ]


def test_arm_schema_has_no_other_keys_and_defines_only_what_it_uses():
    schema = json_schema("arm")
    assert list(schema["properties"]) == ["flexarm", "arm"]
    assert "Scenario" not in schema["$defs"]


def test_material_may_be_a_name():
    options = json_schema("arm")["$defs"]["Link"]["properties"]["material"]["anyOf"]
    assert {"enum": ["steel", "aluminium"]} in options
    assert {"$ref": "#/$defs/Material"} in options
