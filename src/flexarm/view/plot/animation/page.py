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

from flexarm.view.plot.animation.scene import Scene
from flexarm.view.plot.drawn_arm import FloatArray
from flexarm.view.plot.palette import series_colors

#: Parts of the player's script, in their order.
_SCRIPTS = ("canvas.js", "arm.js", "histories.js", "player.js")
#: Resolution of lengths: 1e-4 of the width of the view, a tenth of a pixel.
_PARTS = 1e4


def page(scenes: Sequence[Scene], fps: float, speed: float, title: str) -> str:
    """Return the text of an HTML page that plays scenes side by side; ``speed`` is run s per s."""
    head = f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}'
    head += '</title><meta name="viewport" content="width=device-width, initial-scale=1">'
    head += f"<style>{style()}</style></head>\n<body>"
    return f"{head}{fragment(scenes, fps, speed)}</body></html>\n"


def style() -> str:
    """Return the style sheet of the player."""
    return _text("player.css")


def fragment(scenes: Sequence[Scene], fps: float, speed: float, beside: int | None = None) -> str:
    """Return the player, with ``beside`` histories beside the arm, for pages with `style`."""
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
    """Return the data of the player, plain values and arrays; arguments as in `fragment`."""
    most = max(len(scene.histories) for scene in scenes)
    shown = [_data(scene) for scene in scenes]
    return {
        "fps": fps,
        "speed": speed,
        "scenes": shown,
        "beside": most if beside is None else beside,
    }


def as_json(data: Any) -> str:
    """Return data as JSON in its shortest form, with null for numbers that are not finite."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False, default=_listed)


def _listed(values: FloatArray) -> Any:
    if np.isfinite(values).all():
        return values.tolist()
    found = values.astype(object)
    found[~np.isfinite(values)] = None
    return found.tolist()


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
        "times": _rounded(scene.times, 6),
        "view": _rounded(scene.view, digits),
        "links": _rounded(scene.links, digits),
        "depths": list(scene.depths),
        "bends": [bool(bends) for bends in scene.bends],
        "joints": _rounded(scene.joints, digits),
        "payload": scene.payload,
        "arrows": _rounded(scene.arrows, digits),
        "ghost": _rounded(scene.ghost, digits),
        "path": _rounded(scene.path, digits),
        "pathTimes": _rounded(scene.path_times, 6),
        "reference": None if reference is None else _rounded(reference[0], digits),
        "goal": None if reference is None else _rounded(reference[1], digits),
        "solids": [[_rounded(s.course, digits), _rounded(s.behind, digits)] for s in scene.solids],
        "histories": [
            {
                "title": signals.title,
                "label": signals.axis_label,
                "time": _rounded(signals.time, 6),
                "lines": [_significant(line) for line in signals.values.T],
                "labels": list(signals.labels),
                "colors": list(series_colors(len(signals.labels))),
            }
            for signals in scene.histories
        ],
    }


def _rounded(values: FloatArray | None, digits: int) -> FloatArray | None:
    """Return rounded numbers."""
    if values is None:
        return None
    return np.ascontiguousarray(np.round(values, digits) + 0.0)  # the sum converts -0.0 to 0.0


def _significant(values: FloatArray) -> FloatArray | None:
    """Return numbers rounded to 1e-5 of the largest."""
    largest = float(np.nanmax(np.abs(values[np.isfinite(values)]), initial=0.0))
    digits = 5 - math.floor(math.log10(largest)) if largest > 0.0 else 0
    return _rounded(values, min(max(digits, -300), 300))
