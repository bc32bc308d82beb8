"""State of a window: an immutable scenario or study, its edits, and undo and redo.

Edits that are more than a value, such as another kind or form, a table, new and removed entries,
are paths with one of the words below at their end. They are converted to a value in place of
another one, so that all edits are checked in the same way.
"""

from __future__ import annotations

import json
import math
import re
import zlib
from base64 import b64decode, urlsafe_b64encode
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import astuple, dataclass, replace
from functools import lru_cache
from itertools import count, zip_longest
from pathlib import Path as FilePath
from typing import Any

from flexarm.arm.arm import Arm
from flexarm.base.errors import FlexarmError, InputError, Problem
from flexarm.base.writing.places import AnyPath
from flexarm.model import ArmSpec, Link, PlantSpec, Scenario, StudySpec, file_text
from flexarm.model.arm.links import MATERIALS, Material
from flexarm.model.checks import Record
from flexarm.model.file_format.files import content_of, load_any, record_of_bytes
from flexarm.model.file_format.yaml_text import Change, changed, parse
from flexarm.model.scenarios.study import plant_spec
from flexarm.model.wording import Path, look
from flexarm.view.studio.values import starts
from flexarm.view.studio.values.forms import Forms, forms_at

#: Last part of a path: the kind of a record, another form of a value, the text of a table, a new
#: entry of a list or mapping or a value that was omitted, and its removal; a way to describe a link
#: or its material; a copy of a link and its exchange with the next one, each with its joint. The
#: first part of a path is the last word for a second drive.
KIND, FORM, TABLE, NEW, REMOVE = "kind", "<form>", "<table>", "<new>", "<remove>"
WAY, PRESET, COPY, MOVE, BESIDE = "<way>", "<preset>", "<copy>", "<move>", "<beside>"
WORDS = (KIND, FORM, TABLE, NEW, REMOVE, WAY, PRESET)
LINKS: Path = ("arm", "links")
#: A material that is not a preset.
OWN = "other"
#: Descriptions of a link, and the fields of each.
WAYS: dict[str, tuple[str, ...]] = {
    "constants": (
        "flexural_rigidity",
        "mass_per_length",
        "rotary_inertia_per_length",
        "shear_rigidity",
    ),
    "material and section": ("material", "section"),
    "table": ("table",),
}


def way_of(link: Link) -> str:
    """Return the name of the way in which a link is described."""
    if link.table is not None:
        return "table"
    return "constants" if link.section is None else "material and section"


def plain_edit(
    record: Scenario | StudySpec, scenario: Scenario, place: Path, path: Path, value: Any
) -> tuple[Path, Sequence[Any]]:
    """Return an edit of a scenario's path as a place in the record and the values to try there."""
    word, place, path = place[-1], place[:-1], path[:-1]
    old = _at(record, place)
    if word == TABLE:
        kept = {k: v for k, v in content_of(old).items() if k not in old._columns}
        return place, [{**kept, **table_content(value, old)}]
    if word == REMOVE:
        if not isinstance(place[-1], int):
            return place, [None]
        entries = _at(record, place[:-1])
        kept = content_of((*entries[: place[-1]], *entries[place[-1] + 1 :]))
        optional = forms_at(record, place[:-1]).optional
        return place[:-1], [None if optional and not kept else kept]
    if word == WAY:
        return place, [_described(old, value)]
    if word == PRESET:
        return place, [value if value in MATERIALS else explicit(old)]
    forms = forms_at(record, place)
    if word == KIND and isinstance(old, Record) and not forms.kinds:
        # Another required kind may need a number more or less.
        kept = {**content_of(old), KIND: value}
        fewer = [{k: v for k, v in kept.items() if k != name} for name in kept if name != KIND]
        return place, [kept, {**starts.new_record(scenario, type(old)), **kept}, *fewer]
    if word == KIND:
        omitted = forms.optional and value not in [form.kind for form in forms.kinds]
        if omitted and value == "none":
            return place, [None]
        return place, [starts.new_value(scenario, path, forms, value, old)]
    if word == NEW:
        entries = forms.named("list")
        if entries is None:
            return place, [starts.new_value(scenario, path, forms, value)]
        if old is None and (first := starts.first_entries(scenario, entries.items())):
            return place, [first]
        kinds = entries.items().kinds
        new = starts.new_value(
            scenario, path, entries.items(), value or (kinds and kinds[0].kind) or None
        )
        return place, [[*content_of(old or ()), new]]
    return place, _in_form(scenario, forms, value, old)


