"""Paths of output files: checked in advance, and written completely or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Collection, Iterable
from difflib import get_close_matches
from pathlib import Path

from flexarm.base.arguments import check_path
from flexarm.base.errors import InputError, Problem, shown
from flexarm.base.writing.replace_file import replace_file

AnyPath = str | os.PathLike[str]


def check_place(name: str, path: AnyPath, suffixes: Collection[str]) -> Path:
    """Return ``path`` if a file can be written there; create missing folders.

    The allowed suffixes of its name are in lower case, such as ``(".nc", ".csv")``.
    """
    place = check_path(name, path)
    problem = _suffix_problem(name, place, suffixes) or _place_problem(name, place)
    if problem:
        raise InputError(problem)
    return place


def check_folder(name: str, path: AnyPath) -> Path:
    """Return the folder ``path`` if files can be written in it; create it if missing.

    Raises:
        InputError: if it is a file, cannot be created, or is not writable.
    """
    folder = Path(path)
    reason = _unwritable(folder)
    if reason:
        raise InputError(Problem(name, "be a writable folder", shown(str(path)), reason))
    return folder


def write_whole(path: AnyPath, parts: Iterable[bytes | memoryview]) -> None:
    """Write a file from parts, completely or not at all, and create missing folders."""
    try:
        Path(os.path.realpath(path)).parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, parts)
    except (OSError, ValueError) as error:  # ValueError: a null character or surrogate in the path
        rule = f"could not be written: {getattr(error, 'strerror', None) or error}"
        hint = "The older file is unchanged." if os.path.lexists(path) else ""
        raise InputError(Problem("the file", rule, hint=hint, where=str(path))) from None


def write_text(text: str, path: AnyPath) -> None:
    """Write a text file in UTF-8, completely or not at all."""
    write_whole(path, [text.encode()])


def _suffix_problem(name: str, place: Path, suffixes: Collection[str]) -> Problem | None:
    suffix = place.suffix.lower()
    if suffix in suffixes:
        return None
    *others, last = suffixes
    rule = f"end in {', '.join(others)} or {last}" if others else f"end in {last}"
    near = get_close_matches(suffix, suffixes, n=1)
    hint = f"Did you mean {str(place.with_suffix(near[0]))!r}?" if near else ""
    return Problem(name, rule, shown(str(place)), hint)


def _place_problem(name: str, place: Path) -> Problem | None:
    value = shown(str(place))
    try:
        if place.is_dir():
            return Problem(name, "be a file", f"the folder {value}")
        if place.exists() and not place.is_file():
            return Problem(name, "be an ordinary file", value)
        if place.exists() and not os.access(place, os.W_OK):
            return Problem(name, f"{value} is write-protected")
        reason = _unwritable(Path(os.path.realpath(place)).parent)
    except (OSError, ValueError) as error:  # ValueError: a null character
        reason = getattr(error, "strerror", None) or str(error)
        return Problem(name, "be a path", value, f"{reason}.".capitalize())
    return Problem(name, "be in a writable folder", value, reason) if reason else None


def _unwritable(folder: Path) -> str:
    """Create the folder and a test file; return the reason of a failure, or an empty text."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        return f"{reason}: {str(folder)!r}."
    return ""
