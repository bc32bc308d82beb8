"""Numbers of the section "Scale" of docs/how-to/run-on-a-cluster.md: costs of a study.

python docs/performance/measure_scale.py [check]

Measures the processor time of a run, of the recording of a chunk and of a task of Dask, and
computes a study of 1e9 runs. With ``check``, on an idle computer, it predicts the duration of a
study with 1, 2 and 4 workers, and measures it.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import flexarm as fa
from flexarm.base.processes import usable_cores
from flexarm.cases.studies.execution import cluster, execute, executor_of
from flexarm.cases.studies.store import create_store
from flexarm.cases.studies.study import outcomes_of, record_chunk

LINK = {"flexural_rigidity": 40.0, "mass_per_length": 0.5, "elements": 1}
STUDY: dict[str, Any] = {
    "arm": {
        "links": [{"length": 1.0, **LINK}, {"length": 0.8, **LINK}],
        "joints": [{"hub_inertia": 0.1}, {"mass": 0.3, "hub_inertia": 0.02}],
        "payload": {"mass": 0.1},
    },
    "motions": {"line": {"kind": "line", "start": [1.4, 0.5], "end": [1.0, 1.0], "duration": 1.0}},
    "drives": {"torque": {"kind": "rigid_inverse_dynamics"}},
    "vary": {"payload.mass": {"kind": "uniform", "low": 0.0, "high": 0.3}},
    "run": {"duration": 1.5, "rate": 200.0},
}
RUNS, CHUNK = 16_384, 1024
TASKS = 1000
BILLION = 1e9


@dataclass(frozen=True)
class Costs:
    """Measured costs.

    Attributes:
        run: processor time of a run (s). record: of the recording of a chunk (s).
        task: of the scheduler and the driver for a task (s).
        start: duration from the call to the end of the first task of a cluster (s).
        check: of the check of a chunk when a study is resumed (s).
        size: of a run in the store (bytes). files: of a chunk.
    """

    run: float
    record: float
    task: float
    start: float
    check: float
    size: float
    files: int

    def duration(self, runs: float, workers: int, chunk: int) -> float:
        """Return the predicted duration of a study, s."""
        chunks = runs / chunk
        busy = chunks * (chunk * self.run + self.record)
        return self.start + max(busy / workers, chunks * self.task)


def study_of(count: int) -> fa.Study:
    return fa.Study({**STUDY, "samples": {"method": "random", "count": count}})


def measure(folder: Path) -> Costs:
    """Measure the costs in this process and on a cluster of one worker."""
    study = study_of(RUNS)
    executor = executor_of(study._text)
    outcomes = executor.outcomes(0, CHUNK)
    run = least(lambda: executor.outcomes(0, CHUNK)) / CHUNK
    path = folder / "costs.zarr"
    store = create_store(path, study._text, executor, study._prepared.names, CHUNK)
    before = sum(1 for file in path.rglob("*") if file.is_file())
    record = min(least(lambda i=i: store.write(i, outcomes)) for i in range(store.chunks))
    written = [file for file in path.rglob("*") if file.is_file()]
    size = sum(file.stat().st_size for file in written) / RUNS
    files = round((len(written) - before) / store.chunks)
    check = least(store.missing) / store.chunks
    started = time.perf_counter()
    with cluster(None, 1) as client:
        client.submit(outcomes_of, study._text, 0, CHUNK).result()
        start = time.perf_counter() - started - CHUNK * run
        tasks = [(i,) for i in range(TASKS)]
        task = least(lambda: execute(client, _nothing, tasks, lambda *_: None)) / TASKS
    return Costs(run, record, task, start, check, size, files)


def least(function: Callable[[], object], times: int = 3) -> float:
    """Return the least processor time of a call, s, with all threads of this process."""
    durations = []
    for _ in range(times):
        started = time.process_time()
        function()
        durations.append(time.process_time() - started)
    return min(durations)


def _nothing(_: int) -> None:
    pass


def measured_duration(folder: Path, workers: int) -> float:
    """Return the duration of the study, with the start of its workers, s."""
    study = study_of(RUNS)
    started = time.perf_counter()
    store = create_store(
        folder / f"{workers}.zarr", study._text, study._executor, study._prepared.names, CHUNK
    )
    tasks = [(str(store.path), store.digest, i) for i in range(store.chunks)]
    with cluster(None, workers) as client:
        execute(client, record_chunk, tasks, lambda *_: None)
    return time.perf_counter() - started


def main() -> None:
    """Print the measurements and what follows."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        costs = measure(folder)
        print(costs)
        overhead = (costs.record + costs.task) / (CHUNK * costs.run)
        print(f"overhead of a task of {CHUNK} runs: {100 * overhead:.1f} %")
        for workers in (1, 2, 4) if "check" in sys.argv[1:] else ():
            predicted = costs.duration(RUNS, min(workers, usable_cores()), CHUNK)
            found = measured_duration(folder, workers)
            print(f"{workers} workers: predicted {predicted:.1f} s, measured {found:.1f} s")
    billion(costs)


def billion(costs: Costs) -> None:
    """Print the table of a study of 1e9 runs."""
    for task in (1.0, 10.0, 60.0):
        chunk = 2 ** round(np.log2(task / costs.run))
        length = chunk * costs.run
        print(f"tasks of {length:.0f} s, {chunk} runs:", end=" ")
        print(f"one scheduler serves {length / costs.task:.0f} cores,", end=" ")
        print(f"{costs.files * BILLION / chunk:.2g} files")
        for nodes in (1, 10, 100, 1000):
            workers = 64 * nodes
            duration = costs.duration(BILLION, workers, chunk)
            ideal = BILLION * costs.run / workers
            rate = BILLION / duration
            print(
                f"  {nodes:5} nodes: {duration / 3600:8.2f} h, efficiency {ideal / duration:.0%}, "
                f"{rate / chunk:8.1f} tasks/s, {rate * costs.size / 1e6:8.2f} MB/s, "
                f"{costs.files * rate / chunk:8.1f} files/s"
            )
        print(f"  check before resuming: {costs.check * BILLION / chunk / 3600:.1f} h")
    print(f"store: {BILLION * costs.size / 1e9:.0f} GB")


if __name__ == "__main__":
    main()
