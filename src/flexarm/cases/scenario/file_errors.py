"""Conversion of problems in calls to problems in the file that caused them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from flexarm.base.errors import InputError
from flexarm.model.wording import Path, path_of

#: Function that returns the location ``file:line`` of a key path.
Where = Callable[[Path], str]


@contextmanager
def problems_at(place: Where, key: str, names: dict[str, str] | None = None) -> Iterator[None]:
    """Report problems with their file location and key path.

    Args:
        key: key that contains the values; empty if problems name it themselves.
        names: keys of the file by argument, if the names differ; empty for ``key`` itself. A name
            that starts with a dot is a key at the top of the file.
    """
    try:
        yield
    except InputError as error:
        placed = []
        for problem in error.problems:
            reported = (names or {}).get(problem.name, problem.name)
            name = ".".join(filter(None, (key or problem.where, reported)))
            name = reported[1:] if reported.startswith(".") else name
            placed.append(replace(problem, where=place(path_of(name)), name=name))
        raise InputError(*placed) from None


@contextmanager
def problems_under(key: str) -> Iterator[None]:
    """Prefix the names of problems with the key of the part that they belong to."""
    try:
        yield
    except InputError as error:
        raise InputError(*(replace(p, name=f"{key}.{p.name}") for p in error.problems)) from None
