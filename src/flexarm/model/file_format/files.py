"""Arm, scenario and study files: strict reading with the line of each problem, writing, schemas."""

from __future__ import annotations

import gc
import os
import re
import select
import stat
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any, TypeVar, get_args

from pydantic import ValidationError

from flexarm.base.arguments import check_path
from flexarm.base.errors import ModelError, Problem, public_call, shown
from flexarm.base.writing.places import AnyPath, write_text
from flexarm.model.arm.links import MATERIALS, Material
from flexarm.model.arm.spec import ArmSpec
from flexarm.model.checks import Record, faults_of
from flexarm.model.file_format.yaml_text import Change, Document, changed, parse, to_yaml
from flexarm.model.hardware import Hardware
from flexarm.model.scenarios.scenario import Scenario
from flexarm.model.scenarios.study import StudySpec
from flexarm.model.units import QUANTITY_PATTERN, unit_of
from flexarm.model.wording import Path, suggestion


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
        # A kind with one value selects the class of a union, so a file must contain it.
        kind = getattr(value, "kind", None)
        unions = "kind" in fields and get_args(fields["kind"].annotation) == (kind,)
        return {"kind": kind, **reported} if unions else reported
    if isinstance(value, dict):
        return {name: content_of(part) for name, part in value.items()}
    return [content_of(part) for part in value] if isinstance(value, tuple) else value


FILE_VERSION = 1

_MOST_BYTES = 100_000_000  # no description is longer; limits reading from devices

R = TypeVar("R", bound=Record)


def load_document(path: AnyPath) -> Document:
    """Read a YAML file, once, as of a pipe; ModelError if it cannot be read or is not a mapping."""
    file = FilePath(path)
    return _parsed(file, _text(file))


def load_arm_spec(path: AnyPath | Document) -> ArmSpec:
    """Read the arm of an arm, scenario or study file; ModelError lists all problems with lines."""
    problems: list[Problem] = []
    document = path if isinstance(path, Document) else load_document(path)
    holder = _holder_of_arm(document, problems, ())
    spec = None
    if holder is not None:
        spec = _checked(ArmSpec, holder.value["arm"], ("arm",), holder.where, problems)
    if spec is None or problems:
        raise ModelError(*_in_order(document.file, problems))
    return spec


def load_hardware(path: AnyPath) -> Hardware:
    """Read the hardware of a file; ModelError lists all problems with lines.

    The file is a scenario or a study, or has no other key.
    """
    document = load_document(path)
    problems = [*document.problems, *_head_problems(document, None)]
    hardware = None
    if "hardware" not in document.value:
        problems.append(Problem("hardware", "is missing", where=document.where(())))
    else:
        content = document.value["hardware"]
        hardware = _checked(Hardware, content, ("hardware",), document.where, problems)
    if hardware is None or problems:
        raise ModelError(*_in_order(document.file, problems))
    return hardware


@public_call
def load_scenario(path: AnyPath) -> Scenario:
    """Read a scenario file; its `arm` may be the path of another file, relative to the scenario.

    Raises:
        ModelError: if the file or its arm file is invalid; lists all problems with lines.
    """
    return locate_scenario(check_path("path", path))[0]


def locate_scenario(path: AnyPath | Document) -> tuple[Scenario, Callable[[Path], str]]:
    """Read a scenario file; return it with a function from key path to ``file:line``."""
    return _located(Scenario, path)


def locate_study(path: AnyPath | Document) -> tuple[StudySpec, Callable[[Path], str]]:
    """Read a study file; return it with a function from key path to ``file:line``."""
    return _located(StudySpec, path)


