"""The values of a window: groups of fields with their controls, and names of a study."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui
from nicegui.events import GenericEventArguments, ValueChangeEventArguments

from flexarm.base.errors import InputError
from flexarm.model.file_format.files import content_of
from flexarm.model.file_format.yaml_text import change_of, flow_text
from flexarm.model.wording import Path
from flexarm.view.studio.state import FORM, KEYS, ORIGIN, STUDIED, Choice, Project
from flexarm.view.studio.values.fields import Field, Group, Part, alike, fields_in, groups_of

#: Groups that are open when a window opens; the others of many links would fill the screen.
_OPEN = ("Link 1", "Link 2", "Payload", "Motion", "Drive", "Plant")

Put = Callable[[Project], None]


class Panel:
    """Values of a project, each with its control.

    A group has no controls before it is opened, and is not updated while it is closed. ``put``
    receives a project with another choice of what to simulate.
    """

    def __init__(self, preview: _Set, commit: _Set, put: Put) -> None:
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
        controls = self._controls()
        value = path[:-1] if path[-1] == FORM else path
        at = [each for each in controls if each.field.path[: len(value)] == value]
        exact = [each for each in controls if each.field.path == path]
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

    def _controls(self) -> list[_Control]:
        return [each for panel in self._groups.values() for each in panel.controls.values()]

    def _control(self, field: Field) -> _Control:
        return _Control(field, self._preview, self._commit, self.explain)


class _GroupPanel:
    def __init__(self, group: Group, opened: bool, make: Callable[[Field], _Control]) -> None:
        self._make, self._latest = make, group
        self._shown: Group | None = None
        self.controls: dict[Path, _Control] = {}
        self._folded: dict[Path, ui.expansion] = {}
        self._body = ui.expansion(group.title, value=opened)
        self._body.on_value_change(lambda: self.show(self._latest))
        self._body.classes("group").props(f'data-group="{group.title}"')

    @property
    def is_open(self) -> bool:
        """Whether the user sees the controls."""
        return bool(self._body.value)

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
        self._one, self._put = one, put
        known, chosen = list(getattr(now().record, KEYS[one])), getattr(now().choice, one)
        with ui.element("div").classes("choice"):
            label = f"{one} of the study"
            choice = ui.select(known, label=label, value=chosen)
            choice.on_value_change(lambda event: put(now().chosen(**{one: event.value})))
            choice.props("dense outlined")
            with ui.element("div").classes("line"):
                self._add_button("Copy", lambda: self._try(lambda: now().copied(one)))
                with self._add_button("Rename"), ui.menu():
                    name = ui.input(label=f"name of the {one}", value=chosen)
                    name.props("dense outlined autofocus").classes("rename")
                    name.on(
                        "keydown.enter",
                        lambda: self._try(lambda: now().renamed(one, str(name.value))),
                    )
                self._add_button("Remove", lambda: self._try(lambda: now().removed(one)))
            self._message = ui.label().classes("message").props("role=alert")
            self._message.set_visibility(False)

    def _add_button(self, text: str, call: Callable[[], None] | None = None) -> ui.button:
        button = ui.button(text, on_click=call).classes("edit")
        return button.props(f'flat dense no-caps aria-label="{text} the {self._one}"')

    def _try(self, make: Callable[[], Project]) -> None:
        try:
            project = make()
        except InputError as error:
            self._message.set_text("\n".join(problem.statement for problem in error.problems))
            self._message.set_visibility(True)
            return
        self._put(project)


#: Shortest time between the values of a slider that moves, s.
_THROTTLE = 0.04
#: The other form of a value, on the button that switches to it; from a table to a constant.
_FORMS = {"list": "one for each", "number": "one for all", "record": "as table"}
_CONSTANT = "as constant"

#: Receives the path of a field and its new value.
_Set = Callable[[Path, Any], None]


class _Control:
    """Control of one field: ``preview`` while a slider moves, ``refuse`` for text without value."""

    def __init__(
        self, field: Field, preview: _Set, commit: _Set, refuse: Callable[[Path, str], None]
    ) -> None:
        self.field, self._commit = field, commit
        self._preview, self._refuse = preview, refuse
        self._slider: ui.slider | None = None
        self._text: ui.input | ui.textarea | None = None
        self._choice: _List | ui.switch | None = None
        unit = field.unit.replace("^2", "²").replace("^3", "³")
        self._name = f"{field.label} [{unit}]" if unit else field.label
        with ui.element("div").classes("field").props(f"data-path={_quoted(field.name)}"):
            if field.control not in ("switch", "button"):  # which contain their label
                with ui.element("div").classes("line"):
                    ui.label(self._name).classes("name").tooltip(self.field.description)
                    if self.field.other is not None:
                        path, form = self.field.other
                        words = _CONSTANT if self.field.control == "table" else _FORMS[form]
                        button = ui.button(words, on_click=lambda: self._commit(path, form))
                        button.classes("other").props("flat dense no-caps")
            getattr(self, f"_add_{field.control}")()
            self._message = ui.label().classes("message").props("role=alert")
            self._message.set_visibility(False)

    def _add_slider(self) -> None:
        field = self.field
        assert field.range is not None
        low, high, step = field.range.low, field.range.high, field.range.step
        with ui.element("div").classes("line"):
            self._slider = ui.slider(min=low, max=high, step=step, value=field.value)
            self._slider.props(self._named())
            self._slider.on("update:model-value", self._moved, throttle=_THROTTLE)
            self._slider.on("change", self._released)
            self._add_text("inputmode=decimal")

    def _add_text(self, more: str = 'placeholder="not set"') -> None:
        self._text = ui.input(value=_value_text(self.field))
        self._text.props(f"dense outlined {self._named()} {more}")
        self._text.on("keydown.enter", self._typed).on("blur", self._typed)

    def _add_table(self) -> None:
        self._text = ui.textarea(value=_value_text(self.field)).classes("table")
        self._text.props(f"dense outlined {self._named()} wrap=off spellcheck=false")
        self._text.on("keydown.ctrl.enter", self._typed).on("blur", self._typed)

    def _add_list(self) -> None:
        self._choice = _List(self.field, self._chosen)
        self._choice.props(f"dense outlined options-dense {self._named()}")

    def _add_switch(self) -> None:
        self._choice = ui.switch(self._name, value=self.field.value, on_change=self._chosen)
        self._choice.tooltip(self.field.description)

    def _add_button(self) -> None:
        button = ui.button(self._name, on_click=lambda: self._commit(self.field.path, None))
        button.classes("edit").props("flat dense no-caps align=left")
        if self.field.description:
            button.tooltip(self.field.description)

    def _named(self) -> str:
        return f"aria-label={_quoted(self._name)}"

    def show(self, field: Field) -> None:
        """Show the value of a field with the same path and control, without a message."""
        self.field = field
        self.explain("")
        if self._slider is not None:
            for end, choose in (("min", min), ("max", max)):
                limit = choose(self._slider.props[end], field.value)
                if limit != self._slider.props[end]:
                    self._slider.props[end] = limit
            self._slider.set_value(field.value)
        if self._text is not None:
            self._text.set_value(_value_text(field))
        if isinstance(self._choice, _List):
            self._choice.set_value(field.word)
        elif self._choice is not None:
            self._choice.set_value(field.value)

    def explain(self, message: str) -> None:
        """Show a message beside the value, or remove it if it is empty."""
        if message == self._message.text:
            return
        self._message.set_text(message)
        self._message.set_visibility(bool(message))
        if self._text is not None:
            self._text.props["error"] = bool(message)

    def _moved(self, event: GenericEventArguments) -> None:
        value = self._number(event.args)
        if self._text is not None:
            self._text.set_value(_number_text(value))
        self._preview(self.field.path, value)

    def _released(self, event: GenericEventArguments) -> None:
        self._commit(self.field.path, self._number(event.args))

    def _typed(self) -> None:
        """Commit the text: that of a table, or a value in YAML as on the command line."""
        assert self._text is not None
        text = str(self._text.value or "")
        if text == _value_text(self.field):
            self.explain("")
            return
        if self.field.control == "table":
            self._commit(self.field.path, text)
            return
        try:
            change = change_of(ORIGIN, f"{self.field.name}={text}")
        except ValueError as error:
            self._refuse(self.field.path, str(error))
            return
        self._commit(self.field.path, change.value)

    def _chosen(self, event: ValueChangeEventArguments[Any]) -> None:
        value = event.value
        if self.field.control == "list":
            entries = [entry for _, group in self.field.choices for entry in group]
            value = next(own for own, word in entries if word == event.value)
        if value != self.field.value:
            self._commit(self.field.path, value)

    def _number(self, value: Any) -> Any:
        """Return the number of a slider, without the rounding errors of its steps."""
        if isinstance(self.field.value, int) or not isinstance(value, int | float):
            return value
        return float(f"{value:.10g}")


class _List(ui.select):
    """List whose entries stand under titles, which cannot be chosen."""

    def __init__(self, field: Field, chosen: Callable[[Any], None]) -> None:
        titles = [title for title, _ in field.choices if title]
        self._titles = set(titles)
        words: list[str] = []
        for title, entries in field.choices:
            words += [title] * bool(title)
            words += [word for _, word in entries]
        super().__init__(words, value=field.word, on_change=chosen)

    def _update_options(self) -> None:
        super()._update_options()
        for option in self._props["options"]:
            if option["label"] in self._titles:
                option["disable"] = True


def _value_text(field: Field) -> str:
    """Return the value of a field as text: a table as it is, others as in files."""
    if field.value is None:
        return ""
    if field.control == "table":
        return str(field.value)
    if isinstance(field.value, int | float) and not isinstance(field.value, bool):
        return _number_text(field.value)
    return flow_text(content_of(field.value))


def _number_text(value: Any) -> str:
    """Return a number as it is usually written."""
    mantissa, _, power = f"{value:.9e}".partition("e")
    short = f"{mantissa.rstrip('0').rstrip('.')}e{int(power)}"
    plain = repr(value).removesuffix(".0")
    return short if len(plain) > 8 and len(short) < len(plain) and float(short) == value else plain


def _quoted(text: str) -> str:
    """Return text of labels and paths as the value of an attribute."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
