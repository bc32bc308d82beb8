"""Runs of several samples with one call of ``simulate_batch``."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.errors import FlexarmWarning, InputError
from flexarm.cases.scenario.study import PreparedStudy
from flexarm.model.scenarios.events import DURATION
from flexarm.simulation.batch.run import simulate_batch
from flexarm.simulation.calls.compare import Evaluation

#: Arguments of a run that may differ from those of the others of its call, and the other ones.
_OWN = ("torque", "controller", "reference", "initial", "initial_rate")
_SHARED = ("duration", "rate", "stations", "integrator", "loads", "hardware")
#: Channels from which the metrics of runs without contacts are computed, and the largest memory of
#: the channels of a call (bytes).
_CHANNELS, _MEMORY = ("tip", "joint_angle", "torque"), 2**26


class Case(NamedTuple):
    """One run of a study.

    Attributes:
        number: of the sample.
        prepared: study of the sample.
        simulated: arm in place of that of the plant, or None.
        seed: of the noise, or None for that of the hardware.
    """

    number: int
    prepared: PreparedStudy
    simulated: Arm | None
    seed: int | None


def evaluated_together(
    cases: Sequence[Case], drive: str, plant: str, motion: str
) -> dict[int, Evaluation]:
    """Simulate the runs of one drive on one plant along one motion, as far as a batch has them.

    Returns:
        Evaluations by number of the runs that reached their end, equal to those of single runs.
        Runs with contacts or changes, and runs that failed, are missing. A run that
        no other run can join is also missing: ``simulate`` is twice as fast for one run.
    """
    groups: list[tuple[dict[str, Any], list[tuple[Case, dict[str, Any]]]]] = []
    for case in cases:
        arguments = case.prepared.arguments(drive, plant, motion, case.simulated)
        if not {"plant", *_OWN, *_SHARED}.issuperset(arguments):
            continue
        shared = {name: arguments[name] for name in _SHARED if name in arguments}
        model = case.prepared.study.arm if "controller" in arguments else None
        key = {**shared, "model": model}
        group = next((runs for known, runs in groups if known == key), None)
        if group is None:
            groups.append((key, group := []))
        group.append((case, arguments))
    found: dict[int, Evaluation] = {}
    for key, group in groups:
        shared = {name: value for name, value in key.items() if name != "model"}
        samples = shared["duration"] * shared["rate"] + 1.0
        width = 2 + 2 * group[0][0].prepared.arm.joints
        size = max(1, int(_MEMORY / (8.0 * samples * width)))
        for first in range(0, len(group), size):
            part = group[first : first + size]
            if len(part) > 1:
                found |= _evaluated(shared, part, drive, motion)
    return found


def _evaluated(
    shared: dict[str, Any],
    group: Sequence[tuple[Case, dict[str, Any]]],
    drive: str,
    motion: str,
) -> dict[int, Evaluation]:
    own = {name: [arguments.get(name) for _, arguments in group] for name in _OWN}
    seeds = [case.seed for case, _ in group if case.seed is not None and "hardware" in shared]
    try:
        with warnings.catch_warnings():  # kept with the numbers
            warnings.simplefilter("ignore", FlexarmWarning)
            batch = simulate_batch(
                group[0][0].prepared.arm,
                **shared,
                **{name: _joined(items) for name, items in own.items()},
                plant=[arguments["plant"] for _, arguments in group],
                seeds=seeds or None,
                channels=_CHANNELS,
                threads=1,
                progress=False,
            )
    except InputError:  # the run alone says why
        return {}
    times = batch["time"].values
    channels = {name: batch[name].values for name in _CHANNELS}
    ends, texts = batch["ended_by"].values, batch["warning"].values
    found = {}
    for row, (case, _) in enumerate(group):
        if ends[row] == DURATION:
            goal = case.prepared.goal(drive, motion, times)
            metrics = goal.metrics({name: values[row] for name, values in channels.items()})
            if "saturation" in batch:
                metrics["saturation"] = float(batch["saturation"].values[row].max())
            found[case.number] = Evaluation(metrics, warning=str(texts[row]))
    return found


def _joined(items: Sequence[Any]) -> Any:
    """Return the argument of ``simulate_batch`` for those of single runs."""
    if all(item is items[0] for item in items):
        return items[0]
    return np.stack(items) if isinstance(items[0], np.ndarray) else list(items)
