"""The studio in light and dark: contrasts on the page, the switch, and the cards in its menu."""

from __future__ import annotations

import pytest
from studio_server import MASS

from flexarm.view.studio.presets import cards

pytestmark = pytest.mark.sampled("test_text_and_lines_are_readable[dark-1280]")

#: Contrasts (WCAG 2) of visible texts that are not those of disabled or outdated elements.
TEXTS = """() => {
  const numbers = (color) => color.match(/[\\d.]+/g).map(Number);
  const light = (color) => numbers(color).slice(0, 3).map((v) => v / 255)
    .map((v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0.05);
  const solid = (color) => numbers(color).length === 3 || numbers(color)[3] === 1;
  const found = [];
  for (const each of document.querySelectorAll("body *")) {
    const own = [...each.childNodes].some((node) => node.nodeType === 3 && node.data.trim());
    if (!own && !each.matches("input:not([type=range]), textarea, select")) continue;
    if (!each.checkVisibility({ checkVisibilityCSS: true, checkOpacity: true })) continue;
    if (each.closest(".disabled, :disabled, .q-tooltip, script, style, option")) continue;
    let below = each;
    const back = () => getComputedStyle(below).backgroundColor;
    while (below.parentElement && !solid(back())) below = below.parentElement;
    const [text, page] = [each, below].map((one) => getComputedStyle(one));
    const pair = [light(text.color), light(page.backgroundColor)].sort((a, b) => b - a);
    found.push([pair[0] / pair[1], each.className + " " + each.textContent.slice(0, 40)]);
  }
  return found;
}"""
#: Colours of the strokes and texts of a drawing of the canvases, and that of the page.
STROKES = """() => {
  const found = new Set(), of = CanvasRenderingContext2D.prototype;
  const [stroke, text] = [of.stroke, of.fillText];
  of.stroke = function (...all) {
    if (this.globalAlpha === 1) found.add("line " + this.strokeStyle);
    return stroke.apply(this, all);
  };
  of.fillText = function (...all) {
    found.add("text " + this.fillStyle);
    return text.apply(this, all);
  };
  for (const canvas of document.querySelectorAll("canvas")) canvas.key = null;
  window.dispatchEvent(new Event("resize"));
  [of.stroke, of.fillText] = [stroke, text];
  const style = getComputedStyle(document.querySelector(".flexarm-player"));
  return [[...found], ...["paper", "grid"].map((k) => style.getPropertyValue("--flexarm-" + k))];
}"""


def luminance(color):
    if color.startswith("#"):
        values = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
    else:
        values = [float(part) for part in color[color.index("(") + 1 : -1].split(",")[:3]]
    parts = [
        v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4
        for v in (k / 255 for k in values)
    ]
    return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2] + 0.05


def contrast(one, other):
    low, high = sorted([luminance(one), luminance(other)])
    return high / low


def assert_readable(page):
    texts = page.evaluate(TEXTS)
    assert len(texts) > 40
    assert [text for ratio, text in texts if ratio < 4.5] == []
    drawn, paper, grid = page.evaluate(STROKES)
    lines = {each.split(" ", 1)[1] for each in drawn if each.startswith("line")}
    lines = {color for color in lines if abs(luminance(color) - luminance(grid)) > 1e-9}
    assert len(lines) > 4
    assert [color for color in lines if contrast(color, paper) < 3.0] == []
    assert [
        k for k in drawn if k.startswith("text") and contrast(k.split(" ", 1)[1], paper) < 4.5
    ] == []
    return luminance(paper)


@pytest.mark.parametrize("width", [1280, 400])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_and_lines_are_readable(scheme, width, new_window):
    window = new_window(width, 800, scheme)
    page = window.page
    window.choose("drive.kind", "joint PD")
    page.get_by_text("phase margin").wait_for()
    assert (assert_readable(page) > 0.5) == (scheme == "light")
    window.type(MASS, "-1")
    window.field(MASS).locator(".message").wait_for()
    page.get_by_role("button", name="New").click()
    page.get_by_text("Wiping a wall").wait_for()
    page.wait_for_timeout(500)  # the menu appears by degrees
    assert_readable(page)
    page.keyboard.press("Escape")
    page.get_by_role("button", name="Lecture").click()
    page.locator(".studio.lecture").wait_for()
    assert_readable(page)


def test_switch_is_kept_by_the_browser(new_window):
    page = new_window(1280, 800, "dark").page
    dark = "document.body.classList.contains('body--dark')"
    assert page.evaluate(dark)
    page.get_by_role("button", name="Dark").click()
    page.wait_for_function(f"!{dark}")
    page.wait_for_timeout(500)  # colours change by degrees
    assert assert_readable(page) > 0.5
    page.reload()
    page.wait_for_function(f"!{dark} && document.querySelector('.picture canvas')")
    page.get_by_role("button", name="Dark").click()  # as the system again
    page.wait_for_function(dark)
    assert page.evaluate("localStorage.length") == 0
    page.emulate_media(color_scheme="light")
    page.wait_for_function(f"!{dark}")


def test_cards_of_the_gallery_open(window):
    page = window.page
    sentences = {title: sentence for title, sentence, _ in cards()}
    for title, drives in (("Strain feedback", 2), ("Whip", 1)):
        before = window.number
        page.get_by_role("button", name="New").click()
        page.get_by_text(sentences[title]).wait_for()
        page.get_by_text(title, exact=True).click()
        window.wait_for_picture(before)
        assert page.locator(".picture .arm canvas").count() == drives
