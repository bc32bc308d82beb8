"""Headless Chromium for tests that open pages.

Without a browser they are skipped with instructions.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from typing import Any

import pytest

_HOW = "`make browser` installs one"
_NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """Return the browser of the system, or that of Playwright."""
    playwright = pytest.importorskip(
        "playwright.sync_api", reason=f"no browser test: Playwright is not installed; {_HOW}"
    )
    with playwright.sync_playwright() as tools:
        found = [path for path in map(shutil.which, _NAMES) if path]
        path = found[0] if found else tools.chromium.executable_path
        if not os.path.exists(path):
            pytest.skip(f"no browser test: there is no Chromium; {_HOW}")
        # Chromium does not run its sandbox as root.
        root = hasattr(os, "geteuid") and os.geteuid() == 0
        browser = tools.chromium.launch(
            executable_path=path, args=["--no-sandbox"] if root else [], timeout=180_000
        )
        yield browser
        browser.close()


@pytest.fixture
def screen(chromium: Any) -> Iterator[Any]:
    """Return a page of 1200 by 900 pixels without a network, whose animations do not start
    themselves; an error of its script fails the test."""
    context = chromium.new_context(
        viewport={"width": 1200, "height": 900}, offline=True, reduced_motion="reduce"
    )
    context.set_default_timeout(120_000)  # ms; ends a test that hangs, also on a busy machine
    page = context.new_page()
    failures: list[str] = []
    page.on("pageerror", lambda error: failures.append(str(error)))
    page.on("console", lambda line: failures.append(line.text) if line.type == "error" else None)
    yield page
    context.close()
    assert failures == []


@pytest.fixture(scope="session")
def studio_file(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return a scenario file with a short run."""
    from studio_server import SCENARIO

    path = tmp_path_factory.mktemp("studio") / "swing.yaml"
    path.write_text(SCENARIO, encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def studio_running(chromium: Any, studio_file: Any) -> Iterator[Any]:
    """Start a studio with that file, shared by all tests."""
    pytest.importorskip("nicegui", reason="no studio test: NiceGUI is not installed")
    from studio_server import studio

    with studio(studio_file.parent, str(studio_file)) as running:
        yield running


@pytest.fixture
def new_window(chromium: Any, studio_running: Any) -> Iterator[Any]:
    """Return a function that opens a window.

    Errors of scripts and requests to other addresses fail the test.
    """
    from studio_server import Screen

    contexts, failures = [], []
    own = (f"http://127.0.0.1:{studio_running.port}/", "data:", "blob:")

    def made(width: int = 1400, height: int = 900, scheme: str = "light") -> Screen:
        size = {"width": width, "height": height}
        context = chromium.new_context(viewport=size, reduced_motion="reduce", color_scheme=scheme)
        context.set_default_timeout(120_000)
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: failures.append(str(error)))
        page.on(
            "request",
            lambda requested: requested.url.startswith(own) or failures.append(requested.url),
        )
        return Screen(page, studio_running.address)

    yield made
    for context in contexts:
        context.close()
    assert failures == []


@pytest.fixture
def window(new_window: Any) -> Any:
    """Return a window of 1400 by 900 pixels."""
    return new_window()
