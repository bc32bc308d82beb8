"""Pictures per second of the live pages in headless Chromium: ``python -m benchmarks.live_pages``.

The browser asks for 60 pictures per second. The processor time of a picture contains the simulation
up to it in real time, the drawing and all else that the page does; it must be below 16.7 ms, and
does not depend on what else the machine does.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
#: Measured interval of the clock, s.
SECONDS = 2.5
_NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
_PLAY = """async ([page, seconds]) => {
  const player = flexarm.players[page], begun = performance.now(), pictures = player.pictures;
  player.speed = 1;
  player.play(true);
  await new Promise(done => setTimeout(done, 1000 * seconds));
  player.play(false);
  return [player.pictures - pictures, (performance.now() - begun) / 1000];
}"""


def measured(page: str, folder: Path, browser: Any) -> tuple[float, float]:
    """Return the pictures per second, and the processor time of a picture in ms."""
    context = browser.new_context(viewport={"width": 1200, "height": 900}, reduced_motion="reduce")
    screen = context.new_page()
    session = context.new_cdp_session(screen)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})

    def processor_seconds() -> float:
        metrics = session.send("Performance.getMetrics")["metrics"]
        return float(next(one["value"] for one in metrics if one["name"] == "TaskDuration"))

    screen.goto((folder / f"{page}.html").as_uri())
    screen.wait_for_function("globalThis.flexarm?.player")
    screen.evaluate(_PLAY, [page, SECONDS])  # the browser optimizes the code meanwhile
    screen.evaluate("flexarm.player.restart()")
    before = processor_seconds()
    pictures, seconds = screen.evaluate(_PLAY, [page, SECONDS])
    spent = processor_seconds() - before
    context.close()
    return pictures / seconds, 1e3 * spent / pictures


def main() -> None:
    """Print a table of all pages."""
    sys.path += [str(ROOT / "tests"), str(ROOT / "docs" / "site")]
    from playwright.sync_api import sync_playwright

    from live_pages import PAGES, written_pages

    with sync_playwright() as tools, tempfile.TemporaryDirectory() as folder:
        path = next((path for path in map(shutil.which, _NAMES) if path), None)
        root = hasattr(os, "geteuid") and os.geteuid() == 0
        options = ["--no-sandbox"] if root else []
        browser = tools.chromium.launch(executable_path=path, args=options)
        written = written_pages(Path(folder))
        print("| page | pictures per second | processor time of a picture |")
        print("| --- | --- | --- |")
        for page in PAGES:
            rate, spent = measured(page, written, browser)
            print(f"| {page} | {rate:.0f} | {spent:.1f} ms |")
        browser.close()


if __name__ == "__main__":
    main()
