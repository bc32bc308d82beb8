"""YAML text: reading to plain values with line numbers, and writing of records.

Scalars follow YAML 1.2: ``1e5`` and ``70e9`` are numbers (text in YAML 1.1), ``1:30`` and ``yes``
are text (90 and true in YAML 1.1), ``010`` is ten.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import yaml
from yaml.composer import Composer
from yaml.resolver import Resolver

from flexarm.errors import ModelError, Problem, shown
from flexarm.model.wording import Path, path_text

if TYPE_CHECKING:
    from flexarm.model.changes import Change

#: Parser of libyaml; None if PyYAML was built without it.
CParser: Any = getattr(getattr(yaml, "cyaml", None), "CParser", None)

# Aliases can expand a small file to a huge one; no description needs this many values.
_MOST_VALUES = 5_000_000

_TAG = "tag:yaml.org,2002:"
_RESOLVERS = (
    ("bool", r"true|True|TRUE|false|False|FALSE", "tTfF"),
    ("int", r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", "-+0123456789"),
    (
        "float",
        r"[-+]?((\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|\.(inf|Inf|INF))|\.(nan|NaN|NAN)",
        "-+.0123456789",
    ),
    ("merge", r"<<", "<"),
    ("null", r"~|null|Null|NULL|", "~nN"),
)
_TAGS = {_TAG + name for name in ("str", "seq", "map", *(name for name, _, _ in _RESOLVERS))}


class _Loader(yaml.SafeLoader):
    """Loader of nodes with the scalars of YAML 1.2; constructs no Python objects."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012  (PyYAML's own name and form)


class _FastLoader(Composer, CParser or object, Resolver):  # type: ignore[misc]
    """Loader of the same nodes from the events of libyaml, in a seventh of the time.

    It does not use the composer of ``CParser``, which overflows the stack for deep nesting.
    """

    yaml_implicit_resolvers = _Loader.yaml_implicit_resolvers

    def __init__(self, text: str) -> None:
        CParser.__init__(self, text)
        Composer.__init__(self)
        Resolver.__init__(self)


class _Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    """Dumper without anchors, whose output `_Loader` reads as the same values."""

    yaml_implicit_resolvers = _Loader.yaml_implicit_resolvers

    def ignore_aliases(self, data: Any) -> bool:
        return True


for _name, _pattern, _first in _RESOLVERS:
    _rule = (_TAG + _name, re.compile(f"(?:{_pattern})$"))
    for _letter in [*_first, ""] if _name == "null" else _first:
        _Loader.yaml_implicit_resolvers.setdefault(_letter, []).append(_rule)


def to_yaml(content: dict[str, Any]) -> str:
    """Return YAML text of plain values in block style, innermost collections on one line."""
    return yaml.dump(content, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=100)


Entries = dict[str, tuple[yaml.Node, yaml.Node]]


class _EntriesByNode:
    """Key and value nodes of mappings by key; own keys override merged ones (``<<``).

    They are computed once per mapping, because the time for nested merges would be exponential.
    """

    def __init__(self) -> None:
        self._found: dict[int, Entries] = {}

    def of(self, mapping: yaml.MappingNode) -> Entries:
        """Return the entries of a mapping."""
        if id(mapping) not in self._found:
            self._found[id(mapping)] = self._find(mapping)
        return self._found[id(mapping)]

    def _find(self, mapping: yaml.MappingNode) -> Entries:
        own: Entries = {}
        merged: Entries = {}
        for key, value in mapping.value:
            if key.tag == _TAG + "merge":
                for source in value.value if isinstance(value, yaml.SequenceNode) else [value]:
                    if isinstance(source, yaml.MappingNode):
                        merged = self.of(source) | merged
            elif isinstance(key, yaml.ScalarNode):
                own.setdefault(key.value, (key, value))
        return merged | own


@dataclass(frozen=True)
class Document:
    """A YAML file that was read.

    Attributes:
        file: path of the file, as given by the user.
        value: content of the file as plain Python values.
        problems: problems of the content as YAML that did not prevent reading.
        changes: values that replaced those of the file, of which a later one prevails.
    """

    file: FilePath
    value: Any
    problems: list[Problem]
    _root: yaml.Node = field(repr=False)
    _entries: _EntriesByNode = field(repr=False)
    changes: tuple[Change, ...] = ()

    def where(self, path: Path) -> str:
        """Return ``file:line`` of the value at a path, or of the nearest container of it.

        For a value that was replaced, return the change.
        """
        for change in reversed(self.changes):
            if path[: len(change.path)] == change.path:
                return change.told
        node, line = self._root, self._root.start_mark.line
        for part in path:
            if isinstance(node, yaml.MappingNode):
                found = self._entries.of(node).get(str(part))
                if found is None:
                    break
                line, node = found[0].start_mark.line, found[1]
            elif isinstance(node, yaml.SequenceNode) and isinstance(part, int):
                node = node.value[part]
                line = node.start_mark.line
            else:
                break
        return f"{self.file}:{line + 1}"


