"""The studio in a browser: the picture on the screen after every action."""

from __future__ import annotations

import runpy

import numpy as np
import pytest
from studio_server import LENGTH, SCENARIO, assert_shows, project_with, scene_of

import flexarm as fa
from flexarm.base.errors import ModelError
from flexarm.model.file_format.yaml_text import change_of
from flexarm.view.studio.state import open_bytes

pytestmark = pytest.mark.sampled(
    "test_studio_opens_the_file_of_the_command_line",
    "test_dragging_a_slider_moves_the_arm_immediately",
    "long",
)


def test_studio_opens_the_file_of_the_command_line(window):
    assert window.value(LENGTH) == 0.6
    assert window.page.locator(".file").inner_text() == "swing"
    assert_shows(window, project_with())


def test_dragging_a_slider_moves_the_arm_immediately(window):
    page, slider = window.page, window.field(LENGTH).locator(".q-slider")
    box, at = slider.bounding_box(), window.field(LENGTH).locator(".q-slider__thumb").bounding_box()
    before, row = window.number, box["y"] + box["height"] / 2
    still = window.pixels()
    page.mouse.move(at["x"] + at["width"] / 2, row)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.7 * box["width"], row, steps=8)
    page.wait_for_function(
        "(before) => Number(document.querySelector('.picture').dataset.number) > before", arg=before
    )
    assert page.locator(".picture").get_attribute("data-settled") == "0"
    label = "one => getComputedStyle(one, '::before').content"
    assert page.locator(".picture").evaluate(label) == '"Preview: coarse run"'
    assert not page.locator(".status").inner_text().startswith("computed")
    assert np.abs(window.look() - still).max() > 100
    page.mouse.up()
    window.wait_for_picture(before)
    value = window.value(LENGTH)
    assert value != 0.6
    assert page.locator(".picture").evaluate(label) == "none"
    assert_shows(window, project_with(length=value))


def test_previous_run_and_rigid_arm_are_ghosts(window):
    window.set(LENGTH, "0.7")
    page = window.page
    both = window.pixels(".picture .arm canvas")
    page.get_by_label("previous run").uncheck()
    one = window.pixels(".picture .arm canvas")
    page.get_by_label("rigid arm").uncheck()
    none = window.pixels(".picture .arm canvas")
    assert np.abs(both - one).max() > 50
    assert np.abs(one - none).max() > 50
    page.get_by_label("previous run").check()
    page.get_by_label("rigid arm").check()
    assert np.array_equal(window.pixels(".picture .arm canvas"), both)


def test_play_moves_the_arm_to_the_end_of_the_run(window):
    window.plain()
    page = window.page
    page.get_by_role("button", name="Play").click()
    page.get_by_role("button", name="Pause").wait_for()
    page.get_by_role("button", name="Play").wait_for()
    scene = scene_of(project_with())
    np.testing.assert_allclose(window.tip(scene["view"]), scene["links"][-1][-1][-1], atol=0.008)
    window.set(LENGTH, "0.65")  # the time does not change
    assert page.locator(".clock").inner_text() == "t = 0.500 s"


@pytest.mark.parametrize("text", ["-1", "0", "long", "", "[1, 2]", "{a: 1}", "1e400"])
def test_message_of_a_wrong_value_is_beside_its_field(window, text):
    before = window.pixels()
    window.type(LENGTH, text)
    window.field(LENGTH).locator(".message").wait_for()
    project = project_with()
    with pytest.raises(ModelError) as error:
        project.edited(("arm", "links", 0, "length"), change_of("", f"a={text}").value)
    assert window.message(LENGTH) == error.value.problems[0].statement
    assert np.array_equal(window.pixels(), before)
    window.set(LENGTH, "0.7")  # another value removes the message
    assert window.message(LENGTH) == ""


def test_text_that_is_not_yaml_is_rejected(window):
    window.type(LENGTH, "[1")
    window.field(LENGTH).locator(".message").wait_for()
    assert "is not valid YAML" in window.message(LENGTH)


def opacity(page, selector):
    return float(page.locator(selector).evaluate("one => getComputedStyle(one).opacity"))