def shown_by(record: Scenario | StudySpec, place: Path, path: Path) -> Path:
    """Return the path, or its beginning, of the field to continue with after an edit."""
    if path[:2] == LINKS and len(path) == 4 and path[-1] in (COPY, MOVE, REMOVE):
        last = len(record.arm.links) - 1
        return (*LINKS, min(last, int(path[2]) + (path[-1] != REMOVE)), path[-1])
    if path[-1] == REMOVE:
        return (*path[: -2 if isinstance(path[-2], int) else -1], NEW)
    if path[-1] == NEW:
        entries = _at(record, place[:-1])
        return (*path[:-1], len(entries) - 1) if isinstance(entries, tuple) else path[:-1]
    return path[:-1] if path[-1] == FORM else path


def _at(record: Scenario | StudySpec, place: Path) -> Any:
    value: Any = record
    for part in place:
        value = look(value, part)
    return value


def _in_form(scenario: Scenario, forms: Forms, name: str, old: Any) -> list[Any]:
    """Return values in another form, as near to the old value as possible."""
    form = forms.named(name)
    if form is None:
        raise LookupError(name)
    if form is forms.of(old):  # a button that was pressed twice
        return [content_of(old)]
    if name == "record":
        return [starts.new_record(scenario, form.type, old)]
    if name == "list":
        lengths = [Arm(scenario.arm).n_joints] if form.per_joint else [len(scenario.arm.links), 1]
        return [[old] * length for length in lengths]
    if isinstance(old, Record):
        old = getattr(old, old._columns[-1])
        return [content_of(old[0])]
    return [old[0]]


def explicit(value: Any) -> Any:
    """Return the content of a file for a value, in which a material is not the name of a preset."""
    if isinstance(value, Material):
        return dict(value)
    return content_of(value)


def _described(link: Link, way: str) -> dict[str, Any]:
    """Return a link in another way with the same properties at its root, as a file has it."""
    dropped = {name for names in WAYS.values() for name in names}
    kept = {k: v for k, v in content_of(link).items() if k not in dropped}
    beam = link.beam()
    if way == "table":
        columns = {name: getattr(beam, name) for name in beam._columns}
        return {**kept, "table": {k: list(v) for k, v in columns.items() if v and any(v)}}
    if way == "constants":
        values = {name: getattr(beam, name) for name in WAYS[way]}
        return {**kept, **{name: starts.short(v[0]) for name, v in values.items() if v and v[0]}}
    rigidity = beam.flexural_rigidity[0] if beam.flexural_rigidity else 100.0
    material = "aluminium"
    # A tube with a wall of a tenth of its diameter D has I = pi/64 (1 - 0.8^4) D^4.
    moment = rigidity / MATERIALS[material].youngs_modulus
    diameter = starts.short((moment * 64.0 / (math.pi * (1.0 - 0.8**4))) ** 0.25)
    tube = {"kind": "tube", "outer_diameter": diameter, "thickness": starts.short(0.1 * diameter)}
    return {**kept, "material": material, "section": tube}


_SPACES = re.compile(r"\s*[,;\t]\s*|\s+")
_NAME = re.compile(r"(\w+)(?:\[(\d{1,3})\])?$")


def table_text(record: Record) -> str:
    """Return the table of a record; the numbers of a list in a column have columns of their own."""
    columns = {name: getattr(record, name) for name in record._columns}
    head: list[str] = []
    cells: list[list[str]] = []
    for name, values in columns.items():
        if values is None:
            continue
        width = max((len(each) for each in values if isinstance(each, tuple)), default=0)
        head += [f"{name}[{k}]" for k in range(width)] or [name]
        rows = [each if isinstance(each, tuple) else (each,) for each in values]
        cells += [[repr(row[k]).removesuffix(".0") for row in rows] for k in range(max(width, 1))]
    rows_text = [", ".join(row) for row in zip_longest(*cells, fillvalue="")]
    return "\n".join([", ".join(head), *rows_text])


