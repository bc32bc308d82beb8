"""The studio in a browser: what is on the screen after every action."""

from __future__ import annotations

import io
import json
import os
import runpy
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from studio_server import SCENARIO, Screen, studio

import flexarm as fa
from flexarm.errors import ModelError
from flexarm.studio.compute import Request, parts_of
from flexarm.studio.state import open_bytes

pytest.importorskip("nicegui", reason="no studio test: NiceGUI is not installed")

#: Made anew with STUDIO_PICTURE=1.
PICTURE = Path(__file__).parents[2] / "docs" / "how-to" / "studio.png"
LENGTH, MASS = "arm.links[0].length", "arm.payload.mass"


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("studio") / "swing.yaml"
    path.write_text(SCENARIO, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def server(chromium, file):
    with studio(file.parent, str(file)) as running:
        yield running


@pytest.fixture
def new_screen(chromium, server):
    """Function that opens a window; scripts must not fail and nothing else may be requested."""
    contexts, failures = [], []

    def made(width=1400, height=900, address=None):
        context = chromium.new_context(viewport={"width": width, "height": height})
        context.set_default_timeout(120_000)  # ms: stops a test that hangs, on a busy machine too
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: failures.append(str(error)))
        page.on(
            "request",
            lambda asked: (
                None
                if asked.url.startswith((f"http://127.0.0.1:{server.port}/", "data:", "blob:"))
                else failures.append(asked.url)
            ),
        )
        return Screen(page, address or server.address)

    yield made
    for context in contexts:
        context.close()
    assert failures == []


@pytest.fixture
def screen(new_screen):
    return new_screen()


def project_with(**values):
    project = open_bytes(SCENARIO.encode(), "swing.yaml")
    for path, value in values.items():
        project = project.edited({"length": ("arm", "links", 0, "length")}[path], value)
    return project


def scene_of(project):
    return json.loads(next(parts_of(Request(project))).data)["scenes"][0]


def assert_shows(screen, project):
    """The payload is where a fresh run has it at its start, to two pixels."""
    screen.plain()
    scene = scene_of(project)
    np.testing.assert_allclose(screen.tip(scene["view"]), scene["links"][0][-1][-1], atol=0.008)


def test_it_opens_the_file_of_the_command_line(screen):
    assert screen.value(LENGTH) == 0.6
    assert screen.page.locator(".file").inner_text() == "swing"
    assert_shows(screen, project_with())


def test_dragging_a_slider_moves_the_arm_while_it_is_dragged(screen):
    page, slider = screen.page, screen.field(LENGTH).locator(".q-slider")
    box, at = slider.bounding_box(), screen.field(LENGTH).locator(".q-slider__thumb").bounding_box()
    before, row = screen.number, box["y"] + box["height"] / 2
    still = screen.pixels()
    page.mouse.move(at["x"] + at["width"] / 2, row)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.7 * box["width"], row, steps=8)
    page.wait_for_function(
        "(before) => Number(document.querySelector('.picture').dataset.number) > before", arg=before
    )
    assert page.locator(".picture").get_attribute("data-settled") == "0"
    assert np.abs(screen.look() - still).max() > 100
    page.mouse.up()
    screen.wait_for_picture(before)
    value = screen.value(LENGTH)
    assert value != 0.6
    assert_shows(screen, project_with(length=value))


def test_the_previous_run_and_the_rigid_arm_are_ghosts(screen):
    screen.set(LENGTH, "0.7")
    page = screen.page
    both = screen.pixels(".picture .arm canvas")
    page.get_by_label("previous run").uncheck()
    one = screen.pixels(".picture .arm canvas")
    page.get_by_label("rigid arm").uncheck()
    none = screen.pixels(".picture .arm canvas")
    assert np.abs(both - one).max() > 50
    assert np.abs(one - none).max() > 50
    page.get_by_label("previous run").check()
    page.get_by_label("rigid arm").check()
    assert np.array_equal(screen.pixels(".picture .arm canvas"), both)


def test_play_moves_the_arm_to_the_end_of_the_run(screen):
    screen.plain()
    page = screen.page
    page.get_by_role("button", name="Play").click()
    page.get_by_role("button", name="Pause").wait_for()
    page.get_by_role("button", name="Play").wait_for()
    scene = scene_of(project_with())
    np.testing.assert_allclose(screen.tip(scene["view"]), scene["links"][-1][-1][-1], atol=0.008)
    screen.set(LENGTH, "0.65")  # the time stays
    assert page.locator(".clock").inner_text() == "t = 0.500 s"


