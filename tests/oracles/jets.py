"""Two number types that differentiate any formula written with ``+ - *``, ``sin`` and ``cos``.

``Rate`` carries a value and its time derivative; ``Jet`` a value with all its first and second
partial derivatives. Nested as ``Rate`` of ``Jet`` they turn a formula for the *position* of a
material point into its velocity, and that into all terms of Lagrange's equations: exact to
rounding, no step size, no algebra by hand.

Both hold arrays, shape ``S`` either ``()`` or ``(points,)``, so that one number stands for a
quantity at every material point at once. ``matrix @ number`` applies a constant matrix.
"""

from __future__ import annotations

from typing import Any

import numpy as np


class Jet:
    """A second-order Taylor polynomial in ``n`` variables.

    value: shape ``S``; first: ``S + (n,)``, the gradient; second: ``S + (k, n)``, the first ``k``
    rows of the Hessian, so that only the required ones are computed.
    """

    __slots__ = ("first", "second", "value")
    __array_ufunc__ = None  # makes NumPy call `Jet` for `array * jet` and `array @ jet`

    def __init__(self, value: Any, first: np.ndarray, second: np.ndarray) -> None:
        self.value, self.first, self.second = value, first, second

    @classmethod
    def variables(cls, point: np.ndarray, rows: int) -> Jet:
        """The independent variables at ``point`` (n,), as one jet of shape (n,) with k = rows."""
        n = len(point)
        return cls(point, np.eye(n, dtype=point.dtype), np.zeros((n, rows, n), dtype=point.dtype))

    def __add__(self, other: Any) -> Jet:
        if isinstance(other, Jet):
            return Jet(
                self.value + other.value, self.first + other.first, self.second + other.second
            )
        value = self.value + other
        first = np.broadcast_to(self.first, np.shape(value) + self.first.shape[-1:])
        second = np.broadcast_to(self.second, np.shape(value) + self.second.shape[-2:])
        return Jet(value, first, second)

    def __mul__(self, other: Any) -> Jet:
        a, b = self, other
        if not isinstance(b, Jet):
            b = np.asarray(b)
            return Jet(a.value * b, a.first * b[..., None], a.second * b[..., None, None])
        return Jet(
            a.value * b.value,
            a.value[..., None] * b.first + b.value[..., None] * a.first,
            a.value[..., None, None] * b.second
            + b.value[..., None, None] * a.second
            + a._rows() * b.first[..., None, :]
            + b._rows() * a.first[..., None, :],
        )

    def __neg__(self) -> Jet:
        return Jet(-self.value, -self.first, -self.second)

    def __sub__(self, other: Any) -> Jet:
        return self + (-other)

    def __rsub__(self, other: Any) -> Jet:
        return -self + other

    __radd__ = __add__
    __rmul__ = __mul__

    def __rmatmul__(self, matrix: np.ndarray) -> Jet:
        return Jet(
            matrix @ self.value,
            np.tensordot(matrix, self.first, axes=1),
            np.tensordot(matrix, self.second, axes=1),
        )

    def __getitem__(self, index: Any) -> Jet:
        return Jet(self.value[index], self.first[index], self.second[index])

    def _rows(self) -> np.ndarray:
        """Return the first ``k`` derivatives as a column, the left factor of a product of
        gradients."""
        return self.first[..., : self.second.shape[-2], None]

    def _chain(self, f: Any, df: Any, ddf: Any) -> Jet:
        """Return a function with value ``f`` and derivatives ``df``, ``ddf`` at ``self.value``."""
        df, ddf = np.asarray(df), np.asarray(ddf)
        square = self._rows() * self.first[..., None, :]
        return Jet(
            f,
            df[..., None] * self.first,
            df[..., None, None] * self.second + ddf[..., None, None] * square,
        )

    def sin(self) -> Jet:
        s, c = np.sin(self.value), np.cos(self.value)
        return self._chain(s, c, -s)

    def cos(self) -> Jet:
        s, c = np.sin(self.value), np.cos(self.value)
        return self._chain(c, -s, -c)


class Rate:
    """A quantity and its time derivative; both plain arrays, or both jets."""

    __slots__ = ("rate", "value")
    __array_ufunc__ = None

    def __init__(self, value: Any, rate: Any) -> None:
        self.value, self.rate = value, rate

    def __add__(self, other: Any) -> Rate:
        if isinstance(other, Rate):
            return Rate(self.value + other.value, self.rate + other.rate)
        return Rate(self.value + other, self.rate + np.zeros(np.shape(other)))

    def __mul__(self, other: Any) -> Rate:
        if isinstance(other, Rate):
            rate = self.rate * other.value + self.value * other.rate
            return Rate(self.value * other.value, rate)
        return Rate(self.value * other, self.rate * other)

    def __neg__(self) -> Rate:
        return Rate(-self.value, -self.rate)

    def __sub__(self, other: Any) -> Rate:
        return self + (-other)

    def __rsub__(self, other: Any) -> Rate:
        return -self + other

    __radd__ = __add__
    __rmul__ = __mul__

    def __rmatmul__(self, matrix: np.ndarray) -> Rate:
        return Rate(matrix @ self.value, matrix @ self.rate)

    def __getitem__(self, index: Any) -> Rate:
        return Rate(self.value[index], self.rate[index])

    def sin(self) -> Rate:
        return Rate(sin(self.value), cos(self.value) * self.rate)

    def cos(self) -> Rate:
        return Rate(cos(self.value), -sin(self.value) * self.rate)


def sin(x: Any) -> Any:
    """Return the sine of a jet, a rate or a plain array."""
    return x.sin() if isinstance(x, Jet | Rate) else np.sin(x)


def sqrt(x: Any) -> Any:
    """Return the square root of a jet or a number."""
    if not isinstance(x, Jet):
        return np.sqrt(x)
    root = np.sqrt(x.value)
    return x._chain(root, 0.5 / root, -0.25 / (root * x.value))


def cos(x: Any) -> Any:
    """Return the cosine of a jet, a rate or a plain array."""
    return x.cos() if isinstance(x, Jet | Rate) else np.cos(x)
