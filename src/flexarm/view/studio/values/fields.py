"""Fields of a window: every value of a scenario or study has one.

Names, types, units, descriptions and bounds are those of the records: a new key, load or controller
has its field without a change here.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Literal

from flexarm.integrate import INTEGRATORS
from flexarm.model import Link, StudySpec
from flexarm.model.arm.joints import Joint
from flexarm.model.arm.links import MATERIALS, Material
from flexarm.model.checks import Record, descriptions_of
from flexarm.model.drives import DRIVES
from flexarm.model.hardware import Hardware
from flexarm.model.scenarios.scenario import RunSpec
from flexarm.model.units import unit_of
from flexarm.model.wording import Path, path_text
from flexarm.view.studio import state
from flexarm.view.studio.values.forms import Form, Forms, field_forms, kind_of

#: Keys outside "More values"; of other records those that have a default.
_USUAL: dict[type[Record], tuple[str, ...]] = {
    Link: (
        "length",
        "flexural_rigidity",
        "mass_per_length",
        "material",
        "section",
        "table",
        "elements",
        "damping",
    ),
    Joint: ("damping", "stiffness", "hub_inertia", "mass", "friction"),
    RunSpec: ("duration", "rate", "integrator"),
    Hardware: ("instruments", "motors"),
}
#: Longer lists are edited as text.
_MOST_NUMBERS = 12
_POINT = re.compile(r"\[x, y\]|: x along")
_AXES = ("x", "y")
#: In the description of a point of the plane.
_PLACE = "world frame (m)"
#: Entry of a list for a value that is omitted.
_OMITTED = "not set"
_MORE = "More values"
#: Keys whose name in words is another one.
_NAMES = {
    "prescribed": "prescribed joints",
    "initial": "initial state",
    "youngs_modulus": "Young's modulus",
    "poissons_ratio": "Poisson's ratio",
    "coulomb": "Coulomb friction",
    "viscous": "viscous friction",
    "static": "static friction",
    "stribeck_rate": "Stribeck rate",
    "rtol": "relative tolerance",
    "atol": "absolute tolerance",
}
_ABBREVIATIONS = ("pd", "pid", "lqg", "mpc", "rbf", "zv", "zvd", "zvdd", "ei", "si")
#: Parts of words that are not in lower case: abbreviations and names.
_WRITTEN = {
    **{word: word.upper() for word in _ABBREVIATIONS},
    **{word: word.capitalize() for word in ("rayleigh", "timoshenko")},
    "euler bernoulli": "Euler-Bernoulli",
}
#: Keys without fields: the studio computes no samples, but keeps them in the file.
SAMPLED = ("vary", "samples", "rare_failures")
#: Fields of a link that its other descriptions replace.
_DESCRIBING = ("material", "section", "table")
_WAY = "A link is described by constants, by its material and section, or by a table."


def groups_of(project: state.Project) -> list[Group]:
    """Return the fields of a project, by part of the scenario."""
    record, arm = project.record, project.record.arm
    lengths = [link.reach for link in arm.links]
    of = FieldMaker(Sizes(len(lengths), sum(lengths), max(lengths)))
    groups = [Group(f"Link {k + 1}", partial(of.link, link, k)) for k, link in enumerate(arm.links)]
    groups += [
        Group(f"Joint {k + 1}", partial(of.record, joint, ("arm", "joints", k)))
        for k, joint in enumerate(arm.joints)
    ]
    groups.append(Group("Payload", partial(of.group, _value_of(arm, "payload", ("arm",)))))
    rest = [name for name in type(arm).model_fields if name not in ("links", "joints", "payload")]
    groups.append(Group("Arm", partial(of.groups, [_value_of(arm, k, ("arm",)) for k in rest])))
    for name in type(record).model_fields:
        if isinstance(record, StudySpec) and name in state.STUDIED:
            one = state.STUDIED[name]
            value = getattr(record, name)[getattr(project.choice, one)]
            forms = field_forms(type(record), name).given[0].items()
            described = _Value(value, forms, (one,), one, f"The {one} that is simulated.")
            groups.append(Group(_title(one), partial(of.group, described)))
        elif name not in ("arm", *SAMPLED):
            groups.append(Group(_title(name), partial(of.group, _value_of(record, name, ()))))
    groups.append(Group("Comparison", partial(_comparison, project.beside is not None)))
    return groups


def _comparison(two: bool) -> Iterator[_Entry]:
    """Yield the buttons of a second drive."""
    texts = {state.MOVE: "Exchange both drives", state.REMOVE: "Remove the drive beside"}
    about = "Its run is shown beside that of the drive, with a table of both."
    for word, text in texts.items() if two else [(state.NEW, "Compare with another drive")]:
        yield Field((state.BESIDE, word), text, None, "button", "", about)


def _title(name: str) -> str:
    return _NAMES.get(name, name).replace("_", " ").capitalize()


@dataclass(frozen=True, eq=False)
class _Value:
    """A value, its forms, its path in the scenario, and the name and description of its key."""

    value: Any
    forms: Forms
    path: Path
    name: str
    description: str

    @property
    def label(self) -> str:
        """The name in words."""
        return _NAMES.get(self.name, self.name).replace("_", " ").removesuffix(" hz")

    @property
    def other(self) -> tuple[Path, str] | None:
        """The edit that gives the value its other form, or None."""
        other = self.forms.other(self.value)
        return ((*self.path, state.FORM), other) if other else None

    def at(self, *part: str | int) -> Path:
        """Return a path in the value."""
        return (*self.path, *part)


def _value_of(record: Record, name: str, path: Path) -> _Value:
    description = descriptions_of(type(record)).get(name, "")
    return _Value(
        getattr(record, name), field_forms(type(record), name), (*path, name), name, description
    )


class FieldMaker:
    """Makes the fields of an arm of some sizes."""

    def __init__(self, sizes: Sizes) -> None:
        self._sizes = sizes

    def groups(self, values: Sequence[_Value]) -> Iterator[_Entry]:
        """Yield the fields of values that share a group."""
        for of in values:
            yield from self.group(of)

    def group(self, of: _Value) -> Iterator[_Entry]:
        """Yield the fields of a value whose title is that of a group."""
        for entry in self._value(of):
            same = isinstance(entry, Part) and entry.path == of.path
            yield from entry.entries if same else (entry,)  # type: ignore[union-attr]

    def link(self, link: Link, k: int) -> Iterator[_Entry]:
        """Yield the fields of a link, and buttons that change the row of links and joints."""
        yield from self.record(link, (*state.LINKS, k))
        last = k == self._sizes.links - 1
        edits = {state.COPY: "Copy link {}", state.MOVE: "Exchange link {} with the next one"}
        for word, text in {**edits, state.REMOVE: "Remove link {}"}.items():
            if not (last and word == state.MOVE) and self._sizes.links > (word != state.COPY):
                path, about = (*state.LINKS, k, word), "With the joint at its root."
                yield Field(path, text.format(k + 1), None, "button", "", about)

    def record(self, record: Record, path: Path) -> Iterator[_Entry]:
        """Yield the fields of a record: first those that files usually have."""
        usual, more = _USUAL.get(type(record)), []
        fields = type(record).model_fields
        hidden = {state.KIND} if kind_of(type(record)) is not None else set()
        if isinstance(record, Link):
            now = state.way_of(record)
            hidden |= {name for way, names in state.WAYS.items() if way != now for name in names}
            choices = _choices([(way, way) for way in state.WAYS])
            yield Field((*path, state.WAY), "described by", now, "list", "", _WAY, choices=choices)
        if record._columns:
            yield _table(record, path)
            hidden |= set(() if _has_points(record) else record._columns)
        for name, field in fields.items():
            if name in hidden:
                continue
            of = _value_of(record, name, path)
            if name in _DESCRIBING and isinstance(record, Link):
                of = replace(of, forms=replace(of.forms, optional=False))
            entries = self._value(of)
            if name in usual if usual else not of.forms.optional or of.forms.kinds:
                yield from entries
            else:
                more.append((of.value == field.default, tuple(entries)))
        if more:
            every = tuple(entry for _, entries in more for entry in entries)
            folded = all(omitted for omitted, _ in more)
            yield Part(_MORE, (*path, _MORE), every, folded=folded)

    def _value(self, of: _Value) -> Iterator[_Entry]:
        """Yield the fields of a value of any form."""
        entries = of.forms.named("list")
        if entries is not None and entries.items().records:
            yield self._list(of, entries.items())
        elif of.forms.kinds:
            yield from self._kinds(of)
        elif isinstance(of.value, Record):
            yield self._single(of)
        elif of.value is None and of.forms.records:
            yield Field(of.at(state.NEW), f"Add {of.label}", None, "button", "", of.description)
        else:
            yield from self._plain(of)

    def _list(self, of: _Value, forms: Forms) -> Part:
        """Return the entries of a list of records, and a button that adds one."""
        one = of.label.removesuffix("s")
        parts: list[_Entry] = []
        for k, entry in enumerate(of.value or ()):
            inside = _Value(entry, forms, of.at(k), "kind", of.description)
            fields = self._kinds(inside) if forms.kinds else self.record(entry, of.at(k))
            title = f"{one} {k + 1}"
            ended = (*fields, _remove(of.at(k), title))
            parts.append(Part(title.capitalize(), of.at(k), ended))
        button = Field(of.at(state.NEW), f"Add {one}", None, "button", "", of.description)
        return Part(of.label.capitalize(), of.path, (*parts, button))

    def _kinds(self, of: _Value) -> Iterator[_Entry]:
        """Yield the kind of a record and the fields of this kind."""
        now = "none" if of.value is None else of.value.kind
        choices = _grouped(of.forms.kinds, of.forms.optional)
        yield Field(of.at(state.KIND), of.label, now, "list", "", of.description, choices=choices)
        if of.value is not None:
            prefix = "" if len(of.path) == 1 or of.name == "kind" else f"{of.label} "
            for entry in self.record(of.value, of.path):
                if isinstance(entry, Field) and entry.control != "button":
                    entry = replace(entry, label=prefix + entry.label)
                yield entry

    def _single(self, of: _Value) -> Part:
        """Return the fields of a record that has no kinds, under its name."""
        fields = list(self.record(of.value, of.path))
        if isinstance(of.value, Material):
            known = next((name for name, own in MATERIALS.items() if own == of.value), state.OWN)
            choices = _choices([(name, name) for name in (*MATERIALS, state.OWN)])
            preset = Field(of.at(state.PRESET), of.label, known, "list", "", of.description)
            fields.insert(0, replace(preset, choices=choices))
        if of.other is not None and isinstance(fields[0], Field):
            fields[0] = replace(fields[0], other=of.other)
        return _part(of, fields)

    def _plain(self, of: _Value) -> Iterator[_Entry]:
        """Yield the fields of a value that is not a record."""
        value, form, words = of.value, of.forms.of(of.value), _words(of)
        if words and (form is None or form.name in ("choice", "word", "flag")):
            yield Field(of.path, of.label, value, "list", "", of.description, choices=words)
        elif form is not None and form.name == "flag" and len(of.forms.given) == 1:
            yield Field(of.path, of.label, value, "switch", "", of.description)
        elif form is not None and form.name == "number":
            yield replace(self._slider(of, form, of.path, of.label, value), other=of.other)
        elif form is not None and form.name in ("pair", "list") and _few_numbers(value, form):
            fields = list(self._numbers(of, form))
            fields[0] = replace(fields[0], other=of.other)
            yield from (_part(of, fields),) if of.forms.optional else fields
        else:
            shown = None if form is None else value
            unit = unit_of(of.description)
            yield Field(of.path, of.label, shown, "text", unit, of.description, other=of.other)

    def _numbers(self, of: _Value, form: Form) -> Iterator[Field]:
        """Yield a slider for each number of a list or a list of points."""
        item = form.items().given[0]
        for k, value in enumerate(of.value):
            part = f" {_AXES[k]}" if _POINT.search(of.description) and k < 2 else f" {k + 1}"
            if not isinstance(value, tuple):
                yield self._slider(of, item, of.at(k), of.label + part, value)
                continue
            for axis, number in enumerate(value):
                label = f"{of.label} {k + 1} {_AXES[axis]}"
                yield self._slider(of, item.items().given[0], of.at(k, axis), label, number)

    def _slider(self, of: _Value, form: Form, path: Path, label: str, value: float) -> Field:
        about = of.description
        limits = _range_of(of.name, value, about, form, self._sizes)
        return Field(path, label, value, "slider", unit_of(about), about, limits)


def _part(of: _Value, fields: Sequence[_Entry]) -> Part:
    """Return the fields of a value under its name, with a button that removes it if it may be."""
    end = (_remove(of.path, of.label),) if of.forms.optional else ()
    return Part(of.label.capitalize(), of.path, (*fields, *end))


def _remove(path: Path, label: str) -> Field:
    return Field((*path, state.REMOVE), f"Remove {label}", None, "button")


def _table(record: Record, path: Path) -> Field:
    names = [name for name in record._columns if getattr(record, name) is not None]
    texts = descriptions_of(type(record))
    about = " ".join(f"{name}: {texts[name]}" for name in record._columns)
    label = ", ".join(names).replace("_", " ")
    return Field((*path, state.TABLE), label, state.table_text(record), "table", "", about)


def _choices(entries: Sequence[tuple[Any, str]]) -> _Choices:
    return (("", tuple(entries)),)


def _in_words(word: str) -> str:
    """Return a word of a file as it is usually written, such as joint PD for joint_pd."""
    plain = word.replace("_", " ")
    return _WRITTEN.get(plain) or " ".join(_WRITTEN.get(part, part) for part in plain.split())


def _grouped(kinds: Sequence[Form], optional: bool) -> _Choices:
    """Return the entries of a list of kinds; those of drives under the titles of their groups."""
    words = {form.type: (form.kind, _in_words(str(form.kind))) for form in kinds}
    drives = tuple(
        (title, tuple(words[record] for record in records if record in words))
        for title, records in DRIVES.items()
    )
    if any(entries for _, entries in drives):
        return tuple((title, entries) for title, entries in drives if entries)
    return _choices([*([("none", "none")] if optional else []), *words.values()])


def _words(of: _Value) -> tuple[Any, ...]:
    """Return the entries of a list for a value that is one of several words; else none."""
    forms = of.forms.given
    omitted = [(None, _OMITTED)] if of.forms.optional else []
    if of.name == "integrator":
        return _choices([(name, name) for name in dict.fromkeys(("auto", *INTEGRATORS, of.value))])
    if len(forms) != 1:
        return ()
    if forms[0].name == "choice":
        words = [(word, _in_words(word)) for word in forms[0].words]
        return _choices([*omitted, *words])
    if forms[0].name == "flag" and omitted:
        return _choices([*omitted, (True, "yes"), (False, "no")])
    return ()


def _few_numbers(values: tuple[Any, ...], form: Form) -> bool:
    """Whether a list has few enough finite numbers or points for sliders, and nothing else."""
    names = {item.name for item in form.items().given}
    count = len(values) * (2 if names == {"pair"} else 1)
    return 0 < count <= _MOST_NUMBERS and names in ({"number"}, {"pair"}) and math.inf not in values


def _has_points(record: Record) -> bool:
    """Whether the table of a record is a list of points, few enough for sliders."""
    name, *others = record._columns
    value, form = getattr(record, name), field_forms(type(record), name).named("list")
    if others or form is None or form.items().named("pair") is None:
        return False
    return _few_numbers(value, form)


def points_of(project: state.Project) -> list[tuple[Path, str, tuple[float, float]]]:
    """Return the points of the motion of the tip: path, name in words, and place [x, y] m."""
    motion = project.scenario.motion
    inside: Path = ("motion", "path") if hasattr(motion, "path") else ("motion",)
    spec: Record | None = getattr(motion, "path", motion)
    points: list[tuple[Path, str, tuple[float, float]]] = []
    for name, about in descriptions_of(type(spec)).items() if spec is not None else ():
        value = getattr(spec, name)
        if _PLACE not in about:
            continue
        if isinstance(value[0], tuple):
            points += [((*inside, name, k), f"point {k + 1}", at) for k, at in enumerate(value)]
        else:
            points.append(((*inside, name), name, value))
    return points


#: Entries of a list, as value and word, under titles; an empty title is not shown.
_Choices = tuple[tuple[str, tuple[tuple[Any, str], ...]], ...]


@dataclass(frozen=True)
class Field:
    """One value with its control, or a button."""

    path: Path  # in the simulated scenario, or of an edit; see `flexarm.view.studio.state`.
    label: str  # name in words
    value: Any  # current one; of a table its text
    #: Slider (a number), list (one of ``choices``), switch (true or false), text (YAML), table
    #: (rows of numbers), or button (an edit without a value)
    control: Literal["slider", "list", "switch", "text", "table", "button"]
    unit: str = ""  # of the record's field
    description: str = ""  # of the record's field
    range: _Range | None = None  # of the slider; text may give other values
    choices: _Choices = ()
    #: Edit that gives the value its other form, as a path and the name of the form
    other: tuple[Path, str] | None = None

    @property
    def name(self) -> str:
        """The path as text, as in ``--set``."""
        return path_text(self.path)

    @property
    def word(self) -> str:
        """The entry of the list for the value."""
        entries = [entry for _, group in self.choices for entry in group]
        return next(
            (word for value, word in entries if value is self.value or value == self.value), ""
        )

    def looks_like(self, other: Field) -> bool:
        """Whether the control of another field can show this one."""
        shape = (self.path, self.control, self.label, self.choices, self.other)
        return shape == (other.path, other.control, other.label, other.choices, other.other)


@dataclass(frozen=True)
class Part:
    """Fields under one title."""

    title: str
    path: Path  # of the value that they describe
    entries: tuple[_Entry, ...]
    folded: bool = False  # whether it starts closed

    def looks_like(self, other: Part) -> bool:
        """Whether the controls of another part can show this one."""
        same = (self.title, self.path) == (other.title, other.path)
        return same and alike(self.entries, other.entries)


_Entry = Field | Part


def alike(some: tuple[_Entry, ...], others: tuple[_Entry, ...]) -> bool:
    """Whether the controls of some entries can show others."""
    return len(some) == len(others) and all(
        type(one) is type(other) and one.looks_like(other)  # type: ignore[arg-type]
        for one, other in zip(some, others, strict=True)
    )


def fields_in(entries: Iterable[_Entry]) -> Iterator[Field]:
    """Yield the fields among entries, those of parts included."""
    for entry in entries:
        if isinstance(entry, Part):
            yield from fields_in(entry.entries)
        else:
            yield entry


@dataclass(frozen=True, eq=False)
class Group:
    """Part of the panel with a title, whose fields are made when they are shown."""

    title: str
    make: Callable[[], Iterator[_Entry]]

    @cached_property
    def entries(self) -> tuple[_Entry, ...]:
        """The fields and their parts."""
        return tuple(self.make())


#: Nonnegative numbers that are zero in special cases only.
_POSITIVE = ("mass_per_length",)
#: Largest slider value for a number that is zero, by unit; 1 for others.
_USUAL_MOST = {
    "rad": math.pi,
    "m/s^2": 10.0,
    "kg": 2.0,
    "kg m^2": 0.1,
    "N m/rad": 100.0,
    "Hz": 10.0,
    "N": 10.0,
}
_ROUND = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)


@dataclass(frozen=True)
class _Range:
    low: float
    high: float
    step: float


@dataclass(frozen=True)
class Sizes:
    """Sizes of an arm that limit sliders."""

    links: int  # number of links
    reach: float  # m
    longest: float  # length of the longest link (m)


def _range_of(name: str, value: float, description: str, form: Form, sizes: Sizes) -> _Range:
    bounds = list(form.bounds())
    lowest = max((bound for bound, below, _ in bounds if below), default=-math.inf)
    highest = min((bound for bound, below, _ in bounds if not below), default=math.inf)
    if form.type is int:
        most = {"link": sizes.links, "joint": sizes.links}.get(name, max(8.0, 2.0 * value))
        least = -most if lowest < 0.0 else lowest
        return _Range(least, max(min(most, highest), least + 1.0, value), 1.0)
    if _PLACE in description:
        return _Range(-sizes.reach, sizes.reach, _nice(sizes.reach / 300.0))
    scale = abs(value) or _USUAL_MOST.get(unit_of(description), 1.0) / 2.0
    high = sizes.longest if name == "station" else _nice(2.0 * scale)
    step = _nice(high / 300.0)
    low = 0.0 if lowest >= 0.0 else -high
    open_below = any(below and strict for _, below, strict in bounds)
    open_above = any(not below and strict for _, below, strict in bounds)
    if open_below or name in _POSITIVE:
        lowest = max(lowest, 0.0) + step if lowest >= 0.0 or name in _POSITIVE else lowest + step
    return _Range(max(low, lowest), min(high, highest - step if open_above else highest), step)


def _nice(value: float) -> float:
    """Return a round number that is not smaller."""
    power = 10.0 ** math.floor(math.log10(value))
    factor = next(k for k in _ROUND if k * power >= value * (1.0 - 1e-9))
    return float(f"{factor * power:.6g}")
