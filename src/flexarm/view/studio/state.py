"""State of a window: an immutable scenario or study, its edits, and undo and redo."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path as FilePath
from typing import Any

from flexarm.base.errors import InputError, Problem
from flexarm.base.writing.places import AnyPath
from flexarm.model import ArmSpec, PlantSpec, Scenario, StudySpec, file_text
from flexarm.model.checks import Record
from flexarm.model.file_format.content import content_of
from flexarm.model.file_format.files import load_any, record_of_bytes
from flexarm.model.file_format.yaml_text import Change, changed, parse
from flexarm.model.scenarios.study import plant_spec
from flexarm.model.wording import Path, look
from flexarm.view.studio.values.edits import WORDS, explicit, plain_edit
from flexarm.view.studio.values.starts import scenario_around

#: Location of an edited value in messages.
ORIGIN = "studio"
#: Keys of a study of which a window simulates one entry, and that entry.
STUDIED = {"motions": "motion", "drives": "drive", "plants": "plant"}
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
    """A scenario or a study, and what of it is simulated; edits return another project."""

    record: Scenario | StudySpec  # the scenario or the study
    name: str  # name for its files, without suffix
    choice: Choice | None = None  # None for a scenario

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
        """Return the path in the record of a path in the simulated scenario; ``plant`` is one."""
        for names, one in STUDIED.items() if self.choice is not None else ():
            if path[:1] == (one,):
                return (names, getattr(self.choice, one), *path[1:])
        return path

    def edited(self, path: Path, value: Any) -> Project:
        """Return a project with another value at a path of the simulated scenario.

        This is the override of ``flexarm run --set``, with its messages. Paths that end with a word
        of `flexarm.view.studio.values.edits` are other edits, such as a new entry of a list.
        """
        place = self.placed(path)
        values: Sequence[Any] = (value,)
        if path[-1:] and path[-1] in WORDS:
            place, values = plain_edit(self.record, self.scenario, place, path, value)
        *others, last = values
        for each in others:
            with suppress(InputError):
                return self._with(place, each)
        return self._with(place, last)

    def _with(self, place: Path, value: Any) -> Project:
        document = parse(FilePath(ORIGIN), file_text(self.record))
        change = Change(ORIGIN, place, value)
        missing = _abbreviated(self.record, document.value, place)
        record = load_any(changed(document, [*missing, change]))
        assert isinstance(record, Scenario | StudySpec)
        return replace(self, record=record)

    def chosen(self, **names: str) -> Project:
        """Return a project that simulates another drive, motion or plant of its study."""
        assert self.choice is not None
        return replace(self, choice=replace(self.choice, **names))

    def copied(self, one: str) -> Project:
        """Return a project with a copy of the chosen drive, motion or plant, which is chosen."""
        entries = self._entries(one)
        old = getattr(self.choice, one)
        numbered = (f"{old} {k}" for k in count(2))
        name = next(name for name in numbered if name not in entries)
        return self._with_entries(one, {**entries, name: entries[old]}, name)

    def renamed(self, one: str, name: str) -> Project:
        """Return a project in which the chosen drive, motion or plant has another name."""
        old, entries = getattr(self.choice, one), self._entries(one)
        if name != old and name in entries:
            raise InputError(Problem(one, f"repeats {name!r}, the name of another one"))
        renamed = {name if key == old else key: value for key, value in entries.items()}
        return self._with_entries(one, renamed, name)

    def removed(self, one: str) -> Project:
        """Return a project without the chosen drive, motion or plant, unless it is the only one."""
        entries = self._entries(one)
        del entries[getattr(self.choice, one)]
        return self._with_entries(one, entries, next(iter(entries), ""))

    def _entries(self, one: str) -> dict[str, Any]:
        names = next(names for names, each in STUDIED.items() if each == one)
        return dict(content_of(getattr(self.record, names)))

    def _with_entries(self, one: str, entries: dict[str, Any], name: str) -> Project:
        names = next(names for names, each in STUDIED.items() if each == one)
        return self._with((names,), entries).chosen(**{one: name})

    def files(self) -> dict[str, tuple[str, str]]:
        """Return name and text of the files that a user can save, by their kind."""
        found = {
            "model": (f"{self.name}-arm.yaml", file_text(self.record.arm)),
            "scenario": (f"{self.name}.yaml", file_text(self.scenario)),
        }
        if isinstance(self.record, StudySpec):
            found["scenario"] = (f"{self.name}-scenario.yaml", found["scenario"][1])
            found["study"] = (f"{self.name}.yaml", file_text(self.record))
        return found


def _abbreviated(record: Scenario | StudySpec, content: Any, path: Path) -> Iterator[Change]:
    """Yield explicit values on a path for those that the file omits or gives by name."""
    for k, part in enumerate(path):
        given, value = content, record
        for step in path[:k]:
            given, value = look(given, step), look(value, step)  # type: ignore[assignment]
        omitted = isinstance(part, int) and given is None and isinstance(value, tuple)
        if omitted or (isinstance(given, str) and isinstance(value, Record)):
            yield Change(ORIGIN, path[:k], explicit(value))
            return


def project_of(record: ArmSpec | Scenario | StudySpec, name: str) -> Project:
    """Return the project of the content of a file; an arm alone gets a motion and a drive."""
    if isinstance(record, ArmSpec):
        record = scenario_around(record)
    if isinstance(record, Scenario):
        return Project(record, name)
    first = (next(iter(names)) for names in (record.drives, record.motions, record.plants))
    return Project(record, name, Choice(*first))


def open_file(path: AnyPath) -> Project:
    """Open an arm, scenario or study file; ModelError lists all problems with lines."""
    return project_of(load_any(path), _stem(str(path)))


def open_bytes(content: bytes, file: str) -> Project:
    """Open the content of a file that a browser sent; it must not name another file."""
    return project_of(record_of_bytes(content, file), _stem(file))


def paper_project() -> Project:
    """Return the paper's example, the state of a studio without a file."""
    from flexarm.view.paper import paper_scenario

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