def test_values_of_a_run_in_progress_turn_grey(window):
    """Here while the server cannot answer: what is shown belongs to another arm."""
    page = window.page
    window.choose("drive.kind", "joint PD")
    page.locator(".numbers td").first.wait_for()
    shown = (".picture", ".frequencies", ".numbers table >> nth=0")
    assert [opacity(page, each) for each in shown] == [1.0] * 3
    page.evaluate("""() => {
        window.greys = [];
        new MutationObserver(() => window.greys.push([...document.querySelectorAll('.waiting')]
            .map((each) => each.className))).observe(document.querySelector('.stage'),
            {subtree: true, attributes: true, attributeFilter: ['class']}); }""")
    window.set(LENGTH, "0.55")
    page.wait_for_function("!document.querySelector('.waiting')")
    names = " ".join(name for each in page.evaluate("window.greys") for name in each)
    assert "picture" in names
    assert "frequencies" in names


def test_failed_run_keeps_the_last_picture_and_marks_it(window):
    page = window.page
    window.type("motion.end[0]", "5")
    page.locator(".picture.old").wait_for()
    assert window.message("motion.end[0]").startswith("motion.end must lie within the reach")
    assert "The picture shows the last run that worked." in page.locator(".failure").inner_text()
    grey = window.pixels()
    assert np.ptp(grey, axis=-1).max() < 10  # no colour is left
    # The frequencies of the arm before are grey, too, and its margins are removed.
    assert page.locator(".frequencies").inner_text().endswith("Hz")
    assert opacity(page, ".frequencies") < 0.5
    page.get_by_text("Margins are not computed.").wait_for()
    assert page.locator(".numbers td").count() == 0
    window.type("motion.end[0]", "0.2")  # the style of the picture
    page.wait_for_function("!document.querySelector('.picture.old')")
    assert opacity(page, ".frequencies") == 1.0
    assert not page.locator(".failure").is_visible()
    assert_shows(window, project_with())


def test_broken_file_is_reported_with_its_lines(window, tmp_path):
    path = tmp_path / "broken.yaml"
    path.write_text(SCENARIO.replace("length: 0.6", "length: -0.6"), encoding="utf-8")
    window.plain()
    before = window.pixels(".picture .arm canvas")
    window.open(path)
    notice = window.page.locator(".stage > .notice").first
    notice.wait_for()
    assert "broken.yaml:4: arm.links[0].length must be greater than 0, got -0.6." in (
        notice.inner_text()
    )
    assert window.value(LENGTH) == 0.6
    path.write_bytes(b"\xff\xfe\x00")
    window.open(path)
    window.page.get_by_text("is not text in UTF-8").wait_for()
    # A scenario must not read an arm from another file of the machine.
    path.write_text("flexarm: 1\narm: /etc/hostname\nrun: {duration: 1}\n", encoding="utf-8")
    window.open(path)
    window.page.get_by_text("refers to another file").wait_for()
    notice.scroll_into_view_if_needed()
    after = window.pixels(".picture .arm canvas")
    rows = min(len(before), len(after))  # the notice above moves the canvas by a fraction of a row
    away = np.abs(after[:rows] - before[:rows]).max(axis=-1)
    assert (away > 60).mean() < 0.007  # a link of 0.61 instead of 0.6 m changes 0.9 %


def test_a_file_that_is_not_sent_is_reported_with_its_cause(window, tmp_path):
    notice = window.page.locator(".stage > .notice").first
    texts = {
        "notes.txt": ("a", "its name does not end in .yaml or .yml."),
        "large.yaml": ("#" * 20_000_001, "it is larger than 20 MB."),
        "lost.yaml": (SCENARIO, "the browser could not send it (status 0)."),
    }
    window.page.route("**/upload/**", lambda route: route.abort())
    for name, (text, reason) in 2 * list(texts.items()):  # the same file again
        (tmp_path / name).write_text(text, encoding="utf-8")
        window.open(tmp_path / name)
        window.page.get_by_text(f"The file {name} was not opened: {reason}").wait_for()
    window.page.unroute("**/upload/**")
    (tmp_path / "empty.yaml").touch()
    window.open(tmp_path / "empty.yaml")
    window.page.get_by_text("The file empty.yaml was not opened.").wait_for()
    (tmp_path / "good.yaml").write_text(SCENARIO.replace("0.6", "0.7"), encoding="utf-8")
    window.show_file(tmp_path / "good.yaml")
    assert not notice.is_visible()
    assert window.value(LENGTH) == 0.7


def test_texts_of_a_file_are_not_executed(window, tmp_path):
    bad = "<img src=x onerror=alert(1)><script>document.title='run'</script>"
    path = tmp_path / "names.yaml"
    text = SCENARIO.replace("kind: line", f'kind: "{bad}"')
    path.write_text(text, encoding="utf-8")
    window.open(path)
    window.page.get_by_text("motion.kind must be one of").wait_for()
    assert "<img src=x" in window.page.locator(".stage > .notice").first.inner_text()
    assert window.page.title() == "flexarm studio"


