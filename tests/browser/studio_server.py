"""A studio in a separate process, and actions of tests in its windows."""

from __future__ import annotations

import io
import json
import os
import re
import socket
import subprocess
import sys
import time
from contextlib import contextmanager

import numpy as np
from PIL import Image

from flexarm.view.studio.state import open_bytes

#: Short run of a stiff arm, so that each change is computed within a fraction of a second.
SCENARIO = """\
flexarm: 1
arm:
  links:
    - {length: 0.6, flexural_rigidity: 60.0, mass_per_length: 0.4, elements: 1}
    - {length: 0.5, flexural_rigidity: 60.0, mass_per_length: 0.4, elements: 1}
  joints: [{hub_inertia: 0.05}, {mass: 0.2, hub_inertia: 0.02}]
  payload: {mass: 0.2}
motion: {kind: line, start: [0.8, 0.2], end: [0.2, 0.8], duration: 0.4}
drive: {kind: rigid_inverse_dynamics}
run: {duration: 0.5, rate: 400}
"""
LENGTH, MASS = "arm.links[0].length", "arm.payload.mass"
PAYLOAD = (230, 159, 0)  # orange


class Server:
    """A running studio."""

    def __init__(self, process, address):
        self.process, self.address = process, address
        host = re.match(r"http://([^/]+)/", address)[1]
        self.host, self.port = host.rsplit(":", 1)


