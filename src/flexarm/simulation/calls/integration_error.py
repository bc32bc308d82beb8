"""Error of the integration of a run, from a second run with looser tolerances."""

from __future__ import annotations

import copy
import math
import warnings
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import xarray as xr

from flexarm.base.errors import FlexarmError
from flexarm.simulation.calls.preparation import Situation
from flexarm.simulation.run.accuracy import DEFAULT_ACCURACY
from flexarm.simulation.run.tolerance import reach_of

#: Accuracy of the second run over that of the first.
_LOOSER = 10.0
#: Exponent of the accuracy by which the error of the looser run becomes that of the other: the
#: errors of two runs whose accuracies differ by 10 differ by a factor of 4 or more in nine of ten.
_POWER = 0.6
#: Runs until a requested accuracy counts as missed; aim of a repetition over the request, and the
#: least accuracy of a repetition over the one before.
_MOST_RUNS, _AIM, _LEAST = 4, 0.3, 1e-3
#: Sum of the angles (rad) by which all joints turn, above which a run without a controller is
#: verified although no accuracy is requested: errors of links that swing freely grow.
_SWINGING = 2.0 * math.pi
#: Error over the default accuracy above which such a run gets a warning.
_DOUBTFUL = 3.0

#: Executes a run and returns its result.
Execute = Callable[[Situation], xr.Dataset]


def with_error(
    situation: Situation, result: xr.Dataset, execute: Execute
) -> tuple[xr.Dataset, str]:
    """Return the result of a run with its attribute ``integration_error`` (m), and a warning.

    If an accuracy is requested and the error exceeds it, the run is repeated. Without one, the
    attribute is present only for runs in which errors may grow. The warning is empty if the error
    is small enough.

    Args:
        result: that of ``situation``.
        execute: executes a variation of it, without warnings.
    """
    arm, settings = situation.simulated, situation.settings
    requested = settings.accuracy
    allowed = DEFAULT_ACCURACY * reach_of(arm) if requested is None else requested
    if settings.request(arm) is None or (requested is None and not _swings(situation, result)):
        return result, ""

    def executed(accuracy: float) -> xr.Dataset | None:
        # The controller of the user keeps the state of the run whose result is returned.
        try:
            varied = replace(
                situation,
                settings=settings.replaced(accuracy=accuracy),
                controller=copy.deepcopy(situation.controller),
            )
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return execute(varied)
        except (FlexarmError, TypeError):
            return None

    accuracy, other, ratio = allowed, executed(_LOOSER * allowed), _LOOSER
    error = _error(result, other, ratio)
    runs = 2
    while requested is not None and error > allowed and runs < _MOST_RUNS:
        ratio = 1.0 / max(_AIM * allowed / error, _LEAST)
        finer = executed(accuracy / ratio)
        if finer is None:
            break
        error = _error(finer, result, ratio)
        result, accuracy, runs = finer, accuracy / ratio, runs + 1
    result = result.assign_attrs(accuracy=allowed, integration_error=error)
    if error <= (allowed if requested is not None else _DOUBTFUL * allowed):
        return result, ""
    if math.isnan(error):
        text = f"the integration error could not be compared with the accuracy of {allowed:.2g} m"
        return result, text if requested is not None else ""
    cause = "errors grow in this motion. Do not rely on its end, or reduce the duration"
    remedy = "" if requested is not None else ", or request an accuracy"
    text = f"the integration error of the tip is about {error:.1g} m: {cause}{remedy}."
    return result, text


def _swings(situation: Situation, result: xr.Dataset) -> bool:
    """Return whether links of a run without a controller turn so far that errors may grow."""
    if situation.controller is not None:
        return False
    return float(np.abs(np.diff(result.joint_angle.values, axis=0)).sum()) > _SWINGING


def _error(result: xr.Dataset, other: xr.Dataset | None, ratio: float) -> float:
    """Return the estimated error (m) of the tip in a result; NaN without another one.

    Args:
        ratio: accuracy of the other result over that of this one.
    """
    if other is None:
        return math.nan
    count = min(result.sizes["time"], other.sizes["time"])
    tips = (dataset.tip.values[:count, :2] for dataset in (result, other))
    apart = float(np.abs(np.subtract(*tips)).max(initial=0.0))
    return float(apart * ratio**-_POWER)
