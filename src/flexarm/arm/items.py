"""Links and joints of an arm as sequences, which still convert to the numbers that they were."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeVar, cast

import numpy as np

from flexarm.base.errors import warn_deprecated

T = TypeVar("T")


def items_of(values: Iterable[T], name: str, count: int) -> Sequence[T]:
    """Return a sequence of ``values`` that can be used as ``count``, the former ``arm.name``."""
    return cast("Sequence[T]", _Items(tuple(values), name, count))


class _Items(dict[int, Any]):
    """Sequence that behaves like a number, with a DeprecationWarning, where one is expected.

    NumPy takes each sequence, also one with ``__index__``, for a shape, but a `dict` for a scalar.
    Therefore a subclass of `dict` is the only one with which the former ``np.zeros(arm.joints)``
    works. When the deprecation ends, a tuple replaces it.
    """

    __array_ufunc__ = None  # arrays leave arithmetic to this class

    def __init__(self, values: tuple[Any, ...], name: str, count: int) -> None:
        super().__init__(enumerate(values))
        self._values, self._name, self._count = values, name, count
        # `plain` and checks of lists read it, as they read that of an array.
        self.index, self.count, self.tolist = values.index, values.count, lambda: [*values]

    def __getitem__(self, index: Any) -> Any:
        return self._values[index]

    def __iter__(self) -> Iterator[Any]:
        return iter(self._values)

    def __reversed__(self) -> Iterator[Any]:
        return iter(self._values[::-1])

    def __contains__(self, value: object) -> bool:
        return value in self._values

    def __eq__(self, other: object) -> bool:
        return self._values == tuple(other) if isinstance(other, Iterable) else int(self) == other

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(self._values)

    def __repr__(self) -> str:
        return repr(self._values)

    def __reduce__(self) -> tuple[Any, ...]:
        return _Items, (self._values, self._name, self._count)

    def __index__(self) -> int:
        new = f"arm.n_{self._name}, or len(arm.{self._name}) with fixed joints"
        warn_deprecated(f"arm.{self._name} as a number", new, "0.3")
        return self._count

    __int__ = __index__

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Any:
        return np.array(int(self), dtype)

    def _refuse(self, *_: object, **__: object) -> Any:
        raise TypeError("An arm cannot be changed; use flexarm.Arm(links=[...], joints=[...])")

    __setitem__ = __delitem__ = __ior__ = update = pop = popitem = clear = setdefault = _refuse


def _of_number(function: Callable[[Any, Any], Any], reflected: bool = False) -> Any:
    if reflected:
        return lambda items, other: function(other, int(items))
    return lambda items, other: function(int(items), other)


def _after(items: Any, other: Any) -> Any:
    """Return a list of both; the sum with a number or an array for the old use."""
    return [*items, *other] if isinstance(other, list | tuple | _Items) else int(items) + other


def _before(items: Any, other: Any) -> Any:
    return [*other, *items] if isinstance(other, list | tuple | _Items) else other + int(items)


for _name in ("add", "sub", "mul", "truediv", "floordiv", "mod", "pow", "lt", "le", "gt", "ge"):
    setattr(_Items, f"__{_name}__", _of_number(getattr(operator, _name)))
    if _name not in ("lt", "le", "gt", "ge"):
        setattr(_Items, f"__r{_name}__", _of_number(getattr(operator, _name), reflected=True))
setattr(_Items, "__add__", _after)  # noqa: B010
setattr(_Items, "__radd__", _before)  # noqa: B010
Sequence.register(_Items)
