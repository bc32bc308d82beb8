"""YAML text: reading to plain values with line numbers, changes of values, and writing.

Scalars follow YAML 1.2: ``1e5`` and ``70e9`` are numbers (text in YAML 1.1), ``1:30`` and ``yes``
are text (90 and true in YAML 1.1), ``010`` is ten.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import Any

import yaml
from yaml.composer import Composer
from yaml.resolver import Resolver

from flexarm.base.errors import InputError, ModelError, Problem, shown
from flexarm.model.paths import parts_of
from flexarm.model.wording import Path, path_text

#: Parser of libyaml; None if PyYAML was built without it.
CParser: Any = getattr(getattr(yaml, "cyaml", None), "CParser", None)

# No description needs this many values, nor this many mappings in a list, such as links or gauges.
# The limits bound the time until the answer: reading and checking a mapping takes up to 0.2 ms.
# Aliases can expand a small file to a huge one, so values are counted with them, too.
_MOST_VALUES = 2_000_000
_MOST_MAPPINGS = 5_000

_TAG = "tag:yaml.org,2002:"


class _Resolver(Resolver):
    """Resolver of the scalars of YAML 1.2, in place of those of PyYAML."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012  (PyYAML's own name and form)


for _name, _pattern, _first in (
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", "-+0123456789"),
    (
        "float",
        r"[-+]?((\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|\.(inf|Inf|INF))|\.(nan|NaN|NAN)",
        "-+.0123456789",
    ),
    ("merge", r"<<", "<"),
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
):
    _Resolver.add_implicit_resolver(_TAG + _name, re.compile(f"(?:{_pattern})$"), [*_first])


class _TooManyError(Exception):
    """A file exceeds a limit: the rule, and the line (from 0)."""


class _Bounded:
    """Composer that stops at the limits, before the rest of a long file is read."""

    _nodes = 0

    def compose_node(self: Any, parent: Any, index: Any) -> Any:
        self._nodes += 1
        mapping = type(index) is int and index >= _MOST_MAPPINGS  # an entry of a list
        if self._nodes > 2 * _MOST_VALUES:  # keys are nodes, too
            rule = f"has more than {_MOST_VALUES} values"
        elif mapping and self.check_event(yaml.MappingStartEvent):
            rule = f"has a list of more than {_MOST_MAPPINGS} mappings"
        else:
            return Composer.compose_node(self, parent, index)
        raise _TooManyError(rule, self.peek_event().start_mark.line)


class _Loader(_Bounded, yaml.SafeLoader):
    """Loader of nodes by PyYAML's own parser; constructs no Python objects."""

    yaml_implicit_resolvers = _Resolver.yaml_implicit_resolvers


class _FastLoader(_Bounded, Composer, CParser or object, _Resolver):  # type: ignore[misc]
    """Loader of the same nodes from the events of libyaml, in a seventh of the time.

    It does not use the composer of ``CParser``, which overflows the stack for deep nesting.
    """

    def __init__(self, text: str) -> None:
        CParser.__init__(self, text)
        Composer.__init__(self)
        _Resolver.__init__(self)


class _Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    """Dumper without anchors, whose output the loaders read as the same values."""

    yaml_implicit_resolvers = _Resolver.yaml_implicit_resolvers

    def ignore_aliases(self, data: Any) -> bool:
        return True


def to_yaml(content: dict[str, Any]) -> str:
    """Return YAML text of plain values in block style, innermost collections on one line."""
    return yaml.dump(content, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=100)


def flow_text(value: Any) -> str:
    """Return a plain value as YAML text on one line."""
    text: str = yaml.dump(
        value, Dumper=_Dumper, sort_keys=False, default_flow_style=True, width=10**9
    )
    return text.removesuffix("\n").removesuffix("\n...")


Entries = dict[str, tuple[yaml.Node, yaml.Node]]


