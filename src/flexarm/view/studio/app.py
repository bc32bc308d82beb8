"""The server of the studio: its address, and one window for each page."""

from __future__ import annotations

import asyncio
import json
import secrets
from collections.abc import Callable, Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from nicegui import Client, app, ui
from nicegui.events import GenericEventArguments, UploadEventArguments
from starlette.middleware.gzip import GZipMiddleware
from starlette.responses import Response

from flexarm.base.errors import InputError, printable
from flexarm.model import ArmSpec
from flexarm.model.wording import Path, path_text
from flexarm.view.plot.animation.scene import player_function, style
from flexarm.view.studio.compute import (
    Failure,
    Margins,
    Part,
    Picture,
    Report,
    Request,
    Row,
    parts_of,
)
from flexarm.view.studio.guard import Guard, is_loopback
from flexarm.view.studio.panel import Panel
from flexarm.view.studio.presets import PRESETS, cards
from flexarm.view.studio.script import script_of
from flexarm.view.studio.state import (
    LARGEST_FILE,
    History,
    Project,
    link_of,
    open_bytes,
    open_link,
    shown_by,
)
from flexarm.view.studio.values.fields import points_of
from flexarm.view.studio.worker import Worker

_TAB = "flexarm_history"
#: Time (s) for which the state of a closed or reloaded tab is kept.
_KEPT = 12 * 3600.0
#: Time (s) for which a window without connection is kept, such as that of a sleeping computer.
_RECONNECT = 60.0


def serve(project: Project, host: str, port: int, token: str, show: bool) -> None:
    """Serve the studio until it is interrupted; a browser must send the token."""
    worker = Worker(parts_of, lambda text: Failure((("", text),)))
    # The first answers load or compile their kernels while the browser opens.
    for purpose in ("picture", "margins"):
        worker.submit(purpose, Request(project, purpose), lambda number, part: None)
    windows: dict[str, _Window] = {}
    app.storage.max_tab_storage_age = _KEPT
    first = secrets.token_urlsafe(24) if show else ""
    app.add_middleware(Guard, token=token, first=first, local=is_loopback(host), port=port)

    @app.get("/picture/{key}")
    async def picture(key: str, shown: int = 0) -> Response:
        asking = windows.get(key)
        if asking is None or asking.latest is None:
            return Response(status_code=404)
        number, settled, data = asking.latest
        head = {
            "X-Number": str(number),
            "X-Settled": str(int(settled)),
            "Cache-Control": "no-store",
        }
        if shown == number:
            return Response(status_code=204, headers=head)
        return Response(data, media_type="application/json", headers=head)

    @ui.page("/", title="flexarm studio", response_timeout=30.0)
    async def window(client: Client) -> None:
        ui.add_head_html(f"<style>{style()}{_text('studio.css')}</style>")
        script = f"const makePlayer = {player_function()};\n{_text('studio.js')}"
        ui.add_head_html(f"<script>{script}</script>")
        await client.connected()
        if client.is_deleted:
            return  # a program requested the page and did not connect
        # A reloaded page continues with its state; a duplicated tab starts with a copy of it.
        owner, history = app.storage.tab.get(_TAB, (client.tab_id, History(project)))
        if owner != client.tab_id:
            history = history.copy()
        app.storage.tab[_TAB] = (client.tab_id, history)
        made = _Window(history, worker)
        windows[made.key] = made

        def leave(_: Any = None) -> None:
            windows.pop(made.key, None)
            made.close()

        client.on_delete(leave)

    try:
        _run(host, port, first)
    finally:
        worker.close()


def _run(host: str, port: int, first: str) -> None:
    """Run the server, and open a browser with the secret ``first`` unless it is empty."""
    ui.run(
        host=host,
        port=port,
        title="flexarm studio",
        dark=None,  # as the system
        show=f"/?token={first}" if first else False,
        reload=False,
        tailwind=False,
        reconnect_timeout=_RECONNECT,
        show_welcome_message=False,
        # Compressing a picture takes longer than sending it to the same machine.
        gzip_middleware_factory=None if is_loopback(host) else GZipMiddleware,
        favicon=_ICON,
    )


_ICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32">'
    '<path d="M5 27 Q13 20 16 15 T28 5" fill="none" stroke="#0072B2" stroke-width="4"/>'
    '<circle cx="28" cy="5" r="3.5" fill="#E69F00"/></svg>'
)


