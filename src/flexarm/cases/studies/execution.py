"""Execution of the samples of a study, also by the workers of a Dask cluster, and their table."""

from __future__ import annotations

import logging
import re
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property, lru_cache, partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.base.arguments import library_missing
from flexarm.base.errors import FlexarmError, FlexarmWarning, InputError, Problem, shown
from flexarm.base.late import xr
from flexarm.cases.scenario.file_errors import Where
from flexarm.cases.scenario.study import PreparedStudy
from flexarm.cases.studies.samples import Samples, in_study
from flexarm.integrate.base import FloatArray
from flexarm.model import ArmSpec, StudySpec
from flexarm.model.file_format.files import record_of_bytes
from flexarm.model.paths import with_numbers
from flexarm.model.scenarios.scenario import DURATION, recording_rate
from flexarm.model.scenarios.study import plant_spec
from flexarm.simulation.batch.run import simulate_batch
from flexarm.simulation.calls.compare import Evaluation, evaluated
from flexarm.simulation.calls.metrics import METRICS

#: Dimensions of a run in a study.
DIMS = ("sample", "controller", "plant", "reference")


def table_of(
    outcomes: Outcomes,
    numbers: NDArray[np.int64],
    names: Mapping[str, Sequence[str]],
    paths: Sequence[str],
    attributes: Mapping[str, Any],
) -> xr.Dataset:
    """Return the labelled dataset of outcomes."""
    table = xr.Dataset(attrs=dict(attributes))
    label = {"long_name": "sample, counted from 0"}
    table = table.assign_coords({"sample": ("sample", numbers, label)})
    table = table.assign_coords({dim: list(own) for dim, own in names.items()})
    for j, path in enumerate(paths):
        label = {"long_name": f"{path} of the sample"}
        table = table.assign_coords({path: ("sample", outcomes.parameters[:, j], label)})
    for j, metric in enumerate(RECORDED):
        labels = {"units": metric.unit, "long_name": metric.meaning}
        table[metric.name] = (DIMS, outcomes.metrics[..., j], labels)
    texts = outcomes.failure.astype(str)
    absent = np.char.startswith(texts, INFEASIBLE)
    reasons = [text.removeprefix(INFEASIBLE) for text in np.where(absent, texts, "").flat]
    table["failure"] = (DIMS, np.where(absent, "", texts), {"long_name": "why a run failed"})
    label = {"long_name": "why the numbers of a run are not possible"}
    table["infeasible"] = (DIMS, np.array(reasons, dtype=str).reshape(texts.shape), label)
    table["warning"] = (DIMS, outcomes.warning.astype(str), {"long_name": "warnings of a run"})
    return table


#: Tasks that wait or run for each thread of the cluster, so that no worker idles between two.
_AHEAD = 3
#: How often a chunk may end with its workers, each time after three attempts of Dask.
_MOST_LOSSES = 3


def check_client(client: object) -> None:
    """Raise if a value is neither a client of Dask, nor an address, nor None."""
    if client is None:
        return
    rule = "be a Client of Dask or the address of a scheduler"
    hint = "An address is text such as 'tcp://host:8786'."
    distributed = _distributed()
    if isinstance(client, str):
        right = re.fullmatch(r"\w+://[^\s/]+:\d+", client) is not None
    else:
        right = isinstance(client, distributed.Client)
    if not right:
        raise InputError(Problem("client", rule, shown(client), hint))


def _distributed() -> Any:
    try:
        import distributed
    except ImportError:
        raise library_missing("distributed", "cluster") from None
    return distributed


@contextmanager
def cluster(client: object, workers: int) -> Iterator[Any]:
    """Provide a client of Dask, or ``workers`` processes of this computer."""
    distributed = _distributed()
    if client is None:
        # One thread for each process: most of a run is Python code, and threads take turns at it.
        try:
            local = distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                memory_limit=None,
                silence_logs=logging.ERROR,
                # Not the default port, which may be in use: Dask would warn.
                dashboard_address="127.0.0.1:0",
                worker_dashboard_address="127.0.0.1:0",
                scheduler_kwargs={"dashboard": False},
            )
        except RuntimeError:
            hint = 'A script needs the guard `if __name__ == "__main__":`; workers=1 does not.'
            raise InputError(Problem("workers", "could not be started", hint=hint)) from None
        with local, distributed.Client(local) as own:
            yield own
    elif isinstance(client, str):
        try:
            connected = distributed.Client(client)
        except OSError:
            rule = "be the address of a scheduler that runs"
            raise InputError(Problem("client", rule, shown(client))) from None
        with connected:
            yield connected
    else:
        yield client


