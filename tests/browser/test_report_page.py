"""A report opened from a file in a browser: the picture on the screen after every action."""

from __future__ import annotations

import io
import re
from functools import cache

import numpy as np
import pytest
from PIL import Image
from stored_pictures import assert_looks_like

import flexarm as fa
from flexarm.view.plot.palette import BLUE, ORANGE

pytestmark = pytest.mark.sampled(
    "test_page_opens_with_the_arm_at_its_start",
    "test_play_moves_the_arm_to_the_end",
    "test_bending_is_magnified_by_its_slider",
    "test_texts_of_a_result_are_not_executed",
)

LINK = {"length": 0.5, "flexural_rigidity": 3.0, "mass_per_length": 0.4, "elements": 1}
#: Of 255: edges of lines are smoothed and differ more than this from the colour of the line.
TOLERANCE = 30
#: Places in the canvases, CSS pixels; see `drawArm` and `backdrop` of the player.
ARM_LEFT, ARM_TOP, HISTORY_LEFT, HISTORY_RIGHT, HISTORY_TOP = 52, 28, 62, 12, 24
END, PULSE = 0.2, (0.1, 0.11)  # s


@cache
def result():
    """Simulate a short run with a pulse in the torque of joint 1."""
    arm = fa.Arm(links=[LINK, LINK], payload={"mass": 0.1})
    start = {"initial": arm.rest([0.3, 0.6]), "initial_rate": arm.rest([2.0, 1.0])}
    run = fa.simulate(arm, END, rate=1000.0, **start)
    time = run.time.values
    run["torque"][:, 0] = np.where((time >= PULSE[0]) & (time <= PULSE[1]), 0.4, 0.0)
    return run


@pytest.fixture
def page(screen, tmp_path):
    path = tmp_path / "report.html"
    fa.report(
        result(), path, title="Swing & <b>stop</b>", notes="two\nlines", rigid=True, magnify=1.0
    )
    requested = []
    screen.on("request", lambda request: requested.append(request.url))
    screen.goto(path.as_uri())
    # Saved files and links within the page are data; no other request is allowed.
    assert requested == [path.as_uri()]
    return screen


def picture(locator):
    """Return the pixels of an element on the screen: (rows, columns, 3) from 0 to 255."""
    locator.scroll_into_view_if_needed()
    with Image.open(io.BytesIO(locator.screenshot())) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def has_color(pixels, color):
    wanted = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)])
    return np.abs(pixels - wanted).max(axis=-1) < TOLERANCE


def arm_canvas(page):
    return page.locator(".arm canvas")


def history(page, title):
    return page.locator(f'canvas[aria-label="{title} over time"]')


def tip_on_screen(page):
    """Return the position of the payload, the orange dot, in metres."""
    pixels = picture(arm_canvas(page))
    rows, columns = np.nonzero(has_color(pixels, ORANGE))
    assert rows.size > 40, "there is no payload on the screen"
    left, right, _, top = fa.animate(result(), rigid=True, magnify=1.0).scenes[0].view
    side = min(pixels.shape[1] - 64, pixels.shape[0] - 72)
    scale = (right - left) / side
    return np.array(
        [
            left + scale * (columns.mean() + 0.5 - ARM_LEFT),
            top - scale * (rows.mean() + 0.5 - ARM_TOP),
        ]
    )


def assert_tip(page, time):
    """Check that the payload is at its place in the result, within two pixels (5 mm each)."""
    expected = result().tip.sel(time=time, method="nearest").values
    np.testing.assert_allclose(tip_on_screen(page), expected, atol=0.01)


def cursor(page, title="Joint rate"):
    """Return the column of the time cursor as a fraction of the axis, or None without a cursor."""
    pixels = picture(history(page, title))
    # A line of one pixel that lies between two columns is dark grey in both; the grid is light.
    dark = pixels[HISTORY_TOP + 2 : -66, HISTORY_LEFT + 3 :].max(axis=-1) < 190
    found = HISTORY_LEFT + 3 + np.nonzero(dark.mean(axis=0) > 0.6)[0]
    if not found.size:
        return None
    return (found.mean() - HISTORY_LEFT) / (pixels.shape[1] - HISTORY_LEFT - HISTORY_RIGHT)


