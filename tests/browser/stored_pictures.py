"""Comparison of a page on the screen with the picture of it in the documentation."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

_FOLDER = Path(__file__).parents[2] / "docs" / "how-to"
#: Side of the squares whose mean colours are compared (pixels).
_SIDE = 10


def assert_looks_like(page: Any, name: str) -> None:
    """Compare means of squares, because fonts and smoothing differ between machines.

    With NEW_PICTURES=1 in the environment the picture is stored instead: look at it.
    """
    found, stored = page.screenshot(), _FOLDER / name
    if os.environ.get("NEW_PICTURES"):
        stored.write_bytes(found)
    means = []
    for source in (io.BytesIO(found), stored):
        with Image.open(source) as image:
            pixels = np.asarray(image.convert("RGB")).astype(float)
        height, width, _ = pixels.shape
        assert height % _SIDE == width % _SIDE == 0
        squares = pixels.reshape(height // _SIDE, _SIDE, width // _SIDE, _SIDE, 3)
        means.append(squares.mean(axis=(1, 3)))
    assert means[0].shape == means[1].shape
    away = np.abs(means[0] - means[1]).max(axis=-1)
    # Of 255. Letters of another font change by 0.4 in the mean and 0.6 % of the squares by more
    # than 20; the arm 0.14 s later changes by 0.8 in the mean, 1.4 %; without the arm, 1.0 and 2 %.
    assert away.mean() < 0.6
    assert (away > 20.0).mean() < 0.01
