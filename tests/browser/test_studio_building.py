"""A window builds an arm: from an empty studio to three links with a controller, and more."""

from __future__ import annotations

import re
import runpy
import time

import numpy as np
import pytest
from stored_pictures import assert_looks_like
from studio_server import assert_shows, scene_of

import flexarm as fa
from flexarm.view.studio.state import open_bytes

pytestmark = pytest.mark.thorough

LINKS = "arm.links"


def saved(window):
    name, content = window.save("Save", "Save the scenario")
    return open_bytes(content, name)


def start(window, name):
    """Choose an entry of the menu of starting points with the mouse."""
    before = window.number
    window.page.get_by_role("button", name="New").click()
    window.page.locator(".q-menu .q-item", has_text=re.compile(f"^{name}$")).click()
    window.wait_for_picture(before)


def start_by_keyboard(window, name):
    """Choose an entry of the menu of starting points with the keyboard."""
    before, page = window.number, window.page
    page.get_by_role("button", name="New").focus()
    page.keyboard.press("Enter")
    entry = page.locator(".q-menu .q-item", has_text=re.compile(f"^{name}$"))
    # The menu takes the focus at the end of its transition.
    page.wait_for_function("() => document.activeElement.classList.contains('q-menu')")
    for _ in range(20):
        page.keyboard.press("Tab")
        if entry.evaluate("entry => entry.contains(document.activeElement)"):
            break
    page.keyboard.press("Enter")
    window.wait_for_picture(before)


def press(window, path, way):
    """Press a button of the panel and wait for the picture."""
    before, button = window.number, window.field(path).locator("button")
    if way == "mouse":
        button.click()
    else:
        button.focus()
        button.press("Enter")
    window.wait_for_picture(before)


@pytest.mark.parametrize("way", ["mouse", "keyboard"])
def test_an_arm_of_three_links_with_a_controller_is_built(new_window, way, capsys):
    window = new_window()
    began = time.monotonic()
    (start if way == "mouse" else start_by_keyboard)(window, "One link")
    press(window, f"{LINKS}[0].<copy>", way)
    press(window, f"{LINKS}[1].<copy>", way)
    window.open_group("Link 3")
    for k, length in enumerate(("0.8", "0.6", "0.4")):
        window.set(f"{LINKS}[{k}].length", length)
    window.choose("drive.kind", "joint PID")
    with capsys.disabled():
        print(f"\n{way}: {time.monotonic() - began:.1f} s")
    project = saved(window)
    assert [link.length for link in project.record.arm.links] == [0.8, 0.6, 0.4]
    assert project.record.drive.kind == "joint_pid"
    assert len(project.record.motion.end) == 3
    window.wait_until_idle()
    window.plain()
    scene = scene_of(project)
    np.testing.assert_allclose(window.tip(scene["view"]), scene["links"][0][-1][-1], atol=0.03)
    before = window.pixels()
    press(window, f"{LINKS}[1].<move>", way)
    assert [link.length for link in saved(window).record.arm.links] == [0.8, 0.4, 0.6]
    assert np.abs(window.pixels()[: len(before)] - before).max() > 100
    press(window, f"{LINKS}[1].<remove>", way)
    assert [link.length for link in saved(window).record.arm.links] == [0.8, 0.6]
    for _ in range(2):
        window.page.get_by_role("button", name="Undo").click()
        window.wait_until_idle()
    assert saved(window).record == project.record


def test_the_goal_is_dragged_with_the_mouse(window):
    page, goal = window.page, window.page.locator(".handle").nth(1)
    box, before = goal.bounding_box(), window.number
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 60.0, y + 30.0, steps=10)
    page.mouse.up()
    window.wait_for_picture(before)
    window.wait_until_idle()
    project = saved(window)
    moved = np.array(project.record.motion.end)
    assert moved[0] > 0.25
    assert moved[1] < 0.78
    window.plain()
    box = goal.bounding_box()  # in the axes of the new picture
    view = scene_of(project)["view"]
    canvas = page.locator(".picture .arm canvas").bounding_box()
    scale = (view[1] - view[0]) / min(canvas["width"] - 64, canvas["height"] - 72)
    place = [
        view[0] + scale * (box["x"] + box["width"] / 2 - canvas["x"] - 52),
        view[3] - scale * (box["y"] + box["height"] / 2 - canvas["y"] - 28),
    ]
    np.testing.assert_allclose(place, moved, atol=2.0 * scale)
    assert project.record.motion.start == (0.8, 0.2)
    window.page.get_by_role("button", name="Undo").click()
    window.wait_until_idle()
    assert saved(window).record.motion.end == (0.2, 0.8)


def test_via_points_are_moved_with_the_keyboard(window):
    window.choose("motion.kind", "via points")
    page = window.page
    assert page.locator(".handle").count() == 3
    point = page.locator(".handle").nth(1)
    old = saved(window).record.motion.points
    point.focus()
    before = window.number
    page.keyboard.press("ArrowRight")
    window.wait_for_picture(before)
    window.wait_until_idle()
    assert point.evaluate("point => point === document.activeElement")
    new = saved(window).record.motion.points
    assert new[1][0] > old[1][0]
    assert [new[0], new[2]] == [old[0], old[2]]
    assert new[1][1] == pytest.approx(old[1][1], abs=0.005)


def test_a_goal_out_of_reach_is_refused_and_the_picture_turns_grey(window):
    page, goal = window.page, window.page.locator(".handle").nth(1)
    box = goal.bounding_box()
    page.mouse.move(box["x"] + 11.0, box["y"] + 11.0)
    page.mouse.down()
    page.mouse.move(box["x"] + 400.0, box["y"] - 60.0, steps=5)
    page.mouse.up()
    page.locator(".picture.old").wait_for()
    assert "motion.end must lie within the reach" in page.locator(".failure").inner_text()