@cache
def _text(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


#: Name of a file that the browser does not send, or could not send, and the reason.
_REJECTED = "(all) => emit(all[0].file.name, all[0].failedPropValidation)"
_FAILED = "(info) => emit(info.files[0].name, `status ${info.xhr.status}`)"
_REASONS = {
    "accept": "its name does not end in .yaml or .yml.",
    "max-file-size": f"it is larger than {LARGEST_FILE / 1e6:g} MB.",
}
#: Links of other pages are not longer.
_LONGEST_LINK = 200_000  # characters
_FIRST = (
    "The first run loads the compiled kernels. An installation without them compiles them now, "
    "which takes about a minute."
)
_MARGINS = ("", "gain margin", "phase margin [°]", "delay margin [ms]")


class _Window:
    """A browser window; ``key`` is the secret part of the address of its picture."""

    def __init__(self, history: History, worker: Worker) -> None:
        self.history, self._worker = history, worker
        self.key = secrets.token_urlsafe(16)
        #: Number, whether the slider is released, and data (JSON) of the newest picture.
        self.latest: tuple[int, bool, bytes] | None = None
        self._margins_key = f"{self.key} margins"
        # Numbers of pictures: the last request, the one shown, the oldest that may be shown.
        self._newest = self._shown = self._oldest = 0
        self._requested: Request | None = None
        self._pictured: Request | None = None
        self._seconds = 0.0
        self._arms: dict[str, ArmSpec] = {}  # of the opened files, which scenarios may name
        self._loop = asyncio.get_running_loop()
        self._client = ui.context.client
        ui.colors(primary="#005A8E")  # dark enough for text on white
        self._linked = False
        with ui.element("div").classes("studio") as self._studio:
            self._add_bar()
            with ui.element("main").classes("stage"):
                self._add_stage()
            self._panel = Panel(self._preview, self._commit, self._put)
        ui.on("studio_point", self._drag)
        ui.on("studio_link", self._follow)
        self._refresh()
        self._client.run_javascript("flexarmStudio.follow()")

    def close(self) -> None:
        """Drop what is waiting for this window."""
        for owner in (self.key, self._margins_key, f"{self.key} report"):
            self._worker.forget(owner)

    # The bar, and what its buttons do.

    def _add_bar(self) -> None:
        with ui.element("header").classes("bar"):
            ui.label("flexarm studio").classes("brand")
            self._name = ui.label().classes("file")
            upload = ui.upload(auto_upload=True, max_file_size=LARGEST_FILE, on_upload=self._open)
            upload.classes("hidden").props("accept=.yaml,.yml")
            upload.on("rejected", self._refuse, js_handler=_REJECTED)
            upload.on("failed", self._refuse, js_handler=_FAILED)
            self._upload = upload
            pick = f"() => getElement({upload.id}).$refs.qRef.pickFiles()"
            with _button("New", "Start with another arm"), ui.menu():
                for name, make in PRESETS.items():
                    ui.menu_item(name[:1].upper() + name[1:], lambda make=make: self._begin(make()))
                ui.menu_item("Cards of the gallery").props("disable")
                for title, sentence, make in cards():
                    with ui.menu_item(title, lambda make=make: self._begin(make())):
                        ui.label(sentence).classes("caption")
            _button("Open", "Open an arm, scenario or study file").on("click", js_handler=pick)
            with _button("Save", "Save a file"), ui.menu():
                for kind in ("model", "scenario", "study"):
                    item = ui.menu_item(f"Save the {kind}", lambda kind=kind: self._save(kind))
                    if kind == "study":
                        self._save_study = item
            with _button("Export", "Export a report, a Python script or a link"), ui.menu():
                ui.menu_item("Report (HTML)", self._report)
                ui.menu_item("Python script", self._script)
                ui.menu_item("Link in the address", self._link)
            self._undo = _button("Undo", "Undo (Ctrl+Z)", self.undo).classes("undo")
            self._redo = _button("Redo", "Redo (Ctrl+Y)", self.redo).classes("redo")
            screen = ui.fullscreen(on_value_change=lambda event: self._enlarge(event.value))
            _button("Lecture", "Full screen with large type; Esc ends it").on_click(screen.enter)
            values = _button("Values", "Show or hide the values")
            values.on_click(lambda: self._resize(self._studio.classes(toggle="wide")))
            scheme = _button("Dark", "Dark or light; this browser keeps the choice")
            scheme.on("click", js_handler="() => flexarmStudio.toggleDark()")
            self._status = ui.label().classes("status").props("role=status")

    async def _open(self, event: UploadEventArguments) -> None:
        self._upload.reset()
        try:
            project = open_bytes(await event.file.read(), event.file.name, self._arms)
        except InputError as error:
            self._say(f"The file {printable(event.file.name)} was not opened.\n{error}")
            return
        except OSError as error:  # of the temporary file of a large upload
            self._say(f"The file was not opened: {error.strerror or error}.")
            return
        self._say("")
        self._arms[event.file.name] = project.record.arm
        self._begin(project)

    def _refuse(self, event: GenericEventArguments) -> None:
        """Report a file that was not sent."""
        name, cause = map(str, event.args)
        self._upload.reset()
        reason = _REASONS.get(cause, f"the browser could not send it ({cause}).")
        self._say(f"The file {printable(name)} was not opened: {reason}")

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

    def _link(self) -> None:
        """Show a link to the state in the address of the page, until the state changes."""
        link = link_of(self.history.now)
        if len(link) > _LONGEST_LINK:
            self._say("The state is too large for a link: save the file.")
            return
        ui.navigate.history.replace(f"#{link}")
        self._linked = True
        self._status.set_text("the address of this page is the link; it opens in this browser")

    def _follow(self, event: GenericEventArguments) -> None:
        """Open the link that was in the address of the page."""
        try:
            project = open_link(str(event.args)[: _LONGEST_LINK + 1])
        except InputError as error:
            self._say(f"The link was not opened: {error}")
            return
        self._begin(project)

    def _enlarge(self, large: bool) -> None:
        self._resize(self._studio.classes(**{"add" if large else "remove": "lecture"}))

    def _resize(self, _: Any) -> None:
        """Draw the picture in its new size, after another layout."""
        self._client.run_javascript(
            "setTimeout(() => window.dispatchEvent(new Event('resize')), 50)"
        )

    def undo(self) -> None:
        self.history.undo()
        self._refresh()

    def redo(self) -> None:
        self.history.redo()
        self._refresh()

    # The picture, the numbers and the messages.

    def _add_stage(self) -> None:
        self._notice = ui.label().classes("notice").props("role=alert")
        self._failure = ui.label().classes("notice failure").props("role=alert")
        self._picture = ui.element("div").classes("picture").props(f"data-key={self.key}")
        with self._picture:
            self._first = ui.label(_FIRST).classes("quiet")
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
            with ui.element("div") as self._compared:
                ui.label("Outcome of both drives").classes("title")
                self._outcome = ui.element("table")
        for hidden in (self._notice, self._failure, self._warnings, self._compared):
            hidden.set_visibility(False)
        # What belongs to a run: grey while it is that of another project.
        self._of_the_run = (self._picture, self._warnings, self._frequencies, self._outcome)
        self._of_the_loop = (self._margins, self._note)

    def _say(self, text: str) -> None:
        _fill(self._notice, text)

    # Values and their fields.

    def _preview(self, path: Path, value: Any) -> None:
        project = self._edited(path, value)
        if project is not None:
            self._panel.explain(path, "")
            # The last value of a slider may arrive after its release.
            current = project == self.history.now
            self._ask(Request(project, "picture" if current else "preview"))

    def _commit(self, path: Path, value: Any) -> None:
        project = self._edited(path, value)
        if project is None:
            self._settle()  # not the preview of a value that was refused
        else:
            self._put(project)
            name = json.dumps(path_text(shown_by(project.record, project.placed(path), path)))
            self._client.run_javascript(f"flexarmStudio.focus({name})")

    def _edited(self, path: Path, value: Any) -> Project | None:
        """Return the edited project, or show beside the field why there is none."""
        try:
            return self.history.now.edited(path, value)
        except InputError as error:
            self._panel.explain(path, "\n".join(problem.statement for problem in error.problems))
            return None

    def _begin(self, project: Project) -> None:
        """Continue with another arm, whose picture does not show the one before."""
        self._client.run_javascript("flexarmStudio.begin()")
        self._put(project)

    def _put(self, project: Project) -> None:
        self.history.put(project)
        self._refresh()

    def _refresh(self) -> None:
        """Compute the state, and show it in all fields meanwhile."""
        project = self.history.now
        self._settle()
        self._name.set_text(project.name)
        self._undo.set_enabled(self.history.can_undo)
        self._redo.set_enabled(self.history.can_redo)
        self._save_study.set_visibility(project.choice is not None)
        self._panel.show(project)
        if self._linked:
            ui.navigate.history.replace("/")
            self._linked = False

    def _drag(self, event: GenericEventArguments) -> None:
        """Move a point of the motion to where the user drags its handle."""
        name, place, released = event.args
        paths = [path for path, *_ in points_of(self.history.now) if path_text(path) == name]
        for path in paths:
            (self._commit if released else self._preview)(path, [float(each) for each in place])

    # Requests and answers.

    def _ask(self, request: Request) -> None:
        """Compute a picture or a preview, unless it is shown or was requested last."""
        if request == self._requested:
            return
        self._requested = request
        self._worker.forget(self._margins_key)
        _mark(self._of_the_loop, add="waiting")
        if request == self._pictured:
            self._worker.forget(self.key)
            self._oldest = self._newest + 1  # pictures on their way are of other projects
            self._be_current()
            return
        self._newest = self._worker.submit(self.key, request, self._deliver(request))
        _mark(self._of_the_run, add="waiting")
        self._status.set_text("computing …")

    def _settle(self) -> None:
        """Compute what belongs to the state: its picture, and after it the margins."""
        project = self.history.now
        points = json.dumps([(path_text(path), name, at) for path, name, at in points_of(project)])
        self._client.run_javascript(f"flexarmStudio.points({points})")
        picture, margins = Request(project), Request(project, "margins")
        self._ask(picture)
        if picture == self._pictured and self.latest is not None:
            # It arrived while another state was current.
            self.latest = (self.latest[0], True, self.latest[2])
            self._client.run_javascript(f"flexarmStudio.show('{self.key}')")
        self._worker.submit(self._margins_key, margins, self._deliver(margins), after=self.key)

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
            elif request.purpose == "report":
                assert isinstance(part, Failure)
                self._say("The report was not written.\n" + _text_of(part))
                self._status.set_text("")
            elif request.purpose == "margins":
                assert isinstance(part, Margins | Failure)
                if request.project == self.history.now:
                    self._show_margins(self._without(part) if isinstance(part, Failure) else part)
            elif number < max(self._shown, self._oldest):
                return  # a newer picture is shown
            elif isinstance(part, Picture):
                self._show_picture(request, number, part)
            elif number == self._newest and isinstance(part, Failure):
                self._show_failure(part)

    def _show_picture(self, request: Request, number: int, part: Picture) -> None:
        self._shown, self._pictured = number, request
        self.latest = (number, request == Request(self.history.now), part.data)
        self._client.run_javascript(f"flexarmStudio.show('{self.key}')")
        if request.purpose == "picture":
            _fill(self._warnings, "\n".join(f"Warning: {text}" for text in part.warnings))
        listed = ", ".join(f"{frequency:.4g}" for frequency in part.frequencies or ())
        none = "none in this posture" if part.frequencies is None else "none: all links are rigid"
        self._frequencies.set_text(f"{listed} Hz" if listed else none)
        self._first.set_visibility(False)
        self._compared.set_visibility(bool(part.outcome))
        _fill_table(self._outcome, part.outcome)
        self._seconds = part.seconds
        if number == self._newest:
            self._be_current()

    def _be_current(self) -> None:
        """Show that the picture is that of the newest request."""
        assert self._pictured is not None
        preview = self._pictured.purpose == "preview"
        _fill(self._failure, "")
        _mark(self._of_the_run, remove="waiting old")
        _mark([self._warnings] * preview, add="waiting")  # those of the last complete run
        name = "preview" if preview else "computed"
        self._status.set_text(f"{name} in {1e3 * self._seconds:.0f} ms")

    def _without(self, failure: Failure) -> Margins:
        """Return what is shown in place of margins; the picture may report the same failure."""
        cause = f": {_text_of(failure)}" if Request(self.history.now) == self._pictured else "."
        return Margins((), f"Margins are not computed{cause}")

    def _show_margins(self, part: Margins) -> None:
        self._note.set_text(part.note)
        _mark(self._of_the_loop, remove="waiting")
        _fill_table(self._margins, (_MARGINS, *part.rows) if part.rows else ())

    def _show_failure(self, part: Failure) -> None:
        """Show why there is no picture; the last run stays, marked as old."""
        old = self.latest is not None
        head = "The picture shows the last run that worked." if old else "There is no picture."
        _fill(self._failure, f"{_text_of(part)}\n{head}")
        for name, text in part.problems:
            if name:
                self._panel.explain_named(name, text)
        _mark(self._of_the_run, remove="waiting", add="old")
        self._status.set_text("not computed")


def _button(text: str, help_text: str, call: Callable[[], None] | None = None) -> ui.button:
    button = ui.button(text, on_click=call).props("flat dense no-caps")
    return button.tooltip(help_text)


def _mark(elements: Sequence[ui.element], add: str = "", remove: str = "") -> None:
    for element in elements:
        element.classes(add=add, remove=remove)


def _text_of(failure: Failure) -> str:
    return "\n".join(text for _, text in failure.problems)


def _fill_table(table: ui.element, rows: Sequence[Row]) -> None:
    """Show rows of text, of which the first is the head."""
    table.clear()
    with table:
        for k, row in enumerate(rows):
            with ui.element("tr"):
                for text in row:
                    with ui.element("th" if k == 0 else "td"):
                        ui.label(text)


def _fill(label: ui.label, text: str) -> None:
    """Show a text, or hide its label if it is empty."""
    label.set_text(text)
    label.set_visibility(bool(text))
