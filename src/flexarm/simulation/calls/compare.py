"""Comparison of controllers, plants and references in one table: ``flexarm.compare``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_number, check_positive
from flexarm.base.errors import (
    FlexarmError,
    InputError,
    Problem,
    SimulationError,
    UnstableLoopWarning,
    check_array,
    public_call,
    shown,
    warn_caller,
    without_warnings,
)
from flexarm.base.late import xr
from flexarm.control.contract.base import Controller, Reference
from flexarm.model import Change, Hardware, Load
from flexarm.model.scenarios.scenario import DURATION
from flexarm.simulation.calls.metrics import METRICS, metrics_of
from flexarm.simulation.calls.result import exceeded_bound
from flexarm.simulation.calls.run import simulate
from flexarm.simulation.run.progress import Meter

#: Difference of two times, as a fraction of the run, below which they are equal.
_ROUNDING = 1e-9
#: Warning of a run whose estimator fails its consistency test.
INCONSISTENT = (
    "the estimator is inconsistent: its errors are larger than its covariance says. Correct its "
    "arm, or raise torque_noise or the noise of the instruments."
)
#: Metrics of the time after a motion, and why some runs have none.
_AFTER = ("tip_error_settled", "residual_vibration")
MOVES_TO_THE_END = (
    "NaN where the run ends before the motion and its settling time: extend the duration"
)
_DIMS = ("controller", "plant", "reference")
#: Simulated arm, optionally with its own loads, changes during the run, and hardware.
ComparedPlant = Arm | tuple[Arm, Sequence[Load | Change | Hardware]]


@public_call
def compare(
    arm: Arm,
    controllers: Mapping[str, Controller],
    duration: float,
    references: Mapping[str, Reference],
    plants: Mapping[str, ComparedPlant] | None = None,
    *,
    hardware: Hardware | None = None,
    settling: float = 0.0,
    progress: bool | None = None,
    **options: Any,
) -> xr.Dataset:
    """Simulate all combinations of controllers, plants and references; return their metrics.

    Args:
        arm: the controllers' model of the arm.
        controllers: by name; the same objects serve all runs, reset before each.
        duration: of every run, s.
        references: motions by name.
        plants: simulated arms by name; None for the arm itself, as "nominal". A pair
            ``(arm, loads)`` is an arm with loads that act only on it, in addition to those of the
            option ``loads``; no controller includes any of them in its model. The list may also
            contain changes of this arm during the run (``Change``), and one ``Hardware`` in place
            of that of all runs, for example with faults of instruments.
        hardware: of every run, with the same seed: the noise is the same in all.
        settling: time (s) after the end of a motion to exclude from the metrics of the time after
            it; shorter than the run.
        progress: True or False shows or hides the bar.
        options: further arguments of ``flexarm.simulate``, the same for all runs.

    Returns:
        Dataset (controller, plant, reference) of ``flexarm.simulation.calls.metrics.METRICS``, and
        ``failure``: why a run stopped early, or empty. The metrics of such a run are NaN.
        ``warning``: warnings of a run (as in `simulate`, of an inconsistent estimator or of slow
        growth of its loop), or empty.

    Raises:
        InputError: if there are no controllers or references, a plant is neither an arm nor an arm
            with loads, ``settling`` excludes everything, or ``simulate`` raises for the first run.

    Warns:
        UnstableLoopWarning: if the sampled loop of a run is unstable, as in ``simulate``;
            ``warning`` contains the text.
    """
    plants = {"nominal": arm} if plants is None else plants
    given = {"controllers": controllers, "plants": plants, "references": references}
    for name in ("plant", "reference", "controller", "progress", "torque"):
        if name in options:
            hint = f"Use {name}s={{'name': ...}}." if name != "torque" else ""
            raise InputError(Problem(name, "is not an argument of compare", hint=hint))
    for name, items in given.items():
        named = isinstance(items, Mapping) and all(isinstance(name, str) for name in items)
        if not named or not items:
            rule = "be a dictionary by name with at least one entry"
            raise InputError(Problem(name, rule, shown(items)))
    duration = check_positive("duration", duration)
    check_settling(settling, duration, references)
    loaded = {name: _with_loads(name, plant) for name, plant in plants.items()}
    everywhere = {name: options.pop(name, ()) for name in ("loads", "changes")}

    def one(controller: str, plant: str, reference: str) -> tuple[xr.Dataset, Reference]:
        simulated, own = loaded[plant]
        run: dict[str, Any] = {"plant": simulated, "reference": references[reference]}
        for (name, shared), kind in zip(everywhere.items(), (Load, Change), strict=True):
            more = [item for item in own if isinstance(item, kind)]
            # Pass what is not a list unchanged, so that simulate raises its own error.
            both = more and isinstance(shared, list | tuple)
            run[name] = [*shared, *more] if both else shared
        own_hardware = [item for item in own if isinstance(item, Hardware)]
        run["hardware"] = own_hardware[0] if own_hardware else hardware
        run |= {"progress": False, **options}
        chosen = controllers[controller]
        return simulate(arm, duration, controller=chosen, **run), references[reference]

    names = {"controller": list(controllers), "plant": list(plants), "reference": list(references)}
    evaluations = (evaluated(partial(one, *run), arm, settling) for run in runs_of(names))
    table = comparison(names, evaluations, progress)
    table.attrs["duration"] = duration
    return table


def check_settling(settling: object, duration: float, references: Mapping[str, Any]) -> None:
    """Raise if a settling time is not a time or leaves nothing of a run of ``duration`` (s).

    A motion that ends with the run or after it is accepted: its metrics after the motion are NaN.
    """
    rule = f"be at least 0 and less than the duration of {duration:g} s"
    left_out = check_number("settling", settling, lambda time: 0.0 <= time < duration, rule)
    for name, reference in references.items():
        end = check_array(f"end_time of {name!r}", getattr(reference, "end_time", duration), ())
        rest = duration - float(end)
        least = _ROUNDING * duration
        if rest > least and left_out > rest - least:
            rule = f"be less than the {rest:g} s of the run after the end of {name!r}"
            raise InputError(Problem("settling", rule, shown(settling)))


def _with_loads(name: str, plant: object) -> tuple[Arm, Sequence[Load | Change | Hardware]]:
    """Return a plant as its arm, and what is its own: loads, changes, hardware."""
    match plant:
        case Arm():
            return plant, ()
        case (Arm() as simulated, list() | tuple() as own):
            known = all(isinstance(item, Load | Change | Hardware) for item in own)
            if known and sum(isinstance(item, Hardware) for item in own) <= 1:
                return simulated, own
    rule = (
        "be an Arm, or a pair of an Arm and a list of Load and Change objects and at most one "
        "Hardware"
    )
    raise InputError(Problem(f"plants[{name!r}]", rule, shown(plant)))


def runs_of(names: Mapping[str, Sequence[str]]) -> list[tuple[str, ...]]:
    """Return the controller, plant and reference of all runs, in the order of the table."""
    return list(product(*(names[dim] for dim in _DIMS)))


def comparison(
    names: Mapping[str, Sequence[str]], evaluations: Iterable[Evaluation], progress: bool | None
) -> xr.Dataset:
    """Create the table of ``compare``."""
    shape = tuple(len(names[dim]) for dim in _DIMS)
    values = {metric.name: np.full(shape, np.nan) for metric in METRICS}
    failures, bent, unstable = np.full((3, *shape), "", dtype=object)
    with Meter("comparing", progress) as meter:
        for done, (index, found) in enumerate(zip(np.ndindex(shape), evaluations, strict=True)):
            # An invalid argument of the first run is invalid in all runs, a later one only in its
            # own run.
            if found.refusal is not None and done == 0:
                raise found.refusal
            unstable[index], failures[index] = found.unstable, found.failure
            bent[index] = found.warning
            for name, value in found.metrics.items():
                values[name][index] = value
            meter.update((done + 1) / int(np.prod(shape)))
    table = xr.Dataset(coords={dim: list(names[dim]) for dim in _DIMS})
    for metric in METRICS:
        labels = {"units": metric.unit, "long_name": metric.meaning}
        missing = np.isnan(values[metric.name]) & (failures == "")
        if metric.name in _AFTER and missing.any():
            labels["comment"] = MOVES_TO_THE_END
        table[metric.name] = (_DIMS, values[metric.name], labels)
    table["failure"] = (_DIMS, failures.astype(str))
    table["warning"] = (_DIMS, bent.astype(str))
    _warn(names, unstable)
    return table


class Evaluation(NamedTuple):
    """Metrics of one run."""

    metrics: Mapping[str, float] = {}  # by name; empty for a run that failed
    failure: str = ""  # why the run stopped early, or empty
    warning: str = ""  # warnings of a complete run, or empty
    unstable: str = ""  # the text on an unstable loop, or empty
    refusal: InputError | None = None  # of a run that could not start because of its arguments


def evaluated(
    run: Callable[[], tuple[xr.Dataset, Reference]], arm: Arm, settling: float
) -> Evaluation:
    """Simulate one run and return its metrics, also if it fails."""
    try:
        with without_warnings():  # kept with the numbers
            result, reference = run()
    except SimulationError as error:
        return Evaluation(failure=str(error), unstable=_unstable(error.result))
    except InputError as error:
        return Evaluation(failure=str(error), refusal=error)
    except FlexarmError as error:  # without an equilibrium or a reference
        return Evaluation(failure=str(error))
    unstable = _unstable(result)
    if result.attrs["ended_by"] != DURATION:  # metrics of a shorter run are not comparable
        failure = f"ended by the event {result.attrs['ended_by']!r}"
        return Evaluation(failure=failure, unstable=unstable)
    metrics = metrics_of(result, arm, reference, settling)
    texts = [result.attrs.get("slow_instability"), *warnings_of(result)]
    return Evaluation(metrics, "", " ".join(filter(None, texts)), unstable)


def inconsistent(result: xr.Dataset) -> bool:
    """Return whether the estimator of a run fails its consistency test."""
    return bool(result.attrs.get("estimator_consistent", 1) == 0)


def warnings_of(result: xr.Dataset) -> list[str]:
    """Return the warnings of a run, from the attributes of its result."""
    found = [str(result.attrs.get(name, "")) for name in ("unstable_loop", "warning")]
    found.append(exceeded_bound(result.attrs))
    return [text for text in found if text] + [INCONSISTENT] * inconsistent(result)


def _unstable(result: xr.Dataset | None) -> str:
    """Return the text on the unstable loop of a run, or empty text."""
    return "" if result is None else str(result.attrs.get("unstable_loop", ""))


def _warn(names: Mapping[str, Sequence[str]], unstable: Any) -> None:
    """Issue one warning for all runs whose loop is unstable."""
    runs = [tuple(index) for index in np.argwhere(unstable != "").tolist()]
    called = [
        " on ".join(repr(names[dim][k]) for dim, k in zip(_DIMS[:2], index[:2], strict=True))
        for index in runs
    ]
    if runs:
        text = f"{', '.join(dict.fromkeys(called))}: {unstable[runs[0]]}"
        warn_caller(text, UnstableLoopWarning)
