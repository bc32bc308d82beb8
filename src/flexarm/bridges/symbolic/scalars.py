"""Scalars of CasADi and JAX for use in NumPy arrays and the source of the kernels."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextvars import ContextVar
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

#: Array of objects: `Scalar` objects and numbers.
Objects = NDArray[Any]


def _of_numbers(method: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Delegate operations with arrays to NumPy, which applies them to each entry."""

    def operation(self: Any, other: Any) -> Any:
        return NotImplemented if isinstance(other, np.ndarray) else method(self, other)

    return operation


class SymbolError(TypeError):
    """Error of code that cannot be evaluated over symbols."""


#: Function that chooses the truth value of a symbol, while code with conditions is evaluated.
choose: ContextVar[Callable[[Any], bool] | None] = ContextVar("choose", default=None)


class Scalar:
    """Scalar of CasADi or JAX as an entry of an array of objects.

    The wrapper is necessary because NumPy treats the libraries' own scalars as arrays. Sums with 0
    and products with 0 and 1, which are frequent in padded modes, are simplified.

    Args:
        value: the scalar.
        library: module with its functions, ``casadi`` or ``jax.numpy``.
    """

    __slots__ = ("library", "value")
    symbolic: ClassVar[bool] = True

    def __init__(self, value: Any, library: Any) -> None:
        self.value = value
        self.library = library

    def __deepcopy__(self, memo: dict[int, Any]) -> Scalar:
        return self  # it does not change, and modules cannot be copied

    def _new(self, value: Any) -> Scalar:
        return Scalar(value, self.library)

    def __neg__(self) -> Scalar:
        return self._new(-self.value)

    @_of_numbers
    def __add__(self, other: Any) -> Scalar:
        return self if _is(other, 0.0) else self._new(self.value + plain(other))

    __radd__ = __add__

    @_of_numbers
    def __sub__(self, other: Any) -> Scalar:
        return self if _is(other, 0.0) else self._new(self.value - plain(other))

    @_of_numbers
    def __rsub__(self, other: Any) -> Scalar:
        return -self if _is(other, 0.0) else self._new(plain(other) - self.value)

    @_of_numbers
    def __mul__(self, other: Any) -> Any:
        if _is(other, 0.0):
            return 0.0
        return self if _is(other, 1.0) else self._new(self.value * plain(other))

    __rmul__ = __mul__

    @_of_numbers
    def __truediv__(self, other: Any) -> Scalar:
        return self if _is(other, 1.0) else self._new(self.value / plain(other))

    @_of_numbers
    def __rtruediv__(self, other: Any) -> Any:
        return 0.0 if _is(other, 0.0) else self._new(plain(other) / self.value)

    def __pow__(self, exponent: float) -> Any:
        if exponent == 0.0:
            return 1.0
        return self if exponent == 1.0 else self._new(self.value**exponent)

    def __abs__(self) -> Scalar:
        return self._new(self.library.fabs(self.value))  # abs needs CasADi 3.8

    @_of_numbers
    def __lt__(self, other: Any) -> Scalar:
        return self._new(self.value < plain(other))

    @_of_numbers
    def __le__(self, other: Any) -> Scalar:
        return self._new(self.value <= plain(other))

    @_of_numbers
    def __gt__(self, other: Any) -> Scalar:
        return self._new(self.value > plain(other))

    @_of_numbers
    def __ge__(self, other: Any) -> Scalar:
        return self._new(self.value >= plain(other))

    @_of_numbers
    def __eq__(self, other: Any) -> Any:
        return self._new(self.value == plain(other))

    @_of_numbers
    def __ne__(self, other: Any) -> Any:
        return self._new(self.value != plain(other))

    __hash__ = object.__hash__

    def __float__(self) -> float:
        """Return the number of a constant expression; a symbol has none."""
        if not self._is_constant:
            raise SymbolError("uses the number of a symbol, for example in a condition")
        return float(self.value)

    def __bool__(self) -> bool:
        """Return the truth value; without this method, every symbol would silently be true."""
        decide = choose.get()
        if decide is None or self._is_constant:
            return bool(float(self))
        return decide(self.value)

    @property
    def _is_constant(self) -> bool:
        is_constant = getattr(self.value, "is_constant", None)
        return is_constant is not None and bool(is_constant())

    def arctan2(self, x: Any) -> Scalar:
        """Angle of the point (x, self)."""
        return self._new(self.library.arctan2(self.value, plain(x)))


def _method(name: str) -> Callable[[Scalar], Scalar]:
    """Return the method that NumPy calls when its function is applied to an object."""
    return lambda self: self._new(getattr(self.library, name)(self.value))


#: Functions of NumPy that are methods of `Scalar`.
FUNCTIONS = (
    *("sin", "cos", "tan", "arcsin", "arccos", "arctan"),
    *("sinh", "cosh", "tanh", "arctanh", "exp", "log", "sqrt"),
)
for _name in FUNCTIONS:
    setattr(Scalar, _name, _method(_name))


def _is(other: Any, number: float) -> bool:
    return isinstance(other, int | float) and other == number


def plain(number: Any) -> Any:
    """Return the library's own scalar; return a number unchanged."""
    return number.value if isinstance(number, Scalar) else number


def objects(scalars: Iterable[Any], library: Any) -> Objects:
    """Return scalars of a library as an array of objects (k,)."""
    listed = [Scalar(scalar, library) for scalar in scalars]
    array = np.empty(len(listed), dtype=object)
    array[:] = listed
    return array
