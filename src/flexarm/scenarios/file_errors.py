"""Problems of calls, told as problems of the file that asked for them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from flexarm.errors import InputError
from flexarm.model.wording import Path, path_of

#: Where a key path stands in its file: ``file:line``.
Where = Callable[[Path], str]


@contextmanager
def told_as(place: Where, key: str, names: dict[str, str] | None = None) -> Iterator[None]:
    """Name problems by the line and the key path that they come from.

    Args:
        key: where the values stand that may be refused; nothing where problems say it themselves.
        names: keys of the file for arguments that are called otherwise.
    """
    try:
        yield
    except InputError as error:
        placed = []
        for problem in error.problems:
            told = (names or {}).get(problem.name, problem.name)
            name = f"{key or problem.where}.{told}"
            placed.append(replace(problem, where=place(path_of(name)), name=name))
        raise InputError(*placed) from None


@contextmanager
def told_inside(key: str) -> Iterator[None]:
    """Name problems of a part by the key that it has in the whole."""
    try:
        yield
    except InputError as error:
        raise InputError(*(replace(p, name=f"{key}.{p.name}") for p in error.problems)) from None
