"""Timing laws: the fraction of a path as a function of the fraction of its time.

A timing law is a piecewise polynomial, whose conditions are validated exactly and whose breaks are
known.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.base.arguments import check_number, check_times
from flexarm.base.errors import InputError, Problem, check_array, nearest, public_call, shown

Floats = NDArray[np.float64]

ALGEBRA_TOLERANCE = 1e-12
"""Largest defect of a law's own algebra: coefficients of size 100 rounded a few times."""


class Progress(NamedTuple):
    """Path fraction s and its derivatives s', s'' with respect to the time fraction u."""

    s: Any
    ds: Any
    dds: Any


@dataclass(frozen=True)
class TimingLaw:
    """A piecewise polynomial s(u) on [0, 1], from rest at 0 to rest at 1, never decreasing.

    Attributes:
        name: name in messages and files.
        breaks: ends of the pieces, `pieces + 1` strictly increasing numbers from 0 to 1. The
            second or a higher derivative may jump there; within a piece the law is smooth.
        coefficients: for each piece the coefficients of w^0, w^1, ... with w = u - (its start).

    Raises:
        InputError: if the polynomials do not satisfy these conditions.
    """

    name: str
    breaks: tuple[float, ...]
    coefficients: tuple[tuple[float, ...], ...]

    @public_call
    def __post_init__(self) -> None:
        breaks = check_array("breaks", self.breaks, (len(self.coefficients) + 1,))
        increasing = len(breaks) > 1 and bool(np.all(np.diff(breaks) > 0.0))
        if not increasing or breaks[0] != 0.0 or breaks[-1] != 1.0:
            raise InputError(Problem("breaks", "increase strictly from 0 to 1", shown(self.breaks)))
        for piece, row in enumerate(self.coefficients):
            check_array(f"coefficients[{piece}]", row, (-1,))
        self._check_algebra()

    @public_call
    def __call__(self, u: ArrayLike) -> Progress:
        """Evaluate the law.

        Args:
            u: time fractions, any shape; outside [0, 1] the law is constant, 0 or 1.

        Returns:
            s, s' and s'', each of the shape of `u`. At a break s'' is that of the piece that starts
            there, and at u = 1 that of the rest that follows.
        """
        u = check_times("u", u)
        piece = np.searchsorted(self.breaks, u, side="right") - 1
        starts = np.concatenate([self.breaks, [0.0]])
        return self.on_pieces(piece, u - starts[piece])

    def on_pieces(self, piece: NDArray[np.intp], local: Any) -> Progress:
        """Evaluate the law for given pieces; complex `local` is allowed.

        Args:
            piece: index of the piece of each point; -1 is the rest before the law, `pieces` the
                rest after it.
            local: u minus the start of that piece, of the same shape; unused at rest.

        Returns:
            s, s' and s'', each of that shape.
        """
        resting = (piece < 0) | (piece >= len(self.coefficients))
        local = np.where(resting, 0.0, local)  # infinite times are allowed there
        rows = self._table[piece]
        if local.size == 1:  # scalar arithmetic takes a third of the time
            number = local.item()
            parts = _differentiated(rows.ravel()[::-1].tolist(), number, 0.0)
            return Progress(*(np.full(local.shape, part) for part in parts))
        falling = (rows[..., power] for power in reversed(range(rows.shape[-1])))
        return _differentiated(falling, local, np.zeros_like(local))

    def inverse(self, s: Floats) -> Floats:
        """Return time fractions u (k,) at which the law passes path fractions `s` (k,)."""
        low, high = np.zeros(len(s)), np.ones(len(s))
        for _ in range(60):  # bisection to rounding: the law never decreases
            middle = 0.5 * (low + high)
            late = self(middle).s >= s
            low, high = np.where(late, low, middle), np.where(late, middle, high)
        return high

    @cached_property
    def _table(self) -> Floats:
        """Coefficients of all pieces, padded, of the rest after the law, and of that before it."""
        width = max(len(row) for row in self.coefficients)
        padded = [(*row, *[0.0] * (width - len(row))) for row in self.coefficients]
        return np.array([*padded, np.eye(width)[0], np.zeros(width)])

    def _check_algebra(self) -> None:
        pieces = len(self.coefficients)
        index = np.arange(pieces)
        first = self.on_pieces(index, np.zeros(pieces))
        last = self.on_pieces(index, np.diff(self.breaks))
        ends = {"s(0)": (first.s[0], 0.0), "s'(0)": (first.ds[0], 0.0)}
        ends |= {"s(1)": (last.s[-1], 1.0), "s'(1)": (last.ds[-1], 0.0)}
        for k in range(pieces - 1):
            ends[f"s at the start of piece {k + 1}"] = (first.s[k + 1], last.s[k])
            ends[f"s' at the start of piece {k + 1}"] = (first.ds[k + 1], last.ds[k])
        problems = [
            Problem(name, f"be {want:.15g}", f"{got:.15g}")
            for name, (got, want) in ends.items()
            if abs(got - want) > ALGEBRA_TOLERANCE
        ]
        slowest = float(np.min(self(np.linspace(0.0, 1.0, 1025)).ds))
        if slowest < -ALGEBRA_TOLERANCE:
            problems.append(Problem("s'(u)", "never be negative", f"{slowest:.6g}"))
        if problems:
            raise InputError(*problems)