def test_two_drives_are_side_by_side_with_one_table(window):
    window.page.locator('[data-group="Comparison"] .q-item').first.click()
    press(window, "<beside>.<new>", "mouse")
    page = window.page
    assert page.locator(".picture .arm canvas").count() == 2
    table = page.locator(".numbers table").nth(1)
    table.locator("th").nth(2).wait_for()
    heads = [each.inner_text() for each in table.locator("th").all()]
    assert heads == ["", "computed torque", "rigid inverse dynamics"]
    window.choose("drive.kind", "joint PD")
    assert table.locator("th").nth(1).inner_text() == "joint pd"
    pictures = [window.pixels(f".picture .scene:nth-child({k}) .arm canvas") for k in (1, 2)]
    rows = min(map(len, pictures))
    assert np.abs(pictures[0][:rows] - pictures[1][:rows]).max() > 60
    press(window, "<beside>.<remove>", "mouse")
    assert page.locator(".picture .arm canvas").count() == 1
    assert not table.is_visible()


def test_a_link_opens_the_state_in_another_window(window, new_window):
    window.set(f"{LINKS}[0].length", "0.7")
    page = window.page
    page.get_by_role("button", name="Export").click()
    page.get_by_text("Link in the address").click()
    page.wait_for_function("location.hash.length > 100")
    link = page.url.partition("#")[2]
    window.set(f"{LINKS}[0].length", "0.75")
    page.wait_for_function("location.hash === ''")  # the address would be that of another state
    other = new_window()
    before = other.number
    other.page.evaluate("link => { location.hash = link; }", link)
    other.wait_for_picture(before)
    assert other.value(f"{LINKS}[0].length") == 0.7
    # Part of a link leaves the window as it is.
    other.page.evaluate("link => { location.hash = link; }", link[:-7])
    other.page.get_by_text("The link was not opened: the link is damaged or incomplete.").wait_for()
    assert other.value(f"{LINKS}[0].length") == 0.7
    assert other.page.evaluate("location.hash") == ""
    other.page.goto(f"{other.page.url}#{link}")
    other.wait_for_picture(0)
    assert_shows(other, saved(other))


def test_the_script_of_a_built_arm_gives_its_numbers(window, tmp_path):
    start(window, "Two links")
    name, content = window.save("Export", "Python script")
    text = content.decode()
    assert "fa.line_motion(" in text
    assert "fa.JointPD(" in text
    assert "import flexarm as fa\n\narm = fa.Arm(" in text
    path = tmp_path / name
    path.write_bytes(content)
    expected = fa.run_scenario(saved(window).scenario)
    np.testing.assert_array_equal(runpy.run_path(str(path))["result"].q, expected.q)


def test_a_picture_is_refused_by_its_kind_not_by_its_size(window, tmp_path):
    path = tmp_path / "photo.png"
    path.write_bytes(bytes(245_000))
    window.open(path)
    reason = "its name does not end in .yaml or .yml."
    window.page.get_by_text(f"The file photo.png was not opened: {reason}").wait_for()
    path = tmp_path / "photo.yaml"
    path.write_bytes(b"\x89PNG\r\n" + bytes(245_000))
    window.open(path)
    notice = window.page.locator(".stage > .notice").first
    window.page.get_by_text("The file photo.yaml was not opened.").wait_for()
    assert "is not text in UTF-8" in notice.inner_text()


def test_the_files_of_init_are_opened_one_after_the_other(window, tmp_path):
    from flexarm.cases.templates import mechanism_files

    for name, text in zip(("arm", "scenario"), mechanism_files("four-bar"), strict=True):
        (tmp_path / f"{name}.yaml").write_text(text, encoding="utf-8")
    window.show_file(tmp_path / "arm.yaml")
    window.show_file(tmp_path / "scenario.yaml")
    assert saved(window).record == fa.load_scenario(tmp_path / "scenario.yaml")


@pytest.mark.parametrize(("width", "name"), [(1280, "studio-lecture.png"), (400, None)])
def test_the_lecture_mode_has_large_type(new_window, width, name):
    window = new_window(width, 800)
    page = window.page
    page.evaluate("document.documentElement.requestFullscreen = async () => {}")
    small = page.locator(".picture .arm canvas").bounding_box()
    page.get_by_role("button", name="Lecture").click()
    page.locator(".studio.lecture").wait_for()
    page.wait_for_timeout(300)
    large = page.locator(".picture .hint").evaluate("hint => hint.currentCSSZoom || 1")
    assert large > 1.3
    assert small["width"] > 0.0
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    if name is not None:
        page.locator(".time").fill("20")
        page.evaluate("document.querySelector('.status').textContent = ''")
        page.locator(".stage").evaluate("stage => stage.scrollTo(0, 0)")
        page.mouse.move(1, 1)
        page.wait_for_function("!document.querySelector('.q-tooltip')")
        page.evaluate("document.activeElement.blur()")
        assert_looks_like(page, name)
    beside = page.locator(".stage").bounding_box()["width"]
    page.get_by_role("button", name="Values", exact=True).click()
    page.locator(".panel").wait_for(state="hidden")
    assert page.locator(".stage").bounding_box()["width"] == pytest.approx(width, abs=1.0)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.get_by_role("button", name="Values", exact=True).click()
    page.locator(".panel").wait_for()
    assert page.locator(".stage").bounding_box()["width"] == beside