@contextmanager
def studio(folder, *arguments):
    """Start ``flexarm studio`` and wait until it listens; its output must have no errors."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    log = folder / "studio.log"
    # NiceGUI would treat the server as a part of this test.
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST")}
    environment["PYTHONUNBUFFERED"] = "1"
    command = [sys.executable, "-m", "flexarm", "studio", *arguments]
    with open(log, "w", encoding="utf-8") as out:
        process = subprocess.Popen(
            [*command, "--no-browser", "--port", str(port)],
            stdout=out,
            stderr=subprocess.STDOUT,
            env=environment,
        )
    try:
        while True:
            stated = log.read_text(encoding="utf-8")
            assert process.poll() is None, stated
            found = re.search(r"studio at (\S+)", stated)
            server = found and Server(process, found[1].replace("0.0.0.0", "127.0.0.1"))
            if server and _listens(server):
                break
            time.sleep(0.1)
        yield server
    finally:
        process.terminate()
        process.wait(timeout=60)
    assert "Traceback" not in log.read_text(encoding="utf-8"), log.read_text(encoding="utf-8")


def _listens(server):
    with socket.socket() as probe:
        return probe.connect_ex((server.host, int(server.port))) == 0


class Screen:
    """A window of a studio, with the actions of a user and the picture on the screen."""

    def __init__(self, page, address):
        self.page = page
        page.goto(address)
        self.wait_for_picture(0)

    @property
    def number(self):
        return int(self.page.locator(".picture").get_attribute("data-number") or 0)

    def wait_for_picture(self, after):
        """Wait for the picture of the state, after that of a slider in motion, by its number."""
        self.page.wait_for_function(
            """(after) => { const shown = document.querySelector('.picture');
            return shown && shown.dataset.settled === '1' && Number(shown.dataset.number) > after
                && document.querySelector('.status').textContent.startsWith('computed'); }""",
            arg=after,
        )

    def wait_until_idle(self):
        """Wait until no further picture arrives, after keys whose values the page collects."""
        number = -1
        while number != self.number:
            number = self.number
            self.page.wait_for_timeout(700)
            self.wait_for_picture(0)

    def field(self, path):
        return self.page.locator(f'[data-path="{path}"]')

    def value(self, path):
        return float(self.field(path).locator("input").input_value())

    def text(self, path):
        return self.field(path).locator("textarea").input_value()

    def open_group(self, title):
        """Open a group of the panel."""
        group = self.page.locator(f'[data-group="{title}"]')
        group.locator(".q-item").first.click()
        group.locator(".field").first.wait_for()

    def close_group(self, title):
        """Close a group of the panel."""
        group = self.page.locator(f'[data-group="{title}"]')
        group.locator(".q-item").first.click()
        group.locator(".field").first.wait_for(state="hidden")

    def open_part(self, path):
        """Open "More values" around a field."""
        part = self.page.locator(".part", has=self.field(path)).last
        if not self.field(path).is_visible():
            part.locator(".q-item").first.click()
        self.field(path).locator("input, button").first.wait_for()

    def press(self, path):
        """Press a button that adds or removes something, and wait until its field is replaced."""
        self.field(path).locator("button").click()
        self.wait_until_idle()

    def type_table(self, path, text):
        """Replace the text of a table."""
        box = self.field(path).locator("textarea")
        box.fill(text)
        box.press("Control+Enter")

    def message(self, path):
        shown = self.field(path).locator(".message")
        return shown.inner_text() if shown.is_visible() else ""

    def type(self, path, text):
        """Type a value and press Enter; the result may be an error message."""
        box = self.field(path).locator("input")
        box.fill(text)
        box.press("Enter")

    def set(self, path, text):
        """Type a value and wait for its picture."""
        before = self.number
        self.type(path, text)
        self.wait_for_picture(before)

    def drag(self, path, end):
        """Drag a slider with the mouse to a fraction of its range."""
        slider = self.field(path).locator(".q-slider")
        slider.scroll_into_view_if_needed()
        box, thumb = slider.bounding_box(), self.field(path).locator(".q-slider__thumb")
        at = thumb.bounding_box()
        row = box["y"] + box["height"] / 2
        before = self.number
        self.page.mouse.move(at["x"] + at["width"] / 2, row)
        self.page.mouse.down()
        self.page.mouse.move(box["x"] + end * box["width"], row, steps=8)
        self.page.mouse.up()
        self.wait_for_picture(before)

    def choose(self, path, text):
        """Choose an entry of a list and wait for the picture."""
        before = self.number
        self.field(path).locator(".q-select").click()
        self.page.get_by_role("option", name=text, exact=True).click()
        self.wait_for_picture(before)

    def open(self, path):
        """Open a file with the file dialog."""
        with self.page.expect_file_chooser() as chooser:
            self.page.get_by_role("button", name="Open").click()
        chooser.value.set_files(str(path))

    def show_file(self, path):
        """Open a file and wait for its picture."""
        before = self.number
        self.open(path)
        self.wait_for_picture(before)

    def save(self, menu, item):
        """Return name and content of a file that is saved from a menu."""
        self.page.get_by_role("button", name=menu).click()
        with self.page.expect_download() as waiting:
            self.page.get_by_text(item, exact=True).click()
        with open(waiting.value.path(), "rb") as file:
            return waiting.value.suggested_filename, file.read()

    def plain(self):
        """Hide the ghosts, which depend on earlier runs."""
        for name in ("rigid arm", "previous run"):
            self.page.get_by_label(name).uncheck()

    def pixels(self, selector=".picture .scenes"):
        """Return the pixels of an element on the screen, (rows, columns, 3) from 0 to 255."""
        self.page.mouse.move(1, 1)  # away from elements with a tooltip
        self.page.wait_for_function("!document.querySelector('.q-tooltip')")
        return self.look(selector)

    def look(self, selector=".picture .scenes"):
        """Return the pixels of an element without moving the mouse."""
        place = self.page.locator(selector).first
        place.scroll_into_view_if_needed()
        with Image.open(io.BytesIO(place.screenshot())) as image:
            return np.asarray(image.convert("RGB")).astype(int)

    def tip(self, view):
        """Return the place of the payload on the screen, in metres; ``view`` is that of the
        scene."""
        pixels = self.pixels(".picture .arm canvas")
        rows, columns = np.nonzero(np.abs(pixels - PAYLOAD).max(axis=-1) < 30)
        # The cross of the reference covers some of the 80 pixels.
        assert rows.size > 20, "there is no payload on the screen"
        left, right, _, top = view
        scale = (right - left) / min(pixels.shape[1] - 64, pixels.shape[0] - 72)
        return left + scale * (columns.mean() + 0.5 - 52), top - scale * (rows.mean() + 0.5 - 28)


def project_with(**values):
    project = open_bytes(SCENARIO.encode(), "swing.yaml")
    for path, value in values.items():
        project = project.edited({"length": ("arm", "links", 0, "length")}[path], value)
    return project


def scene_of(project):
    from flexarm.view.studio.compute import Request, parts_of

    return json.loads(next(parts_of(Request(project))).data)["scenes"][0]


def assert_shows(window, project):
    """Check that the payload is at its initial place of a new run, within two pixels."""
    window.plain()
    scene = scene_of(project)
    np.testing.assert_allclose(window.tip(scene["view"]), scene["links"][0][-1][-1], atol=0.008)
