"""The guard of the studio: who may send requests to its server."""

from __future__ import annotations

import ipaddress
from hmac import compare_digest
from urllib.parse import urlsplit

from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send


def is_loopback(host: str) -> bool:
    """Return whether an address is reached from this machine only."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


class Guard:
    """Middleware that answers only requests with the token and from the studio's own page.

    Other users of the same machine reach a loopback address, too. A page of another site could let
    a browser send requests to a server on the same machine. Such requests have another `Origin`, or
    another `Host` if the name of that site is directed to this machine. The address contains the
    token once, and then a cookie does, whose name has the port, because cookies are shared by all
    ports of a machine. ``first`` stands for the token in the first request with it: it is that of
    the browser that the program opens, because other users can read the addresses in the arguments
    of programs. ``local`` states whether the server is reached from this machine only.
    """

    def __init__(self, app: ASGIApp, token: str, first: str, local: bool, port: int) -> None:
        self._app, self._token, self._first, self._local = app, token, first, local
        self._cookie = f"flexarm_studio_{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if refusal is None:
            await self._app(scope, receive, send)
        elif scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008})
        else:
            await refusal(scope, receive, send)

    def _refusal(self, scope: Scope) -> Response | None:
        request = HTTPConnection(scope)
        host = request.headers.get("host", "")
        if self._local and not is_loopback(_name_of(host)):
            return PlainTextResponse("This studio is reached from its own machine only.", 403)
        origin = request.headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != host:
            return PlainTextResponse("Requests of other pages are refused.", 403)
        if _same(request.cookies.get(self._cookie, ""), self._token):
            return None
        given = request.query_params.get("token", "")
        if scope["type"] == "http" and scope["path"] == "/" and self._opens(given):
            response = RedirectResponse("/", 303)
            response.set_cookie(self._cookie, self._token, httponly=True, samesite="strict")
            return response
        text = "The token is missing or wrong. Open the address that flexarm studio printed."
        return PlainTextResponse(text, 403)

    def _opens(self, given: str) -> bool:
        if self._first and _same(given, self._first):
            self._first = ""
            return True
        return _same(given, self._token)


def _same(given: str, secret: str) -> bool:
    return compare_digest(given.encode(), secret.encode())


def _name_of(host: str) -> str:
    """Return the name in the header `Host`, without the port."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""