def pulse_width(page):
    """Return the width of the pulse at half its height, as a fraction of the axis."""
    pixels = picture(history(page, "Torque"))
    blue = has_color(pixels[60:90, HISTORY_LEFT + 3 :], BLUE).any(axis=0)
    columns = np.nonzero(blue)[0]
    assert columns.size
    return np.ptp(columns) / (pixels.shape[1] - HISTORY_LEFT - HISTORY_RIGHT)


def drag(page, locator, start, end):
    """Drag with the mouse between two fractions of a history's axis."""
    locator.scroll_into_view_if_needed()
    box = locator.bounding_box()
    width = box["width"] - HISTORY_LEFT - HISTORY_RIGHT
    row = box["y"] + 80
    page.mouse.move(box["x"] + HISTORY_LEFT + start * width, row)
    page.mouse.down()
    page.mouse.move(box["x"] + HISTORY_LEFT + 0.5 * (start + end) * width, row, steps=3)
    page.mouse.move(box["x"] + HISTORY_LEFT + end * width, row, steps=3)
    page.mouse.up()


def clock(page):
    return float(re.fullmatch(r"t = (.*) s", page.locator(".clock").inner_text())[1])


def test_page_opens_with_the_arm_at_its_start(page):
    assert page.title() == "Swing & <b>stop</b>"
    assert page.locator("h1").inner_text() == "Swing & <b>stop</b>"
    assert page.locator(".notes").inner_text() == "two\nlines"
    assert_tip(page, 0.0)
    assert clock(page) == 0.0


def test_play_moves_the_arm_to_the_end(page):
    button = page.get_by_role("button", name="Play")
    # Read the label in the same script: on a busy machine the motion can end before another action.
    assert button.evaluate("button => { button.click(); return button.textContent; }") == "Pause"
    page.get_by_role("button", name="Play").wait_for()
    assert clock(page) == END
    assert_tip(page, END)
    # Both clicks in one script: on a busy machine the motion can end between two actions.
    button.evaluate("button => { button.click(); button.click(); }")
    button.wait_for()
    assert clock(page) < END


def test_bending_is_magnified_by_its_slider(page):
    """The payload moves away from the tip of the result, and back."""
    page.locator(".time").fill("40")
    bending = page.get_by_label("factor on the drawn bending")
    assert "bending × 1" in page.locator(".bending").inner_text()
    assert_tip(page, clock(page))
    true = tip_on_screen(page)
    bending.fill("3")
    assert "bending × 10" in page.locator(".bending").inner_text()
    scene = fa.animate(result(), rigid=True, magnify=10.0, fps=200.0).scenes[0]
    frame = int(np.abs(scene.times - clock(page)).argmin())
    drawn = scene.links[frame, -1, -1]
    assert np.linalg.norm(drawn - true) > 0.025
    np.testing.assert_allclose(tip_on_screen(page), drawn, atol=0.01)
    bending.fill("0")
    np.testing.assert_array_equal(tip_on_screen(page), true)


def test_animations_start_themselves_and_repeat(chromium, tmp_path):
    path = tmp_path / "arm.html"
    fa.animate(result(), path, speed=2.0)
    moving = chromium.new_context(offline=True, reduced_motion="no-preference")
    screen = moving.new_page()
    # All times that the clock shows.
    screen.add_init_script("""window.shown = [];
      document.addEventListener("DOMContentLoaded", () => new MutationObserver(() =>
        shown.push(document.querySelector(".clock").textContent)).observe(
          document.querySelector(".clock"), { childList: true }))""")
    screen.goto(path.as_uri())
    start, end = "t = 0.000 s", f"t = {END:.3f} s"
    again = f"shown.lastIndexOf('{start}') > shown.indexOf('{end}') && shown.includes('{end}')"
    screen.wait_for_function(again)
    assert screen.locator(".play").inner_text() == "Pause"
    screen.locator(".play").click()
    assert screen.locator(".play").inner_text() == "Play"
    moving.close()


