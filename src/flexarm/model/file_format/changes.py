"""Values given on the command line in place of those of a file: ``--set run.duration=3``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import Any

from flexarm.base.errors import InputError, ModelError, Problem, shown
from flexarm.model.file_format.yaml_text import Document, parse
from flexarm.model.paths import parts_of
from flexarm.model.wording import Path, path_text


@dataclass(frozen=True)
class Change:
    """A value at a key path of a file.

    Attributes:
        origin: the option with its value, in place of the line of the file in messages.
        path: the key path.
        value: plain value in place of the one of the file.
    """

    origin: str
    path: Path
    value: Any


def change_of(option: str, text: str) -> Change:
    """Return the change that an option requests as ``PATH=VALUE``, with the value in YAML.

    Args:
        option: name of the option, for messages.

    Raises:
        InputError: if the text does not have this form, or the value is not YAML.
    """
    name, given, value = text.partition("=")
    path = tuple(parts_of(name.strip()))
    if not given or not path:
        rule = "be a key path and a value, such as run.duration=3 or arm.links[0].length=1.2"
        raise InputError(Problem(option, rule, shown(text)))
    origin = f"{option} {text}"
    if not value.strip():
        return Change(origin, path, None)
    try:
        document = parse(FilePath(option), value)
        if document.problems:
            raise ModelError(*document.problems)
    except ModelError as error:
        named = (replace(p, where=origin, name=path_text(path)) for p in error.problems)
        raise ModelError(*named) from None
    return Change(origin, path, document.value)


def changed(document: Document, changes: Sequence[Change]) -> Document:
    """Return a document with other values; `Document.where` names the changes.

    Keys of the document that are paths themselves, such as those of ``vary``, are found in the path
    of a change. Changes inside an arm that the document names by its file are kept for that file.

    Raises:
        ModelError: if a path leads through a value that has no keys or entries, or to an entry of a
            list that does not exist.
    """
    value = document.value
    changes = [replace(change, path=_with_keys(value, change.path)) for change in changes]
    for change in changes:
        elsewhere = change.path[:1] == ("arm",) and isinstance(value.get("arm"), str)
        if not elsewhere or len(change.path) == 1:
            value = _with(value, change, ())
    return document.changed(value, changes)


def _with_keys(value: Any, path: Path) -> Path:
    """Return a path in which the keys of a value that contain dots or indices are one part each."""
    whole: Path = ()
    while path:
        lengths = range(len(path), 1, -1) if isinstance(value, dict) else ()
        taken = next((k for k in lengths if path_text(path[:k]) in value), 1)
        part = path[0] if taken == 1 else path_text(path[:taken])
        whole, path = (*whole, part), path[taken:]
        try:
            value = value[part]
        except (KeyError, IndexError, TypeError):
            return (*whole, *path)
    return whole


def _with(value: Any, change: Change, walked: Path) -> Any:
    """Return a value with the change in it; containers are copied, because aliases share them."""
    if walked == change.path:
        return change.value
    part = change.path[len(walked)]
    inside = (*walked, part)
    if isinstance(part, str):
        if not isinstance(value, dict | None):
            rule = "be a mapping of keys to values"
            raise ModelError(Problem(path_text(walked), rule, shown(value), where=change.origin))
        old = value or {}
        return {**old, part: _with(old.get(part), change, inside)}
    if not isinstance(value, list):
        raise ModelError(Problem(path_text(walked), "be a list", shown(value), where=change.origin))
    if part >= len(value):
        rule = f"does not exist: the list has {len(value)} entries, counted from 0"
        raise ModelError(Problem(path_text(inside), rule, where=change.origin))
    return [*value[:part], _with(value[part], change, inside), *value[part + 1 :]]
