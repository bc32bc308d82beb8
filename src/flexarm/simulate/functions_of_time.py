"""Functions of time that users write: called so that what they raise ends a run as a failure."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial, wraps
from inspect import signature
from typing import TYPE_CHECKING, Any, ParamSpec

from flexarm.errors import FlexarmError, InputError, LargeDeflectionWarning, SimulationError
from flexarm.model.events import FAILURE

if TYPE_CHECKING:
    import xarray as xr

P = ParamSpec("P")

#: Halvings of the interval in which a function begins to fail: to the last digit of the time.
_HALVINGS = 60


class FunctionError(SimulationError):
    """A function of time raised an exception, its ``__cause__``; until ``time`` it answered."""


def call(name: str, function: Callable[[Any], Any], t: Any) -> Any:
    """Return the value of a function at a time (s), or at times (T,).

    Raises:
        FunctionError: if the function raises; flexarm's own errors go through as they are.
    """
    try:
        return function(t)
    except FlexarmError:
        raise
    except Exception as error:
        raise _failure(name, _first(t), error) from error


def computed_until_failure(simulate: Callable[P, xr.Dataset]) -> Callable[P, xr.Dataset]:
    """Give the failure of a function of time the record of the run up to that time.

    Functions of time are followed before a run begins. Where one fails, the run is computed again
    up to the time at which it last answered.
    """

    @wraps(simulate)
    def run(*args: P.args, **options: P.kwargs) -> xr.Dataset:
        try:
            return simulate(*args, **options)
        except FunctionError as failed:
            if failed.result is None and failed.time > 0.0:
                given = signature(simulate).bind(*args, **options).arguments
                _keep_result(failed, partial(run, **{**given, "duration": failed.time}))
            raise

    return run


def _keep_result(failed: FunctionError, again: Callable[[], xr.Dataset]) -> None:
    """Attach the result of a shorter run; a run that ends even earlier raises its own error."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LargeDeflectionWarning)
        try:
            failed.result = again()
        except InputError:  # the time is shorter than the given step
            return
    failed.result.attrs |= {"failure": str(failed), "ended_by": FAILURE}


def first_failure(
    name: str, function: Callable[[float], Any], before: float, failed: FunctionError
) -> FunctionError:
    """Return the failure of a function at the time from which on it fails, by bisection.

    Args:
        before: a time (s) at which it answers.
        failed: its failure at a later time.
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


def _first(t: Any) -> float:
    return float(t) if getattr(t, "ndim", 0) == 0 else float(t[0])
