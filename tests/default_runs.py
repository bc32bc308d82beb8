"""Runs at default settings, recorded, and their error against the same run at tight tolerances."""

from __future__ import annotations

import sys
from typing import Any, NamedTuple

import numpy as np
import pytest
import xarray as xr

import flexarm as fa
from flexarm.cases.scenario.scenario import run_scenario

#: Largest error of the tip over the length of the arm, as the documentation states it.
PROMISED = 1e-5
#: The tight runs agree with runs ten times tighter to 3e-13 of the reach.
TIGHT = {"integrator": "dormand_prince_8", "rtol": 1e-11, "atol": 1e-13}
#: Arguments that replace default settings.
_ASKED = ("accuracy", "rtol", "atol", "step")
_simulate = fa.simulate


class DefaultRun(NamedTuple):
    """Arguments of `fa.simulate` and its result."""

    arm: fa.Arm
    given: tuple[Any, ...]
    options: dict[str, Any]
    result: xr.Dataset

    def error(self) -> float:
        """Return the largest distance of the tips at any time, over the length of the arm.

        The run is repeated at tight tolerances; a closed loop with the same controller and sample
        times.
        """
        tight = _simulate(self.arm, *self.given, **self.options | TIGHT)
        away = self.result["tip"].values - tight["tip"].values
        simulated = self.options.get("plant") or self.arm
        return float(np.hypot(*away.T).max() / simulated.lengths.sum())


def record(patch: pytest.MonkeyPatch) -> list[DefaultRun]:
    """Return a list to which every run at default settings is added while ``patch`` is active."""
    found: list[DefaultRun] = []

    def spy(arm: fa.Arm, *given: Any, **options: Any) -> xr.Dataset:
        result = _simulate(arm, *given, **options)
        by_default = options.get("integrator", "auto") == "auto"
        if by_default and not any(name in options for name in _ASKED):
            found.append(DefaultRun(arm, given, options, result))
        return result

    patch.setattr(fa, "simulate", spy)
    # The module is found in `sys.modules`, because the attribute `simulate` is the function.
    patch.setattr(sys.modules[run_scenario.__module__], "simulate", spy)
    return found
