"""User functions of time, with errors that contain the time of a failure."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from copy import copy
from types import AsyncGeneratorType, CoroutineType, GeneratorType
from typing import Any

import numpy as np

from flexarm.base.errors import FlexarmError, InputError, Problem, SimulationError

_UNFINISHED = (CoroutineType, GeneratorType, AsyncGeneratorType)
#: Bisections of the interval in which a function begins to fail: to the last digit of the time.
_HALVINGS = 60


class FunctionError(SimulationError):
    """A function of time raised an exception, its ``__cause__``; it succeeds before ``time``."""


def call(name: str, function: Callable[[Any], Any], t: Any) -> Any:
    """Return the value of a function at a time (s), or at times (T,).

    An exception of the function becomes a FunctionError; flexarm's own exceptions pass unchanged.
    """
    try:
        value = function(t)
    except FlexarmError:
        raise
    except Exception as error:
        first = t if getattr(t, "ndim", 0) == 0 else t[0]
        raise _failure(name, float(first), error) from error
    return _finished(name, value)


def call_many(
    name: str, function: Callable[[float], Any], times: Iterable[float], rows: list[Any]
) -> None:
    """Append the rows of numbers that a function returns at times (s) to ``rows``.

    The exceptions are those of ``call``; ``rows`` then contains the values before the failure.
    """
    t = 0.0
    try:
        for t in times:
            row = function(t)
            kind = type(row)
            # Copy, because the function may write each result into the same array or list.
            if kind is np.ndarray:
                row = row.copy()
            elif kind is not tuple:
                row = _finished(name, row)
                row = copy(row) if kind is list or hasattr(row, "__array__") else row
            rows.append(row)
    except FlexarmError:
        raise
    except Exception as error:
        raise _failure(name, t, error) from error


def _finished(name: str, value: Any) -> Any:
    """Return the value of a function, which must not be a coroutine or a generator."""
    if isinstance(value, _UNFINISHED):
        kind = "a generator" if isinstance(value, GeneratorType) else "an asynchronous function"
        if isinstance(value, CoroutineType):
            value.close()  # else Python warns that it was never awaited
        raise InputError(Problem(name, "be a function that returns a value", kind))
    return value


def first_failure(
    name: str, function: Callable[[float], Any], before: float, failed: FunctionError
) -> FunctionError:
    """Return the failure of a function at the earliest time of failure, found by bisection.

    At ``before`` (s) the function succeeds; ``failed`` is its failure at a later time.
    """
    at, cause = failed.time, failed.__cause__
    for _ in range(_HALVINGS):
        middle = 0.5 * (before + at)
        if not before < middle < at:
            break
        try:
            function(middle)
        except Exception as error:
            at, cause = middle, error
        else:
            before = middle
    found = _failure(name, before, cause)
    found.__cause__ = cause
    return found


def _failure(name: str, t: float, error: BaseException | None) -> FunctionError:
    words = " ".join(str(error).split())
    return FunctionError(t, f"{name} failed with {type(error).__name__}: {words}")
