"""Colours of the plots and pages; without Matplotlib, because pages use them too."""

from __future__ import annotations

from collections.abc import Sequence

# M. Okabe and K. Ito, "Color Universal Design" (2008): distinct for every kind of colour vision.
BLUE = "#0072B2"
VERMILLION = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
SKY = "#56B4E9"
ORANGE = "#E69F00"
INK = "#262626"
GREY = "#8C8C8C"
#: Colours of the lines of one plot, in order.
SERIES = (BLUE, VERMILLION, GREEN, PURPLE, SKY, ORANGE)

# Matplotlib's colour map "viridis" up to 0.9, because its end is too pale for a line on white.
_ORDERED = (
    (0x44, 0x01, 0x54),
    (0x48, 0x24, 0x75),
    (0x41, 0x44, 0x87),
    (0x35, 0x5F, 0x8D),
    (0x2A, 0x78, 0x8E),
    (0x21, 0x91, 0x8C),
    (0x22, 0xA8, 0x84),
    (0x44, 0xBF, 0x70),
    (0x7A, 0xD1, 0x51),
    (0xBB, 0xDF, 0x27),
)


def series_colors(count: int) -> Sequence[str]:
    """Return distinct colours for few lines, or colours of an ordered map for many."""
    if count <= len(SERIES):
        return SERIES[:count]
    last = len(_ORDERED) - 1
    return [_between(last * k / (count - 1)) for k in range(count)]


def _between(place: float) -> str:
    """Return the colour at a position of the map, from 0 to 9."""
    k = min(int(place), len(_ORDERED) - 2)
    part = place - k
    mixed = (a + part * (b - a) for a, b in zip(_ORDERED[k], _ORDERED[k + 1], strict=True))
    return "#" + "".join(f"{round(value):02x}" for value in mixed)
