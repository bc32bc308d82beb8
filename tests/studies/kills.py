"""A study whose driver and workers are killed at random: does it leave the same store?

``make kills`` runs 10,000 runs on a Dask cluster of two worker processes and kills 20 times. The
suite does the same with fewer runs and kills.
"""

from __future__ import annotations

import argparse
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil
import yaml
from small_study import content, files_of

import flexarm as fa


def write_study(folder: Path, samples: int) -> Path:
    """Write the study file."""
    path = folder / "study.yaml"
    path.write_text(yaml.safe_dump({"flexarm": 1, **content(samples)}, sort_keys=False))
    return path


def driver(study: Path, store: Path, scheduler: str, chunk: int) -> subprocess.Popen[bytes]:
    """Start the command that runs or resumes the study."""
    command = [sys.executable, "-m", "flexarm", "sweep", str(study), "--out", str(store)]
    command += ["--resume", "--chunk", str(chunk), "--scheduler", scheduler]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL)


def recorded(store: Path) -> int:
    """Return the number of recorded chunks."""
    folder = store / "checksum" / "c"
    return len(os.listdir(folder)) if folder.exists() else 0


def interrupted(
    study: Path, store: Path, cluster: Any, client: Any, chunk: int, times: list[float]
) -> dict[str, int]:
    """Run a study to its end while the driver and the workers are killed.

    Args:
        chunk: number of samples of a chunk.
        times: of the kills, in recorded chunks; each kills the driver or a worker at random.

    Returns:
        How often each was killed.
    """
    choice = random.Random(len(times))
    killed = {"driver": 0, "worker": 0}
    running = driver(study, store, cluster.scheduler_address, chunk)
    try:
        for at in times:
            while recorded(store) < at and running.poll() is None:
                time.sleep(0.01)
            time.sleep(choice.uniform(0.0, 0.02))
            if running.poll() is not None:
                break
            if choice.random() < 0.5:
                running.kill()
                running.wait()
                killed["driver"] += 1
                running = driver(study, store, cluster.scheduler_address, chunk)
            elif pids := list(client.run(os.getpid).values()):
                psutil.Process(choice.choice(pids)).kill()
                killed["worker"] += 1
        assert running.wait(timeout=3600) == 0
    finally:
        running.kill()
        running.wait()
    return killed


def compare(
    folder: Path, samples: int, kills: int, chunk: int, seed: int = 1, workers: int = 1
) -> dict[str, int]:
    """Run a study with and without kills, and compare all files of the stores.

    Args:
        workers: number of processes of the study without kills.

    Raises:
        AssertionError: if a file differs, or a run is missing.
    """
    from distributed import Client, LocalCluster

    study = write_study(folder, samples)
    fa.Study(study).run(folder / "undisturbed.zarr", workers=workers, chunk=chunk)
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
    ):
        choice = random.Random(seed)
        times = sorted(choice.uniform(0.0, 0.9 * samples / chunk) for _ in range(kills))
        killed = interrupted(study, folder / "killed.zarr", cluster, client, chunk, times)
    expected, found = (files_of(folder / f"{name}.zarr") for name in ("undisturbed", "killed"))
    assert found.keys() == expected.keys()
    assert found == expected
    assert fa.read_study(folder / "killed.zarr").sizes["sample"] == samples
    return killed


def main() -> None:
    """Print what was killed, and whether the stores are identical."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--chunk", type=int, default=25)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    started = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="flexarm-kills-") as folder:
        killed = compare(Path(folder), given.runs, given.kills, given.chunk, given.seed, 2)
    print(f"{given.runs} runs, {killed}: all files are identical.")
    print(f"{time.perf_counter() - started:.0f} s")


if __name__ == "__main__":
    main()
