"""One table of controllers, plants and references: ``flexarm.compare``."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.arm import Arm
from flexarm.control import Controller, Hardware, Reference
from flexarm.errors import InputError, LargeDeflectionWarning, Problem, SimulationError, shown
from flexarm.simulate.meter import Meter
from flexarm.simulate.metrics import METRICS, metrics_of
from flexarm.simulate.run import simulate

if TYPE_CHECKING:
    import xarray as xr

_DIMS = ("controller", "plant", "reference")


def compare(
    arm: Arm,
    controllers: Mapping[str, Controller],
    duration: float,
    references: Mapping[str, Reference],
    plants: Mapping[str, Arm] | None = None,
    *,
    hardware: Hardware | None = None,
    settling: float = 0.0,
    progress: bool | None = None,
    **options: Any,
) -> xr.Dataset:
    """Run every controller on every plant along every reference, and return numbers of each run.

    Args:
        arm: what the controllers believe the arm to be.
        controllers: by name; the same objects serve all runs, reset before each.
        duration: of every run, s.
        references: motions by name.
        plants: arms that are really simulated, by name; None for the arm itself, as "nominal".
        hardware: of every run, with the same seed: the noise is the same in all.
        settling: s after the end of a motion that the numbers of the time after it leave out.
        progress: True or False shows or hides the bar.
        options: further arguments of ``flexarm.simulate``, the same for all runs.

    Returns:
        Dataset (controller, plant, reference) of ``flexarm.simulate.metrics.METRICS``, and
        ``failure``: why a run stopped early, or empty. Numbers of a run that stopped are NaN.

    Raises:
        InputError: no controllers or references, a plant that is no arm, or what ``simulate``
            refuses.
    """
    import xarray as xr

    where = "compare"
    plants = {"nominal": arm} if plants is None else plants
    given = {"controllers": controllers, "plants": plants, "references": references}
    for name, items in given.items():
        if not isinstance(items, Mapping) or not items:
            rule = "be a dictionary by name, with one entry at least"
            raise InputError(Problem(where, name, rule, shown(items)))
    names = [list(controllers), list(plants), list(references)]
    shape = tuple(map(len, names))
    values = {metric.name: np.full(shape, np.nan) for metric in METRICS}
    failures = np.full(shape, "", dtype=object)
    bent = np.full(shape, "", dtype=object)
    with Meter("comparing", progress) as meter:
        for done, index in enumerate(product(*map(range, shape))):
            meter.update(done / int(np.prod(shape)))
            controller = controllers[names[0][index[0]]]
            plant, reference = plants[names[1][index[1]]], references[names[2][index[2]]]
            run: dict[str, Any] = {
                "controller": controller,
                "reference": reference,
                "plant": plant,
                **options,
            }
            try:
                with warnings.catch_warnings():  # kept with the numbers, and told once
                    warnings.simplefilter("ignore", LargeDeflectionWarning)
                    result = simulate(arm, duration, hardware=hardware, progress=False, **run)
            except SimulationError as error:
                failures[index] = str(error)
                continue
            bent[index] = result.attrs["warning"]
            for name, value in metrics_of(result, arm, reference, settling).items():
                values[name][index] = value
    dataset = xr.Dataset(
        {
            metric.name: (
                _DIMS,
                values[metric.name],
                {"units": metric.unit, "long_name": metric.meaning},
            )
            for metric in METRICS
        },
        coords=dict(zip(_DIMS, names, strict=True)),
    )
    dataset["failure"] = (_DIMS, failures.astype(str))
    dataset["warning"] = (_DIMS, bent.astype(str))
    dataset.attrs["duration"] = duration
    return dataset
