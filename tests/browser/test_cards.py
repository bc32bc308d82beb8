"""Cards in a browser: the pictures play where a page shows them, in light and in dark."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gallery.moving import FOLDER, NAMES
from PIL import Image

pytestmark = pytest.mark.thorough
#: Of each scheme: mean brightness of pictures, and of pages without one, 0 to 255.
SCHEMES = {"light": (200.0, 255.0), "dark": (15.0, 60.0)}


@pytest.fixture
def shown(screen: Any, tmp_path: Path) -> Any:
    """Return a page with all cards, as the entry page has them."""
    images = "".join(
        f'<img id="{name}" src="{(FOLDER / name).as_uri()}.svg" width="300">' for name in NAMES
    )
    page = tmp_path / "cards.html"
    page.write_text(f'<html style="color-scheme: light dark">{images}</html>', encoding="utf-8")
    screen.emulate_media(reduced_motion="no-preference")

    def open_page(scheme: str) -> Any:
        screen.emulate_media(color_scheme=scheme)
        screen.goto(page.as_uri())
        screen.wait_for_function("[...document.images].every(image => image.naturalWidth === 360)")
        return screen

    return open_page


def picture(screen: Any, name: str) -> np.ndarray:
    with Image.open(io.BytesIO(screen.locator(f"#{name}").screenshot())) as image:
        return np.asarray(image.convert("RGB")).astype(float)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_every_picture_is_drawn_in_the_colours_of_the_reader(scheme: str, shown: Any) -> None:
    screen = shown(scheme)
    low, high = SCHEMES[scheme]
    for name in NAMES:
        seen = picture(screen, name)
        assert low < seen.mean() < high, name
        far = np.abs(seen - np.median(seen, axis=(0, 1))).max(axis=-1)
        assert (far > 60.0).mean() > 0.005, f"{name}: nothing is drawn"


def test_every_picture_moves(shown: Any) -> None:
    """Within some seconds: a run may begin or end at rest, and repetitions pause for 0.8 s."""
    screen = shown("light")
    still = {name: picture(screen, name) for name in NAMES}
    for _ in range(20):
        screen.wait_for_timeout(300)
        for name in list(still):
            if (np.abs(picture(screen, name) - still[name]).max(axis=-1) > 60.0).mean() > 0.001:
                del still[name]
        if not still:
            return
    assert not still


def test_pictures_stand_still_for_readers_who_prefer_that(screen: Any, tmp_path: Path) -> None:
    """At the address with #still they show postures at several times."""
    page = tmp_path / "still.html"
    page.write_text(f'<img id="whip" src="{(FOLDER / "whip.svg").as_uri()}#still">')
    screen.goto(page.as_uri())
    first = picture(screen, "whip")
    screen.wait_for_timeout(1500)
    assert (picture(screen, "whip") == first).all()
    blue = (first[..., 2] - first[..., 0] > 60.0).mean()
    assert blue > 0.02, "six postures are more than one"
