"""The studio in a browser: appearance, rapid changes, several windows, memory and access."""

from __future__ import annotations

import os
import urllib.request
from urllib.error import HTTPError

import numpy as np
import pytest
from stored_pictures import assert_looks_like
from studio_server import LENGTH, MASS, Screen, assert_shows, project_with, studio

from flexarm.view.studio.state import open_bytes

pytestmark = pytest.mark.thorough


@pytest.mark.parametrize(("scheme", "name"), [("light", "studio.png"), ("dark", "studio-dark.png")])
def test_page_looks_like_the_picture_of_the_documentation(scheme, name, new_window):
    window = new_window(1400, 900, scheme)
    page = window.page
    window.choose("drive.kind", "joint PD")
    window.set(MASS, "0.4")
    window.open_group("Loads")
    window.press("loads.<new>")
    window.set("loads[0].force[1]", "-2")
    for title in ("Link 1", "Link 2", "Payload", "Motion"):
        window.close_group(title)
    page.get_by_text("phase margin").wait_for()
    page.locator(".time").fill("45")
    page.mouse.move(1, 1)
    page.wait_for_function("!document.querySelector('.q-tooltip')")
    page.locator('[data-group="Drive"]').evaluate("group => group.scrollIntoView()")
    page.evaluate("document.querySelector('.status').textContent = ''")
    page.evaluate("document.activeElement.blur()")
    assert_looks_like(page, name)


def test_two_windows_have_independent_states(new_window):
    one, two = new_window(), new_window()
    for k in range(10):
        one.type(LENGTH, f"{0.5 + 0.01 * k:.2f}")
        two.type(LENGTH, f"{0.7 + 0.01 * k:.2f}")
    before = one.number, two.number
    for window, length in ((one, 0.52), (two, 0.74)):
        window.type(LENGTH, str(length))
    one.wait_for_picture(before[0])
    two.wait_for_picture(before[1])
    for window, length in ((one, 0.52), (two, 0.74)):
        assert window.value(LENGTH) == length
        assert_shows(window, project_with(length=length))


def test_500_rapid_changes_end_with_the_picture_of_the_last_one(window, new_window, tmp_path):
    page = window.page
    window.field(LENGTH).locator(".q-slider__track-container").focus()
    before = window.number
    for k in range(500):
        # Back and forth, because the motion is out of reach of an arm with a very long link.
        page.keyboard.press("ArrowRight" if k % 50 < 28 else "ArrowLeft")
    window.wait_until_idle()
    assert window.number > before + 20
    window.set(MASS, "0.25")
    value = window.value(LENGTH)
    name, content = window.save("Save", "Save the scenario")
    project = open_bytes(content, name)
    assert project.record.arm.links[0].length == value
    assert_shows(window, project)
    path = tmp_path / name
    path.write_bytes(content)
    fresh = new_window()
    fresh.show_file(path)
    fresh.plain()
    assert np.array_equal(window.pixels(), fresh.pixels())


def test_memory_is_bounded(window, studio_running, capsys):
    """With FULL=1 after 1,000 runs, which take minutes; otherwise after 60."""
    import psutil

    runs = 1000 if os.environ.get("FULL_PAGES") else 60
    process = psutil.Process(studio_running.process.pid)

    def megabytes():
        each = [process, *process.children(recursive=True)]
        return [one.memory_info().rss / 1e6 for one in each]

    def change(count):
        for k in range(count):
            window.set(LENGTH, f"{0.5 + 0.001 * (k % 200):.3f}")

    change(20)
    before = megabytes()
    change(runs)
    after = megabytes()
    with capsys.disabled():
        print(f"\n{runs} runs: {sum(before):.0f} MB before, {sum(after):.0f} MB after")
    # Undo keeps 200 projects of some kilobytes, and allocators keep some more.
    assert sum(after) < sum(before) + 60.0


@pytest.mark.parametrize("host", ["127.0.0.2", "0.0.0.0"])
def test_every_address_requires_its_token(host, chromium, studio_file):
    """Also a loopback address, which other users of the machine reach."""
    with studio(studio_file.parent, str(studio_file), "--host", host) as open_server:
        plain, _, token = open_server.address.partition("?token=")
        assert len(token) > 20
        context = chromium.new_context()
        context.set_default_timeout(120_000)
        page = context.new_page()
        for address in (plain, f"{plain}?token=wrong", f"{plain}picture/x"):
            answer = page.goto(address)
            assert answer.status == 403
            assert "token" in page.locator("body").inner_text()
        assert page.request.get(f"{plain}_nicegui_ws/socket.io/?EIO=4").status == 403
        window = Screen(page, open_server.address)
        assert token not in page.url  # the token is in a cookie from here on
        assert window.value(LENGTH) == 0.6
        context.close()


def test_requests_of_other_pages_are_rejected(studio_running):
    address, _, token = studio_running.address.partition("?token=")
    cookie = {"Cookie": f"flexarm_studio_{studio_running.port}={token}"}
    with urllib.request.urlopen(
        urllib.request.Request(address, headers=cookie), timeout=60
    ) as page:
        assert page.status == 200
    for headers in ({"Host": "evil.example"}, {"Origin": "http://evil.example"}):
        requested = urllib.request.Request(address, headers=cookie | headers)
        with pytest.raises(HTTPError) as error:
            urllib.request.urlopen(requested, timeout=60)
        with error.value as refusal:
            assert refusal.code == 403