def table_content(text: str, record: Record) -> dict[str, Any]:
    """Return the columns of a table in text; names may be missing, other cells remain text."""
    rows = [_SPACES.split(line.strip()) for line in text.splitlines() if line.strip()]
    head = _SPACES.split(table_text(record).splitlines()[0])
    if rows and any(isinstance(_value(cell), str) for cell in rows[0]):
        head = rows.pop(0)
    columns: dict[str, Any] = dict.fromkeys(record._columns)
    for k, row in enumerate(rows):
        if len(row) != len(head):
            rule = f"have {len(head)} values, one for each name"
            raise InputError(Problem(f"row {k + 1} of the table", rule, str(len(row))))
    for k, name in enumerate(head):
        match = _NAME.match(name)
        values = [_value(row[k]) for row in rows]
        if match is None or match[2] is None:
            columns[name] = values
        else:
            entries = columns.get(match[1]) or [[] for _ in rows]
            columns[match[1]] = [[*old, value] for old, value in zip(entries, values, strict=True)]
    return {name: values for name, values in columns.items() if values is not None}


def _value(cell: str) -> float | str:
    try:
        return float(cell)
    except ValueError:
        return cell


#: Location of an edited value in messages.
ORIGIN = "studio"
#: Keys of a study of which a window simulates one entry, and that entry.
STUDIED = {"motions": "motion", "drives": "drive", "plants": "plant"}
#: Key of the study by the name of an entry.
KEYS = {entry: key for key, entry in STUDIED.items()}
#: Largest size of an opened file or link, bytes.
LARGEST_FILE = 20_000_000
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
    beside: Any = None  # a second drive, whose run is shown beside the first, or None

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
        of `flexarm.view.studio.state` are other edits, such as a new entry of a list.
        """
        if path[:2] == LINKS and len(path) == 4 and path[-1] in (COPY, MOVE, REMOVE):
            record = _rebuilt(self.record, _order(path, self.record.arm))
            return replace(self, record=record, beside=None)
        if path[:1] == (BESIDE,):
            return self._beside(path[1])
        place = self.placed(path)
        values: Sequence[Any] = (value,)
        if path[-1:] and path[-1] in WORDS:
            place, values = plain_edit(self.record, self.scenario, place, path, value)
        *others, last = values
        edited = None
        for each in others:
            with suppress(InputError):
                edited = edited or self._with(place, each)
        edited = edited or self._with(place, last)
        return self._with_gains(edited) if path[:1] == ("arm",) else edited

    def _with_gains(self, edited: Project) -> Project:
        """Return a project of an edited arm with new starting gains, if it has those of this one.

        Gains that the user has chosen remain.
        """
        old, new = self.record, edited.record
        if isinstance(old, Scenario) and isinstance(new, Scenario):
            with suppress(FlexarmError):
                if _with_starting_gains(old) == old:
                    return replace(edited, record=_with_starting_gains(new))
        return edited

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

    @property
    def sides(self) -> list[Project]:
        """The projects whose runs are shown side by side: this one, and that of another drive."""
        if self.beside is None:
            return [self]
        record: Any = self.record
        drives = {"drive": self.beside}
        if self.choice is not None:
            drives = {"drives": {**record.drives, self.choice.drive: self.beside}}
        return [replace(self, beside=None), replace(self, record=record.replace(**drives))]

    def _beside(self, word: str | int) -> Project:
        """Return a project with another drive beside this one, with both exchanged, or with one."""
        now, kind = self.scenario.drive, "computed_torque"
        if word == REMOVE:
            return replace(self, beside=None)
        if word == MOVE:
            return replace(self._with(self.placed(("drive",)), content_of(self.beside)), beside=now)
        if now.kind == kind:
            kind = "joint_pd"
        return replace(self.edited(("drive", KIND), kind), beside=now)

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
        return dict(content_of(getattr(self.record, KEYS[one])))

    def _with_entries(self, one: str, entries: dict[str, Any], name: str) -> Project:
        return self._with((KEYS[one],), entries).chosen(**{one: name})

    def files(self) -> dict[str, tuple[str, str]]:
        """Return name and text of the files that a user can save, by their kind."""
        texts = {
            "model": (f"{self.name}-arm.yaml", file_text(self.record.arm)),
            "scenario": (f"{self.name}.yaml", file_text(self.scenario)),
        }
        if isinstance(self.record, StudySpec):
            texts["scenario"] = (f"{self.name}-scenario.yaml", texts["scenario"][1])
            texts["study"] = (f"{self.name}.yaml", file_text(self.record))
        return texts


def _order(path: Path, arm: ArmSpec) -> list[int]:
    """Return the links (of the old arm) in the order that an edit of a link leads to."""
    order, k = list(range(len(arm.links))), int(path[2])
    if path[-1] == COPY:
        order.insert(k, k)
    elif path[-1] == REMOVE:
        del order[k]
    else:
        order[k : k + 2] = reversed(order[k : k + 2])
    return order


def _rebuilt(record: Scenario | StudySpec, order: list[int]) -> Scenario | StudySpec:
    """Return a record whose arm has the links of another one in an order, with their joints.

    A branch remains on its link, which cannot be removed before it. The gains of the drive are made
    anew, because those of another arm may be unstable; what does not fit other joints is, too.
    """
    old = record.arm
    links = [old.links[k] for k in order]
    numbers = [k + 1 for k in order]
    for i, link in enumerate(links):
        if link.parent and link.parent not in numbers:
            rule = f"carries link {order[i] + 1}: remove that first, or give it another parent"
            raise InputError(Problem(f"link {link.parent}", rule))
        if link.parent:
            links[i] = link.replace(parent=numbers.index(link.parent) + 1)
    arm = old.replace(links=links, joints=[old.joints[k] for k in order])
    if isinstance(record, StudySpec):
        return record.replace(arm=arm)
    around = starts.scenario_around(arm)
    kept = _scalars(record.drive)
    refusals: list[FlexarmError] = []
    attempts: list[dict[str, Any]] = [
        {"motion": record.motion},
        {"motion": around.motion},
        {"initial": None, "hardware": None, "motion": around.motion},
    ]
    for more in attempts:
        try:
            drive = kept | starts.drive_of_kind(around.replace(**more), record.drive.kind)
            return record.replace(arm=arm, **more, drive=drive)
        except FlexarmError as error:
            refusals.append(error)
    raise refusals[0]


@lru_cache(maxsize=2)  # the record before the edits of a slider is the same for all
def _with_starting_gains(record: Scenario) -> Scenario:
    drive = _scalars(record.drive) | starts.drive_of_kind(record, record.drive.kind)
    return record.replace(drive=drive)


def _scalars(drive: Record) -> dict[str, Any]:
    return {name: value for name, value in content_of(drive).items() if not isinstance(value, list)}


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
        record = starts.scenario_around(record)
    if isinstance(record, Scenario):
        return Project(record, name)
    first = (next(iter(names)) for names in (record.drives, record.motions, record.plants))
    return Project(record, name, Choice(*first))


def open_file(path: AnyPath) -> Project:
    """Open an arm, scenario or study file; ModelError lists all problems with lines."""
    return project_of(load_any(path), _stem(str(path)))


def open_bytes(content: bytes, file: str, arms: Mapping[str, ArmSpec] | None = None) -> Project:
    """Open the content of a file that a browser sent; it may name those of the ``arms``."""
    return project_of(record_of_bytes(content, file, arms), _stem(file))


def link_of(project: Project) -> str:
    """Return a project as text for an address."""
    choice = project.choice and astuple(project.choice)
    content = [project.name, file_text(project.record), choice, content_of(project.beside)]
    return urlsafe_b64encode(zlib.compress(json.dumps(content).encode(), 9)).decode()


def open_link(text: str) -> Project:
    """Open a text of `link_of`; InputError if it is damaged or too large."""
    unpack = zlib.decompressobj()
    try:
        content = unpack.decompress(b64decode(text, b"-_", validate=True), LARGEST_FILE)
        if not unpack.eof or unpack.unused_data:
            raise ValueError
        name, file, choice, beside = json.loads(content)
        project = open_bytes(file.encode(), f"{name}.yaml")
        if choice is not None:
            project = replace(project, choice=Choice(*choice))
        other = project if beside is None else project.edited(("drive",), beside)
        drive = other.scenario.drive  # a choice of other names is a LookupError
        return replace(project, beside=beside and drive)
    except (ValueError, TypeError, LookupError, AttributeError, zlib.error):
        hint = "Copy the whole address."
        raise InputError(Problem("the link", "is damaged or incomplete", hint=hint)) from None


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