@pytest.mark.parametrize("text", ["-1", "0", "long", "", "[1, 2]", "{a: 1}", "1e400"])
def test_a_wrong_value_is_refused_beside_its_field(screen, text):
    before = screen.pixels()
    screen.type(LENGTH, text)
    screen.field(LENGTH).locator(".message").wait_for()
    project = project_with()
    from flexarm.model.changes import change_of

    with pytest.raises(ModelError) as error:
        project.edited(("arm", "links", 0, "length"), change_of("", "", f"a={text}").value)
    assert screen.message(LENGTH) == error.value.problems[0].statement
    assert np.array_equal(screen.pixels(), before)
    screen.set(LENGTH, "0.7")  # another value removes the message
    assert screen.message(LENGTH) == ""


def test_text_that_is_not_yaml_is_refused(screen):
    screen.type(LENGTH, "[1")
    screen.field(LENGTH).locator(".message").wait_for()
    assert "is not valid YAML" in screen.message(LENGTH)


def test_a_run_that_fails_keeps_the_last_picture_and_marks_it_as_old(screen):
    page = screen.page
    screen.type("motion.end[0]", "5")
    page.locator(".picture.old").wait_for()
    assert screen.message("motion.end[0]").startswith("motion.end must lie within the reach")
    assert "The picture shows the last run that worked." in page.locator(".failure").inner_text()
    grey = screen.pixels()
    assert np.ptp(grey, axis=-1).max() < 10  # no colour is left
    screen.type("motion.end[0]", "0.2")  # the state of the picture
    page.wait_for_function("!document.querySelector('.picture.old')")
    assert not page.locator(".failure").is_visible()
    assert_shows(screen, project_with())


def test_a_broken_file_is_reported_with_its_lines(screen, tmp_path):
    path = tmp_path / "broken.yaml"
    path.write_text(SCENARIO.replace("length: 0.6", "length: -0.6"), encoding="utf-8")
    before = screen.pixels()
    screen.open(path)
    notice = screen.page.locator(".stage > .notice").first
    notice.wait_for()
    assert "broken.yaml:4: arm.links[0].length must be greater than 0, got -0.6." in (
        notice.inner_text()
    )
    assert screen.value(LENGTH) == 0.6
    path.write_bytes(b"\xff\xfe\x00")
    screen.open(path)
    screen.page.get_by_text("is not text in UTF-8").wait_for()
    # An arm in another file could be any file of the machine.
    path.write_text("flexarm: 1\narm: /etc/hostname\nrun: {duration: 1}\n", encoding="utf-8")
    screen.open(path)
    screen.page.get_by_text("refers to another file").wait_for()
    notice.scroll_into_view_if_needed()
    assert screen.pixels().shape[1] == before.shape[1]


def test_texts_of_a_file_do_not_run_as_programs(screen, tmp_path):
    bad = "<img src=x onerror=alert(1)><script>document.title='run'</script>"
    path = tmp_path / "names.yaml"
    text = SCENARIO.replace("kind: line", f'kind: "{bad}"')
    path.write_text(text, encoding="utf-8")
    screen.open(path)
    screen.page.get_by_text("motion.kind must be one of").wait_for()
    assert "<img src=x" in screen.page.locator(".stage > .notice").first.inner_text()
    assert screen.page.title() == "flexarm studio"


def test_save_and_open_again(screen, new_screen, tmp_path):
    screen.set(LENGTH, "0.7")
    screen.choose("drive.kind", "joint pd")
    name, content = screen.save("Save", "Save the scenario")
    assert name == "swing.yaml"
    project = open_bytes(content, name)
    assert project.record.arm.links[0].length == 0.7
    assert project.record.drive.kind == "joint_pd"
    path = tmp_path / name
    path.write_bytes(content)
    other = new_screen()
    before = other.number
    other.open(path)
    other.wait_for_picture(before)
    assert other.value(LENGTH) == 0.7
    for each in (screen, other):
        each.plain()
    assert np.array_equal(screen.pixels(), other.pixels())
    name, content = screen.save("Save", "Save the model")
    assert open_bytes(content, name).record.arm == project.record.arm


