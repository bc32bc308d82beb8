"""`help()` of records shows plain types and units; JSON schemas keep the short description."""

from __future__ import annotations

import inspect
import pydoc

import pytest

import flexarm as fa
from flexarm.model.checks import Record, descriptions_of
from flexarm.model.file_format.files import json_schema

RECORDS = sorted(name for name in fa.__all__ if isinstance(getattr(fa, name), type(Record)))


@pytest.mark.parametrize("name", RECORDS)
def test_help_of_a_record_has_plain_types_and_every_field(name: str) -> None:
    record = getattr(fa, name)
    text = pydoc.render_doc(record, renderer=pydoc.plaintext)
    assert not any(word in text for word in ("Annotated", "FieldInfo", "<function"))
    assert not any(word in text for word in ("__", "inherited from pydantic")), text
    for field in record.model_fields:
        if field != "kind":
            assert field in descriptions_of(record), f"{name}.{field} has no description"
        assert f"    {field}: " in text


def test_signature_of_a_link_lists_its_arguments() -> None:
    parameters = inspect.signature(fa.Link).parameters
    assert str(parameters["length"]) == "length: float"
    assert str(parameters["flexural_rigidity"]) == "flexural_rigidity: float | None = None"
    assert str(parameters["elements"]) == "elements: int = 4"
    assert str(parameters["gauges"]) == "gauges: Sequence[Gauge] = ()"
    assert "(N m^2)" in (inspect.getdoc(fa.Link) or "")


def test_signature_of_an_arm_lists_its_arguments() -> None:
    assert list(inspect.signature(fa.Arm).parameters) == [
        "links", "joints", "payload", "gravity", "base", "closures", "theory",
    ]  # fmt: skip


def test_schema_describes_a_record_without_the_list_of_its_fields() -> None:
    description = json_schema()["$defs"]["Gauge"]["description"]
    assert description.startswith("A strain gauge")
    assert "Args:" not in description


def test_record_hides_attributes_of_pydantic_but_not_its_own() -> None:
    assert {"length", "beam", "replace"} & set(dir(fa.Link)) >= {"beam", "replace"}
    assert "model_dump_json" not in dir(fa.Link)
