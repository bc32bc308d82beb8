"""A value with its control, and parts of the panel that group them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from flexarm.model.wording import Path, path_text
from flexarm.view.studio.values.ranges import Range

#: Entries of a list, as value and word, under titles; an empty title is not shown.
Choices = tuple[tuple[str, tuple[tuple[Any, str], ...]], ...]


@dataclass(frozen=True)
class Field:
    """One value with its control, or a button.

    Attributes:
        path: in the simulated scenario, or of an edit; see `flexarm.view.studio.values.edits`.
        label: name in words. value: current one; of a table its text.
        control: slider (a number), list (one of ``choices``), switch (true or false), text (YAML),
            table (rows of numbers), or button (an edit without a value).
        unit, description: of the record's field.
        range: of the slider; text may give other values.
        other: edit that gives the value its other form, as a path and the name of the form.
    """

    path: Path
    label: str
    value: Any
    control: Literal["slider", "list", "switch", "text", "table", "button"]
    unit: str = ""
    description: str = ""
    range: Range | None = None
    choices: Choices = ()
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
    """Fields under one title.

    Attributes:
        path: of the value that they describe. folded: whether it starts closed.
    """

    title: str
    path: Path
    entries: tuple[Entry, ...]
    folded: bool = False

    def looks_like(self, other: Part) -> bool:
        """Whether the controls of another part can show this one."""
        same = (self.title, self.path) == (other.title, other.path)
        return same and alike(self.entries, other.entries)


Entry = Field | Part


def alike(some: tuple[Entry, ...], others: tuple[Entry, ...]) -> bool:
    """Whether the controls of some entries can show others."""
    return len(some) == len(others) and all(
        type(one) is type(other) and one.looks_like(other)  # type: ignore[arg-type]
        for one, other in zip(some, others, strict=True)
    )


def fields_in(entries: Iterable[Entry]) -> Iterator[Field]:
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
    make: Callable[[], Iterator[Entry]]

    @cached_property
    def entries(self) -> tuple[Entry, ...]:
        """The fields and their parts."""
        return tuple(self.make())

    @property
    def fields(self) -> list[Field]:
        """All fields, those of parts included."""
        return list(fields_in(self.entries))
