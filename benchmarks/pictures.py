"""Time of animations, reports and previews of the studio.

`python -m benchmarks.pictures` prints only this table.
"""

from __future__ import annotations

import resource
import tempfile
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path

import numpy as np

import flexarm as fa
from benchmarks.arms import chain, table_one
from benchmarks.startup import Wait
from flexarm.view.studio.compute import Request, parts_of
from flexarm.view.studio.presets import paper_project

#: Goals for the elapsed time (s) on two idle cores: an animation may take five times its duration.
#: A studio that draws 20 pictures a second moves with its slider.
GOALS = {"animation": 10.0, "report": 2.0, "preview": 0.05}
#: Steps of the chain: its motion does not matter here, only its links and samples.
_SHORT = 0.05


def waits(duration: float = 2.0, links: int = 64, repeats: int = 3) -> dict[str, Wait]:
    """Return the shortest of ``repeats`` times of each picture, by its name in the table."""
    arm = table_one()
    moving = fa.simulate(arm, duration, initial=arm.rest([0.3, -0.5]), torque=_torque)
    long = fa.simulate(chain(links), _SHORT, rate=20_000.0)
    minute = long.assign_coords(time=long.time * (60.0 / _SHORT))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        calls: dict[str, Callable[[], object]] = {
            f"animation of {duration:g} s, {kind}": lambda kind=kind: fa.animate(
                moving, folder / f"arm.{kind}"
            )
            for kind in ("mp4", "gif", "html")
        }
        calls[f"report of {duration:g} s"] = lambda: fa.report(moving)
        calls[f"report of a minute, {links} links"] = lambda: fa.report(minute)
        project, gains = paper_project().edited(("drive", "kind"), "joint_pd"), count(1)
        calls["preview of 3 s, joint PD at 1 kHz, another gain"] = lambda: list(
            parts_of(
                Request(
                    project.edited(("drive", "derivative", 0), 0.3 + 1e-3 * next(gains)), "preview"
                )
            )
        )
        return {what: min(_wait(call) for _ in range(repeats)) for what, call in calls.items()}


def _torque(t: float) -> np.ndarray:
    return np.array([4.0, 1.5]) * np.sin(np.pi * t)


def _wait(call: Callable[[], object]) -> Wait:
    before, started = _processor(), time.perf_counter()
    call()
    return Wait(time.perf_counter() - started, _processor() - before)


def _processor() -> float:
    """Return the CPU time of this process and of its finished children, such as ffmpeg."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def main() -> None:
    """Print the table."""
    from benchmarks.report import pictures_table

    print(pictures_table(waits()))


if __name__ == "__main__":
    main()