def parse(file: FilePath, text: str) -> Document:
    """Read YAML text.

    Args:
        file: path of the file, for messages.
        text: one YAML document.

    Raises:
        ModelError: if the text is not YAML, is empty, or contains too many values.
    """
    try:
        root = _composed(text)
        if root is None:
            raise ModelError(Problem(str(file), "the file", "hold a mapping", "empty"))
        entries = _EntriesByNode()
        reader = _Reader(file, entries)
        value = reader.value(root, ())
    except yaml.MarkedYAMLError as error:
        raise ModelError(_syntax_problem(file, error)) from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        value = f"broken by the character {error.character:#x}"
        raise ModelError(Problem(f"{file}:{line}", "the file", "be text", value)) from None
    except RecursionError:
        rule = "be nested a few levels deep"
        raise ModelError(Problem(str(file), "the file", rule, "nested too deeply")) from None
    return Document(file, value, reader.problems, root, entries)


def _composed(text: str) -> yaml.Node | None:
    """Compose the nodes of YAML text.

    Raises:
        yaml.YAMLError: if it is not YAML; by PyYAML's own parser, whose messages are clearer.
    """
    if CParser is not None:
        try:
            return yaml.compose(text, Loader=_FastLoader)
        except (yaml.YAMLError, UnicodeError):
            pass
    return yaml.compose(text, Loader=_Loader)


def _syntax_problem(file: FilePath, error: yaml.MarkedYAMLError) -> Problem:
    """Convert PyYAML's syntax error to a problem."""
    mark = error.problem_mark or error.context_mark
    where = f"{file}:{mark.line + 1}" if mark else str(file)
    value = f"broken: {error.problem or error.context}"
    hint = "Indent with spaces." if "'\\t'" in value else ""
    return Problem(where, "the file", "be YAML", value, hint)


class _Reader:
    """Conversion of nodes to plain values, once per node for any number of aliases of it."""

    def __init__(self, file: FilePath, entries: _EntriesByNode) -> None:
        self.problems: list[Problem] = []
        self._entries = entries
        self._file = file
        self._done: dict[int, tuple[Any, int]] = {}
        self._open: set[int] = set()

    def value(self, node: yaml.Node, path: Path) -> Any:
        """Return the plain value of a node."""
        return self._sized(node, path)[0]

    def _sized(self, node: yaml.Node, path: Path) -> tuple[Any, int]:
        """Return the value, and the number of values in it with its aliases expanded."""
        if id(node) in self._open:
            self._report(node, path, "not contain itself", "an alias of what it is in")
            return None, 1
        if id(node) not in self._done:
            self._open.add(id(node))
            self._done[id(node)] = self._build(node, path)
            self._open.remove(id(node))
        value, size = self._done[id(node)]
        if size > _MOST_VALUES:
            rule = f"hold at most {_MOST_VALUES} values once its aliases are written out"
            raise ModelError(Problem(str(self._file), "the file", rule, "larger"))
        return value, size

    def _build(self, node: yaml.Node, path: Path) -> tuple[Any, int]:
        if node.tag not in _TAGS:
            tag = node.tag.removeprefix(_TAG)
            self._report(node, path, "be plain YAML", f"tagged {shown(tag)}")
        if isinstance(node, yaml.SequenceNode):
            values, size = [], 1
            for i, item in enumerate(node.value):
                # Numbers of long tables need neither a path nor protection against aliases.
                if item.tag in _NUMBERS and isinstance(item, yaml.ScalarNode):
                    value, more = self._scalar(item), 1
                else:
                    value, more = self._sized(item, (*path, i))
                values.append(value)
                size += more
            return values, size
        if isinstance(node, yaml.MappingNode):
            self._check_keys(node, path)
            entries = {
                key: self._sized(value, (*path, key))
                for key, (_, value) in self._entries.of(node).items()
            }
            size = 1 + sum(size for _, size in entries.values())
            return {key: value for key, (value, _) in entries.items()}, size
        return self._scalar(node), 1

    def _check_keys(self, node: yaml.MappingNode, path: Path) -> None:
        """Report duplicate keys and keys that are not scalars."""
        lines: dict[str, int] = {}
        for key, _ in node.value:
            line = key.start_mark.line + 1
            if not isinstance(key, yaml.ScalarNode):
                self._report(key, path, "have words for keys", "one with a list or mapping as key")
            elif key.value in lines:
                value = f"given again (first in line {lines[key.value]})"
                self._report(key, (*path, key.value), "be given once", value)
            else:
                lines[key.value] = line

    def _scalar(self, node: yaml.Node) -> Any:
        """Return the number, boolean, None or text of a scalar."""
        text: str = node.value
        if node.tag in _NUMBERS:
            return _NUMBERS[node.tag](text)
        match node.tag.removeprefix(_TAG):
            case "null":
                return None
            case "bool":
                return text.lower() == "true"
            case _:
                return text

    def _report(self, node: yaml.Node, path: Path, rule: str, value: str) -> None:
        where = f"{self._file}:{node.start_mark.line + 1}"
        self.problems.append(Problem(where, path_text(path) or "the file", rule, value))


def _whole(text: str) -> int | float:
    """Convert text to an integer; thousands of digits give infinity, which is rejected later."""
    if text.startswith(("0o", "0x")):
        return int(text, 0)
    return int(text) if len(text) < 400 else float(text)


def _real(text: str) -> float:
    """Convert text with a point or an exponent, ``.inf`` or ``.nan``, to a number."""
    return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))


_NUMBERS: dict[str, Callable[[str], float]] = {_TAG + "int": _whole, _TAG + "float": _real}
