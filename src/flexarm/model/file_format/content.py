"""Content of a file for a record: plain values without defaults."""

from __future__ import annotations

from typing import Any

from flexarm.model.arm.sections import MATERIALS, Material
from flexarm.model.checks import Record


def content_of(value: Any) -> Any:
    """Return the content of a file for a value of a record, without defaults."""
    if isinstance(value, Material) and value in MATERIALS.values():
        return next(name for name, preset in MATERIALS.items() if preset == value)
    if isinstance(value, Record):
        fields = type(value).model_fields
        reported = {
            name: content_of(part)
            for name, part in value
            if name in value.model_fields_set
            and (part != fields[name].default or name in value._written)
        }
        kind = {"kind": value.kind} if "kind" in fields else {}  # type: ignore[attr-defined]
        return {**kind, **reported}
    if isinstance(value, dict):
        return {name: content_of(part) for name, part in value.items()}
    return [content_of(part) for part in value] if isinstance(value, tuple) else value
