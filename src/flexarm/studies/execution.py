"""Execution of the samples of a study: all drives on all plants along all motions for each."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache, partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm import Arm
from flexarm.errors import FlexarmError
from flexarm.integrate.base import FloatArray
from flexarm.model import StudySpec
from flexarm.model.file_format.files import record_of_bytes
from flexarm.model.paths import with_number
from flexarm.model.scenarios.study import plant_spec
from flexarm.scenarios.file_errors import Where
from flexarm.scenarios.study import PreparedStudy
from flexarm.simulation.compare import Evaluation, evaluated
from flexarm.simulation.metrics import METRICS
from flexarm.studies.samples import Samples, in_study

#: Recorded metrics. The computing time of controllers differs from run to run.
RECORDED = tuple(metric for metric in METRICS if metric.name != "controller_time")
#: Code that is compiled in the middle of a run may differ in the last digits.
_EXACT = {"specialized": False}


class Outcomes(NamedTuple):
    """Results of consecutive samples.

    Attributes:
        parameters: (samples, parameters), the values of the varied numbers.
        metrics: (samples, controllers, plants, references, metrics) of ``RECORDED``; NaN for a run
            that failed.
        failure, warning: (samples, controllers, plants, references) texts, or empty.
    """

    parameters: FloatArray
    metrics: FloatArray
    failure: NDArray[np.object_]
    warning: NDArray[np.object_]

    def at(self, part: slice | NDArray[np.bool_]) -> Outcomes:
        """Return a part of the samples."""
        return Outcomes(
            self.parameters[part], self.metrics[part], self.failure[part], self.warning[part]
        )


class Executor:
    """Runs of a study.

    Args:
        place: function from key path to location in its file, for messages.

    Raises:
        InputError: if a part of the study does not fit another, or a path leads to no number.
    """

    def __init__(self, prepared: PreparedStudy, place: Where = lambda _: "study") -> None:
        self._prepared = prepared
        self.samples = Samples(prepared.study, place)
        self.shape = tuple(map(len, prepared.names.values()))

    def outcomes(self, start: int, stop: int) -> Outcomes:
        """Execute the samples from ``start`` to before ``stop``."""
        count = stop - start
        found = Outcomes(
            self.samples.values(start, stop),
            np.full((count, *self.shape, len(RECORDED)), np.nan),
            *np.full((2, count, *self.shape), "", dtype=object),
        )
        names = self._prepared.names
        runs = list(product(names["controller"], names["plant"], names["reference"]))
        for k in range(count):
            values = dict(zip(self.samples.paths, found.parameters[k].tolist(), strict=True))
            for index, chosen in zip(np.ndindex(self.shape), runs, strict=True):
                one = self._run(start + k, values, chosen)
                place = (k, *index)
                for j, metric in enumerate(RECORDED):
                    found.metrics[(*place, j)] = one.metrics.get(metric.name, np.nan)
                found.failure[place] = one.failure
                found.warning[place] = one.warning or one.unstable
        return found

    def _run(self, k: int, values: Mapping[str, float], chosen: tuple[str, str, str]) -> Evaluation:
        """Execute one run of sample k; ``chosen``: its drive, plant and motion."""
        try:
            prepared, simulated = self._varied(values, chosen[1])
        except FlexarmError as error:  # impossible values, or no reference exists for them
            return Evaluation(failure=str(error))
        instead: dict[str, Any] = dict(_EXACT)
        seed, hardware = self.samples.noise_seed(k), prepared.study.hardware
        if seed is not None and hardware is not None and prepared.controlled(chosen[0]):
            instead["hardware"] = hardware.replace(seed=seed)
        run = partial(prepared.one, *chosen, simulated, **instead)
        return evaluated(run, prepared.arm, prepared.study.run.settling)

    def _varied(self, values: Mapping[str, float], plant: str) -> tuple[PreparedStudy, Arm | None]:
        """Return the study of a sample, and its simulated arm if that differs from the plant.

        Raises:
            InputError: if the values are not possible.
            FlexarmError: if a reference or an equilibrium for them was not found.
        """
        own = {path: value for path, value in values.items() if in_study(path)}
        prepared = _changed(self._prepared, tuple(own.items())) if own else self._prepared
        if len(own) == len(values):
            return prepared, None
        spec = prepared.study.arm
        for path, value in values.items():
            if path not in own:
                spec = with_number(spec, path, value)
        return prepared, Arm(plant_spec(spec, prepared.study.plants[plant]))


@lru_cache(maxsize=2)
def _changed(prepared: PreparedStudy, values: tuple[tuple[str, float], ...]) -> PreparedStudy:
    """Return a study with other numbers in its file."""
    study: StudySpec = prepared.study
    for path, value in values:
        study = with_number(study, path, value)
    return PreparedStudy(study)


@lru_cache(maxsize=2)
def executor_of(text: str) -> Executor:
    """Return the executor of the text of a study, kept because a process executes many chunks."""
    study = record_of_bytes(text.encode(), "the study")
    assert isinstance(study, StudySpec)
    return Executor(PreparedStudy(study))
