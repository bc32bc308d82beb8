"""Every key of every record that a file can contain has a field in the studio."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest

from flexarm.base.errors import InputError
from flexarm.model import Scenario, StudySpec
from flexarm.model.checks import Record
from flexarm.model.wording import look
from flexarm.view.studio.state import KIND, NEW, PRESET, TABLE, WAY, WORDS, Project, open_bytes
from flexarm.view.studio.values.fields import SAMPLED, Field, fields_in, groups_of
from flexarm.view.studio.values.forms import Forms, forms_of

#: A scenario in which a contact, instruments and a controller are possible.
SCENARIO = """\
flexarm: 1
arm:
  links:
    - length: 0.8
      flexural_rigidity: 30.0
      mass_per_length: 0.5
      gauges: [{station: 0.1, distance: 0.005}]
    - {length: 0.6, flexural_rigidity: 20.0, mass_per_length: 0.4}
  joints: [{hub_inertia: 0.05, limits: {lower: -3, upper: 3, stiffness: 100}}, {hub_inertia: 0.03}]
motion: {kind: line, start: [1.0, 0.2], end: [0.6, 0.6], duration: 0.5}
drive: {kind: joint_pd, proportional: [8.0, 3.0], derivative: [0.8, 0.3]}
run: {duration: 0.6}
"""
FREE = SCENARIO.replace(
    "kind: joint_pd, proportional: [8.0, 3.0], derivative: [0.8, 0.3]", "kind: none"
)
STUDY = SCENARIO.replace("motion: ", "motions:\n  one: ").replace("drive: ", "drives:\n  one: ")


def records_in(forms: Forms, found: set[type[Record]]) -> None:
    """Collect the records that a value of these forms may contain."""
    for form in forms.given:
        if form.name in ("list", "pair", "names"):
            records_in(form.items(), found)
        elif form.name == "record" and form.type not in found:
            found.add(form.type)
            for field in form.type.model_fields.values():
                records_in(forms_of(field), found)


def keys_of(root: type[Record]) -> set[tuple[str, str]]:
    """Return class and name of every key below a scenario or study."""
    found: set[type[Record]] = {root}
    for name, field in root.model_fields.items():
        if name not in SAMPLED:
            records_in(forms_of(field), found)
    return {
        (record.__name__, name)
        for record in found
        for name in record.model_fields
        if record is not root or name not in SAMPLED
    }


def shown(project: Project) -> Iterator[tuple[tuple[str, str], Field]]:
    """Yield class and name of each key that a field shows, or that contains it, and the field."""
    for group in groups_of(project):
        for field in fields_in(group.entries):
            value: Any = project.record
            *path, last = project.placed(field.path)
            for part in (*path, last):
                if isinstance(value, Record) and part in type(value).model_fields:
                    yield (type(value).__name__, str(part)), field
                value = look(value, part) if part not in WORDS or part == KIND else value
            if last == TABLE:
                for name in value._columns:
                    yield (type(value).__name__, name), field


def edits_of(field: Field) -> list[Any]:
    """Return the values of a field that show others: kinds, forms, and what can be added."""
    if field.path[-1] in (KIND, WAY, PRESET):
        return [value for _, entries in field.choices for value, _ in entries]
    return [None] if field.path[-1] == NEW else []


def found_from(project: Project) -> set[tuple[str, str]]:
    """Return all keys with a field in a project or after edits that show other fields."""
    found: set[tuple[str, str]] = set()
    tried: set[Any] = set()
    waiting = [project]
    while waiting:
        now = waiting.pop()
        for key, field in list(shown(now)):
            found.add(key)
            edits = [(field.path, value) for value in edits_of(field)]
            edits += [field.other] if field.other is not None else []
            for path, value in edits:
                edit = tuple(part for part in path if not isinstance(part, int)), value
                if edit not in tried:
                    tried.add(edit)
                    # An edit that does not fit this project is tried in another one.
                    with suppress(InputError):
                        waiting.append(now.edited(path, value))
    return found


def every_field(root: type[Record]) -> set[tuple[str, str]]:
    if root is StudySpec:
        return found_from(open_bytes(STUDY.encode(), "c.yaml").edited(("contacts", NEW), None))
    scenario = open_bytes(SCENARIO.encode(), "a.yaml").edited(("contacts", NEW), None)
    return found_from(scenario) | found_from(open_bytes(FREE.encode(), "b.yaml"))


@pytest.mark.thorough
@pytest.mark.parametrize("root", [Scenario, StudySpec], ids=lambda root: root.__name__)
def test_every_key_has_a_field(root: type[Record]) -> None:
    assert sorted(keys_of(root) - every_field(root)) == []
