"""Paths of output files: checked before the work, written whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Collection, Iterable
from difflib import get_close_matches
from pathlib import Path

from flexarm.arguments import check_path
from flexarm.errors import InputError, Problem, shown
from flexarm.replace_file import replace_file

AnyPath = str | os.PathLike[str]


def check_place(where: str, name: str, path: AnyPath, suffixes: Collection[str]) -> Path:
    """Return ``path`` if a file can be written there; missing folders are made.

    Args:
        where: the call or command that was given the path, for the message.
        name: its argument.
        path: the file to be.
        suffixes: what the file name may end in, in lower case, such as ``(".nc", ".csv")``.

    Raises:
        InputError: unknown suffix, a folder or device of that name, no folder to be had, no
            permission.
    """
    place = check_path(where, name, path)
    problem = _suffix_problem(where, name, place, suffixes) or _place_problem(where, name, place)
    if problem:
        raise InputError(problem)
    return place


def check_folder(where: str, name: str, path: AnyPath) -> Path:
    """Return the folder ``path``, made if missing, if files can be written in it.

    Raises:
        InputError: it is a file, cannot be made, or gives no permission.
    """
    folder = Path(path)
    reason = _unwritable(folder)
    if reason:
        raise InputError(Problem(where, name, "be a folder to write in", shown(str(path)), reason))
    return folder


def write_whole(path: AnyPath, parts: Iterable[bytes | memoryview]) -> None:
    """Write a file of the given parts, whole or not at all; see `replace_file`.

    Raises:
        InputError: if the disk is full, the folder has gone, or the like.
    """
    try:
        replace_file(path, parts)
    except OSError as error:
        reason = f"not: {error.strerror or error}"
        hint = "The older file is unchanged." if os.path.lexists(path) else ""
        raise InputError(Problem(str(path), "the file", "be writable", reason, hint)) from None


def write_text(text: str, path: AnyPath) -> None:
    """Write a text file in UTF-8, whole or not at all."""
    write_whole(path, [text.encode()])


def _suffix_problem(
    where: str, name: str, place: Path, suffixes: Collection[str]
) -> Problem | None:
    suffix = place.suffix.lower()
    if suffix in suffixes:
        return None
    *others, last = suffixes
    rule = f"end in {', '.join(others)} or {last}" if others else f"end in {last}"
    near = get_close_matches(suffix, suffixes, n=1)
    hint = f"Did you mean {str(place.with_suffix(near[0]))!r}?" if near else ""
    return Problem(where, name, rule, shown(str(place)), hint)


def _place_problem(where: str, name: str, place: Path) -> Problem | None:
    value = shown(str(place))
    try:
        if place.is_dir():
            return Problem(where, name, "name a file", f"the folder {value}")
        if place.exists() and not place.is_file():
            return Problem(where, name, "name an ordinary file", value)
        if place.exists() and not os.access(place, os.W_OK):
            return Problem(
                where, name, "name a writable file", f"{value}, which is write-protected"
            )
        reason = _unwritable(Path(os.path.realpath(place)).parent)
    except (OSError, ValueError) as error:  # ValueError: a null character
        told = getattr(error, "strerror", None) or str(error)
        return Problem(where, name, "be a path", value, f"{told}.".capitalize())
    rule = "lie in a folder that can be written in"
    return Problem(where, name, rule, value, reason) if reason else None


def _unwritable(folder: Path) -> str:
    """Make the folder and a file in it; return why that failed, as a sentence, or nothing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        return f"{reason}: {str(folder)!r}."
    return ""
