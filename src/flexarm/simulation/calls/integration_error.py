"""Error of the integration of a run, from runs with other accuracies."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import xarray as xr

from flexarm.simulation.run.accuracy import LEAST, share_of_finer

#: Accuracy of the second run over that of the first.
_LOOSER = 10.0
#: Accuracy of the first run over that of another one, if both have the same steps.
_FINER = 1000.0
#: Runs until a requested accuracy counts as missed; aim of a repetition over the request, and the
#: least accuracy of a repetition over the one before.
_MOST_RUNS, _AIM, _LEAST = 4, 0.3, 1e-3


def with_error(
    result: xr.Dataset, accuracy: float, executed: Callable[[float], xr.Dataset | None]
) -> tuple[xr.Dataset, str]:
    """Return the result of a run with its attribute ``integration_error`` (m), and a warning.

    If the error exceeds the accuracy, the run is repeated with a smaller one. The warning is empty
    if a run reaches the accuracy. ``evaluations`` and ``wall_seconds`` are those of all runs.

    Args:
        accuracy: requested error of the tip, m.
        executed: executes the run with another accuracy; returns None if that fails.
    """
    used, looser = accuracy, executed(_LOOSER * accuracy)
    runs = [result] if looser is None else [looser, result]
    error = _error(result, looser, _LOOSER)
    if error == 0.0:  # the steps are those of the samples of a loop, or of the largest tolerance
        finer = executed(accuracy / _FINER)
        if finer is not None:
            runs, used, error = [*runs, finer], accuracy / _FINER, _error(finer, result, _FINER)
    for _ in range(_MOST_RUNS - 2):
        if not error > accuracy:
            break
        ratio = 1.0 / max(_AIM * accuracy / error, _LEAST)
        finer = executed(used / ratio)
        if finer is None or finer.attrs["rtol"] == runs[-1].attrs["rtol"]:
            break
        error = _error(finer, runs[-1], ratio)
        runs, used = [*runs, finer], used / ratio
    work = {name: sum(run.attrs[name] for run in runs) for name in ("evaluations", "wall_seconds")}
    result = runs[-1].assign_attrs(accuracy=accuracy, integration_error=error, **work)
    if error <= accuracy:
        return result, ""
    if math.isnan(error):
        text = "no other run can be compared with this one, so the integration error is unknown"
    else:
        text = f"errors grow in this motion: that of the tip is about {error:.1g} m"
    return result, f"{text}. Do not rely on an accuracy of {accuracy:.2g} m."


def _error(result: xr.Dataset, other: xr.Dataset | None, ratio: float) -> float:
    """Return the estimated error (m) of the tip in a result; NaN without another one.

    Args:
        ratio: accuracy of the other result over that of this one.
    """
    if other is None:
        return math.nan
    if result.attrs["rtol"] == other.attrs["rtol"] <= LEAST:  # rounding errors of both are equal
        return math.nan
    count = min(result.sizes["time"], other.sizes["time"])
    tips = (dataset.tip.values[:count, :2] for dataset in (result, other))
    apart = float(np.abs(np.subtract(*tips)).max(initial=0.0))
    return apart * share_of_finer(ratio)