def _differentiated(falling: Iterable[Any], x: Any, zero: Any) -> Progress:
    """Evaluate a polynomial and two derivatives by Horner's scheme, highest power first."""
    s = ds = dds = zero
    for coefficient in falling:
        dds = dds * x + 2.0 * ds
        ds = ds * x + s
        s = s * x + coefficient
    return Progress(s, ds, dds)


def quintic() -> TimingLaw:
    """Return the quintic law s = 10 u^3 - 15 u^4 + 6 u^5, with continuous acceleration."""
    return TimingLaw("quintic", (0.0, 1.0), ((0.0, 0.0, 0.0, 10.0, -15.0, 6.0),))


@public_call
def trapezoidal(ramp: float = 0.25) -> TimingLaw:
    """Return the law of constant acceleration, constant rate and constant deceleration.

    Args:
        ramp: fraction of the time for the acceleration, and again for the deceleration; from 1e-6
            to 0.5, which has no phase of constant rate (triangular).

    Raises:
        InputError: if `ramp` is out of that range.
    """
    ramp = check_number("ramp", ramp, lambda part: 1e-6 <= part <= 0.5, "be from 1e-06 to 0.5")
    rate = 1.0 / (1.0 - ramp)
    half = 0.5 * rate * ramp  # path covered by one ramp
    last = 1.0 - (1.0 - ramp)  # `ramp` after the rounding of the break
    speed_up = (0.0, 0.0, 0.5 * rate / ramp)
    slow_down = (1.0 - half, rate, -0.5 * rate / last)
    if ramp == 0.5:
        return TimingLaw("trapezoidal", (0.0, 0.5, 1.0), (speed_up, slow_down))
    pieces = (speed_up, (half, rate), slow_down)
    return TimingLaw("trapezoidal", (0.0, ramp, 1.0 - ramp, 1.0), pieces)


TIMING_LAWS: dict[str, TimingLaw] = {"quintic": quintic(), "trapezoidal": trapezoidal()}
"""Laws a motion can be given by name; the conformance tests run over them."""


def timing_law(profile: str | TimingLaw) -> TimingLaw:
    """Return the timing law with the given name; return a `TimingLaw` unchanged."""
    if isinstance(profile, TimingLaw):
        return profile
    if isinstance(profile, str) and profile in TIMING_LAWS:
        return TIMING_LAWS[profile]
    rule = f"be a TimingLaw or one of {', '.join(map(repr, TIMING_LAWS))}"
    raise InputError(Problem("profile", rule, shown(profile), nearest(profile, TIMING_LAWS)))