def execute(
    client: Any,
    task: Callable[..., Any],
    arguments: Sequence[tuple[Any, ...]],
    done: Callable[[int, Any], None],
) -> None:
    """Call ``task`` with each of ``arguments`` on a cluster; ``done`` gets place and result."""
    from distributed import CancelledError, KilledWorker, as_completed

    completed: Any = as_completed  # without annotations
    waiting, places, losses = completed(), {}, Counter[int]()
    left = iter(range(len(arguments)))

    def submit(place: int) -> None:
        future = client.submit(task, *arguments[place], pure=False)
        places[future.key] = place
        waiting.add(future)

    def fill() -> None:
        most = _AHEAD * max(1, sum(client.nthreads().values()))
        while len(places) < most and (place := next(left, None)) is not None:
            submit(place)

    fill()
    for future in waiting:
        place = places.pop(future.key)
        try:
            result = future.result()
        except KilledWorker:
            losses[place] += 1
            if losses[place] >= _MOST_LOSSES:
                rule = f"ended the process of each worker that executed task {arguments[place]}"
                hint = "Its memory may not suffice."
                raise InputError(Problem("study", rule, hint=hint)) from None
            submit(place)
            continue
        except CancelledError:
            hint = "Resume the study."
            raise InputError(Problem("client", "has lost its scheduler", hint=hint)) from None
        finally:
            future.release()
        done(place, result)
        fill()


#: Recorded metrics. The computing time of controllers differs from run to run.
RECORDED = tuple(metric for metric in METRICS if metric.name != "controller_time")
#: Samples that are simulated together, in the lanes of ``simulate_batch`` where it has them.
_TOGETHER = 128
#: Beginning of the recorded failure of a run whose numbers no arm or file can have, such as a
#: negative mass. It is no failure of a controller.
INFEASIBLE = "infeasible: "
#: Code that is compiled in the middle of a run may differ in the last digits.
_EXACT = {"specialized": False}


class Outcomes(NamedTuple):
    """Results of consecutive samples."""

    parameters: FloatArray  # (samples, parameters), the values of the varied numbers
    #: (samples, controllers, plants, references, metrics) of ``RECORDED``; NaN for a run that
    #: failed
    metrics: FloatArray
    #: (samples, controllers, plants, references) texts, or empty; the failure of an infeasible
    #: run begins with ``INFEASIBLE``
    failure: NDArray[np.object_]
    warning: NDArray[np.object_]  # likewise

    def at(self, part: slice | NDArray[np.bool_]) -> Outcomes:
        """Return a part of the samples."""
        return Outcomes(
            self.parameters[part], self.metrics[part], self.failure[part], self.warning[part]
        )


class Executor:
    """Runs of a study."""

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
        for first in range(0, count, _TOGETHER):
            rows = range(first, min(first + _TOGETHER, count))
            samples = {k: self._sample(found.parameters[k]) for k in rows}
            for index, chosen in zip(np.ndindex(self.shape), runs, strict=True):
                for k, one in self._evaluations(samples, start, chosen):
                    place = (k, *index)
                    for j, metric in enumerate(RECORDED):
                        found.metrics[(*place, j)] = one.metrics.get(metric.name, np.nan)
                    found.failure[place] = one.failure
                    found.warning[place] = one.warning or one.unstable
        return found

    def performances(
        self, values: FloatArray, first: int, chosen: tuple[str, str, str], limits: dict[str, float]
    ) -> FloatArray:
        """Return the largest metric of a run for each sample, divided by its limit.

        Returns:
            (samples,), infinite for a run that failed or has no value, -inf for an infeasible one.
        """
        found = np.full(len(values), -np.inf)
        for start in range(0, len(values), _TOGETHER):
            rows = range(start, min(start + _TOGETHER, len(values)))
            samples = {k: self._sample(values[k]) for k in rows}
            for k, one in self._evaluations(samples, first, chosen):
                if one.failure.startswith(INFEASIBLE):
                    continue
                ratios = [one.metrics.get(name, np.nan) / most for name, most in limits.items()]
                failed = bool(one.failure) or bool(np.isnan(ratios).any())
                found[k] = np.inf if failed else max([0.0, *ratios])
        return found

    def _sample(self, values: FloatArray) -> _Sample:
        named = dict(zip(self.samples.paths, values.tolist(), strict=True))
        return _Sample(self._prepared, named)

    def _evaluations(
        self, samples: Mapping[int, _Sample], start: int, chosen: tuple[str, str, str]
    ) -> Iterator[tuple[int, Evaluation]]:
        """Execute one run of each sample; ``chosen``: its drive, plant and motion."""
        cases = []
        for k, sample in samples.items():
            try:
                simulated, seed = sample.simulated(chosen[1]), self.samples.noise_seed(start + k)
            except InputError as error:
                yield k, Evaluation(failure=INFEASIBLE + str(error))
                continue
            try:
                cases.append(Case(k, sample.prepared, simulated, seed))
            except FlexarmError as error:  # for example, there is no reference for these values
                yield k, Evaluation(failure=str(error))
        together = evaluated_together(cases, *chosen)
        for case in cases:
            k = case.number
            yield k, together.get(k) or self._alone(case, chosen)

    def _alone(self, case: Case, chosen: tuple[str, str, str]) -> Evaluation:
        """Execute one run by ``simulate``."""
        prepared, instead = case.prepared, dict[str, Any](_EXACT)
        hardware = prepared.hardware_of(chosen[1])
        if case.seed is not None and hardware is not None and prepared.controlled(chosen[0]):
            instead["hardware"] = hardware.replace(seed=case.seed)
        run = partial(prepared.one, *chosen, case.simulated, **instead)
        return evaluated(run, prepared.arm, prepared.study.run.settling)


