"""Live pages in a browser: sliders, buttons and keys act, and the numbers are those of Python."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from live_pages import COMPARED, OTHERS, PAGES, assert_as_python, simulated, written_pages

pytestmark = pytest.mark.thorough


@pytest.fixture(scope="session")
def written(chromium: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a plain page for each live page."""
    return written_pages(tmp_path_factory.mktemp("live"))


@pytest.fixture
def opened(screen: Any, written: Path) -> Any:
    """Return a function that opens a live page, at its start and paused."""

    def open_page(page: str) -> Any:
        screen.emulate_media(reduced_motion="reduce")
        screen.goto((written / f"{page}.html").as_uri())
        screen.wait_for_function("globalThis.flexarm?.player")
        return screen

    return open_page


def state(screen: Any) -> Any:
    """Return the numbers that a page shows."""
    return screen.evaluate("flexarm.state")


def drawn_pixels(screen: Any) -> int:
    """Return the number of pixels of the picture that are drawn."""
    count = """() => {
      const {canvas} = flexarm.player, pen = canvas.getContext("2d");
      return pen.getImageData(0, 0, canvas.width, canvas.height).data
        .filter((value, place) => place % 4 === 3 && value > 0).length;
    }"""
    return int(screen.evaluate(count))


@pytest.mark.parametrize("page", PAGES)
def test_moved_sliders_give_the_numbers_of_python(page: str, opened: Any) -> None:
    screen = opened(page)
    for name, value in OTHERS[page].items():
        move = f"""slider => {{
          slider.value = flexarm.player.scene.sliders.find(other => other.name === "{name}")
            .values.findIndex(other => Math.abs(other - {value}) < 1e-9);
          slider.dispatchEvent(new Event("input"));
          flexarm.player.play(false);
        }}"""
        screen.eval_on_selector(f"input[name={name}]", move)
    assert state(screen)["sliders"] == OTHERS[page]
    screen.evaluate(f"flexarm.player.restart(), flexarm.player.runTo({COMPARED})")
    runs = screen.evaluate("""flexarm.player.runs.map(run => Array.from(
      {length: flexarm.player.sample + 1}, (_, k) => Array.from(run.state(k))))""")
    for states, (case, result) in zip(runs, simulated(page, OTHERS[page]), strict=True):
        assert_as_python(states, result, case)
    assert drawn_pixels(screen) > 1000


def test_a_slider_moves_by_keys_and_changes_the_run(opened: Any) -> None:
    screen = opened("torques")
    screen.evaluate(f"flexarm.player.runTo({COMPARED})")
    before = state(screen)
    slider = screen.get_by_label("torque of joint 1")
    slider.focus()
    slider.press("ArrowRight")
    slider.press("ArrowRight")
    assert state(screen)["sliders"]["first"] == pytest.approx(before["sliders"]["first"] + 0.2)
    assert slider.get_attribute("aria-valuetext") == "0.5 N m"
    screen.evaluate("flexarm.player.restart()")
    screen.evaluate(f"flexarm.player.runTo({COMPARED})")
    assert state(screen)["runs"] != before["runs"]


def test_buttons_play_pause_and_drop(opened: Any) -> None:
    screen = opened("payload")
    screen.get_by_role("button", name="Play").click()
    screen.wait_for_function("flexarm.state.time > 0.1")
    screen.get_by_role("button", name="Drop the payload").click()
    assert state(screen)["sliders"]["mass"] == 0.0
    screen.wait_for_function("flexarm.player.runs[0].traces[0].some(value => value > -30)")
    screen.get_by_role("button", name="Pause").click()
    time = state(screen)["time"]
    screen.wait_for_timeout(100)
    assert state(screen)["time"] == time > 0.0
    screen.get_by_role("button", name="Restart").click()
    screen.wait_for_function(f"flexarm.state.time < {time} || flexarm.player.playing")


def test_magnified_bending_is_stated_and_drawn(opened: Any) -> None:
    screen = opened("spin")
    points = "Array.from(flexarm.player.runs[0].points())"
    before = np.reshape(screen.evaluate(points), (-1, 2))
    screen.get_by_label("Bending drawn").select_option("10")
    after = np.reshape(screen.evaluate(points), (-1, 2))
    assert after[-1, 1] == pytest.approx(5.0 * before[-1, 1], rel=1e-9)  # 2 at the start
    assert screen.evaluate("flexarm.player.magnify") == 10


def test_a_page_fits_a_phone(opened: Any) -> None:
    for page in PAGES:
        screen = opened(page)
        screen.set_viewport_size({"width": 360, "height": 700})
        assert screen.evaluate("document.documentElement.scrollWidth") <= 360
        heights = screen.eval_on_selector_all(
            ".live button, .live select", "all => all.map(one => one.offsetHeight)"
        )
        assert min(heights) >= 40  # pixels that a finger needs


def test_a_run_out_of_bounds_stops_and_says_so(opened: Any) -> None:
    screen = opened("spin")
    screen.evaluate("flexarm.player.set('rate', 30)")
    screen.evaluate("flexarm.player.runTo(2)")
    text = screen.locator(".live-status").text_content()
    assert text.startswith("first order: A link bends beyond the theory. The run stops at 0.")
    assert [bool(run["error"]) for run in state(screen)["runs"]] == [True, False]
