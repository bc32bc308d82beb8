"""``flexarm studio``: a local web application with the arm of a file."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from flexarm.base.arguments import library_missing
from flexarm.base.errors import InputError, Problem, shown
from flexarm.cli.options import argument, flag, option
from flexarm.cli.tables import print_line


def studio(
    file: Annotated[
        Path | None, argument("[FILE]", "Arm, scenario or study; by default the paper's arm.")
    ] = None,
    host: Annotated[str, option("ADDRESS", "Address of this machine to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to listen on.")] = 8550,
    browser: Annotated[bool, flag("--browser/--no-browser", "Open a browser window.")] = True,
) -> None:
    """Change an arm and its run in the browser and see it move: a local web application."""
    import secrets

    for module, name in (("nicegui", "NiceGUI"), ("jinja2", "Jinja2")):
        if find_spec(module) is None:
            raise library_missing(name, "studio")
    from flexarm.view.studio.app import serve
    from flexarm.view.studio.guard import is_loopback
    from flexarm.view.studio.presets import paper_project
    from flexarm.view.studio.state import open_file

    project = paper_project() if file is None else open_file(file)
    _check_address(host, port)
    token = secrets.token_urlsafe(24)
    name = f"[{host}]" if ":" in host else host
    print_line(f"studio at http://{name}:{port}/?token={token}")
    if not is_loopback(host):
        print_line("Anyone with this address can use the studio. It is not encrypted.")
    print_line("Ctrl-C ends it.")
    serve(project, host, port, token, browser)


def _check_address(host: str, port: int) -> None:
    """Raise if the address cannot be used."""
    import socket

    try:
        family, *_ = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
    except OSError as error:
        rule = f"cannot be used: {error.strerror or error}"
        hint = "Give another one with --host or --port."
        raise InputError(Problem(shown(f"{host}:{port}"), rule, hint=hint)) from None