def test_a_study_has_lists_of_drives_motions_and_plants(screen, tmp_path):
    study = """\
flexarm: 1
arm:
  links: [{length: 0.5, flexural_rigidity: 3.0, mass_per_length: 0.4, elements: 1}]
  joints: [{hub_inertia: 0.05}]
  payload: {mass: 0.1}
motions: {slow: {kind: joint, start: [0.0], end: [1.0], duration: 0.4}}
drives:
  torque alone: {kind: rigid_inverse_dynamics}
  <b>joint PD</b>: {kind: joint_pd, proportional: 2.0, derivative: 0.5}
run: {duration: 0.5, rate: 200}
"""
    path = tmp_path / "drives.yaml"
    path.write_text(study, encoding="utf-8")
    before = screen.number
    screen.open(path)
    screen.wait_for_picture(before)
    before = screen.number
    screen.page.get_by_label("drive of the study").click()
    screen.page.get_by_role("option", name="<b>joint PD</b>", exact=True).click()
    screen.wait_for_picture(before)
    screen.set("drive.proportional", "1.5")
    name, content = screen.save("Save", "Save the study")
    assert open_bytes(content, name).record.drives["<b>joint PD</b>"].proportional == 1.5
    screen.page.get_by_text("phase margin").wait_for()


def test_export_a_script_and_a_report(screen, tmp_path):
    screen.set(LENGTH, "0.7")
    name, content = screen.save("Export", "Python script")
    path = tmp_path / name
    path.write_bytes(content)
    expected = fa.run_scenario(project_with(length=0.7).scenario)
    np.testing.assert_array_equal(runpy.run_path(str(path))["result"].tip, expected.tip)
    name, content = screen.save("Export", "Report (HTML)")
    assert name == "swing.html"
    assert b"length: 0.7" in content


def test_undo_and_redo_with_buttons_and_keys(screen):
    page = screen.page
    assert page.get_by_role("button", name="Undo").is_disabled()
    screen.plain()
    first = screen.pixels()
    screen.drag(LENGTH, 0.8)
    second, value = screen.pixels(), screen.value(LENGTH)
    assert np.abs(second - first).max() > 100
    before = screen.number
    page.get_by_role("button", name="Undo").click()
    screen.wait_for_picture(before)
    assert screen.value(LENGTH) == 0.6
    assert np.array_equal(screen.pixels(), first)
    before = screen.number
    page.locator(".stage").click(position={"x": 5, "y": 5})
    page.keyboard.press("Control+y")
    screen.wait_for_picture(before)
    assert screen.value(LENGTH) == value
    assert np.array_equal(screen.pixels(), second)
    before = screen.number
    page.keyboard.press("Control+z")
    screen.wait_for_picture(before)
    assert np.array_equal(screen.pixels(), first)


def test_the_keyboard_is_enough(screen):
    page = screen.page
    screen.field(LENGTH).locator(".q-slider__track-container").focus()
    before, value = screen.number, screen.value(LENGTH)
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    screen.wait_for_picture(before)
    screen.wait_until_idle()
    assert screen.value(LENGTH) > value
    page.keyboard.press("Tab")  # the number beside the slider
    assert page.evaluate("document.activeElement.tagName") == "INPUT"
    before = screen.number
    page.keyboard.press("Control+a")
    page.keyboard.type("0.66")
    page.keyboard.press("Tab")
    screen.wait_for_picture(before)
    assert_shows(screen, project_with(length=0.66))


def test_the_state_survives_a_reload(screen):
    screen.set(LENGTH, "0.7")
    screen.page.reload()
    screen.wait_for_picture(0)
    assert screen.value(LENGTH) == 0.7
    before = screen.number
    screen.page.get_by_role("button", name="Undo").click()
    screen.wait_for_picture(before)
    assert screen.value(LENGTH) == 0.6


def test_a_narrow_screen_needs_no_sideways_scrolling(new_screen):
    screen = new_screen(360, 740)
    page = screen.page
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    for selector in (".picture .arm canvas", f'[data-path="{LENGTH}"] .q-slider'):
        box = page.locator(selector).bounding_box()
        assert box["x"] >= 0.0
        assert box["x"] + box["width"] <= 360.0
    screen.drag(LENGTH, 0.8)
    # The arm is on the screen beside the slider.
    box = page.locator(".picture .arm canvas").bounding_box()
    assert 0.0 <= box["y"] < 370.0
    assert_shows(screen, project_with(length=screen.value(LENGTH)))


