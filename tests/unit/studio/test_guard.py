"""Guard of the studio: token, cookie, names of the machine, and other web pages."""

import asyncio

import pytest

pytest.importorskip("starlette", reason="no guard: it comes with the extra studio")

from flexarm.view.studio.guard import Guard

TOKEN = "a-secret-of-the-server"
HOME = (b"host", b"127.0.0.1:8550")


def answer(guard_options, path="/", query=b"", headers=(HOME,), kind="http", guard=None):
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
    asyncio.run((guard or Guard(passed, **guard_options))(scope, receive, send))
    first = sent[0]
    return first.get("status", first.get("code")), dict(first.get("headers", []))


LOCAL = {"token": TOKEN, "first": "", "local": True, "port": 8550}
WIDE = LOCAL | {"local": False}
COOKIE = (b"cookie", f"other=1; flexarm_studio_8550={TOKEN}".encode())


@pytest.mark.parametrize(
    "host", [b"127.0.0.1:8550", b"localhost:8550", b"[::1]:8550", b"127.0.0.2:8550"]
)
def test_local_server_is_reached_by_every_name_of_its_machine(host):
    assert answer(LOCAL, headers=[(b"host", host), COOKIE])[0] == 200
    assert answer(LOCAL, headers=[(b"host", host)])[0] == 403


@pytest.mark.parametrize("host", [b"evil.example", b"127.0.0.1.evil.example:8550", b"", b"[::1"])
def test_local_server_rejects_other_host_names(host):
    assert answer(LOCAL, headers=[(b"host", host), COOKIE])[0] == 403


@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_requests_of_other_pages_are_rejected(kind):
    refused = 403 if kind == "http" else 1008
    other = (b"origin", b"http://evil.example")
    assert answer(LOCAL, headers=[HOME, other, COOKIE], kind=kind)[0] == refused
    own = (b"origin", b"http://127.0.0.1:8550")
    assert answer(LOCAL, headers=[HOME, own, COOKIE], kind=kind)[0] == 200


@pytest.mark.parametrize("options", [LOCAL, WIDE])
@pytest.mark.parametrize("query", [b"", b"token=", b"token=wrong", b"token=%ff"])
def test_wrong_token_is_rejected(query, options):
    assert answer(options, query=query)[0] == 403
    for text in ("flexarm_studio_8550=wrong", f"flexarm_studio_8551={TOKEN}"):
        cookie = (b"cookie", text.encode())
        assert answer(options, headers=[HOME, cookie])[0] == 403
        assert answer(options, headers=[HOME, cookie], kind="websocket")[0] == 1008


def test_token_becomes_a_cookie_of_its_port():
    status, headers = answer(WIDE, query=f"token={TOKEN}".encode())
    assert status == 303
    assert headers[b"location"] == b"/"
    cookie = headers[b"set-cookie"]
    assert cookie.startswith(f"flexarm_studio_8550={TOKEN};".encode())
    assert b"httponly" in cookie.lower()
    assert b"samesite=strict" in cookie.lower()
    for kind in ("http", "websocket"):
        assert answer(WIDE, path="/picture/x", headers=[HOME, COOKIE], kind=kind)[0] == 200


def test_token_opens_the_page_only():
    assert answer(WIDE, path="/picture/x", query=f"token={TOKEN}".encode())[0] == 403


def test_secret_of_the_opened_browser_is_valid_once():
    """Other users can read it in the arguments of the browser; the first request is its own."""

    async def passed(scope, receive, send):
        await send({"status": 200})

    guard = Guard(passed, **(LOCAL | {"first": "once"}))
    answers = [answer({}, query=b"token=once", guard=guard) for _ in range(2)]
    assert [status for status, _ in answers] == [303, 403]
    assert answers[0][1][b"set-cookie"].startswith(f"flexarm_studio_8550={TOKEN};".encode())
    assert answer(LOCAL, query=b"token=")[0] == 403  # without a browser there is no such secret
