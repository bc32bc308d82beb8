"""The values of a window: groups of fields, and the names of what a study simulates."""

from __future__ import annotations

from collections.abc import Callable

from nicegui import ui
from nicegui.events import ValueChangeEventArguments

from flexarm.base.errors import InputError
from flexarm.model.wording import Path
from flexarm.view.studio.controls import Control, Set
from flexarm.view.studio.state import STUDIED, Choice, Project
from flexarm.view.studio.values.edits import FORM
from flexarm.view.studio.values.field import Field, Group, Part, alike, fields_in
from flexarm.view.studio.values.fields import groups_of

#: Groups that are open when a window opens; the others of many links would fill the screen.
_OPEN = ("Link 1", "Link 2", "Payload", "Motion", "Drive", "Plant")

Put = Callable[[Project], None]


class Panel:
    """Values of a project, each with its control.

    A group has no controls before it is opened, and is not updated while it is closed.

    Args:
        preview, commit: as for `Control`.
        put: receives a project with another choice of what to simulate.
    """

    def __init__(self, preview: Set, commit: Set, put: Put) -> None:
        self._preview, self._commit, self._put = preview, commit, put
        self._place = ui.element("aside").classes("panel").props('aria-label="values"')
        self._project: Project | None = None
        self._choice: Choice | None = None
        self._names: list[str] = []
        self._groups: dict[str, _GroupPanel] = {}

    def show(self, project: Project) -> None:
        """Show a project."""
        groups = groups_of(project)
        names = [*_names(project), *(group.title for group in groups)]
        self._project = project
        if names != self._names or project.choice != self._choice:
            self._names, self._choice = names, project.choice
            opened = {title: panel.is_open for title, panel in self._groups.items()}
            self._place.clear()
            with self._place:
                if project.choice is not None:
                    for one in ("drive", "motion", "plant"):
                        _Chooser(self._now, one, self._put)
                self._groups = {
                    group.title: _GroupPanel(
                        group, opened.get(group.title, group.title in _OPEN), self._control
                    )
                    for group in groups
                }
        for group in groups:
            self._groups[group.title].show(group)

    def _now(self) -> Project:
        assert self._project is not None
        return self._project

    def explain(self, path: Path, message: str) -> None:
        """Show a message beside the field of an edit, or remove it if it is empty."""
        found = self._controls()
        value = path[:-1] if path[-1] == FORM else path
        at = [each for each in found if each.field.path[: len(value)] == value]
        exact = [each for each in found if each.field.path == path]
        for control in (exact or at)[:1]:
            control.explain(message)

    def explain_named(self, name: str, message: str) -> None:
        """Show a message beside the fields that belong to a name in a problem, or contain it."""
        controls = self._controls()
        inside = [each for each in controls if each.field.name.startswith(name)]
        around = [each for each in controls if name.startswith(each.field.name.split(".<")[0])]
        around.sort(key=lambda each: len(each.field.name))
        for control in inside or around[-1:]:
            control.explain(message)

    def _controls(self) -> list[Control]:
        return [each for panel in self._groups.values() for each in panel.controls.values()]

    def _control(self, field: Field) -> Control:
        return Control(field, self._preview, self._commit, self.explain)


class _GroupPanel:
    """Controls of one group."""

    def __init__(self, group: Group, opened: bool, make: Callable[[Field], Control]) -> None:
        self._make, self._latest = make, group
        self._shown: Group | None = None
        self.controls: dict[Path, Control] = {}
        self._folded: dict[Path, ui.expansion] = {}
        self._body = ui.expansion(group.title, value=opened, on_value_change=self._opened)
        self._body.classes("group").props(f'data-group="{group.title}"')

    @property
    def is_open(self) -> bool:
        """Whether the user sees the controls."""
        return bool(self._body.value)

    def _opened(self) -> None:
        self.show(self._latest)

    def show(self, group: Group) -> None:
        """Show the values of the group, in its controls if they fit."""
        self._latest = group
        if not self.is_open or self._shown is group:
            return
        if self._shown is not None and alike(self._shown.entries, group.entries):
            for field in fields_in(group.entries):
                self.controls[field.path].show(field)
        else:
            opened = {path: part.value for path, part in self._folded.items()}
            self._body.clear()
            self.controls.clear()
            self._folded.clear()
            with self._body:
                for entry in group.entries:
                    self._add(entry, opened)
        self._shown = group

    def _add(self, entry: Field | Part, opened: dict[Path, bool]) -> None:
        if isinstance(entry, Field):
            self.controls[entry.path] = self._make(entry)
            return
        value = opened.get(entry.path, not entry.folded)
        part = ui.expansion(entry.title, value=value).classes("part").props("dense")
        self._folded[entry.path] = part
        with part:
            for inner in entry.entries:
                self._add(inner, opened)


def _names(project: Project) -> list[str]:
    """Return the names of what a study can simulate."""
    if project.choice is None:
        return []
    return [f"{names} {name}" for names in STUDIED for name in getattr(project.record, names)]


class _Chooser:
    """List of the drives, motions or plants of a study, and buttons that change the list."""

    def __init__(self, now: Callable[[], Project], one: str, put: Put) -> None:
        self._project, self._one, self._put = now, one, put
        names = next(names for names, each in STUDIED.items() if each == one)
        known, chosen = list(getattr(now().record, names)), getattr(now().choice, one)
        with ui.element("div").classes("choice"):
            label = f"{one} of the study"
            choice = ui.select(known, label=label, value=chosen, on_change=self._chosen)
            choice.props("dense outlined")
            with ui.element("div").classes("line"):
                self._add_button("Copy", lambda: self._try(lambda: now().copied(one)))
                with self._add_button("Rename"), ui.menu():
                    self._input = ui.input(label=f"name of the {one}", value=chosen)
                    self._input.props("dense outlined autofocus").classes("rename")
                    self._input.on("keydown.enter", self._renamed)
                self._add_button("Remove", lambda: self._try(lambda: now().removed(one)))
            self._message = ui.label().classes("message").props("role=alert")
            self._message.set_visibility(False)

    def _add_button(self, text: str, call: Callable[[], None] | None = None) -> ui.button:
        button = ui.button(text, on_click=call).classes("edit")
        return button.props(f'flat dense no-caps aria-label="{text} the {self._one}"')

    def _chosen(self, event: ValueChangeEventArguments[str]) -> None:
        self._put(self._project().chosen(**{self._one: event.value}))

    def _renamed(self) -> None:
        self._try(lambda: self._project().renamed(self._one, str(self._input.value)))

    def _try(self, make: Callable[[], Project]) -> None:
        try:
            project = make()
        except InputError as error:
            self._message.set_text("\n".join(problem.statement for problem in error.problems))
            self._message.set_visibility(True)
            return
        self._put(project)
