"""Guard of the server: a token where others can reach it, and no requests of other web pages."""

from __future__ import annotations

from hmac import compare_digest
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

_COOKIE = "flexarm_studio"
_LOCAL = ("127.0.0.1", "localhost", "::1")


class Guard:
    """Middleware that answers only requests with the token and from the studio's own page.

    A page of another site could otherwise let a browser send requests to a server on the same
    machine. Such requests have another `Origin`, or another `Host` if the name of that site is
    directed to this machine.

    Args:
        app: the application behind it.
        token: secret that the address contains once, and then a cookie; None for none.
        local: whether the server is reached from this machine only.
    """

    def __init__(self, app: ASGIApp, token: str | None, local: bool) -> None:
        self._app, self._token, self._local = app, token, local

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
        headers = {
            name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]
        }
        host = headers.get("host", "")
        if self._local and _name_of(host) not in _LOCAL:
            return PlainTextResponse("This studio is reached as 127.0.0.1 only.", 403)
        origin = headers.get("origin")
        if origin is not None and urlsplit(origin).netloc != host:
            return PlainTextResponse("Requests of other pages are refused.", 403)
        if self._token is None or self._matches(_cookie_of(headers.get("cookie", ""))):
            return None
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
        if scope["type"] == "http" and scope["path"] == "/" and self._matches(given):
            response = RedirectResponse("/", 303)
            response.set_cookie(_COOKIE, self._token, httponly=True, samesite="strict")
            return response
        text = "The token is missing or wrong. Open the address that flexarm studio printed."
        return PlainTextResponse(text, 403)

    def _matches(self, given: str) -> bool:
        assert self._token is not None
        return compare_digest(given.encode(), self._token.encode())


def _name_of(host: str) -> str:
    """Return the name in the header `Host`, without the port."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _cookie_of(text: str) -> str:
    try:
        cookie: Any = SimpleCookie(text).get(_COOKIE)
    except CookieError:
        return ""
    return "" if cookie is None else str(cookie.value)
