"""Print how far the other programs' tips are from flexarm's: `make peers`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from importlib.metadata import version

import numpy as np

from peers import exudyn_arm, flexarm_arm, mujoco_arm
from peers.arms import PENDULUM, TABLE_ONE, Case, distance

#: Pieces of each link, and the step in seconds that belongs to them: what `make peers` runs.
EXUDYN = ((4, 1e-3), (8, 2e-4), (16, 1e-4))
MUJOCO = ((4, 1e-3), (8, 2.5e-4), (16, 5e-5))

_WIDTHS = "{:<18} {:<32} {:>12} {:>8}"


def main() -> None:
    """Run every program on every case, a minute or less."""
    names = ("flexarm", "exudyn", "mujoco")
    print(", ".join(f"{name} {version(name)}" for name in names))
    print("Largest distance of the tip from flexarm's over the motion. Finer settings of either")
    print("program must come closer, down to flexarm's own 6e-6 m.\n")
    print(_WIDTHS.format("motion", "program", "distance m", "time s"))
    for case in (TABLE_ONE, PENDULUM):
        for program, far, seconds in _rows(case):
            print(_WIDTHS.format(case.name, program, far, f"{seconds:.2f}"), flush=True)


def _rows(case: Case) -> Iterator[tuple[str, str, float]]:
    """Yield program and setting, distance and wall time."""
    flexarm_arm.tip(case)  # compiles where this machine has not yet
    ours, seconds = _timed(lambda: flexarm_arm.tip(case))
    yield f"flexarm, {case.segments} segments", "", seconds
    for elements, step in EXUDYN:
        path, seconds = _timed(lambda n=elements, h=step: exudyn_arm.tip(case, n, h))
        yield f"Exudyn, {elements} elements, {step:g} s", f"{distance(path, ours):.1e}", seconds
    paths = []
    for segments, step in MUJOCO:
        path, seconds = _timed(lambda n=segments, h=step: mujoco_arm.tip(case, n, h))
        paths.append(path)
        yield f"MuJoCo, {segments} segments, {step:g} s", f"{distance(path, ours):.1e}", seconds
    limit = mujoco_arm.limit(*paths[-2:])
    yield "MuJoCo, limit of the last two", f"{distance(limit, ours):.1e}", 0.0


def _timed(run: Callable[[], np.ndarray]) -> tuple[np.ndarray, float]:
    started = time.perf_counter()
    path = run()
    return path, time.perf_counter() - started


if __name__ == "__main__":
    main()
