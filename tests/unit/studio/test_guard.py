"""Guard of the studio: token, cookie, names of the machine, and other web pages."""

import asyncio

import pytest

pytest.importorskip("starlette", reason="no guard: it comes with the extra studio")

from flexarm.studio.guard import Guard

TOKEN = "a-secret-of-the-server"
HOME = (b"host", b"127.0.0.1:8550")


def answer(guard_options, path="/", query=b"", headers=(HOME,), kind="http"):
    """Return status and headers of the response; 200 and no headers if the guard accepts the
    request."""
    sent = []

    async def passed(scope, receive, send):
        sent.append({"status": 200, "headers": []})

    async def receive():
        return {"type": "websocket.connect"}

    async def send(message):
        sent.append(message)

    scope = {"type": kind, "path": path, "query_string": query, "headers": list(headers)}
    scope["method"] = "GET"
    asyncio.run(Guard(passed, **guard_options)(scope, receive, send))
    first = sent[0]
    return first.get("status", first.get("code")), dict(first.get("headers", []))


OPEN = {"token": None, "local": True}
WIDE = {"token": TOKEN, "local": False}


def test_local_server_needs_no_token():
    assert answer(OPEN)[0] == 200
    assert answer(OPEN, headers=[(b"host", b"localhost:8550")])[0] == 200
    assert answer(OPEN, headers=[(b"host", b"[::1]:8550")])[0] == 200


@pytest.mark.parametrize("host", [b"evil.example", b"127.0.0.1.evil.example:8550", b"", b"[::1"])
def test_local_server_rejects_other_host_names(host):
    assert answer(OPEN, headers=[(b"host", host)])[0] == 403


@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_requests_of_other_pages_are_rejected(kind):
    refused = 403 if kind == "http" else 1008
    other = (b"origin", b"http://evil.example")
    assert answer(OPEN, headers=[HOME, other], kind=kind)[0] == refused
    own = (b"origin", b"http://127.0.0.1:8550")
    assert answer(OPEN, headers=[HOME, own], kind=kind)[0] == 200


@pytest.mark.parametrize("query", [b"", b"token=", b"token=wrong", b"token=%ff"])
def test_non_local_server_rejects_a_wrong_token(query):
    assert answer(WIDE, query=query)[0] == 403
    cookie = (b"cookie", b"flexarm_studio=wrong")
    assert answer(WIDE, headers=[HOME, cookie])[0] == 403
    assert answer(WIDE, headers=[HOME, cookie], kind="websocket")[0] == 1008


def test_token_becomes_a_cookie():
    status, headers = answer(WIDE, query=f"token={TOKEN}".encode())
    assert status == 303
    assert headers[b"location"] == b"/"
    cookie = headers[b"set-cookie"].lower()
    assert b"httponly" in cookie
    assert b"samesite=strict" in cookie
    given = (b"cookie", f"other=1; flexarm_studio={TOKEN}".encode())
    for kind in ("http", "websocket"):
        assert answer(WIDE, path="/picture/x", headers=[HOME, given], kind=kind)[0] == 200


def test_token_opens_the_page_only():
    assert answer(WIDE, path="/picture/x", query=f"token={TOKEN}".encode())[0] == 403
