"""The server of the studio: its address, its guard, and one page for each window."""

from __future__ import annotations

import secrets
from functools import cache
from importlib.resources import files
from typing import Any

from nicegui import Client, app, ui
from starlette.middleware.gzip import GZipMiddleware
from starlette.responses import Response

from flexarm.view.plot.animation.scene import player_function, style
from flexarm.view.studio.compute import Failure, Request, parts_of
from flexarm.view.studio.guard import Guard, is_loopback
from flexarm.view.studio.page import Window
from flexarm.view.studio.state import History, Project
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
    windows: dict[str, Window] = {}
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
        made = Window(history, worker)
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
