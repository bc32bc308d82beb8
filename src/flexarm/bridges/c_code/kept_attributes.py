"""Attributes that a controller keeps between samples, to compare them over symbols."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from enum import Enum
from types import ModuleType
from typing import Any

import numpy as np

from flexarm.bridges.symbolic.scalars import Scalar, SymbolError
from flexarm.control.analysis.linear_controller import Memory


def kept_attributes(owner: Any, packages: tuple[str, ...]) -> dict[str, Any]:
    """Return what an object keeps, by the paths of its attributes.

    Symbols are replaced by a marker. Of the package's own objects, only those of classes in
    ``packages`` are searched.
    """
    found: dict[str, Any] = {}
    _add(owner, "", packages, found, set())
    return found


def _add(
    owner: Any, prefix: str, packages: tuple[str, ...], found: dict[str, Any], seen: set[int]
) -> None:
    seen.add(id(owner))
    for name in _names(owner):
        value = getattr(owner, name, None)
        if not _is_searched(value, packages):
            found[prefix + name] = _shown(value)
        elif id(value) not in seen:
            _add(value, f"{prefix}{name}.", packages, found, seen)


def _names(owner: Any) -> list[str]:
    slots = [one for kind in type(owner).__mro__ for one in getattr(kind, "__slots__", ())]
    return [*getattr(owner, "__dict__", ()), *slots]


def _is_searched(value: Any, packages: tuple[str, ...]) -> bool:
    """Return whether the attributes of a value are compared instead of the value."""
    if isinstance(value, type | ModuleType | Enum | Scalar | np.ndarray) or callable(value):
        return False
    module = type(value).__module__
    return bool(_names(value)) and (module.startswith(packages) or module[:7] != "flexarm")


def _shown(value: Any) -> Any:
    """Return a value that is equal for equal values, symbols apart."""
    if isinstance(value, Scalar):
        return "symbol"
    if isinstance(value, np.ndarray | list | tuple | deque):
        return (np.shape(value) if isinstance(value, np.ndarray) else len(value)), [
            _shown(one) for one in (value.flat if isinstance(value, np.ndarray) else value)
        ]
    if isinstance(value, Mapping):
        return [(repr(key), _shown(one)) for key, one in value.items()]
    if isinstance(value, set | frozenset):
        return sorted(map(repr, value))
    if isinstance(value, np.generic):
        return repr(value.item())
    if value is None or isinstance(value, bool | int | float | complex | str | bytes | Enum):
        return repr(value)
    return getattr(value, "__qualname__", type(value).__qualname__)


def check_kept(
    before: Any, after: list[Any], declared: set[str], packages: tuple[str, ...]
) -> None:
    """Raise if an attribute that the memory does not declare changes.

    Args:
        before: the controller before an update; None for the first sample.
        after: the controller after the update, along each path through its conditions.
        declared: paths of the memory.
        packages: see `kept_attributes`.
    """
    first, *others = (kept_attributes(one, packages) for one in after)
    pairs = [(other, "in a condition") for other in others]
    if before is not None:
        pairs.append((kept_attributes(before, packages), "between samples"))
    for other, when in pairs:
        for path in dict.fromkeys([*first, *other]):
            if path not in declared and first.get(path) != other.get(path):
                raise SymbolError(f"changes {path!r} {when}, but its memory does not declare it")


def check_sizes(memories: list[Memory]) -> None:
    """Raise if the sizes of the attributes in a memory differ."""
    if any(one.shapes != memories[0].shapes for one in memories):
        raise SymbolError("changes the size of its memory")
