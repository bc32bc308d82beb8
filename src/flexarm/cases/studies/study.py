"""Studies: all drives on all plants along all motions, for all samples of uncertain numbers."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_choice, check_path
from flexarm.base.errors import (
    FlexarmWarning,
    InputError,
    Problem,
    public_call,
    shown,
    warn_caller,
)
from flexarm.base.late import xr
from flexarm.base.processes import check_workers
from flexarm.cases.scenario.file_errors import Where, problems_at
from flexarm.cases.scenario.study import PreparedStudy
from flexarm.cases.studies.execution import (
    RECORDED,
    Executor,
    Outcomes,
    check_client,
    cluster,
    execute,
    executor_of,
    table_of,
)
from flexarm.cases.studies.rare import rare_failures
from flexarm.cases.studies.store import (
    Ending,
    Store,
    check_versions,
    checksum,
    create_store,
    opened,
    versions,
)
from flexarm.kernels.compilation.cache import compile_seconds
from flexarm.kernels.compilation.packs import LANES
from flexarm.model import StudySpec, file_text, locate_study
from flexarm.model.checks import checked_arguments
from flexarm.model.plausible import implausible, warn_of
from flexarm.model.quantities import Count, CountOrZero, Flag, Workers
from flexarm.model.scenarios.study import RareFailures
from flexarm.simulation.batch.lanes import arm_fits_lanes
from flexarm.simulation.run.progress import Meter

#: Duration of a task (s), long compared with what a scheduler and a store need for it; number of
#: tasks for each worker, so that all end at about the same time, unless they get too short.
TASK_SECONDS, TASKS_PER_WORKER, LEAST_SECONDS = 1.0, 8, 0.2
_MOST_CHUNK = 4096
#: Longest task (s) of samples that take long: up to it, samples are given out to fill the lanes.
_LONGEST_SECONDS = 60.0
#: Duration of a sample (s) below which more of them are measured, and duration of a measurement
#: above which the time to load compiled code makes little difference.
_SHORT, _LONG = 0.02, 10.0


class Study:
    """A study: all drives on all plants along all motions, for all samples of varied numbers.

    Args:
        study: path of a study file, or its content as a dictionary; ``arm`` may be an `Arm`.

    Attributes:
        samples: number of samples, of which `samples.stop` may leave out some. runs: number of
            runs, those of all samples. spec: the study as a record.

    Raises:
        ModelError: if the study is not valid; it lists every problem.
        InputError: if a motion leaves the arm's reach, a drive does not fit the arm, or a path of
            ``vary`` leads to no number.

    Warns:
        FlexarmWarning: if the number of Sobol samples is not a power of two.
        ImplausibleValueWarning: if numbers of the arm look like those of another unit.
    """

    @public_call
    def __init__(self, study: str | os.PathLike[str] | Mapping[str, Any] | StudySpec) -> None:
        spec, place = _located(study)
        self._text = file_text(spec)
        self._prepared = PreparedStudy(spec, place)
        self._executor = Executor(self._prepared, place)
        self.spec = spec
        _warn_of_unbalanced(spec)
        warn_of(implausible(spec.arm))
        self.samples = self._executor.samples.count
        self.runs = self.samples * int(np.prod(self._executor.shape))
        self._ending = Ending(spec.samples, self.samples)
        if spec.samples is not None and spec.samples.stop is not None:
            with problems_at(place, "samples.stop"):
                names = [metric.name for metric in RECORDED]
                check_choice("metric", spec.samples.stop.metric, names)

    def __repr__(self) -> str:
        return f"<flexarm.Study: {self.samples} samples, {self.runs} runs>"

    @public_call
    def run(
        self,
        store: str | os.PathLike[str] | None = None,
        client: Any = None,
        *,
        resume: Flag = False,
        workers: int | None = None,
        chunk: Count | None = None,
        progress: bool | None = None,
    ) -> xr.Dataset:
        """Execute all runs and return their metrics.

        Args:
            store: folder for the results, which all workers reach, in the format Zarr; None keeps
                them in memory.
            client: a ``distributed.Client``, or the address of a scheduler of Dask, such as
                ``"tcp://host:8786"``; None for processes of this computer.
            resume: whether a store that exists is continued; otherwise it is an error.
            workers: number of those processes, by default one for each core; 1 uses none but this.
            chunk: samples of a task; by default from the measured duration of the first ones.
            progress: True or False shows or hides the bar. By default a terminal shows it, and
                other streams get a line from time to time.

        Returns:
            Dataset (sample, controller, plant, reference) with the metrics of ``compare`` without
            the computing times. The metrics of a run that failed are NaN. ``failure`` is its
            reason, or empty; ``warning`` likewise, and ``infeasible`` for a run whose numbers are
            not possible, such as a negative mass. The varied numbers are coordinates of
            ``sample``, by their paths.

        Warns:
            AccuracyWarning: if all samples do not suffice for the precision of `samples.stop`.

        Raises:
            InputError: if the first run cannot start, the store exists, belongs to another study
                or to other versions of the software, or cannot be written, or a package of the
                extra ``cluster`` is missing.

        The numbers do not depend on ``chunk``, on the number of workers, nor on interruptions: a
        study that was killed and resumed leaves the same files as one that was not. In a script,
        processes require the guard ``if __name__ == "__main__":``.
        """
        processes = check_workers("workers", workers)
        if client is not None and workers is not None:
            raise InputError(Problem("workers", "cannot be combined with client"))
        check_client(client)
        place = None if store is None else check_path("store", store)
        if place is not None and place.exists():
            kept = self._existing(place, resume)
        else:
            size = min(self._ending.decisions[0], chunk or self._measured_chunk(processes))
            if place is None:
                return self._in_memory(size, client, processes, progress)
            kept = create_store(place, self._text, self._executor, self._prepared.names, size)
        path = str(kept.path.resolve())

        def task(i: int) -> tuple[Any, ...]:
            return record_chunk, path, kept.digest, i

        self._execute(kept.lacking, task, lambda *_: None, client, processes, progress)
        kept.clean()
        self._ending.warn(kept.metrics(kept.lacking()[0]))
        return kept.table()

    @public_call
    def nominal(self, *, workers: Workers = 1, progress: bool | None = None) -> xr.Dataset:
        """Run the study once with the numbers of its file, without variation.

        Args:
            workers: number of processes if the runs take long; None for one for each core.
            progress: True or False shows or hides the bar.

        Returns:
            The table of ``compare``, with the drives as controllers.

        Raises:
            InputError: if the first run cannot start.
        """
        return self._prepared.run(progress, workers or 1)

    @public_call
    def rare_failures(
        self,
        limits: Mapping[str, float] | None = None,
        *,
        samples: int | None = None,
        seed: int | None = None,
        workers: int | None = 1,
        progress: bool | None = None,
    ) -> xr.Dataset:
        """Return the probability of failures that are too rare for samples, down to 1e-8.

        Args:
            limits: largest acceptable values of metrics by name; a run that exceeds one, whose
                metric is NaN, or which failed, is a failure. Default of these three arguments: the
                values of the key `rare_failures`.
            samples: of each level, at least 100; a probability of 1e-4 takes four levels.
            seed: of the samples.
            workers: number of processes, which the numbers do not depend on; None for one for each
                core.
            progress: True or False shows or hides the bar, which assumes a probability of 1e-8.

        Returns:
            Dataset over controller, plant and reference: ``probability`` among the possible runs,
            0 below 1e-8; the limits ``probability_low`` and ``probability_high`` of its 95 %
            interval; ``variation``, its coefficient of variation; ``runs``, their number.

        Raises:
            InputError: if no numbers vary, there is no such metric or a limit is not positive.

        Warns:
            AccuracyWarning: if no metric with a limit rises towards the failures: the probability
                is NaN.

        The method is subset simulation (Au and Beck, Probabilistic Engineering Mechanics 16, 2001)
        with adaptive conditional samples. Its runs follow from the seed and stay in memory.
        """
        processes = check_workers("workers", workers)
        given = {"limits": limits, "samples": samples, "seed": seed}
        changes = {name: value for name, value in given.items() if value is not None}
        rare = checked_arguments(RareFailures, **{**dict(self.spec.rare_failures or {}), **changes})
        names = [metric.name for metric in RECORDED]
        for name in rare.limits:
            check_choice("limits", name, names)
        if not self._executor.samples.paths:
            raise InputError(Problem("study", "has no varied numbers"))
        return rare_failures(self._text, self._prepared.names, rare, processes, progress)

    @public_call
    def verify(
        self, store: str | os.PathLike[str], count: Count = 10, seed: CountOrZero = 0
    ) -> list[int]:
        """Repeat random samples of a store and return the numbers of those that differ.

        Args:
            store: folder of the results.
            count: number of samples to repeat.
            seed: of their choice.

        Raises:
            InputError: if the store belongs to another study or to other versions of the software,
                or a recorded chunk is missing or damaged.
        """
        kept = self._existing(check_path("store", store), True)
        samples, missing = kept.lacking()
        count = min(count, samples)
        if missing:
            rule = f"has {len(missing)} of {kept.chunks} chunks missing or damaged"
            raise InputError(Problem("store", rule, hint="Resume the study."))
        random = np.random.default_rng(seed)
        chosen = np.sort(random.choice(samples, count, replace=False)).tolist()
        return [k for k in chosen if not self._repeats(kept, k)]

    def _repeats(self, kept: Store, k: int) -> bool:
        """Return whether sample k has the same numbers again."""
        i, offset = divmod(k, kept.chunk)
        before = kept.read(i).at(slice(offset, offset + 1))
        return checksum(before) == checksum(self._executor.outcomes(k, k + 1))

    def _existing(self, place: Path, resume: bool) -> Store:
        """Return a store of this study that exists."""
        if not resume:
            hint = "Continue it with resume=True (--resume), or name another folder."
            raise InputError(Problem("store", f"{shown(str(place))} exists", hint=hint))
        kept = Store(place)
        if kept.text != self._text:
            raise InputError(Problem("store", f"{shown(str(place))} belongs to another study"))
        check_versions(kept)
        return kept

    def _measured_chunk(self, workers: int) -> int:
        """Return the number of samples of a task, from the duration of the first samples."""
        per_sample = self._measured_seconds(1)
        if per_sample < _SHORT:  # runs of several samples in lanes take less
            per_sample = self._measured_seconds(min(LANES, self.samples))
        longest, least = TASK_SECONDS / per_sample, LEAST_SECONDS / per_sample
        size = min(longest, max(self.samples / (TASKS_PER_WORKER * workers), least))
        if any(map(arm_fits_lanes, self._prepared.plants.values())):
            # In lanes, eight samples may take little longer than one.
            size = max(size, min(LANES, self.samples / workers, _LONGEST_SECONDS / per_sample))
        return int(2 ** np.floor(np.log2(min(max(size, 1.0), _MOST_CHUNK))))

    def _measured_seconds(self, count: int) -> float:
        """Return the duration of a sample, s, if ``count`` of them are executed together."""
        seconds = 0.0
        for _ in range(2):  # the first execution loads compiled code, or compiles it
            started = time.perf_counter() - compile_seconds()
            self._executor.outcomes(0, count)
            seconds = time.perf_counter() - compile_seconds() - started
            if seconds > _LONG:
                break
        return max(seconds / count, 1e-6)

    def _in_memory(
        self, chunk: int, client: Any, workers: int, progress: bool | None
    ) -> xr.Dataset:
        """Execute all runs without a store."""
        parts: dict[int, Outcomes] = {}

        def outcomes(size: int) -> Outcomes:
            chunks = zip(*(parts[i] for i in range(-(-size // chunk))), strict=True)
            return Outcomes(*map(np.concatenate, chunks)).at(slice(0, size))

        def lacking() -> tuple[int, list[int]]:
            return self._ending.lacking(
                lambda size: [i for i in range(-(-size // chunk)) if i not in parts],
                lambda size: outcomes(size).metrics,
            )

        def task(i: int) -> tuple[Any, ...]:
            return outcomes_of, self._text, i * chunk, min((i + 1) * chunk, self.samples)

        self._execute(lacking, task, parts.__setitem__, client, workers, progress)
        size = lacking()[0]
        names, paths = self._prepared.names, self._executor.samples.paths
        attributes = {"study": self._text, **versions()}
        self._ending.warn(outcomes(size).metrics)
        return table_of(outcomes(size), np.arange(size), names, paths, attributes)

    def _execute(
        self,
        lacking: Callable[[], tuple[int, list[int]]],
        task: Callable[[int], tuple[Any, ...]],
        done: Callable[[int, Any], object],
        client: Any,
        workers: int,
        progress: bool | None,
    ) -> None:
        """Execute chunks in this process or on a cluster, until none is lacking."""
        with ExitStack() as stack:
            connected, before = None, list[int]()
            while (chunks := lacking()[1]) and chunks != before:
                before = chunks
                tasks = [task(i) for i in chunks]
                local = client is None and (workers == 1 or len(chunks) < 2)
                if not local and connected is None:
                    connected = stack.enter_context(cluster(client, min(workers, len(chunks))))
                with Meter("simulating", progress, lines=True) as meter:
                    report = partial(_report, meter, chunks, done, count(1))
                    if local:
                        for place, (function, *arguments) in enumerate(tasks):
                            report(place, function(*arguments))
                    else:
                        execute(connected, tasks[0][0], [tuple(own[1:]) for own in tasks], report)


def _report(
    meter: Meter,
    chunks: list[int],
    done: Callable[[int, Any], object],
    counted: Iterator[int],
    place: int,
    result: Any,
) -> None:
    done(chunks[place], result)
    meter.update(next(counted) / len(chunks))


def record_chunk(path: str, digest: str, i: int) -> None:
    """Execute chunk i of the store with a digest at a path, and record it."""
    store = opened(path, digest)
    samples = store.range_of(i)
    store.write(i, executor_of(store.text).outcomes(samples.start, samples.stop))


def outcomes_of(text: str, start: int, stop: int) -> Outcomes:
    """Execute samples of the study with a text."""
    return executor_of(text).outcomes(start, stop)


@public_call
def read_study(store: str | os.PathLike[str]) -> xr.Dataset:
    """Return the results in a store of a study, those that are recorded so far.

    Returns:
        The dataset of `Study.run`; its attributes contain the study as a file, and the versions.

    Raises:
        InputError: if the folder is not a store of a study.

    Warns:
        FlexarmWarning: if files of recorded chunks are missing or damaged; the dataset leaves
            these chunks out.
    """
    kept = Store(check_path("store", store))
    return kept.table()


def _warn_of_unbalanced(study: StudySpec) -> None:
    """Warn if the number of Sobol samples is not a power of two."""
    plan = study.samples
    if plan is None or plan.method != "sobol" or plan.count is None:
        return
    if plan.count & (plan.count - 1):
        below = 2 ** (plan.count.bit_length() - 1)
        text = f"samples.count {plan.count} is not a power of two: such parts of a Sobol sequence"
        advice = f"cover their range unevenly. Use {below} or {2 * below}."
        warn_caller(f"{text} {advice}", FlexarmWarning)


def _located(study: object) -> tuple[StudySpec, Where]:
    if isinstance(study, StudySpec):
        return study, lambda _: "study"
    if isinstance(study, Mapping):
        content = dict(study)
        if not all(isinstance(key, str) for key in content):
            raise InputError(Problem("study", "have text as keys", shown(content)))
        if isinstance(content.get("arm"), Arm):
            content["arm"] = content["arm"].spec
        return checked_arguments(StudySpec, **content), lambda _: "study"
    return locate_study(check_path("study", study))
