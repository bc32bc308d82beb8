"""Fields of a window: the values of a scenario that have a slider, a list or a switch.

Names, units, descriptions and bounds are those of the records.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args, get_origin

from flexarm.integrate import INTEGRATORS
from flexarm.model.checks import Record
from flexarm.model.quantities import Typed
from flexarm.model.wording import Path, path_text
from flexarm.studio.starts import DAMPINGS, DRIVES, MOTIONS
from flexarm.studio.state import Project

#: Keys with a field; of motions and drives all have one.
_LINK = ("length", "flexural_rigidity", "mass_per_length", "section", "elements", "damping")
_JOINT = ("damping", "stiffness", "hub_inertia", "mass", "friction")
_RUN = ("duration", "rate", "integrator", "rtol", "atol", "step")
#: Nonnegative numbers that are zero in special cases only.
_POSITIVE = ("mass_per_length",)
#: Lists with more numbers are edited in the file.
_MOST_NUMBERS = 12
#: Largest slider value for a number that is zero, by unit; 1 for others.
_USUAL = {"rad": math.pi, "m/s^2": 10.0, "kg": 2.0, "kg m^2": 0.1, "N m/rad": 100.0, "Hz": 10.0}
_IN_BRACKETS = re.compile(r"\(((?:[^()]|\([^()]*\))*)\)")
_UNIT_WORDS = {"m", "s", "kg", "N", "Hz", "rad", "Pa", "J"}
_POINT = re.compile(r"\[x, y\]|: x along")
_AXES = ("x", "y")
_ROUND = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)


@dataclass(frozen=True)
class Field:
    """One value with its control.

    Attributes:
        path: in the simulated scenario. label: name in words. value: current one.
        control: slider (a number), list (one of ``choices``) or switch (true or false).
        unit, description: of the record's field.
        low, high, step: range of the slider; text may give other values.
    """

    path: Path
    label: str
    value: Any
    control: Literal["slider", "list", "switch"]
    unit: str = ""
    description: str = ""
    low: float = 0.0
    high: float = 1.0
    step: float = 0.01
    choices: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The path as text, as in ``--set``."""
        return path_text(self.path)


@dataclass(frozen=True)
class Group:
    """Fields under one title."""

    title: str
    fields: tuple[Field, ...]


def groups_of(project: Project) -> list[Group]:
    """Return the fields of a project, by part of the scenario."""
    scenario = project.scenario
    arm, motion, drive = scenario.arm, scenario.motion, scenario.drive
    groups = []
    for k, link in enumerate(arm.links):
        fields = _of_record(link, ("arm", "links", k), _LINK)
        groups.append(Group(f"Link {k + 1}", tuple(fields)))
    for k, joint in enumerate(arm.joints):
        fields = _of_record(joint, ("arm", "joints", k), _JOINT)
        groups.append(Group(f"Joint {k + 1}", tuple(fields)))
    groups.append(Group("Payload", tuple(_of_record(arm.payload, ("arm", "payload")))))
    kinds = _kinds(
        ("motion", "kind"), motion.kind if motion else None, MOTIONS, "Kind of the motion."
    )
    of_motion = _of_record(motion, ("motion",)) if motion else ()
    reach = _nice(sum(link.length for link in arm.links))
    groups.append(Group("Motion", (kinds, *(_within(reach, field) for field in of_motion))))
    kinds = _kinds(("drive", "kind"), drive.kind, DRIVES, "Source of the joint torques.")
    groups.append(Group("Drive", (kinds, *_of_record(drive, ("drive",)))))
    of_arm = _of_record(arm, ("arm",), ("gravity", "theory"))
    groups.append(Group("Run", (*_of_record(scenario.run, ("run",), _RUN), *of_arm)))
    return groups


def _within(reach: float, field: Field) -> Field:
    """Return a field of a motion; points of the tip have the reach of the arm (m) as range."""
    if field.unit != "m" or field.low >= 0.0:
        return field
    return replace(field, low=-reach, high=reach, step=_nice(reach / 300.0))


def _of_record(record: Record, path: Path, names: Sequence[str] | None = None) -> Iterator[Field]:
    """Yield the fields of a record, of the given names or of all."""
    for name, info in type(record).model_fields.items():
        if name == "kind" or (names is not None and name not in names):
            continue
        place, value = (*path, name), getattr(record, name)
        label = name.replace("_", " ").removesuffix(" hz")
        if name == "damping" and len(path) == 3 and path[1] == "links":
            kind = "none" if value is None else value.kind
            yield _kinds((*place, "kind"), kind, DAMPINGS, info.description or "")
        if name == "integrator":
            choices = ("auto", *INTEGRATORS)
            yield Field(place, label, value, "list", "", info.description or "", choices=choices)
            continue
        yield from _of_value(value, place, label, info.description or "", info)