def test_saved_file_can_be_opened_again(window, new_window, tmp_path):
    window.set(LENGTH, "0.7")
    window.choose("drive.kind", "joint PD")
    name, content = window.save("Save", "Save the scenario")
    assert name == "swing.yaml"
    project = open_bytes(content, name)
    assert project.record.arm.links[0].length == 0.7
    assert project.record.drive.kind == "joint_pd"
    path = tmp_path / name
    path.write_bytes(content)
    other = new_window()
    other.show_file(path)
    assert other.value(LENGTH) == 0.7
    for each in (window, other):
        each.plain()
    assert np.array_equal(window.pixels(), other.pixels())
    name, content = window.save("Save", "Save the model")
    assert open_bytes(content, name).record.arm == project.record.arm


def test_study_has_lists_of_drives_motions_and_plants(window, tmp_path):
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
    window.show_file(path)
    before = window.number
    window.page.get_by_label("drive of the study").click()
    window.page.get_by_role("option", name="<b>joint PD</b>", exact=True).click()
    window.wait_for_picture(before)
    window.set("drive.proportional", "1.5")
    name, content = window.save("Save", "Save the study")
    assert open_bytes(content, name).record.drives["<b>joint PD</b>"].proportional == 1.5
    window.page.get_by_text("phase margin").wait_for()


def test_script_and_report_can_be_exported(window, tmp_path):
    window.set(LENGTH, "0.7")
    name, content = window.save("Export", "Python script")
    path = tmp_path / name
    path.write_bytes(content)
    expected = fa.run_scenario(project_with(length=0.7).scenario)
    np.testing.assert_array_equal(runpy.run_path(str(path))["result"].tip, expected.tip)
    name, content = window.save("Export", "Report (HTML)")
    assert name == "swing.html"
    assert b"length: 0.7" in content


def test_buttons_and_keys_undo_and_redo(window):
    page = window.page
    assert page.get_by_role("button", name="Undo").is_disabled()
    window.plain()
    first = window.pixels()
    window.drag(LENGTH, 0.8)
    second, value = window.pixels(), window.value(LENGTH)
    assert np.abs(second - first).max() > 100
    before = window.number
    page.get_by_role("button", name="Undo").click()
    window.wait_for_picture(before)
    assert window.value(LENGTH) == 0.6
    assert np.array_equal(window.pixels(), first)
    before = window.number
    page.locator(".stage").click(position={"x": 5, "y": 5})
    page.keyboard.press("Control+y")
    window.wait_for_picture(before)
    assert window.value(LENGTH) == value
    assert np.array_equal(window.pixels(), second)
    before = window.number
    page.keyboard.press("Control+z")
    window.wait_for_picture(before)
    assert np.array_equal(window.pixels(), first)


def test_all_values_can_be_changed_with_the_keyboard(window):
    page = window.page
    window.field(LENGTH).locator(".q-slider__track-container").focus()
    before, value = window.number, window.value(LENGTH)
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    window.wait_for_picture(before)
    window.wait_until_idle()
    assert window.value(LENGTH) > value
    page.keyboard.press("Tab")  # the number beside the slider
    assert page.evaluate("document.activeElement.tagName") == "INPUT"
    before = window.number
    page.keyboard.press("Control+a")
    page.keyboard.type("0.66")
    page.keyboard.press("Tab")
    window.wait_for_picture(before)
    assert_shows(window, project_with(length=0.66))


def test_state_is_kept_after_a_reload(window):
    window.set(LENGTH, "0.7")
    window.page.reload()
    window.wait_for_picture(0)
    assert window.value(LENGTH) == 0.7
    before = window.number
    window.page.get_by_role("button", name="Undo").click()
    window.wait_for_picture(before)
    assert window.value(LENGTH) == 0.6


def test_narrow_screen_needs_no_horizontal_scrolling(new_window):
    window = new_window(360, 740)
    page = window.page
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    for selector in (".picture .arm canvas", f'[data-path="{LENGTH}"] .q-slider'):
        box = page.locator(selector).bounding_box()
        assert box["x"] >= 0.0
        assert box["x"] + box["width"] <= 360.0
    window.drag(LENGTH, 0.8)
    # The arm is on the screen beside the slider.
    box = page.locator(".picture .arm canvas").bounding_box()
    assert 0.0 <= box["y"] < 370.0
    assert_shows(window, project_with(length=window.value(LENGTH)))
