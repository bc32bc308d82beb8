"""Runs of study files: all combinations of drives, plants and motions."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from os import PathLike
from typing import Any

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_path
from flexarm.base.errors import InputError, Problem, public_call
from flexarm.base.late import xr
from flexarm.base.processes import in_processes
from flexarm.cases.scenario.file_errors import Where, problems_at
from flexarm.cases.scenario.references import Followed, TaskReference
from flexarm.cases.scenario.scenario import Prepared, check_fit, prepare
from flexarm.control.contract.base import Reference
from flexarm.integrate.base import FloatArray
from flexarm.model import Hardware, StudySpec, locate_study
from flexarm.model.drives import CONTROLLED, ControllerDrive
from flexarm.model.plausible import implausible, warn_of
from flexarm.model.scenarios.study import placed, plant_spec
from flexarm.model.wording import Path, path_of, path_text
from flexarm.simulation.calls import compare
from flexarm.simulation.calls.metrics import Goal


class PreparedStudy:
    """Validated study, converted to objects and ready to run."""

    def __init__(self, study: StudySpec, place: Where = lambda _: "study") -> None:
        self.study = study
        self.arm = Arm(study.arm)
        self.plants = {name: Arm(plant_spec(study.arm, p)) for name, p in study.plants.items()}
        self._prepared: dict[tuple[str, str], Prepared] = {}
        self._goals: dict[tuple[str, str], Goal] = {}
        # Reused, because pressed motions and tip inversions take seconds to create.
        made: dict[str, TaskReference | None] = {}
        followed: dict[tuple[str, str | None], Followed] = {}
        for drive in study.drives:
            for motion in study.motions:
                own = partial(_place, place, drive, motion)
                scenario = study.scenario(drive, motion)
                with _problems_in_study(drive, motion):
                    law = scenario.drive
                    kind = law.reference_kind if isinstance(law, ControllerDrive) else _OWN
                    prepared = prepare(
                        scenario, own, made.get(motion), followed.get((motion, kind)), self.arm
                    )
                self._prepared[drive, motion] = prepared
                made[motion] = prepared.motion
                if kind != _OWN:
                    followed[motion, kind] = prepared.followed
        self._check_hardware_of_plants(place)
        with problems_at(place, "run"):
            for (_, name), one in self._prepared.items():
                references = {name: one.followed.motion}
                compare.check_settling(study.run.settling, study.run.duration, references)

    def _check_hardware_of_plants(self, place: Where) -> None:
        """Raise if a drive reads what the hardware of a plant does not measure."""
        for (drive, motion), prepared in self._prepared.items():
            for plant, spec in self.study.plants.items():
                if spec.hardware is None or not self.controlled(drive):
                    continue
                own = partial(_place, place, drive, motion, plant=plant)
                options = prepared.options | {"hardware": spec.hardware}
                with _problems_in_study(drive, motion, plant):
                    check_fit(self.plants[plant], self.study.scenario(drive, motion), own, options)

    @property
    def names(self) -> dict[str, list[str]]:
        """Names of the drives, plants and motions, by the dimensions of the table."""
        study = self.study
        return {
            "controller": list(study.drives),
            "plant": list(study.plants),
            "reference": list(study.motions),
        }

    def run(self, progress: bool | None = None, workers: int = 1) -> xr.Dataset:
        """Run the study once; return the table of ``flexarm.compare``, drives as controllers."""
        evaluations = in_processes(self.evaluation, compare.runs_of(self.names), workers)
        table = compare.comparison(self.names, evaluations, progress)
        table.attrs["duration"] = self.study.run.duration
        return table

    def evaluation(self, drive: str, plant: str, motion: str) -> compare.Evaluation:
        """Simulate one run; return its metrics, also if it fails."""
        run = partial(self.one, drive, plant, motion)
        return compare.evaluated(run, self.arm, self.study.run.settling)

    def controlled(self, drive: str) -> bool:
        """Return whether a drive is a controller, which has instruments and motors."""
        return self.study.drives[drive].kind in CONTROLLED

    def unstable_loops(self) -> dict[str, str]:
        """Describe the unstable sampled loops, by "drive on plant along motion"."""
        texts = {}
        for (drive, motion), prepared in self._prepared.items():
            for plant, arm in self.plants.items():
                changes = self.study.plants[plant].changes
                loop = prepared.stability(arm, self.hardware_of(plant), changes)
                texts[f"{drive} on {plant} along {motion}"] = loop.text or loop.slow
        return {name: text for name, text in texts.items() if text}

    def one(
        self, drive: str, plant: str, motion: str, simulated: Arm | None = None, **instead: Any
    ) -> tuple[xr.Dataset, Reference]:
        """Simulate one run; return its result and its motion.

        ``simulated`` replaces the arm of the plant, whose loads and changes act on it.
        """
        arguments = self._acting(drive, plant, simulated) | instead
        result = self._prepared[drive, motion].run(**arguments, progress=False)
        return result, self.reference(drive, motion)

    def arguments(
        self, drive: str, plant: str, motion: str, simulated: Arm | None = None
    ) -> dict[str, Any]:
        """Return the arguments of ``simulate`` for one run; the arguments are those of ``one``."""
        return self._prepared[drive, motion].arguments(**self._acting(drive, plant, simulated))

    def reference(self, drive: str, motion: str) -> Reference:
        """Return the motion of a drive, which depends on its kind of reference."""
        reference = self._prepared[drive, motion].followed.motion
        assert reference is not None
        return reference

    def goal(self, drive: str, motion: str, times: FloatArray) -> Goal:
        """Return the goal of complete runs, which all have the same sample times (samples,), s."""
        goal = self._goals.get((drive, motion))
        if goal is None:
            goal = Goal(self.arm, self.reference(drive, motion), times, self.study.run.settling)
            self._goals[drive, motion] = goal
        return goal

    def hardware_of(self, plant: str) -> Hardware | None:
        """Return the instruments and motors of a plant, its own or those of the study."""
        return self.study.plants[plant].hardware or self.study.hardware

    def _acting(self, drive: str, plant: str, simulated: Arm | None) -> dict[str, Any]:
        spec = self.study.plants[plant]
        arm = simulated or self.plants[plant]
        own = {"plant": arm, "loads": spec.loads, "changes": spec.changes}
        hardware = self.hardware_of(plant)
        if hardware is not None and self.controlled(drive):
            own["hardware"] = hardware
        return own


#: Kind of the reference of drives without feedback, which share nothing.
_OWN = "own"


@public_call
def run_study(
    study: StudySpec | str | PathLike[str], *, progress: bool | None = None
) -> xr.Dataset:
    """Run a study without samples, given as an object or as the path of its file.

    Returns:
        The table of ``flexarm.compare``, with the drives as controllers.

    Raises:
        ModelError: if the file is not valid; it lists every problem with its line.
        InputError: if a motion leaves the arm's reach, a drive does not fit the arm, or the study
            has samples.

    Warns:
        ImplausibleValueWarning: if numbers of the arm look like those of another unit.
    """
    located = (study,) if isinstance(study, StudySpec) else locate_study(check_path("study", study))
    prepared = PreparedStudy(*located)
    warn_of(implausible(prepared.study.arm))
    if prepared.study.samples is not None:
        hint = "Use Study(...).run()."
        raise InputError(Problem("study", "has samples, which run_study does not run", hint=hint))
    return prepared.run(progress)


@contextmanager
def _problems_in_study(drive: str, motion: str, plant: str | None = None) -> Iterator[None]:
    """Report problems of one scenario with their key paths in the study."""
    try:
        yield
    except InputError as error:
        paths = [_in_study(path_of(p.name), drive, motion, plant) for p in error.problems]
        pairs = zip(error.problems, paths, strict=True)
        raise InputError(*(replace(p, name=path_text(path)) for p, path in pairs)) from None


def _place(place: Where, drive: str, motion: str, path: Path, plant: str | None = None) -> str:
    """Convert a location in one scenario to a location in the study."""
    return place(_in_study(path, drive, motion, plant))


def _in_study(path: Path, drive: str, motion: str, plant: str | None) -> Path:
    """Return the key path in the study for a key path in one of its scenarios."""
    if plant is not None and path[:1] == ("hardware",):
        return ("plants", plant, *path)
    return placed(path, drive, motion)
