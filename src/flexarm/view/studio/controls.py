"""Controls of a field in the browser, each with a message beside it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui
from nicegui.events import GenericEventArguments, ValueChangeEventArguments

from flexarm.model.file_format.content import content_of
from flexarm.model.file_format.yaml_text import change_of, flow_text
from flexarm.model.wording import Path
from flexarm.view.studio.state import ORIGIN
from flexarm.view.studio.values.field import Field

#: Shortest time between the values of a slider that moves, s.
_THROTTLE = 0.08
#: The other form of a value, on the button that switches to it; from a table to a constant.
_FORMS = {"list": "one for each", "number": "one for all", "record": "as table"}
_CONSTANT = "as constant"

#: Receives the path of a field and its new value.
Set = Callable[[Path, Any], None]


class Control:
    """Control of one field.

    Args:
        field: what it shows.
        preview: called with the values of a slider that moves.
        commit: called with every other new value.
        refuse: called with the path and the message of text that is not a value.
    """

    def __init__(
        self, field: Field, preview: Set, commit: Set, refuse: Callable[[Path, str], None]
    ) -> None:
        self.field, self._commit = field, commit
        self._preview, self._refuse = preview, refuse
        self._slider: ui.slider | None = None
        self._text: ui.input | ui.textarea | None = None
        self._choice: _List | ui.switch | None = None
        unit = field.unit.replace("^2", "²").replace("^3", "³")
        self._name = f"{field.label} [{unit}]" if unit else field.label
        with ui.element("div").classes("field").props(f"data-path={_quoted(field.name)}"):
            add: dict[str, Callable[[], None]] = {
                "slider": self._add_slider,
                "list": self._add_list,
                "switch": self._add_switch,
                "text": self._add_text,
                "table": self._add_table,
                "button": self._add_button,
            }
            add[field.control]()
            self._message = ui.label().classes("message").props("role=alert")
            self._message.set_visibility(False)

    def _add_label(self) -> None:
        with ui.element("div").classes("line"):
            ui.label(self._name).classes("name").tooltip(self.field.description)
            if self.field.other is not None:
                path, form = self.field.other
                words = _CONSTANT if self.field.control == "table" else _FORMS[form]
                button = ui.button(words, on_click=lambda: self._commit(path, form))
                button.classes("other").props("flat dense no-caps")

    def _add_slider(self) -> None:
        field = self.field
        self._add_label()
        assert field.range is not None
        low, high, step = field.range.low, field.range.high, field.range.step
        with ui.element("div").classes("line"):
            self._slider = ui.slider(min=low, max=high, step=step, value=field.value)
            self._slider.props(self._named())
            self._slider.on("update:model-value", self._moved, throttle=_THROTTLE)
            self._slider.on("change", self._released)
            self._input("inputmode=decimal")

    def _add_text(self) -> None:
        self._add_label()
        self._input('placeholder="not set"')

    def _input(self, more: str) -> None:
        self._text = ui.input(value=value_text(self.field))
        self._text.props(f"dense outlined {self._named()} {more}")
        self._text.on("keydown.enter", self._typed).on("blur", self._typed)

    def _add_table(self) -> None:
        self._add_label()
        self._text = ui.textarea(value=value_text(self.field)).classes("table")
        self._text.props(f"dense outlined {self._named()} wrap=off spellcheck=false")
        self._text.on("keydown.ctrl.enter", self._typed).on("blur", self._typed)

    def _add_list(self) -> None:
        self._add_label()
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
            self._text.set_value(value_text(field))
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
        if text == value_text(self.field):
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


def value_text(field: Field) -> str:
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
