"""State of a window: an immutable scenario or study, its edits, and undo and redo."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path as FilePath
from typing import Any

from flexarm.model import ArmSpec, PlantSpec, Scenario, Study, file_text
from flexarm.model.file_format.changes import Change, changed
from flexarm.model.file_format.content import content_of
from flexarm.model.file_format.files import load_any, record_of_bytes
from flexarm.model.file_format.yaml_text import parse
from flexarm.model.scenarios.study import plant_spec
from flexarm.model.wording import Path, look
from flexarm.studio.starts import scenario_around, start_of_kind
from flexarm.writing.places import AnyPath

#: Location of an edited value in messages.
ORIGIN = "studio"
#: Limit on the states that undo keeps.
MOST_UNDO = 200


@dataclass(frozen=True)
class Choice:
    """Names of the drive, motion and plant of a study that a window simulates."""

    drive: str
    motion: str
    plant: str


@dataclass(frozen=True)
class Project:
    """A scenario or a study, and what of it is simulated; edits return another project.

    Attributes:
        record: the scenario or the study.
        name: name for its files, without suffix.
        choice: None for a scenario.
    """

    record: Scenario | Study
    name: str
    choice: Choice | None = None

    @property
    def scenario(self) -> Scenario:
        """The simulated scenario; in a study that of the choice, with its arm as believed."""
        if isinstance(self.record, Scenario):
            return self.record
        assert self.choice is not None
        return self.record.scenario(self.choice.drive, self.choice.motion)

    @property
    def plant(self) -> PlantSpec | None:
        """Difference of the simulated arm from the one of the scenario; None for a scenario."""
        if isinstance(self.record, Scenario):
            return None
        assert self.choice is not None
        return self.record.plants[self.choice.plant]

    @property
    def simulated_arm(self) -> ArmSpec:
        """The simulated arm."""
        plant = self.plant
        arm = self.record.arm
        return arm if plant is None else plant_spec(arm, plant)

    def placed(self, path: Path) -> Path:
        """Return the path in the record of a path in the simulated scenario."""
        if self.choice is None or path[:1] not in (("drive",), ("motion",)):
            return path
        kind = str(path[0])
        return (f"{kind}s", getattr(self.choice, kind), *path[1:])

    def edited(self, path: Path, value: Any) -> Project:
        """Return a project with another value at a path of the simulated scenario.

        This is the override of ``flexarm run --set``, with its messages. Another ``kind`` replaces
        the whole motion, drive or damping by starting values.

        Raises:
            ModelError: if the value is not valid there.
        """
        if path[-1:] == ("kind",):
            path, value = path[:-1], start_of_kind(self.scenario, path[:-1], value)
        place = self.placed(path)
        document = parse(FilePath(ORIGIN), file_text(self.record))
        change = Change(ORIGIN, place, value)
        missing = _omitted_lists(self.record, document.value, place)
        record = load_any(changed(document, [*missing, change]))
        assert isinstance(record, Scenario | Study)
        return replace(self, record=record)

    def chosen(self, **names: str) -> Project:
        """Return a project that simulates another drive, motion or plant of its study."""
        assert self.choice is not None
        return replace(self, choice=replace(self.choice, **names))

    def files(self) -> dict[str, tuple[str, str]]:
        """Return name and text of the files that a user can save, by their kind."""
        found = {
            "model": (f"{self.name}-arm.yaml", file_text(self.record.arm)),
            "scenario": (f"{self.name}.yaml", file_text(self.scenario)),
        }
        if isinstance(self.record, Study):
            found["scenario"] = (f"{self.name}-scenario.yaml", found["scenario"][1])
            found["study"] = (f"{self.name}.yaml", file_text(self.record))
        return found


def _omitted_lists(record: Scenario | Study, content: Any, path: Path) -> Iterator[Change]:
    """Yield the lists on a path that the file omits because they equal their defaults."""
    for k, part in enumerate(path):
        given, value = content, record
        for step in path[:k]:
            given, value = look(given, step), look(value, step)  # type: ignore[assignment]
        if isinstance(part, int) and given is None and isinstance(value, tuple):
            yield Change(ORIGIN, path[:k], content_of(value))
            return


def project_of(record: ArmSpec | Scenario | Study, name: str) -> Project:
    """Return the project of the content of a file; an arm alone gets a motion and a drive."""
    if isinstance(record, ArmSpec):
        record = scenario_around(record)
    if isinstance(record, Scenario):
        return Project(record, name)
    first = (next(iter(names)) for names in (record.drives, record.motions, record.plants))
    return Project(record, name, Choice(*first))


def open_file(path: AnyPath) -> Project:
    """Open an arm, scenario or study file.

    Raises:
        ModelError: if the file cannot be read or is invalid; lists all problems with lines.
    """
    return project_of(load_any(path), _stem(str(path)))


def open_bytes(content: bytes, file: str) -> Project:
    """Open the content of a file that a browser sent; it must not name another file.

    Raises:
        ModelError: if it is invalid; lists all problems with lines.
    """
    return project_of(record_of_bytes(content, file), _stem(file))


def paper_project() -> Project:
    """Return the paper's example, the state of a studio without a file."""
    from flexarm.paper import paper_scenario

    return Project(paper_scenario(), "paper")


def _stem(file: str) -> str:
    """Return a name for files: that of a file without suffix, of usual characters only."""
    plain = "".join(c if c.isalnum() or c in "-_" else "-" for c in FilePath(file).stem)
    return plain.strip("-")[:60] or "arm"


class History:
    """The project of a window, with undo and redo of the last 200 edits."""

    def __init__(self, first: Project) -> None:
        self.now = first
        self._before: list[Project] = []
        self._after: list[Project] = []

    def copy(self) -> History:
        """Return a history with the same projects, whose further edits are its own."""
        other = History(self.now)
        other._before, other._after = list(self._before), list(self._after)
        return other

    def put(self, project: Project) -> bool:
        """Make a project the current one; return whether it differs from the last."""
        if project == self.now:
            return False
        self._before = [*self._before, self.now][-MOST_UNDO:]
        self.now, self._after = project, []
        return True

    @property
    def can_undo(self) -> bool:
        """Whether there is an earlier project."""
        return bool(self._before)

    @property
    def can_redo(self) -> bool:
        """Whether an edit was undone."""
        return bool(self._after)

    def undo(self) -> None:
        """Return to the project before the last edit, if there is one."""
        if self._before:
            self._after.append(self.now)
            self.now = self._before.pop()

    def redo(self) -> None:
        """Repeat the edit that was undone last, if there is one."""
        if self._after:
            self._before.append(self.now)
            self.now = self._after.pop()
