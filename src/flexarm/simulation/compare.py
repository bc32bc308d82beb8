"""One table of controllers, plants and references: ``flexarm.compare``."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.arguments import check_kind, check_positive
from flexarm.arm import Arm
from flexarm.control.base import Controller, Reference
from flexarm.engine.progress import Meter
from flexarm.errors import (
    AccuracyWarning,
    InconsistentEstimateWarning,
    InputError,
    LargeDeflectionWarning,
    Problem,
    SimulationError,
    UnstableLoopWarning,
    check_array,
    shown,
    warn_caller,
)
from flexarm.hardware.hardware import Hardware
from flexarm.loads import Load
from flexarm.model.events import DURATION
from flexarm.simulation.metrics import METRICS, metrics_of
from flexarm.simulation.run import simulate

if TYPE_CHECKING:
    import xarray as xr

#: Times that differ by less than this part of the run are one.
_ROUNDING = 1e-9
#: Warning of a run whose filter has failed its test.
INCONSISTENT = (
    "the estimator is inconsistent: its errors are larger than its covariance says. Correct its "
    "arm, or raise torque_noise or the noise of the instruments."
)
_DIMS = ("controller", "plant", "reference")
#: An arm that is simulated; with loads that act on it alone.
ComparedPlant = Arm | tuple[Arm, Sequence[Load]]


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
    """Run every controller on every plant along every reference, and return numbers of each run.

    Args:
        arm: what the controllers believe the arm to be.
        controllers: by name; the same objects serve all runs, reset before each.
        duration: of every run, s.
        references: motions by name.
        plants: arms that are really simulated, by name; None for the arm itself, as "nominal". A
            pair ``(arm, loads)`` is an arm with loads that act on it alone, beside those of the
            option ``loads``; no controller knows any of them.
        hardware: of every run, with the same seed: the noise is the same in all.
        settling: s after the end of a motion that the numbers of the time after it leave out;
            shorter than the run.
        progress: True or False shows or hides the bar.
        options: further arguments of ``flexarm.simulate``, the same for all runs.

    Returns:
        Dataset (controller, plant, reference) of ``flexarm.simulation.metrics.METRICS``, and
        ``failure``: why a run stopped early, or empty. Numbers of a run that stopped are NaN.
        ``warning``: what a run warns of (`simulate`, and an inconsistent estimator), or empty.

    Raises:
        InputError: no controllers or references, a plant that is neither an arm nor an arm with
            loads, a settling that leaves nothing, or what ``simulate`` refuses.

    Warns:
        UnstableLoopWarning: the sampled loop of a run is unstable, as in ``simulate``; ``warning``
            says which.
    """
    where = "compare"
    arm = check_kind(where, "arm", arm, Arm)
    plants = {"nominal": arm} if plants is None else plants
    given = {"controllers": controllers, "plants": plants, "references": references}
    for name in ("plant", "reference", "controller", "progress", "torque"):
        if name in options:
            rule = (
                f"be left out: compare takes {name}s by name" if name != "torque" else "be left out"
            )
            raise InputError(Problem(where, name, rule, "given"))
    for name, items in given.items():
        if not isinstance(items, Mapping) or not items or not all(map(_is_word, items)):
            rule = "be a dictionary by name, with one entry at least"
            raise InputError(Problem(where, name, rule, shown(items)))
    duration = check_positive(where, "duration", duration)
    check_settling(where, settling, duration, references)
    loaded = {name: _with_loads(name, plant) for name, plant in plants.items()}
    everywhere = options.pop("loads", ())

    def one(controller: str, plant: str, reference: str) -> tuple[xr.Dataset, Reference]:
        simulated, own = loaded[plant]
        run: dict[str, Any] = {"plant": simulated, "reference": references[reference]}
        # What is no list goes on as it is, for simulate to refuse.
        both = own and isinstance(everywhere, list | tuple)
        run |= {"loads": [*everywhere, *own] if both else everywhere}
        run |= {"hardware": hardware, "progress": False, **options}
        chosen = controllers[controller]
        return simulate(arm, duration, controller=chosen, **run), references[reference]

    names = {"controller": list(controllers), "plant": list(plants), "reference": list(references)}
    table = comparison(arm, names, one, settling, progress)
    table.attrs["duration"] = duration
    return table


def _is_word(name: object) -> bool:
    return isinstance(name, str)


def check_settling(
    where: str, settling: object, duration: float, references: Mapping[str, Any]
) -> None:
    """Refuse what is no time, or one that leaves nothing of a run of ``duration`` (s) to judge.

    A motion that ends with the run or after it is accepted: what is judged after it stays empty.

    Raises:
        InputError: so it is.
    """
    left_out = float(check_array(where, "settling", settling, ()))
    if not 0.0 <= left_out < duration:
        rule = f"be at least 0 and less than the duration of {duration:g} s"
        raise InputError(Problem(where, "settling", rule, shown(settling)))
    for name, reference in references.items():
        end = check_array(
            where, f"end_time of {name!r}", getattr(reference, "end_time", duration), ()
        )
        rest = duration - float(end)
        least = _ROUNDING * duration
        if rest > least and left_out > rest - least:
            rule = f"be less than the {rest:g} s that the run goes on after {name!r} has ended"
            raise InputError(Problem(where, "settling", rule, shown(settling)))


def _with_loads(name: str, plant: object) -> tuple[Arm, Sequence[Load]]:
    """Return a plant as its arm and the loads that act on it alone."""
    match plant:
        case Arm():
            return plant, ()
        case (Arm() as simulated, list() | tuple() as loads):
            if all(isinstance(load, Load) for load in loads):
                return simulated, loads
    rule = "be an Arm, or a pair of an Arm and a list of Load objects"
    raise InputError(Problem("compare", f"plants[{name!r}]", rule, shown(plant)))


def comparison(
    arm: Arm,
    names: Mapping[str, Sequence[str]],
    run: Callable[[str, str, str], tuple[xr.Dataset, Reference]],
    settling: float,
    progress: bool | None,
) -> xr.Dataset:
    """Make the table of ``compare`` from a function that runs one combination of names.

    Args:
        names: of controllers, plants and references.
        run: from one name of each to the result and the reference to judge it by.
    """
    import xarray as xr

    shape = tuple(len(names[dim]) for dim in _DIMS)
    values = {metric.name: np.full(shape, np.nan) for metric in METRICS}
    failures, bent, unstable = np.full((3, *shape), "", dtype=object)
    with Meter("comparing", progress) as meter:
        for done, index in enumerate(np.ndindex(shape)):
            meter.update(done / int(np.prod(shape)))
            chosen = [names[dim][k] for dim, k in zip(_DIMS, index, strict=True)]
            try:
                with warnings.catch_warnings():  # kept with the numbers
                    for kind in (
                        AccuracyWarning,
                        InconsistentEstimateWarning,
                        LargeDeflectionWarning,
                        UnstableLoopWarning,
                    ):
                        warnings.simplefilter("ignore", kind)
                    result, reference = run(*chosen)
            except (SimulationError, InputError) as error:
                unstable[index] = _unstable(getattr(error, "result", None))
                # What is wrong with the first run is wrong with all; with a later one, only there.
                if isinstance(error, InputError) and done == 0:
                    raise
                failures[index] = str(error)
                continue
            unstable[index] = _unstable(result)
            if result.attrs["ended_by"] != DURATION:  # its numbers would flatter it
                failures[index] = f"ended by the event {result.attrs['ended_by']!r}"
                continue
            told = [unstable[index], result.attrs["warning"]]
            told += [INCONSISTENT] * inconsistent(result)
            bent[index] = " ".join(item for item in told if item)
            for name, value in metrics_of(result, arm, reference, settling).items():
                values[name][index] = value
    table = xr.Dataset(coords={dim: list(names[dim]) for dim in _DIMS})
    for metric in METRICS:
        labels = {"units": metric.unit, "long_name": metric.meaning}
        table[metric.name] = (_DIMS, values[metric.name], labels)
    table["failure"] = (_DIMS, failures.astype(str))
    table["warning"] = (_DIMS, bent.astype(str))
    _warn(names, unstable)
    return table


def inconsistent(result: xr.Dataset) -> bool:
    """Tell whether the filter of a run has failed its test."""
    return bool(result.attrs.get("estimator_consistent", 1) == 0)


def _unstable(result: xr.Dataset | None) -> str:
    """Return how the loop of a run is unstable, or nothing."""
    return "" if result is None else str(result.attrs.get("unstable_loop", ""))


def _warn(names: Mapping[str, Sequence[str]], unstable: Any) -> None:
    """Warn once of all runs whose loop is unstable."""
    runs = [tuple(index) for index in np.argwhere(unstable != "").tolist()]
    called = [
        " on ".join(repr(names[dim][k]) for dim, k in zip(_DIMS[:2], index[:2], strict=True))
        for index in runs
    ]
    if runs:
        text = f"{', '.join(dict.fromkeys(called))}: {unstable[runs[0]]}"
        warn_caller(text, UnstableLoopWarning)