def test_slider_moves_arm_and_cursors(page):
    slider = page.locator(".time")
    slider.scroll_into_view_if_needed()
    box = slider.bounding_box()
    row = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + 8, row)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.6 * box["width"], row, steps=5)
    page.mouse.up()
    now = clock(page)
    assert 0.5 * END < now < 0.7 * END
    assert_tip(page, now)
    for title in ("Joint rate", "Energy"):
        assert cursor(page, title) == pytest.approx(now / END, abs=0.01)


def test_dragging_in_a_history_zooms_all_histories(page):
    before = picture(history(page, "Joint rate"))
    assert pulse_width(page) == pytest.approx(0.05, abs=0.02)
    drag(page, history(page, "Torque"), 0.45, 0.6)  # from 0.09 to 0.12 s
    assert pulse_width(page) == pytest.approx(1.0 / 3.0, abs=0.05)
    assert np.abs(picture(history(page, "Joint rate")) - before).max() > 100
    assert cursor(page) is None  # time zero is not in the span
    page.get_by_role("button", name="Whole run").click()
    assert np.array_equal(picture(history(page, "Joint rate")), before)
    assert page.get_by_role("button", name="Whole run").is_disabled()


def test_click_sets_the_time_and_double_click_resets_the_zoom(page):
    drag(page, history(page, "Torque"), 0.45, 0.6)
    drag(page, history(page, "Torque"), 0.5, 0.5)
    assert clock(page) == pytest.approx(0.105, abs=0.003)  # half of the time between frames
    assert_tip(page, clock(page))
    assert cursor(page) == pytest.approx((clock(page) - 0.09) / 0.03, abs=0.02)
    history(page, "Torque").dblclick(position={"x": 200, "y": 80})
    assert pulse_width(page) == pytest.approx(0.05, abs=0.02)


def test_zoomed_span_follows_the_time(page):
    drag(page, history(page, "Torque"), 0.05, 0.15)
    assert cursor(page) is None
    page.locator(".time").fill("50")
    assert cursor(page) == pytest.approx(0.1, abs=0.02)
    assert not page.get_by_role("button", name="Whole run").is_disabled()


def test_keyboard_controls_time_and_zoom(page):
    canvas = history(page, "Joint rate")
    canvas.focus()
    for _ in range(20):
        page.keyboard.press("ArrowRight")
    now = clock(page)
    assert now > 0.0
    assert_tip(page, now)
    page.keyboard.press("+")
    page.keyboard.press("+")
    assert cursor(page) == pytest.approx(now / END, abs=0.02)  # the time keeps its place
    page.keyboard.press("ArrowLeft")
    assert clock(page) < now
    page.keyboard.press("0")
    assert page.get_by_role("button", name="Whole run").is_disabled()


def test_ctrl_with_the_wheel_zooms_and_the_wheel_alone_scrolls(page):
    canvas = history(page, "Torque")
    canvas.hover(position={"x": 200, "y": 80})
    page.mouse.wheel(0, 60)
    reset = page.get_by_role("button", name="Whole run")
    page.wait_for_function("() => window.scrollY > 0")
    assert reset.is_disabled()
    canvas.hover(position={"x": 200, "y": 80})
    page.keyboard.down("Control")
    page.mouse.wheel(0, -100)
    page.keyboard.up("Control")
    page.wait_for_function("() => !document.querySelector('.zoom-reset').disabled")


def test_narrow_screen_needs_no_horizontal_scrolling(page):
    page.set_viewport_size({"width": 360, "height": 640})
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    page.locator(".arm").scroll_into_view_if_needed()
    box = page.get_by_role("button", name="Play").bounding_box()
    assert 0 <= box["x"] < 360
    assert 0 <= box["y"] < 640  # the controls stay on the screen
    assert_tip(page, 0.0)


