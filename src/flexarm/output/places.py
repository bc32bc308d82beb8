"""Where output goes: paths refused before the work, files that appear complete or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Collection
from difflib import get_close_matches
from pathlib import Path

from flexarm.arguments import check_path
from flexarm.errors import InputError, Problem, shown

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


def write_whole(path: AnyPath, write: Callable[[Path], None]) -> None:
    """Let ``write`` fill a file beside ``path`` and put it in place in one step.

    Nobody ever reads half of it, and where writing fails an older file stays as it was.

    Raises:
        InputError: the disk is full, the folder has gone, or the like.
    """
    target = Path(os.path.realpath(path))  # replace what a link points to, not the link
    beside = target.with_name(f".{os.urandom(8).hex()}.tmp")
    try:
        try:
            write(beside)
            if target.exists():
                shutil.copymode(target, beside)
            os.replace(beside, target)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        reason = f"not: {error.strerror or error}"
        raise InputError(Problem(str(path), "the file", "be writable", reason)) from None


def write_text(text: str, path: AnyPath) -> None:
    """Write a text file in UTF-8, whole or not at all."""
    write_whole(path, lambda beside: _write_lines(beside, text))


def _write_lines(path: Path, text: str) -> None:
    with open(path, "w", encoding="utf-8", newline="\n") as stream:
        stream.write(text)


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
    probe = folder / f".{os.urandom(8).hex()}.tmp"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with open(probe, "xb"):
            pass
        probe.unlink()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        return f"{reason}: {str(folder)!r}."
    return ""
