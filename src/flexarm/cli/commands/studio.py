"""``flexarm studio``: a local web application with the arm of a file."""

from __future__ import annotations

import secrets
from importlib.util import find_spec
from pathlib import Path

from flexarm.base.arguments import library_missing
from flexarm.base.errors import InputError, Problem, shown
from flexarm.cli.tables import console


def open_studio(file: Path | None, host: str, port: int, show: bool) -> None:
    """Serve the studio until Ctrl-C; print its address.

    Raises:
        InputError: if NiceGUI or Jinja2 is not installed, the file is not valid, or the address
            cannot be used.
    """
    for module, name in (("nicegui", "NiceGUI"), ("jinja2", "Jinja2")):
        if find_spec(module) is None:
            raise library_missing(name, "studio")
    from flexarm.view.studio.app import serve
    from flexarm.view.studio.guard import is_loopback
    from flexarm.view.studio.state import open_file, paper_project

    project = paper_project() if file is None else open_file(file)
    _check_address(host, port)
    token = secrets.token_urlsafe(24)
    name = f"[{host}]" if ":" in host else host
    screen = console()
    screen.print(f"studio at http://{name}:{port}/?token={token}", soft_wrap=True)
    if not is_loopback(host):
        screen.print("Anyone with this address can use the studio. It is not encrypted.")
    screen.print("Ctrl-C ends it.")
    serve(project, host, port, token, show)


def _check_address(host: str, port: int) -> None:
    """Raise if the address cannot be used.

    Raises:
        InputError: if the host is not an address of this machine, or the port is in use.
    """
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