def test_a_dark_page_is_printed_in_light_colours(page):
    """The figures are drawn before the style of paper applies."""
    page.emulate_media(color_scheme="dark")
    ink = """() => getComputedStyle(document.querySelector('.flexarm-player'))
        .getPropertyValue('--flexarm-ink')"""
    assert page.evaluate(ink) == "rgb(230, 230, 230)"
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate(ink) == "rgb(38, 38, 38)"
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert page.evaluate(ink) == "rgb(230, 230, 230)"


def test_print_layout_shows_several_postures_and_no_controls(page):
    page.emulate_media(media="print")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert not page.locator(".controls").is_visible()
    assert not page.locator("nav").is_visible()
    pixels = picture(arm_canvas(page))
    arm = fa.Arm(links=[LINK, LINK], payload={"mass": 0.1})
    left, right, _, top = fa.animate(result(), rigid=True, magnify=1.0).scenes[0].view
    side = min(pixels.shape[1] - 64, pixels.shape[0] - 72)
    for time in (0.0, END / 2, END):  # the middle of the second link is bluish
        x, y = arm.shape(result().q.sel(time=time, method="nearest").values, 3)[1, 1]
        column = round(ARM_LEFT + side * (x - left) / (right - left))
        row = round(ARM_TOP + side * (top - y) / (right - left))
        red, _, blue = pixels[row - 1 : row + 2, column - 1 : column + 2].mean(axis=(0, 1))
        assert blue > red + 10, time
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    page.emulate_media(media="screen")
    assert page.locator(".controls").is_visible()
    assert_tip(page, 0.0)


def test_report_prints_on_a_few_pages(page):
    printed = page.pdf(format="A4", prefer_css_page_size=True)
    assert 2 <= len(re.findall(rb"/Type\s*/Page\b", printed)) <= 6
    assert len(printed) > 50_000  # the figures are included


def test_embedded_files_can_be_saved(page):
    for name, text in (
        ("arm.yaml", result().attrs["arm"]),
        ("citation.bib", fa.citation(result())),
    ):
        with page.expect_download() as waiting:
            page.locator(f'a[download="{name}"]').click()
        assert waiting.value.suggested_filename == name
        with open(waiting.value.path(), encoding="utf-8") as file:
            assert file.read() == text


def test_texts_of_a_result_are_not_executed(screen, tmp_path):
    bad = "</script></pre><script>document.title = 'run'</script><img src=x onerror=alert(1)>"
    reported = result().copy()
    reported.attrs = {**result().attrs, "warning": bad, "failure": bad, "ended_by": bad}
    path = tmp_path / "report.html"
    fa.report(reported, path, title=bad, notes=bad)
    screen.goto(path.as_uri())
    assert screen.title() == bad
    assert screen.locator(".warnings p").inner_text() == bad
    assert screen.locator(".failure p").first.inner_text() == bad


def test_page_of_animate_can_be_zoomed(screen, tmp_path):
    path = tmp_path / "arm.html"
    fa.animate({"a": result(), "b": result()}, path)
    screen.goto(path.as_uri())
    torques = history(screen, "Torque")
    assert torques.count() == 2
    before = [picture(torques.nth(k)) for k in (0, 1)]
    drag(screen, torques.nth(0), 0.45, 0.6)
    for k in (0, 1):
        assert np.abs(picture(torques.nth(k)) - before[k]).max() > 100


def test_page_looks_like_the_picture_of_the_documentation(screen, tmp_path):
    """The run differs from that of the other tests: a picture for readers."""
    path = tmp_path / "report.html"
    stiff = LINK | {"flexural_rigidity": 10.0}
    arm = fa.Arm(links=[stiff, stiff], payload={"mass": 0.1}, gravity=(0.0, -9.81))
    run = fa.simulate(arm, 2.0, initial=arm.rest([0.3, 0.6]), rate=200.0)
    run.attrs["wall_seconds"] = 0.01  # the page shows it
    fa.report(run, path, title="A double pendulum of two beams", rigid=True)
    screen.set_viewport_size({"width": 1200, "height": 900})
    screen.goto(path.as_uri())
    screen.locator(".time").fill("35")
    screen.evaluate("document.activeElement.blur()")
    assert_looks_like(screen, "report.png")