@contextmanager
def _uncollected() -> Iterator[None]:
    """Pause the garbage collector, which would visit the nodes of a long table repeatedly."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


@_uncollected()
def _located(kind: type[R], path: AnyPath | Document) -> tuple[R, Callable[[Path], str]]:
    document = path if isinstance(path, Document) else load_document(path)
    if kind in _OTHERS:
        _refuse_other_kind(document, kind)
    problems: list[Problem] = []
    holder = _holder_of_arm(document, problems, (), kind)
    content = {key: document.value[key] for key in kind.model_fields if key in document.value}
    content["arm"] = holder.value["arm"] if holder else None

    def where(place: Path) -> str:
        return (holder if holder and place[:1] == ("arm",) else document).where(place)

    reported = () if holder else ("arm",)
    record = _checked(kind, content, (), where, problems, reported)
    if record is None or problems:
        raise ModelError(*_in_order(document.file, problems))
    return record, where


def describes_arm_only(document: Document) -> bool:
    """Return whether a file has no other key than the arm, so that it cannot be simulated."""
    return set(document.value) <= {"flexarm", "arm"}


def _refuse_other_kind(document: Document, kind: type[Record]) -> None:
    """Raise if the file is of another kind: an arm, or a study for a scenario or vice versa."""
    if describes_arm_only(document) and "arm" in document.value:
        rule = f"has an arm only, so it is not a {_WORDS[kind][0]}"
        hint = "`flexarm check`, `modes` and `linearize` read an arm alone."
        if kind is Scenario:
            hint = f"Add `run: {{duration: 2}}` to simulate it. {hint}"
        raise ModelError(Problem("the file", rule, hint=hint, where=document.where(())))
    keys, other_fields = document.value.keys(), _OTHERS[kind].model_fields.keys()
    own = keys & (kind.model_fields.keys() - other_fields)
    others = keys & (other_fields - kind.model_fields.keys())
    if kind is StudySpec:
        others |= keys & {"run"}  # the only key of its own in a scenario of a free arm
    if own or not others:
        return
    expected, (other, command) = _WORDS[kind][0], _WORDS[_OTHERS[kind]]
    hint = f"Run it with `flexarm {command}`, or with run_{other} in Python."
    place = document.where((min(others),))
    raise ModelError(Problem("the file", f"is a {other}, not a {expected}", hint=hint, where=place))


_OTHERS: dict[type[Record], type[Record]] = {Scenario: StudySpec, StudySpec: Scenario}
_WORDS: dict[Any, Any] = {Scenario: ("scenario", "run"), StudySpec: ("study", "compare")}


def save_arm_spec(spec: ArmSpec, path: AnyPath) -> None:
    """Write an arm file, completely or not at all; InputError if it cannot be written."""
    write_text(file_text(spec), path)


def file_text(record: ArmSpec | Scenario | StudySpec) -> str:
    """Return the YAML text of an arm file, a scenario file or a study file."""
    content = content_of(record)
    parts = {"arm": content} if isinstance(record, ArmSpec) else content
    return to_yaml({"flexarm": FILE_VERSION, **parts})


def load_any(path: AnyPath | Document) -> ArmSpec | Scenario | StudySpec:
    """Read a file of any kind: a study has `drives`, an arm file has no other key than `arm`."""
    document = path if isinstance(path, Document) else load_document(path)
    if "drives" in document.value:
        return locate_study(document)[0]
    if describes_arm_only(document):
        return load_arm_spec(document)
    return locate_scenario(document)[0]


def record_of_bytes(
    raw: bytes, file: AnyPath, arms: Mapping[str, ArmSpec] | None = None
) -> ArmSpec | Scenario | StudySpec:
    """Return the arm, scenario or study of the content of a file.

    It names no other file but those of the ``arms``, by their names.
    """
    text = _decoded(FilePath(file), raw)
    document = _parsed(FilePath(file), text)
    named = document.value.get("arm")
    if isinstance(named, str) and arms and named in arms:
        return load_any(changed(document, [Change(str(file), ("arm",), content_of(arms[named]))]))
    return load_any(_whole(text, file))


def arm_spec_of_text(text: str, file: AnyPath) -> ArmSpec:
    """Return the arm of a text of `file_text` from ``file``; ModelError if it describes none."""
    return load_arm_spec(_whole(text, file))


def scenario_of_text(text: str, file: AnyPath) -> Scenario:
    """Return the scenario of a text of `file_text`; ModelError if it describes none."""
    return locate_scenario(_whole(text, file))[0]


def _whole(text: str, file: AnyPath) -> Document:
    """Return the content of a text that is kept in another file, and names none itself."""
    document = _parsed(FilePath(file), text)
    if isinstance(document.value.get("arm"), str):
        named = shown(document.value["arm"])
        rule = f"refers to another file, {named}; it must describe the arm here"
        raise ModelError(Problem("arm", rule, where=str(file)))
    return document


def _checked(
    kind: type[R],
    value: Any,
    inside: Path,
    where: Callable[[Path], str],
    problems: list[Problem],
    reported: Path = (),
) -> R | None:
    """Return a record of the value at `inside`; add faults other than `reported` to `problems`."""
    try:
        return kind.model_validate(value)
    except ValidationError as error:
        for fault in faults_of(error):
            place = (*inside, *fault.path)
            if not reported or place != reported:
                problem = replace(fault, path=place).problem("the file")
                problems.append(replace(problem, where=where(place)))
        return None


def _holder_of_arm(
    document: Document,
    problems: list[Problem],
    came_from: tuple[str, ...],
    kind: type[Record] | None = None,
) -> Document | None:
    """Return the document that contains the arm, following ``arm: other.yaml``, or None."""
    problems += document.problems
    problems += _head_problems(document, kind)
    if "arm" not in document.value:
        problems.append(Problem("arm", "is missing", where=document.where(())))
        return None
    named = document.value["arm"]
    if not isinstance(named, str):
        return document
    here = document.where(("arm",))
    came_from = (*came_from, _real(document.file))
    other = document.file.parent / named
    if _real(other) in came_from:
        problems.append(Problem("arm", "refers to itself through a circle of files", where=here))
        return None
    try:
        text = _text(other)
        if not _ARM_FILE.search(text):
            # The author of a scenario may have fewer rights than this process: do not quote the
            # content of files that were not written for flexarm.
            rule = f"names {shown(named)}, which is not an arm file: it has no key `flexarm`"
            problems.append(Problem("arm", rule, where=here))
            return None
        inside = [c for c in document.changes if c.path[0] == "arm" and len(c.path) > 1]
        return _holder_of_arm(changed(_parsed(other, text), inside), problems, came_from)
    except ModelError as error:
        reported = f"It is named in {here}."
        problems += [replace(p, hint=f"{p.hint} {reported}".strip()) for p in error.problems]
        return None


def _head_problems(document: Document, kind: type[Record] | None) -> list[Problem]:
    """Return the problems of the version and of top-level keys; without ``kind``, of any kind."""
    if kind is None:
        kind = StudySpec if "drives" in document.value else Scenario
    keys = ("flexarm", *kind.model_fields)
    problems = [
        Problem(key, "is not a known key", hint=suggestion(key, keys), where=document.where((key,)))
        for key in document.value
        if key not in keys
    ]
    where = document.where(("flexarm",))
    if "flexarm" not in document.value:
        hint = f"Start the file with `flexarm: {FILE_VERSION}`, the version of its format."
        return [Problem("flexarm", "is missing", hint=hint, where=where), *problems]
    version = document.value["flexarm"]
    if version != FILE_VERSION or not isinstance(version, int) or isinstance(version, bool):
        newer = isinstance(version, int) and version > FILE_VERSION
        hint = "The file is for a newer flexarm: upgrade flexarm." if newer else ""
        rule = f"be {FILE_VERSION} (the version of the file format)"
        return [Problem("flexarm", rule, shown(version), hint, where=where), *problems]
    return problems


def _in_order(first: FilePath, problems: list[Problem]) -> list[Problem]:
    """Sort problems by file and line; those of the file `first` come first."""

    def place(problem: Problem) -> tuple[int, int]:
        file, _, line = problem.where.rpartition(":")
        return files.index(file), int(line) if line.isdigit() else 0

    named = [problem.where.rpartition(":")[0] for problem in problems]
    files = list(dict.fromkeys([str(first), *named]))
    return sorted(problems, key=place)


#: A line that every arm file has, even if it has syntax errors further on. Blank lines are not
#: part of the match, because the time would increase with a power of their number.
_ARM_FILE = re.compile(r"""^[ \t]*(?:\{\s*)?["']?flexarm["']?\s*:""", re.MULTILINE)


def _real(file: FilePath) -> str:
    """Return the path with links resolved, or the path itself if no file can have it."""
    try:
        return os.path.realpath(file)
    except ValueError:
        return str(file)


def _text(file: FilePath) -> str:
    """Return the text of a file in UTF-8."""
    hint = ""
    try:
        raw = read_bytes(file, _MOST_BYTES + 1)
    except FileNotFoundError:
        rule, hint = "does not exist", _near(file)
    except IsADirectoryError:
        rule = "is a directory"
    except (OSError, ValueError) as error:  # ValueError: a path with a null character
        rule = f"cannot be read: {getattr(error, 'strerror', None) or error}"
    else:
        return _decoded(file, raw)
    raise ModelError(Problem("the file", rule, hint=hint, where=str(file)))


def _decoded(file: FilePath, raw: bytes) -> str:
    """Return the text of the content of a file."""
    if len(raw) > _MOST_BYTES:
        rule = f"is larger than {_MOST_BYTES // 10**6} MB"
        raise ModelError(Problem("the file", rule, where=str(file)))
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        where = f"{file}:{line}"
        raise ModelError(Problem("the file", "is not text in UTF-8", where=where)) from None


def _parsed(file: FilePath, text: str) -> Document:
    """Return the content of a YAML file; raise if it is not a mapping."""
    document = parse(file, text)
    if not isinstance(document.value, dict):
        rule, value = "be a mapping of keys to values", shown(document.value)
        raise ModelError(Problem("the file", rule, value, where=document.where(())))
    return document


def _near(file: FilePath) -> str:
    """Return a sentence with a file name in the same folder that is similar to the missing one."""
    import difflib

    try:
        names = {FilePath(name).stem: name for name in sorted(os.listdir(file.parent))}
    except (OSError, ValueError):
        return ""
    near = difflib.get_close_matches(file.stem, names, n=1)
    return f"Did you mean {str(file.with_name(names[near[0]]))!r}?" if near else ""


#: Time limit for a writer to open a named pipe (s).
_WAIT_FOR_WRITER = 5.0
#: Time limit for the first content of a pipe (s); its writer may have to compute before.
_WAIT_FOR_CONTENT = 60.0
_AT_ONCE = 1 << 20


def read_bytes(file: FilePath, most: int) -> bytes:
    """Return the content of a file, a pipe or a terminal, at most ``most`` bytes.

    OSError if it cannot be read, or is a pipe without a writer; ValueError for an impossible path.
    """
    flags = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_NONBLOCK", 0)
    descriptor = os.open(file, flags)
    try:
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError
        return _read(descriptor, most, stat.S_ISFIFO(mode))
    finally:
        os.close(descriptor)


def _read(descriptor: int, most: int, pipe: bool) -> bytes:
    parts: list[bytes] = []
    length = 0
    start = time.monotonic()
    while length < most:
        try:
            part = os.read(descriptor, min(_AT_ONCE, most - length))
        except BlockingIOError:  # the writer has not written more yet
            limit = start + _WAIT_FOR_CONTENT - time.monotonic()
            wait = max(limit, 0.0) if pipe and not parts else None
            if not select.select([descriptor], [], [], wait)[0]:
                reason = f"nothing was written into the pipe for {_WAIT_FOR_CONTENT:g} s"
                raise OSError(reason) from None
            continue
        if part:
            parts.append(part)
            length += len(part)
        elif not pipe or parts:
            break
        elif time.monotonic() > start + _WAIT_FOR_WRITER:
            raise OSError("the pipe is empty, and nobody writes into it")
        else:
            time.sleep(0.02)
    return b"".join(parts)


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
