"""Controls of a field in the browser: a slider with a number, a list or a switch, and a message."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui
from nicegui.events import GenericEventArguments, ValueChangeEventArguments

from flexarm.model.file_format.changes import change_of
from flexarm.model.wording import Path
from flexarm.studio.fields import Field
from flexarm.studio.state import ORIGIN

#: Shortest time between the values of a slider that moves, s.
_THROTTLE = 0.08

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
        self._input: ui.input | None = None
        self._choice: ui.select | ui.switch | None = None
        unit = field.unit.replace("^2", "²")
        name = f"{field.label} [{unit}]" if unit else field.label
        with ui.element("div").classes("field").props(f"data-path={_quoted(field.name)}"):
            if field.control == "slider":
                self._add_label(name)
                self._add_slider(name)
            elif field.control == "list":
                self._add_label(name)
                words = {word: word.replace("_", " ") for word in field.choices}
                self._choice = ui.select(words, value=field.value, on_change=self._chosen)
                self._choice.props(f"dense outlined options-dense aria-label={_quoted(name)}")
            else:
                self._choice = ui.switch(name, value=field.value, on_change=self._chosen)
                self._choice.tooltip(field.description)
            self._message = ui.label().classes("message").props("role=alert")
            self._message.set_visibility(False)

    def _add_label(self, name: str) -> None:
        ui.label(name).classes("name").tooltip(self.field.description)

    def _add_slider(self, name: str) -> None:
        field = self.field
        with ui.element("div").classes("line"):
            self._slider = ui.slider(
                min=field.low, max=field.high, step=field.step, value=field.value
            )
            self._slider.props(f"aria-label={_quoted(name)}")
            self._slider.on("update:model-value", self._moved, throttle=_THROTTLE)
            self._slider.on("change", self._released)
            self._input = ui.input(value=_text(field.value))
            self._input.props(f"dense outlined aria-label={_quoted(name)} inputmode=decimal")
            self._input.on("keydown.enter", self._typed).on("blur", self._typed)

    def show(self, field: Field) -> None:
        """Show the value of a field with the same path and control, without a message."""
        self.field = field
        self.explain("")
        if self._slider is not None and self._input is not None:
            for end, choose in (("min", min), ("max", max)):
                limit = choose(self._slider.props[end], field.value)
                if limit != self._slider.props[end]:
                    self._slider.props[end] = limit
            self._slider.set_value(field.value)
            self._input.set_value(_text(field.value))
        elif self._choice is not None:
            self._choice.set_value(field.value)

    def explain(self, message: str) -> None:
        """Show a message beside the value, or remove it if it is empty."""
        if message == self._message.text:
            return
        self._message.set_text(message)
        self._message.set_visibility(bool(message))
        if self._input is not None:
            self._input.props["error"] = bool(message)

    def fits(self, field: Field) -> bool:
        """Whether this control can show a field."""
        old = self.field
        return (old.path, old.control, old.choices, old.label) == (
            field.path,
            field.control,
            field.choices,
            field.label,
        )

    def _moved(self, event: GenericEventArguments) -> None:
        value = self._number(event.args)
        if self._input is not None:
            self._input.set_value(_text(value))
        self._preview(self.field.path, value)

    def _released(self, event: GenericEventArguments) -> None:
        self._commit(self.field.path, self._number(event.args))

    def _typed(self) -> None:
        """Commit the text as a value in YAML, as the command line does."""
        assert self._input is not None
        text = str(self._input.value)
        if text == _text(self.field.value):
            self.explain("")
            return
        try:
            change = change_of(ORIGIN, f"{self.field.name}={text}")
        except ValueError as error:
            self._refuse(self.field.path, str(error))
            return
        self._commit(self.field.path, change.value)

    def _chosen(self, event: ValueChangeEventArguments[Any]) -> None:
        if event.value != self.field.value:
            self._commit(self.field.path, event.value)

    def _number(self, value: Any) -> Any:
        """Return the number of a slider, without the rounding errors of its steps."""
        if isinstance(self.field.value, int) or not isinstance(value, int | float):
            return value
        return float(f"{value:.10g}")


def _text(value: Any) -> str:
    """Return a number as it is usually written."""
    return repr(value).removesuffix(".0")


def _quoted(text: str) -> str:
    """Return text of labels and paths as the value of an attribute."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
