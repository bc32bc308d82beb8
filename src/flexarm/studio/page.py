"""One window: its state, its controls, and what it shows of the newest answer."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Callable
from typing import Any

from nicegui import ui
from nicegui.events import UploadEventArguments

from flexarm.errors import InputError
from flexarm.model.wording import Path
from flexarm.studio.compute import Failure, Margins, Part, Picture, Report, Request
from flexarm.studio.controls import Control
from flexarm.studio.fields import Group, groups_of
from flexarm.studio.script import script_of
from flexarm.studio.state import Choice, History, Project, open_bytes
from flexarm.studio.worker import Worker

#: Groups that are open when a window opens; the others of many links would fill the screen.
_OPEN = ("Link 1", "Link 2", "Payload", "Motion", "Drive")
_LARGEST_FILE = 20_000_000  # bytes
_MARGINS = ("", "gain margin", "phase margin [°]", "delay margin [ms]")


class Window:
    """A browser window.

    Args:
        history: its state.
        worker: computes for all windows.

    Attributes:
        key: secret part of the address of its picture.
        latest: number, whether the slider is released, and data (JSON) of the newest picture.
    """

    def __init__(self, history: History, worker: Worker) -> None:
        self.history, self._worker = history, worker
        self.key = secrets.token_urlsafe(16)
        self.latest: tuple[int, bool, str] | None = None
        self._newest = self._shown = 0
        self._asked: Request | None = None
        self._pictured: Project | None = None
        self._seconds = 0.0
        self._controls: dict[Path, Control] = {}
        self._parts: dict[str, ui.expansion] = {}
        self._paths: dict[str, set[Path]] = {}
        self._chosen: Choice | None = None
        self._loop = asyncio.get_running_loop()
        self._client = ui.context.client
        with ui.element("div").classes("studio"):
            self._add_bar()
            with ui.element("main").classes("stage"):
                self._add_stage()
            self._panel = ui.element("aside").classes("panel").props('aria-label="values"')
        self._refresh()

    def close(self) -> None:
        """Drop what is waiting for this window."""
        for owner in (self.key, f"{self.key} report"):
            self._worker.forget(owner)

    # The bar, and what its buttons do.

    def _add_bar(self) -> None:
        with ui.element("header").classes("bar"):
            ui.label("flexarm studio").classes("brand")
            self._name = ui.label().classes("file")
            upload = ui.upload(
                auto_upload=True,
                max_file_size=_LARGEST_FILE,
                on_upload=self._open,
                on_rejected=lambda: self._say("The file is larger than 20 MB."),
            )
            upload.classes("hidden").props("accept=.yaml,.yml")
            self._upload = upload
            pick = f"() => getElement({upload.id}).$refs.qRef.pickFiles()"
            _button("Open", "Open an arm, scenario or study file").on("click", js_handler=pick)
            with _button("Save", "Save a file"), ui.menu():
                for kind in ("model", "scenario", "study"):
                    item = ui.menu_item(f"Save the {kind}", lambda kind=kind: self._save(kind))
                    if kind == "study":
                        self._save_study = item
            with _button("Export", "Export a report or a Python script"), ui.menu():
                ui.menu_item("Report (HTML)", self._report)
                ui.menu_item("Python script", self._script)
            self._undo = _button("Undo", "Undo (Ctrl+Z)", self.undo).classes("undo")
            self._redo = _button("Redo", "Redo (Ctrl+Y)", self.redo).classes("redo")
            self._status = ui.label().classes("status").props("role=status")

    async def _open(self, event: UploadEventArguments) -> None:
        content = await event.file.read()
        self._upload.reset()
        try:
            project = open_bytes(content, event.file.name)
        except InputError as error:
            self._say(f"The file was not opened.\n{error}")
            return
        self._say("")
        self._put(project)

    def _save(self, kind: str) -> None:
        name, text = self.history.now.files()[kind]
        ui.download.content(text, name, "application/yaml")

    def _script(self) -> None:
        project = self.history.now
        ui.download.content(script_of(project), f"{project.name}.py", "text/x-python")

    def _report(self) -> None:
        self._status.set_text("writing the report …")
        request = Request(self.history.now, "report")
        self._worker.submit(f"{self.key} report", request, self._deliver(request))

    def undo(self) -> None:
        """Return to the state before the last edit."""
        self.history.undo()
        self._refresh()

    def redo(self) -> None:
        """Repeat the edit that was undone last."""
        self.history.redo()
        self._refresh()

    # The picture, the numbers and the messages.

    def _add_stage(self) -> None:
        self._notice = ui.label().classes("notice").props("role=alert")
        self._failure = ui.label().classes("notice failure").props("role=alert")
        self._picture = ui.element("div").classes("picture").props(f"data-key={self.key}")
        self._warnings = ui.label().classes("notice").props("role=alert")
        with ui.element("div").classes("numbers"):
            with ui.element("div"):
                ui.label("Natural frequencies").classes("title")
                ui.label("joints locked, at the start").classes("quiet")
                self._frequencies = ui.label("–").classes("frequencies")
            with ui.element("div"):
                ui.label("Margins of the loop").classes("title")
                ui.label("at the start, one joint at a time").classes("quiet")
                self._margins = ui.element("table")
                self._note = ui.label().classes("quiet")
        for label in (self._notice, self._failure, self._warnings):
            label.set_visibility(False)

    def _say(self, text: str) -> None:
        _fill(self._notice, text)

    # Values and their fields.

    def _preview(self, path: Path, value: Any) -> None:
        try:
            project = self.history.now.edited(path, value)
        except InputError as error:
            self._refused(path, error.problems[0].statement)
            return
        self._controls[path].explain("")
        self._ask(Request(project, "preview"))

    def _commit(self, path: Path, value: Any) -> None:
        try:
            project = self.history.now.edited(path, value)
        except InputError as error:
            self._refused(path, error.problems[0].statement)
            self._ask(Request(self.history.now))  # not the preview of a value that was refused
            return
        self._put(project)

    def _choose(self, **names: str) -> None:
        self._put(self.history.now.chosen(**names))

    def _put(self, project: Project) -> None:
        self.history.put(project)
        self._refresh()

    def _refused(self, path: Path, message: str) -> None:
        self._controls[path].explain(message)

    def _refresh(self) -> None:
        """Compute the state, and show it in all fields meanwhile."""
        project = self.history.now
        self._ask(Request(project))
        self._name.set_text(project.name)
        self._undo.set_enabled(self.history.can_undo)
        self._redo.set_enabled(self.history.can_redo)
        self._save_study.set_visibility(project.choice is not None)
        groups = groups_of(project)
        if [group.title for group in groups] != list(self._parts) or project.choice != self._chosen:
            self._build(project, groups)
        else:
            for group in groups:
                self._show_group(group)

    def _build(self, project: Project, groups: list[Group]) -> None:
        """Create the controls of all groups."""
        self._panel.clear()
        self._parts.clear()
        self._controls.clear()
        self._chosen = project.choice
        with self._panel:
            if project.choice is not None:
                self._add_choice(project)
            for group in groups:
                part = ui.expansion(group.title, value=group.title in _OPEN).classes("group")
                part.set_visibility(bool(group.fields))
                self._parts[group.title] = part
                self._fill_group(group)

    def _show_group(self, group: Group) -> None:
        """Show the values of a group, in its controls if they fit."""
        paths = {field.path for field in group.fields}
        same = paths == self._paths[group.title] and all(
            self._controls[field.path].fits(field) for field in group.fields
        )
        if not same:
            for path in self._paths[group.title]:
                del self._controls[path]
            self._parts[group.title].clear()
            self._fill_group(group)
            return
        for field in group.fields:
            self._controls[field.path].show(field)

    def _fill_group(self, group: Group) -> None:
        self._paths[group.title] = {field.path for field in group.fields}
        with self._parts[group.title]:
            for field in group.fields:
                control = Control(field, self._preview, self._commit, self._refused)
                self._controls[field.path] = control

    def _add_choice(self, project: Project) -> None:
        record, choice = project.record, project.choice
        for kind in ("drive", "motion", "plant"):
            names = list(getattr(record, f"{kind}s"))
            ui.select(
                names,
                label=f"{kind} of the study",
                value=getattr(choice, kind),
                on_change=lambda event, kind=kind: self._choose(**{kind: event.value}),
            ).props("dense outlined").classes("choice")

    # Requests and answers.

    def _ask(self, request: Request) -> None:
        if request == self._asked:
            return
        self._asked = request
        settled = request.purpose == "picture"
        if settled and request.project == self._pictured and self.latest is not None:
            # The last value of a slider that moved: its picture is shown already.
            self.latest = (self._shown, True, self.latest[2])
            self._client.run_javascript(f"flexarmStudio.show('{self.key}')")
            request = Request(request.project, "margins")
        self._newest = self._worker.submit(self.key, request, self._deliver(request))
        self._status.set_text("computing …")
        self._margins.classes(add="waiting")

    def _deliver(self, request: Request) -> Callable[[int, Any], None]:
        def deliver(number: int, part: Part) -> None:
            self._loop.call_soon_threadsafe(self._receive, request, number, part)

        return deliver

    def _receive(self, request: Request, number: int, part: Part) -> None:
        """Show a part of an answer, unless a newer one is shown."""
        if self._client.is_deleted:
            return
        with self._client:
            if isinstance(part, Report):
                name = f"{request.project.name}.html"
                ui.download.content(part.text, name, "text/html")
                self._status.set_text("report written")
            elif request.purpose == "report" and isinstance(part, Failure):
                self._say("\n".join(text for _, text in part.problems))
            elif number < self._shown:
                return
            elif isinstance(part, Picture):
                self._show_picture(request, number, part)
            elif isinstance(part, Margins):
                self._show_margins(part)
                if number == self._newest and request.project == self._pictured:
                    self._be_current()
            elif number == self._newest:
                self._show_failure(part)

    def _show_picture(self, request: Request, number: int, part: Picture) -> None:
        self._shown, self._pictured = number, request.project
        self.latest = (number, request.project == self.history.now, part.data)
        self._client.run_javascript(f"flexarmStudio.show('{self.key}')")
        _fill(self._warnings, "\n".join(f"Warning: {text}" for text in part.warnings))
        listed = ", ".join(f"{frequency:.4g}" for frequency in part.frequencies)
        self._frequencies.set_text(f"{listed} Hz" if listed else "none: all links are rigid")
        self._seconds = part.seconds
        if number == self._newest:
            self._be_current()

    def _be_current(self) -> None:
        """Show that the picture is that of the newest request."""
        _fill(self._failure, "")
        self._picture.classes(remove="old")
        self._status.set_text(f"computed in {1e3 * self._seconds:.0f} ms")

    def _show_margins(self, part: Margins) -> None:
        self._note.set_text(part.note)
        self._margins.clear()
        self._margins.classes(remove="waiting")
        if not part.rows:
            return
        with self._margins:
            for k, row in enumerate((_MARGINS, *part.rows)):
                with ui.element("tr"):
                    for text in row:
                        with ui.element("th" if k == 0 else "td"):
                            ui.label(text)

    def _show_failure(self, part: Failure) -> None:
        """Show why there is no picture; the last one stays, marked as old."""
        old = self.latest is not None
        head = "The picture shows the last run that worked." if old else "There is no picture."
        _fill(self._failure, "\n".join([*(text for _, text in part.problems), head]))
        for name, text in part.problems:
            for control in self._controls.values():
                if name and control.field.name.startswith(name):
                    control.explain(text)
        self._picture.classes(add="old")
        self._status.set_text("not computed")
        self._margins.clear()
        self._note.set_text("")


def _button(text: str, help_text: str, call: Callable[[], None] | None = None) -> ui.button:
    button = ui.button(text, on_click=call).props("flat dense no-caps")
    return button.tooltip(help_text)


def _fill(label: ui.label, text: str) -> None:
    """Show a text, or hide its label if it is empty."""
    label.set_text(text)
    label.set_visibility(bool(text))