class _Sample:
    """One sample of a study: its file and its simulated arms, created when they are needed."""

    def __init__(self, study: PreparedStudy, values: Mapping[str, float]) -> None:
        self._study = study
        self._own = {path: value for path, value in values.items() if in_study(path)}
        self._of_arm = {path: value for path, value in values.items() if path not in self._own}
        self._arms: dict[str, Arm] = {}

    @cached_property
    def study(self) -> StudySpec:
        """The file with the numbers of the sample."""
        return with_numbers(self._study.study, self._own)

    @cached_property
    def prepared(self) -> PreparedStudy:
        """The study, ready to run; FlexarmError if it does not fit the numbers of the sample."""
        return PreparedStudy(self.study) if self._own else self._study

    def simulated(self, plant: str) -> Arm | None:
        """Return the simulated arm if it differs from that of the plant in the file."""
        study = self.study
        if not self._of_arm:
            return None
        if plant not in self._arms:
            self._arms[plant] = Arm(plant_spec(self._spec, study.plants[plant]))
        return self._arms[plant]

    @cached_property
    def _spec(self) -> ArmSpec:
        return with_numbers(self.study.arm, self._of_arm)


@lru_cache(maxsize=2)
def executor_of(text: str) -> Executor:
    """Return the executor of the text of a study, kept because a process executes many chunks."""
    study = record_of_bytes(text.encode(), "the study")
    assert isinstance(study, StudySpec)
    return Executor(PreparedStudy(study))


#: Arguments of a run that may differ from those of the others of its call, and the other ones.
_OWN = ("torque", "controller", "reference", "initial", "initial_rate")
_SHARED = ("duration", "rate", "stations", "integrator", "loads", "hardware")
#: Channels from which the metrics of runs without contacts are computed, and the largest memory of
#: the channels of a call (bytes).
_CHANNELS, _MEMORY = ("tip", "joint_angle", "torque"), 2**26


class Case(NamedTuple):
    """One run of a study."""

    number: int  # of the sample
    prepared: PreparedStudy  # study of the sample
    simulated: Arm | None  # arm in place of that of the plant, or None
    seed: int | None  # of the noise, or None for that of the hardware


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
        span = shared["duration"]
        samples = span * recording_rate(shared.get("rate"), span) + 1.0
        width = 2 + 2 * group[0][0].prepared.arm.n_joints
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
    names: tuple[str, ...] = _CHANNELS
    if group[0][0].prepared.arm.spec.base.free:
        names = (*names, "base_position")
    try:
        with warnings.catch_warnings():  # kept with the numbers
            warnings.simplefilter("ignore", FlexarmWarning)
            batch = simulate_batch(
                group[0][0].prepared.arm,
                **shared,
                **{name: _joined(items) for name, items in own.items()},
                plant=[arguments["plant"] for _, arguments in group],
                seeds=seeds or None,
                channels=names,
                threads=1,
                progress=False,
            )
    except InputError:  # the run alone says why
        return {}
    times = batch["time"].values
    channels = {name: batch[name].values for name in names}
    ends, texts = batch["ended_by"].values, batch["warning"].values
    found = {}
    for row, (case, _) in enumerate(group):
        if ends[row] == DURATION:
            goal = case.prepared.goal(drive, motion, times)
            metrics = goal.metrics({name: values[row] for name, values in channels.items()})
            for name, channel in (("saturation", "saturation"), ("growth", "loop_growth")):
                if channel in batch:
                    metrics[name] = float(batch[channel].values[row].max())
            found[case.number] = Evaluation(metrics, warning=str(texts[row]))
    return found


def _joined(items: Sequence[Any]) -> Any:
    """Return the argument of ``simulate_batch`` for those of single runs."""
    if all(item is items[0] for item in items):
        return items[0]
    return np.stack(items) if isinstance(items[0], np.ndarray) else list(items)
