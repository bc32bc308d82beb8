"""Run a study file: every drive on every plant along every motion."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from os import PathLike
from typing import TYPE_CHECKING

from flexarm.arguments import check_path
from flexarm.arm import Arm
from flexarm.control.base import Reference
from flexarm.errors import InputError
from flexarm.model import Study, locate_study
from flexarm.model.study import placed, plant_spec
from flexarm.model.wording import Path, path_of, path_text
from flexarm.scenarios.environment import loads_of
from flexarm.scenarios.file_errors import Where, told_as
from flexarm.scenarios.motions import Asked
from flexarm.scenarios.scenario import Prepared, prepare
from flexarm.simulation.compare import check_settling, comparison

if TYPE_CHECKING:
    import xarray as xr


class PreparedStudy:
    """A study with everything checked and made, ready to run.

    Args:
        study: what to run.
        where: where in its file a key path stands, for messages.

    Raises:
        InputError: a motion leaves the arm's reach, a drive does not fit, or ``settling`` leaves
            nothing after a motion.
    """

    def __init__(self, study: Study, where: Where | None = None) -> None:
        self.study = study
        self.arm = Arm(study.arm)
        self.plants = {
            name: (Arm(plant_spec(study.arm, plant)), loads_of(plant.loads))
            for name, plant in study.plants.items()
        }
        self._prepared: dict[tuple[str, str], Prepared] = {}
        made: dict[str, Asked | None] = {}  # one that presses takes seconds to make
        for drive in study.drives:
            for motion in study.motions:
                place = partial(_place, where, drive, motion) if where else "study"
                scenario = study.scenario(drive, motion)
                with _told_in_study(drive, motion):
                    prepared = prepare(scenario, place, made.get(motion))
                self._prepared[drive, motion] = prepared
                made[motion] = prepared.motion
        with told_as(where or (lambda path: "study"), "run"):
            check_settling("run", study.run.settling, study.run.duration, made)

    def run(self, progress: bool | None = None) -> xr.Dataset:
        """Run it and return the table of ``flexarm.compare``: drives are its controllers."""
        study = self.study
        names = {
            "controller": list(study.drives),
            "plant": list(study.plants),
            "reference": list(study.motions),
        }
        table = comparison(self.arm, names, self._one, study.run.settling, progress)
        table.attrs["duration"] = study.run.duration
        return table

    def unstable_loops(self) -> dict[str, str]:
        """Say how sampled loops are unstable, by "drive on plant along motion"."""
        found = {
            f"{drive} on {plant} along {motion}": prepared.unstable_loop(arm)
            for (drive, motion), prepared in self._prepared.items()
            for plant, (arm, _) in self.plants.items()
        }
        return {name: text for name, text in found.items() if text}

    def _one(self, drive: str, plant: str, motion: str) -> tuple[xr.Dataset, Reference]:
        prepared = self._prepared[drive, motion]
        assert prepared.motion is not None
        simulated, loads = self.plants[plant]
        return prepared.run(plant=simulated, loads=loads, progress=False), prepared.motion


def run_study(study: Study | str | PathLike[str], *, progress: bool | None = None) -> xr.Dataset:
    """Compare what a study asks for, given as an object or as the path of its file.

    Returns:
        The table of ``flexarm.compare``, with the drives as controllers.

    Raises:
        ModelError: the file is wrong; every problem with its line.
        InputError: a motion leaves the arm's reach, or a drive does not fit the arm.
    """
    where: Where | None = None
    if not isinstance(study, Study):
        study, where = locate_study(check_path("run_study", "study", study))
    return PreparedStudy(study, where).run(progress)


@contextmanager
def _told_in_study(drive: str, motion: str) -> Iterator[None]:
    """Name problems of one scenario by their key paths in the study."""
    try:
        yield
    except InputError as error:
        names = [path_text(placed(path_of(p.name), drive, motion)) for p in error.problems]
        told = [replace(p, name=n) for p, n in zip(error.problems, names, strict=True)]
        raise InputError(*told) from None


def _place(where: Where, drive: str, motion: str, path: Path) -> str:
    """Tell a place of one scenario as a place in the study."""
    return where(placed(path, drive, motion))
