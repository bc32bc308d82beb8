"""HTML page that plays scenes without a network, from JSON data and a script."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from functools import cache
from html import escape
from importlib.resources import files
from typing import Any

import numpy as np

from flexarm.plot.animation.scene import Scene
from flexarm.plot.drawn_arm import FloatArray
from flexarm.plot.palette import series_colors

#: Parts of the player's script, in their order.
_SCRIPTS = ("canvas.js", "arm.js", "histories.js", "player.js")
#: Resolution of lengths: 1e-4 of the width of the view, a tenth of a pixel.
_PARTS = 1e4


def page(scenes: Sequence[Scene], fps: float, speed: float, title: str) -> str:
    """Return the text of an HTML page that plays scenes side by side.

    Args:
        fps: frames per second of the player.
        speed: seconds of the run per second of the player.
    """
    head = f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}'
    head += '</title><meta name="viewport" content="width=device-width, initial-scale=1">'
    head += f"<style>{style()}</style></head>\n<body>"
    return f"{head}{fragment(scenes, fps, speed)}</body></html>\n"


def style() -> str:
    """Return the style sheet of the player."""
    return _text("player.css")


def fragment(scenes: Sequence[Scene], fps: float, speed: float, beside: int | None = None) -> str:
    """Return the player as a fragment of a page with the style sheet `style`.

    Args:
        beside: number of histories beside the arm, the others are below it; None for all.
    """
    # A title may contain "</script>", so write "<" as an escape sequence.
    text = as_json(player_data(scenes, fps, speed, beside)).replace("<", "\\u003c")
    place = "document.currentScript.previousElementSibling"
    data = f"JSON.parse({place}.textContent)"
    return (
        '<div class="flexarm-player"></div>'
        f'<script type="application/json" class="flexarm-data">{text}</script>'
        f"<script>({player_function()})({place}.previousElementSibling, {data});</script>"
    )


def player_function() -> str:
    """Return a JavaScript function of an element and the data of a player, which it creates there.

    It returns a function ``load(data, previous)`` that shows other data at the time that is shown,
    with the arm and the histories of ``previous`` data, or null, as a ghost.
    """
    script = "".join(_text(name) for name in _SCRIPTS)
    return f'function (root, data) {{\n"use strict";\n{script}return load;\n}}'


def player_data(
    scenes: Sequence[Scene], fps: float, speed: float, beside: int | None = None
) -> dict[str, Any]:
    """Return the data of the player as plain values; arguments as in `fragment`."""
    most = max(len(scene.histories) for scene in scenes)
    shown = [_data(scene) for scene in scenes]
    return {
        "fps": fps,
        "speed": speed,
        "scenes": shown,
        "beside": most if beside is None else beside,
    }


def as_json(data: Any) -> str:
    """Return data as JSON in its shortest form, which has no infinite numbers."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False)


def inline(text: str, height: int) -> str:
    """Return a page in an iframe, which isolates its styles and script from a notebook."""
    look = f"width:100%;height:{height}px;border:0"
    return f'<iframe srcdoc="{escape(text, quote=True)}" style="{look}"></iframe>'


@cache
def _text(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def _data(scene: Scene) -> dict[str, Any]:
    digits = max(0, 4 - math.floor(math.log10(float(scene.view[1] - scene.view[0]))))
    reference = scene.reference
    return {
        "title": scene.title,
        "times": _plain(scene.times, 6),
        "view": _plain(scene.view, digits),
        "links": _plain(scene.links, digits),
        "depths": list(scene.depths),
        "bends": [bool(bends) for bends in scene.bends],
        "joints": _plain(scene.joints, digits),
        "payload": scene.payload,
        "arrows": _plain(scene.arrows, digits),
        "ghost": _plain(scene.ghost, digits),
        "path": _plain(scene.path, digits),
        "pathTimes": _plain(scene.path_times, 6),
        "reference": None if reference is None else _plain(reference[0], digits),
        "goal": None if reference is None else _plain(reference[1], digits),
        "solids": [[_plain(s.course, digits), _plain(s.behind, digits)] for s in scene.solids],
        "histories": [
            {
                "title": signals.title,
                "label": signals.axis_label,
                "time": _plain(signals.time, 6),
                "lines": [_significant(line) for line in signals.values.T],
                "labels": list(signals.labels),
                "colors": list(series_colors(len(signals.labels))),
            }
            for signals in scene.histories
        ],
    }


def _plain(values: FloatArray | None, digits: int) -> Any:
    """Return nested lists of rounded numbers, with None instead of numbers that are not finite."""
    if values is None:
        return None
    rounded = np.round(values, digits) + 0.0  # the sum converts -0.0 to 0.0
    if np.isfinite(rounded).all():
        return rounded.tolist()
    found = rounded.astype(object)
    found[~np.isfinite(rounded)] = None
    return found.tolist()


def _significant(values: FloatArray) -> list[float | None]:
    """Return numbers rounded to 1e-5 of the largest."""
    largest = float(np.nanmax(np.abs(values[np.isfinite(values)]), initial=0.0))
    digits = 5 - math.floor(math.log10(largest)) if largest > 0.0 else 0
    found: list[float | None] = _plain(values, min(max(digits, -300), 300))
    return found