class Document:
    """A YAML file that was read: its path as given by the user, its ``value`` as plain values.

    ``problems`` of the content as YAML did not prevent reading. ``changes`` are values in place of
    those of the file; a later one prevails.
    """

    def __init__(self, file: FilePath, root: yaml.Node) -> None:
        self.file = file
        self.changes: tuple[Change, ...] = ()
        self.problems: list[Problem] = []
        self._root = root
        # By node: aliases have the node of their anchor, and nested merges take exponential time.
        self._entries: dict[int, Entries] = {}
        self._built: dict[int, tuple[Any, int]] = {}
        self._open: set[int] = set()
        self.value = self._sized(root, ())[0]

    def changed(self, value: Any, changes: Sequence[Change]) -> Document:
        """Return this document with another value, and the changes that led to it."""
        other = copy(self)
        other.value, other.changes = value, (*self.changes, *changes)
        return other

    def where(self, path: Path) -> str:
        """Return ``file:line`` of a path or its nearest container; the change of a new value."""
        for change in reversed(self.changes):
            if path[: len(change.path)] == change.path:
                return change.origin
        node, line = self._root, self._root.start_mark.line
        for part in path:
            if isinstance(node, yaml.MappingNode):
                entry = self._entries_of(node).get(str(part))
                if entry is None:
                    break
                line, node = entry[0].start_mark.line, entry[1]
            elif isinstance(node, yaml.SequenceNode) and isinstance(part, int):
                node = node.value[part]
                line = node.start_mark.line
            else:
                break
        return f"{self.file}:{line + 1}"

    def _sized(self, node: yaml.Node, path: Path) -> tuple[Any, int]:
        """Return the value of a node, and the number of values in it with aliases expanded."""
        if id(node) in self._open:
            self._report(node, path, "is an alias of a value that contains it")
            return None, 1
        if id(node) not in self._built:
            self._open.add(id(node))
            self._built[id(node)] = self._build(node, path)
            self._open.remove(id(node))
        value, size = self._built[id(node)]
        if size > _MOST_VALUES:
            rule = f"has more than {_MOST_VALUES} values with its aliases expanded"
            raise ModelError(Problem("the file", rule, where=str(self.file)))
        return value, size

    def _build(self, node: yaml.Node, path: Path) -> tuple[Any, int]:
        if node.tag not in _TAGS:
            tag = node.tag.removeprefix(_TAG)
            self._report(node, path, f"has the tag {shown(tag)}; tags are not supported")
        if isinstance(node, yaml.SequenceNode):
            # Numbers of long tables need neither a path nor protection against aliases.
            items = [
                (_SCALARS[item.tag](item.value), 1)
                if item.tag in _NUMBERS and isinstance(item, yaml.ScalarNode)
                else self._sized(item, (*path, i))
                for i, item in enumerate(node.value)
            ]
            return [value for value, _ in items], 1 + sum(size for _, size in items)
        if isinstance(node, yaml.MappingNode):
            lines: dict[str, int] = {}
            for key, _ in node.value:
                line = key.start_mark.line + 1
                if not isinstance(key, yaml.ScalarNode):
                    self._report(key, path, "has a list or a mapping as a key")
                elif key.value in lines:
                    rule = f"is a duplicate key, first given in line {lines[key.value]}"
                    self._report(key, (*path, key.value), rule)
                else:
                    lines[key.value] = line
            entries = {
                key: self._sized(value, (*path, key))
                for key, (_, value) in self._entries_of(node).items()
            }
            size = 1 + sum(size for _, size in entries.values())
            return {key: value for key, (value, _) in entries.items()}, size
        return _SCALARS.get(node.tag, str)(node.value), 1

    def _entries_of(self, mapping: yaml.MappingNode) -> Entries:
        """Return key and value nodes by key; own keys override merged ones (``<<``)."""
        if id(mapping) in self._entries:
            return self._entries[id(mapping)]
        own: Entries = {}
        merged: Entries = {}
        for key, value in mapping.value:
            if key.tag == _TAG + "merge":
                for source in value.value if isinstance(value, yaml.SequenceNode) else [value]:
                    if isinstance(source, yaml.MappingNode):
                        merged = self._entries_of(source) | merged
            elif isinstance(key, yaml.ScalarNode):
                own.setdefault(key.value, (key, value))
        self._entries[id(mapping)] = merged | own
        return merged | own

    def _report(self, node: yaml.Node, path: Path, rule: str) -> None:
        where = f"{self.file}:{node.start_mark.line + 1}"
        self.problems.append(Problem(path_text(path) or "the file", rule, where=where))


def parse(file: FilePath, text: str) -> Document:
    """Read YAML text of a file; ModelError if it is not YAML, is empty, or has too many values."""
    try:
        root = _composed(text)
        if root is None:
            raise ModelError(Problem("the file", "is empty", where=str(file)))
        return Document(file, root)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"{file}:{mark.line + 1}" if mark else str(file)
        fault = f"is not valid YAML: {error.problem or error.context}"
        hint = "Indent with spaces." if "'\\t'" in fault else ""
        raise ModelError(Problem("the file", fault, hint=hint, where=where)) from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        rule = f"contains the character {error.character:#x}, which YAML does not allow"
        raise ModelError(Problem("the file", rule, where=f"{file}:{line}")) from None
    except _TooManyError as error:
        rule, line = error.args
        raise ModelError(Problem("the file", rule, where=f"{file}:{line + 1}")) from None
    except RecursionError:
        raise ModelError(Problem("the file", "is nested too deeply", where=str(file))) from None


def _composed(text: str) -> yaml.Node | None:
    """Compose the nodes of YAML text; errors are those of PyYAML's parser, which are clearer."""
    if CParser is not None:
        try:
            return yaml.compose(text, Loader=_FastLoader)
        except (yaml.YAMLError, UnicodeError):
            pass
    return yaml.compose(text, Loader=_Loader)


def _whole(text: str) -> int | float:
    """Convert text to an integer; thousands of digits give infinity, which is rejected later."""
    if text.startswith(("0o", "0x")):
        return int(text, 0)
    return int(text) if len(text) < 400 else float(text)


_NUMBERS = {_TAG + "int", _TAG + "float"}
#: Conversion of a scalar by its tag; any other scalar is text.
_SCALARS: dict[str, Callable[[str], Any]] = {
    _TAG + "int": _whole,
    _TAG + "float": lambda text: float(text.lower().replace(".inf", "inf").replace(".nan", "nan")),
    _TAG + "bool": lambda text: text.lower() == "true",
    _TAG + "null": lambda text: None,
}
_TAGS = {*_SCALARS, *(_TAG + name for name in ("str", "seq", "map", "merge"))}


@dataclass(frozen=True)
class Change:
    """A value at a key path of a file."""

    origin: str  # the option with its value, in place of the line of the file in messages
    path: Path
    value: Any  # plain value in place of the one of the file


def change_of(option: str, text: str) -> Change:
    """Return the change of an option ``PATH=VALUE``, the value in YAML, or raise InputError."""
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
    ModelError if a path leads to an entry that cannot exist.
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
