"""Every page of the site at the width of a phone and of a laptop, in light and in dark.

Each page is measured by ``page_faults.js`` and compared with a small picture of its first screen;
one sheet of pictures for each section and view is stored in ``tests/data/pages``. With
NEW_PICTURES=1 in the environment the sheets are stored instead, and ``out/pictures`` has whole
pages in full size: look at them. Pages with faults are drawn there in any case.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from built_site import ROOT, built_site

FAULTS = (Path(__file__).parent / "page_faults.js").read_text(encoding="utf-8")
SHEETS, WHOLE = ROOT / "tests" / "data" / "pages", ROOT / "out" / "pictures"
HEIGHT = 800
VIEWS = [(width, scheme) for width in (1280, 400) for scheme in ("light", "dark")]
#: Pixels of the page in one of a stored picture; sides of the squares whose colours are compared,
#: in pixels of stored pictures; pictures side by side.
REDUCED, SIDE, COLUMNS = 5, 8, 6
#: Mean difference from the stored picture, of 255. Another font changes by up to 2, a shorter
#: paragraph, so that all below moves up, by 4 to 8; another ground or no navigation by over 10.
LARGEST = 9.0
_STORE = "if these pages are right, store their pictures with NEW_PICTURES=1"
_SETTLED = "*, *::before, *::after { transition: none !important; animation: none !important }"

Views = dict[tuple[int, str], Image.Image]


class Reader:
    """A window of a browser in which pages are opened one after another."""

    def __init__(self, chromium: Any, site: Path) -> None:
        self.site = site
        self.faults: list[str] = []
        self._place = ""
        context = chromium.new_context(offline=True, reduced_motion="reduce")
        context.set_default_timeout(120_000)
        self._page = context.new_page()
        self._page.on("pageerror", lambda error: self._add(str(error)))
        self._page.on("requestfailed", lambda request: self._add(f"no file {request.url}"))
        self._page.on("console", lambda line: line.type == "error" and self._add(line.text))

    def _add(self, fault: str) -> None:
        self.faults.append(f"{self._place}: {fault}")

    def read(self, page: Path) -> Views:
        """Note the faults of a page in all views, and return its first screens."""
        name, before, screens = page.relative_to(self.site).as_posix(), len(self.faults), {}
        self._place = name
        self._page.goto(page.as_uri())
        self._page.add_style_tag(content=_SETTLED)
        inks = {}
        for width, scheme in VIEWS:
            self._place = f"{name} at {width} pixels in {scheme}"
            self._page.set_viewport_size({"width": width, "height": HEIGHT})
            self._page.emulate_media(color_scheme=scheme)
            for fault in self._page.evaluate(FAULTS):
                self._add(fault)
            if width == VIEWS[0][0]:
                inks[scheme] = self._inks()
            self._page.evaluate("scrollTo(0, 0)")  # the drawings were brought into view
            screens[width, scheme] = opened(self._page.screenshot())
            if os.environ.get("NEW_PICTURES") or len(self.faults) > before:
                picture = WHOLE / f"{width}-{scheme}" / f"{name}.png"
                picture.parent.mkdir(parents=True, exist_ok=True)
                self._page.screenshot(path=picture, full_page=True)
        self._place = name
        for light, dark in zip(inks["light"], inks["dark"], strict=True):
            # Lines of a drawing that has no colours for a dark page vanish there.
            if not (light > 0.002 and 0.6 < dark / light < 2.0):
                self._add(f"a drawing has {light:.2%} of ink in light and {dark:.2%} in dark")
        return screens

    def _inks(self) -> list[float]:
        """Return the share of pixels of each drawing with a contrast to its ground."""
        drawings = self._page.locator('article img[src*=".svg"]').all()
        return [ink(opened(drawing.screenshot())) for drawing in drawings]


def opened(content: bytes) -> Image.Image:
    with Image.open(io.BytesIO(content)) as image:
        return image.convert("RGB")


def ink(picture: Image.Image) -> float:
    """Return the share of pixels whose contrast to the most frequent colour is above 3."""
    values = np.asarray(picture) / 255.0
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    light = np.round(linear @ (0.2126, 0.7152, 0.0722), 4)
    levels, counts = np.unique(light, return_counts=True)
    ground = levels[counts.argmax()]
    return float(
        ((np.maximum(light, ground) + 0.05) / (np.minimum(light, ground) + 0.05) > 3).mean()
    )


def sections(names: Iterable[str]) -> dict[str, list[str]]:
    """Return the pages of each folder, in the order of their pictures on a sheet."""
    folders: dict[str, list[str]] = {}
    for name in sorted(names):
        folders.setdefault(name.rpartition("/")[0].replace("/", "-") or "entry", []).append(name)
    return folders


def reduced(screen: Image.Image) -> Image.Image:
    size = screen.width // REDUCED, screen.height // REDUCED
    return screen.resize(size, Image.Resampling.BOX)


def place(number: int, width: int) -> tuple[int, int, int, int]:
    """Return left, top, right and bottom of a picture on its sheet."""
    wide, high = width // REDUCED, HEIGHT // REDUCED
    left, top = number % COLUMNS * wide, number // COLUMNS * high
    return left, top, left + wide, top + high


def sheet(pictures: Sequence[Image.Image], width: int) -> Image.Image:
    """Return the reduced pictures of a section side by side."""
    corners = [place(number, width)[2:] for number in range(len(pictures))]
    whole = Image.new("RGB", (max(x for x, _ in corners), max(y for _, y in corners)), "#808080")
    for number, picture in enumerate(pictures):
        whole.paste(picture, place(number, width)[:2])
    return whole


def squares(picture: Image.Image) -> np.ndarray:
    """Return mean colours of squares, 0 to 255."""
    pixels = np.asarray(picture.convert("RGB")).astype(float)
    height, width, _ = pixels.shape
    shape = (height // SIDE, SIDE, width // SIDE, SIDE, 3)
    return pixels.reshape(shape).mean(axis=(1, 3))


def differences(pictures: Sequence[Image.Image], width: int, stored: Path) -> list[float]:
    """Return the mean difference of each picture from that on its stored sheet, of 255."""
    with Image.open(stored) as image:
        whole = image.convert("RGB")
    assert whole.size == sheet(pictures, width).size, f"{stored.stem} has other pages: {_STORE}"
    return [
        np.abs(squares(picture) - squares(whole.crop(place(number, width)))).max(axis=-1).mean()
        for number, picture in enumerate(pictures)
    ]


@pytest.mark.thorough
def test_every_page_looks_right(chromium: Any, tmp_path_factory: pytest.TempPathFactory) -> None:
    site = built_site(tmp_path_factory)
    reader = Reader(chromium, site)
    pages = sorted(page for page in site.rglob("*.html") if "_static" not in page.parts)
    screens = {page.relative_to(site).as_posix(): reader.read(page) for page in pages}
    changed = []
    for section, names in sections(screens).items():
        for width, scheme in VIEWS:
            pictures = [reduced(screens[name][width, scheme]) for name in names]
            stored = SHEETS / f"{section}-{width}-{scheme}.webp"
            if os.environ.get("NEW_PICTURES"):
                stored.parent.mkdir(exist_ok=True)
                sheet(pictures, width).save(stored, quality=40, method=6)
            away = differences(pictures, width, stored)
            looks = zip(names, away, strict=True)
            changed += [f"{name} at {width} in {scheme}" for name, far in looks if far > LARGEST]
    assert not reader.faults, "\n".join(reader.faults)
    assert not changed, f"{_STORE}\n" + "\n".join(changed)
