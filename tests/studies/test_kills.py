"""Studies on several processes: the same files after kills, and no process left behind."""

import os
import subprocess
import sys
import time

import psutil
import pytest
from kills import compare, write_study
from small_study import files_of

import flexarm as fa
from flexarm.cases.studies import execution

pytestmark = pytest.mark.thorough

dask = pytest.importorskip("dask", reason="it comes with the extra: pip install 'flexarm[cluster]'")
pytest.importorskip("distributed", reason="it comes with the same extra")


def test_killed_study_leaves_the_same_store(tmp_path):
    """As `make kills`, with 200 runs."""
    killed = compare(tmp_path, 200, 2, 2)
    assert min(killed.values()) > 0


def test_task_that_kills_its_workers_is_named(monkeypatch):
    """The first process dies, and that of the second attempt; Dask itself would try four times."""
    monkeypatch.setattr(execution, "_MOST_LOSSES", 2)
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        execution.cluster(None, 1) as client,
        pytest.raises(fa.InputError, match=r"ended the process .* that executed task \(7,\)"),
    ):
        execution.execute(client, os._exit, [(7,)], lambda *_: None)


def test_driver_that_is_killed_ends_its_workers(tmp_path):
    study, store = write_study(tmp_path, 400), tmp_path / "a.zarr"
    command = [sys.executable, "-m", "flexarm", "sweep", str(study), "--out", str(store)]
    running = subprocess.Popen([*command, "--chunk", "4", "--workers", "2"])
    try:
        while not (store / "checksum" / "c").exists():
            assert running.poll() is None
            time.sleep(0.05)
        family = psutil.Process(running.pid).children(recursive=True)
        assert len(family) >= 2
    finally:
        running.kill()
        running.wait()
    assert psutil.wait_procs(family, timeout=60)[1] == []
    done = len(list((store / "checksum" / "c").iterdir()))
    assert 0 < done < 100
    fa.Study(study).run(store, workers=1, resume=True)
    fa.Study(study).run(tmp_path / "b.zarr", workers=1, chunk=4)
    assert files_of(store) == files_of(tmp_path / "b.zarr")
