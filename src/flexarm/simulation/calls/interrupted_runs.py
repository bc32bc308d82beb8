"""Results of runs that end by an exception of a user function."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial, wraps
from inspect import signature
from typing import TYPE_CHECKING, ParamSpec

from flexarm.base.errors import InputError, LargeDeflectionWarning
from flexarm.base.user_functions import FunctionError
from flexarm.model.scenarios.events import FAILURE

if TYPE_CHECKING:
    import xarray as xr

P = ParamSpec("P")


def computed_until_failure(simulate: Callable[P, xr.Dataset]) -> Callable[P, xr.Dataset]:
    """Attach the result up to the failure to the exception of a function of time.

    Functions of time are approximated before a run begins. If one fails, the run is repeated up
    to the last time at which it returned a value.
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
    """Attach the result of a shorter run; if that fails even earlier, raise its own error."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LargeDeflectionWarning)
        try:
            failed.result = again()
        except InputError:  # the time is shorter than the given step
            return
    failed.result.attrs |= {"failure": str(failed), "ended_by": FAILURE}