def _of_value(value: Any, path: Path, label: str, description: str, info: Any) -> Iterator[Field]:
    choices = _choices(info.annotation)
    if isinstance(value, Record):
        for field in _of_record(value, path):
            yield _relabelled(field, label)
    elif isinstance(value, bool):
        yield Field(path, label, value, "switch", "", description)
    elif isinstance(value, int | float):
        yield _slider(path, label, value, description, info)
    elif isinstance(value, str) and choices:
        yield Field(path, label, value, "list", "", description, choices=choices)
    elif isinstance(value, tuple) and len(list(_numbers(value))) <= _MOST_NUMBERS:
        joints = not _POINT.search(description)
        for k, item in enumerate(value):
            part = f" {k + 1}" if joints else f" {_AXES[k]}"
            if isinstance(item, tuple):
                for axis, number in zip(_AXES, item, strict=False):
                    place = (*path, k, _AXES.index(axis))
                    yield _slider(place, f"{label}{part} {axis}", number, description, info)
            elif isinstance(item, int | float) and not isinstance(item, bool):
                yield _slider((*path, k), f"{label}{part}", item, description, info)


def _numbers(value: Any) -> Iterator[Any]:
    for item in value:
        yield from _numbers(item) if isinstance(item, tuple) else (item,)


def _relabelled(field: Field, label: str) -> Field:
    return replace(field, label=f"{label} {field.label}")


def _kinds(path: Path, kind: str | None, known: Sequence[str], description: str) -> Field:
    now = kind or "none"
    choices = tuple(dict.fromkeys((*known, now)))
    return Field(path, str(path[-2]), now, "list", "", description, choices=choices)


def _choices(annotation: Any) -> tuple[str, ...]:
    """Return the words of a literal type, or none."""
    if get_origin(annotation) is Literal:
        return tuple(get_args(annotation))
    return next((found for part in get_args(annotation) if (found := _choices(part))), ())


def _slider(path: Path, label: str, value: float, description: str, info: Any) -> Field:
    unit = unit_of(description)
    bounds = list(_bounds(info))
    lowest = max((bound for bound, below, _ in bounds if below), default=-math.inf)
    highest = min((bound for bound, below, _ in bounds if not below), default=math.inf)
    open_below = any(below and strict for _, below, strict in bounds)
    open_above = any(not below and strict for _, below, strict in bounds)
    whole = isinstance(value, int)
    scale = abs(value) or _USUAL.get(unit, 1.0) / 2.0
    high = max(8.0, 2.0 * value) if whole else _nice(2.0 * scale)
    step = 1.0 if whole else _nice(high / 300.0)
    low = 0.0 if lowest >= 0.0 else -high
    if open_below or path[-1] in _POSITIVE:
        lowest = max(lowest, 0.0) + step
    low = max(low, lowest)
    high = min(high, highest - step if open_above else highest)
    return Field(path, label, value, "slider", unit, description, low, high, step)


def unit_of(description: str) -> str:
    """Return the unit in a description, such as N m^2; empty if it has none."""
    for text in reversed(_IN_BRACKETS.findall(description)):
        words = re.sub(r"\^\d|[/()]", " ", text).split()
        if words and set(words) <= _UNIT_WORDS:
            return str(text)
    return ""


def _bounds(item: Any) -> Iterator[tuple[float, bool, bool]]:
    """Yield the bounds in an annotation: number, whether it is a lower one, whether it is open."""
    for name in ("gt", "ge", "lt", "le"):
        bound = getattr(item, name, None)
        if isinstance(bound, int | float):
            yield float(bound), name.startswith("g"), name.endswith("t")
    parts = [*get_args(item), *getattr(item, "metadata", ())]
    if hasattr(item, "annotation"):  # a field of a record, or the type of a parameter
        parts.append(item.annotation)
    if isinstance(item, Typed):
        parts = [item.annotation]
    for part in parts:
        yield from _bounds(part)


def _nice(value: float) -> float:
    """Return a round number that is not smaller."""
    power = 10.0 ** math.floor(math.log10(value))
    factor = next(k for k in _ROUND if k * power >= value * (1.0 - 1e-9))
    return float(f"{factor * power:.6g}")