def test_the_page_looks_like_the_picture_of_the_documentation(new_screen):
    """Means of squares of 10 pixels, because fonts and smoothing differ between machines."""
    screen = new_screen(1400, 900)
    page = screen.page
    screen.choose("drive.kind", "joint pd")
    screen.set(MASS, "0.4")
    page.get_by_text("phase margin").wait_for()
    page.locator(".time").fill("45")
    page.mouse.move(1, 1)
    page.wait_for_function("!document.querySelector('.q-tooltip')")
    page.locator(".panel").evaluate("panel => { panel.scrollTop = 0; }")
    page.evaluate("document.querySelector('.status').textContent = ''")
    page.evaluate("document.activeElement.blur()")
    found = page.screenshot()
    if os.environ.get("STUDIO_PICTURE"):
        PICTURE.write_bytes(found)
    with Image.open(io.BytesIO(found)) as new, Image.open(PICTURE) as old:
        each = [np.asarray(image.convert("RGB")).astype(float) for image in (new, old)]
    assert each[0].shape == each[1].shape
    squares = [pixels.reshape(90, 10, 140, 10, 3).mean(axis=(1, 3)) for pixels in each]
    away = np.abs(squares[0] - squares[1]).max(axis=-1)
    assert away.mean() < 3.0  # of 255
    assert (away > 60.0).mean() < 0.01


def test_two_windows_have_their_own_states(new_screen):
    one, two = new_screen(), new_screen()
    for k in range(10):
        one.type(LENGTH, f"{0.5 + 0.01 * k:.2f}")
        two.type(LENGTH, f"{0.7 + 0.01 * k:.2f}")
    before = one.number, two.number
    for screen, length in ((one, 0.52), (two, 0.74)):
        screen.type(LENGTH, str(length))
    one.wait_for_picture(before[0])
    two.wait_for_picture(before[1])
    for screen, length in ((one, 0.52), (two, 0.74)):
        assert screen.value(LENGTH) == length
        assert_shows(screen, project_with(length=length))


def test_500_rapid_changes_end_with_the_picture_of_the_last(screen, new_screen, tmp_path):
    page = screen.page
    screen.field(LENGTH).locator(".q-slider__track-container").focus()
    before = screen.number
    for k in range(500):
        page.keyboard.press("ArrowRight" if k % 7 else "ArrowLeft")
    screen.wait_until_idle()
    assert screen.number > before + 20
    screen.set(MASS, "0.25")
    value = screen.value(LENGTH)
    name, content = screen.save("Save", "Save the scenario")
    project = open_bytes(content, name)
    assert project.record.arm.links[0].length == value
    assert_shows(screen, project)
    path = tmp_path / name
    path.write_bytes(content)
    fresh = new_screen()
    before = fresh.number
    fresh.open(path)
    fresh.wait_for_picture(before)
    fresh.plain()
    assert np.array_equal(screen.pixels(), fresh.pixels())


def test_the_memory_is_bounded(screen, server, capsys):
    """1,000 runs with FULL=1, which take minutes; else 60."""
    import psutil

    runs = 1000 if os.environ.get("FULL_PAGES") else 60
    process = psutil.Process(server.process.pid)

    def megabytes():
        each = [process, *process.children(recursive=True)]
        return [one.memory_info().rss / 1e6 for one in each]

    def change(count):
        for k in range(count):
            screen.set(LENGTH, f"{0.5 + 0.001 * (k % 200):.3f}")

    change(20)
    before = megabytes()
    change(runs)
    after = megabytes()
    with capsys.disabled():
        print(f"\n{runs} runs: {sum(before):.0f} MB before, {sum(after):.0f} MB after")
    # Undo keeps 200 projects of some kilobytes; allocators keep some more.
    assert sum(after) < sum(before) + 60.0


def test_a_wider_address_needs_its_token(chromium, file):
    with studio(file.parent, str(file), "--host", "0.0.0.0") as open_server:
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
        screen = Screen(page, open_server.address)
        assert token not in page.url  # it is in a cookie from here on
        assert screen.value(LENGTH) == 0.6
        context.close()


def test_other_pages_cannot_reach_it(server):
    import urllib.request
    from urllib.error import HTTPError

    for headers in ({"Host": "evil.example"}, {"Origin": "http://evil.example"}):
        asked = urllib.request.Request(server.address, headers=headers)
        with pytest.raises(HTTPError) as error:
            urllib.request.urlopen(asked, timeout=60)
        assert error.value.code == 403
