"""JSON schemas of the file formats, for completion and validation in editors."""

from __future__ import annotations

from typing import Any

from flexarm.base.errors import ModelError, Problem, public_call, shown
from flexarm.model.arm.sections import MATERIALS
from flexarm.model.arm.spec import ArmSpec
from flexarm.model.file_format.files import FILE_VERSION
from flexarm.model.scenarios.scenario import Scenario
from flexarm.model.scenarios.study import StudySpec
from flexarm.model.units import QUANTITY_PATTERN, unit_of
from flexarm.model.wording import suggestion

_KINDS = {"arm": ArmSpec, "scenario": Scenario, "study": StudySpec}


@public_call
def json_schema(kind: str = "scenario") -> dict[str, Any]:
    """Return the JSON schema of a kind of file.

    Args:
        kind: ``"scenario"``, which is valid for arm files too (only `flexarm` and `arm` are
            required), ``"arm"``, which permits no other keys, or ``"study"``.

    Raises:
        ModelError: if there is no such kind of file.
    """
    if kind not in _KINDS:
        rule = f"be one of {', '.join(map(repr, _KINDS))}"
        hint = suggestion(kind, _KINDS) if isinstance(kind, str) else ""
        raise ModelError(Problem("kind", rule, shown(kind), hint))
    whole = (StudySpec if kind == "study" else Scenario).model_json_schema()
    definitions = whole["$defs"]
    for definition in definitions.values():
        if "const" in definition.get("properties", {}).get("kind", {}):
            # The field has a default, so pydantic lists it as optional, but files require it.
            definition["required"] = ["kind", *definition.get("required", [])]
        for name, field in definition.get("properties", {}).items():
            if unit_of(field.get("description", "")):
                definition["properties"][name] = _with_quantities(field)
    material: list[Any] = definitions["Link"]["properties"]["material"]["anyOf"]
    material.insert(0, {"enum": list(MATERIALS)})  # names are replaced before validation
    properties: dict[str, Any] = whole["properties"]
    parts = ["arm"] if kind == "arm" else list(properties)
    arm = properties["arm"]
    file = {"type": "string", "description": "An arm file, relative to this file."}
    properties["arm"] = {"description": arm.pop("description", ""), "anyOf": [arm, file]}
    version = {"const": FILE_VERSION, "description": "Version of the file format."}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"flexarm {kind} file",
        "type": "object",
        "properties": {"flexarm": version, **{part: properties[part] for part in parts}},
        "required": ["flexarm", *(whole["required"] if kind == "study" else ["arm"])],
        "additionalProperties": False,
        "$defs": definitions,
    }


def _with_quantities(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a field with a unit, whose numbers may be text with a unit."""
    if schema.get("type") == "number":
        return {**schema, "type": ["number", "string"], "pattern": QUANTITY_PATTERN}
    changed = dict(schema)
    for key in ("anyOf", "oneOf", "prefixItems"):
        if key in schema:
            changed[key] = [_with_quantities(member) for member in schema[key]]
    for key in ("items", "additionalProperties"):
        if isinstance(schema.get(key), dict):
            changed[key] = _with_quantities(schema[key])
    return changed
