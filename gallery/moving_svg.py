"""Animations as SVG: vectors that browsers play wherever a page shows a picture, without a script.

Every part that moves has its places at the frames, between which browsers interpolate. Lengths are
tenths of a pixel. Colours follow the scheme of the reader, light or dark. A reader who prefers
reduced motion sees postures at several times, as everybody does at the address FILE.svg#still.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import NamedTuple

import numpy as np

from flexarm.view.plot.animation.scene import Scene, _extent
from flexarm.view.plot.drawn_result import FloatArray, Signals
from flexarm.view.plot.palette import GREEN, ORANGE, PURPLE, VERMILLION, series_colors

_ASPECT = 0.75  # height over width of a picture with at most one history
#: Height of a history and width of the free edge around an arm, as fractions of the width.
_STRIP, _EDGE = 0.2, 0.08
_PAUSE = 0.8  # s at the end of each repetition
_LINK = 36.0  # width of links without a depth
_POSTURES = 6  # of a reader who prefers reduced motion

_STYLE = f"""text{{font:115px system-ui,sans-serif;fill:#555}}.title{{font-weight:600;fill:#262626}}
.right{{text-anchor:end}}path{{fill:none;stroke-linecap:round;stroke-linejoin:round}}
.paper{{fill:#fff}}.solid{{fill:#d9d9d9}}.foot{{fill:#bfbfbf}}.link{{stroke:#0072b2}}
.rigid,.edge{{stroke:#262626}}.edge,.rail,.line,.tip,.reference,.true{{stroke-width:13}}
.true,.ghost,.rail,.body,.axis{{stroke:#8c8c8c}}.true{{opacity:.6}}.axis{{stroke-width:7}}
.ghost,.reference{{stroke-dasharray:50 40}}.ghost,.torque{{stroke-width:17}}.body{{stroke-width:85}}
.tip{{stroke:{VERMILLION};stroke-linecap:butt}}.reference{{stroke:{GREEN}}}
.torque{{stroke:{PURPLE}}}.joint{{fill:#fff;stroke:#262626;stroke-width:11}}.end{{fill:#262626}}
.payload{{fill:{ORANGE}}}.goal{{fill:{GREEN}}}.still{{display:none}}
@media(prefers-color-scheme:dark){{.paper,.joint{{fill:#14181d}}text{{fill:#b5bcc4}}
.title,.end{{fill:#e6e9ed}}.link{{stroke:#56b4e9}}.rigid,.edge,.joint{{stroke:#dfe3e8}}
.solid{{fill:#3a4048}}.foot{{fill:#5b636d}}.line[style*="0072B2"]{{stroke:#56b4e9!important}}
tspan[style*="0072B2"]{{fill:#56b4e9!important}}}}
#still:target~g .moving{{display:none}}#still:target~g .still{{display:inline}}
@media(prefers-reduced-motion:reduce){{.moving{{display:none}}.still{{display:inline}}}}"""


def svg(scenes: Sequence[Scene], fps: float, speed: float, width: int) -> str:
    """Return an SVG of scenes side by side, with their histories below."""
    rows = len(scenes[0].histories)
    across, strip = 10.0 * width, 10.0 * _STRIP * width
    down = max(_ASPECT * across, 0.4 * across + rows * strip)
    box = np.array([across / len(scenes), down - rows * strip])
    spans = np.max([np.ptp(np.concatenate(_extent(scene)), axis=0) for scene in scenes], axis=0)
    spans = np.maximum(spans, 1e-9 * spans.max() + 1e-300)
    scale = float(np.min((box - 2.0 * _EDGE * across) / spans))
    times = scenes[0].times
    clock = _Clock(
        len(times), fps, max(float(max(each.times[-1] for each in scenes) - times[0]), 1e-300)
    )
    text = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{down / 10:.0f}" '
    text += f'viewBox="0 0 {across:.0f} {down:.0f}"><style>{_STYLE}</style>'
    text += f'<rect class="paper" width="{across:.0f}" height="{down:.0f}" rx="60"/>'
    text += f'<clipPath id="box"><rect width="{box[0]:.0f}" height="{box[1]:.0f}"/></clipPath>'
    text += '<g id="still"/>'
    for k, scene in enumerate(scenes):
        panel = "\n".join(_panel(scene, box, scale, clock))
        text += f'\n<g transform="translate({k * box[0]:.0f})">{panel}</g>'
        for row, signals in enumerate(scene.histories):
            values = np.concatenate([each.histories[row].values.ravel() for each in scenes])
            frame = k * box[0] + 80.0, box[1] + row * strip, box[0] - 160.0, strip
            text += _history(signals, values, clock, frame, named=k == 0)
    return text + _notes(scenes[0], speed, scale, across, box[1]) + "</svg>\n"


class _Clock(NamedTuple):
    """Times of the frames in a repetition."""

    frames: int
    fps: float
    span: float  # of the run, s

    def animate(self, name: str, values: Sequence[str]) -> str:
        """Return the element that animates an attribute, with values that are evenly spaced."""
        moving = max(self.frames - 1, 1) / self.fps
        times = np.append(np.linspace(0.0, moving / (moving + _PAUSE), len(values)), 1.0)
        keys = ";".join(f"{t:.4g}" for t in times)
        text = ";".join([*values, values[-1]])
        return (
            f'<animate attributeName="{name}" dur="{moving + _PAUSE:.3f}s" '
            f'repeatCount="indefinite" keyTimes="{keys}" values="{text}"/>'
        )


def _panel(scene: Scene, box: FloatArray, scale: float, clock: _Clock) -> Iterable[str]:
    """Yield the elements of an arm in a box."""
    points = np.concatenate(_extent(scene))
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))

    def placed(values: FloatArray) -> FloatArray:
        return np.asarray(0.5 * box + scale * (values - middle) * [1.0, -1.0])

    def lines(values: FloatArray, look: str) -> str:
        """Return the path of lines (F, L, points, 2)."""
        return _moving_path(placed(values), look, clock)

    if scene.title:
        yield f'<text class="title" x="70" y="165">{escape(scene.title)}</text>'
    for solid in scene.solids:
        outline = np.concatenate([solid.course, solid.behind[::-1]])
        for look, points in (("solid", outline), ("edge", solid.course)):
            yield f'<path class="{look}" clip-path="url(#box)" d="{_path(placed(points[None]))}"/>'
    triangle = np.array([[0.0, 0.0], [-70.0, 110.0], [70.0, 110.0]])
    for foot in placed(scene.marks.feet):
        yield f'<path class="foot" d="{_path((foot + triangle)[None])}"/>'
    if scene.reference is not None:
        yield f'<path class="reference" d="{_path(placed(scene.reference[0][None]))}"/>'
    widths = [max(_LINK, scale * depth) for depth in scene.depths]
    looks = [
        f'{"link" if bends else "rigid"}" stroke-width="{wide:.0f}'
        for bends, wide in zip(scene.bends, widths, strict=True)
    ]
    groups = {look: [k for k, other in enumerate(looks) if other == look] for look in looks}
    yield '<g class="still">'
    for k in np.linspace(0, clock.frames - 1, _POSTURES).round().astype(int):
        for look, chosen in groups.items():
            shade = 0.25 + 0.75 * (k + 1) / clock.frames
            path = _path(placed(scene.links[k, chosen]))
            yield f'<path class="{look}" opacity="{shade:.2f}" d="{path}"/>'
    yield '</g><g class="moving">'
    if scene.path is not None:
        yield _trace(placed(scene.path), scene, clock)
    if scene.ghost is not None:
        yield lines(scene.ghost, "ghost")
    if scene.true is not None:
        yield lines(scene.true.links, "true")
    if scene.marks.rails.size:
        yield lines(scene.marks.rails, "rail")
    if scene.marks.body is not None:
        yield lines(scene.marks.body[:, None], "body")
    for look, chosen in groups.items():
        yield lines(scene.links[:, chosen], look)
    if scene.arrows is not None:
        seats = scene.joints[:, : scene.arrows.shape[1], None]
        arrows = np.where(np.isnan(scene.arrows), seats, scene.arrows)
        yield lines(arrows[:, :, [*range(0, 25, 3), *range(25, arrows.shape[2])]], "torque")
    for joint in range(scene.joints.shape[1]):
        yield _dot(placed(scene.joints[:, joint]), "joint", 38, clock)
    look, radius = ("payload", 62) if scene.payload else ("end", 26)
    yield _dot(placed(scene.links[:, -1, -1]), look, radius, clock)
    if scene.reference is not None:
        yield _dot(placed(scene.reference[1]), "goal", 26, clock)
    yield "</g>"


def _path(lines: FloatArray) -> str:
    """Return the commands of lines (L, points, 2), relative after the first point."""
    text = ""
    for line in np.rint(lines).astype(int):
        steps = " ".join(map(str, np.diff(line, axis=0).ravel())).replace(" -", "-")
        text += f"M{line[0, 0]} {line[0, 1]}l{steps}"
    return text


def _moving_path(lines: FloatArray, look: str, clock: _Clock) -> str:
    paths = [_path(each) for each in lines]
    moving = clock.animate("d", paths) if len({*paths}) > 1 else ""
    return f'<path class="{look}" d="{paths[len(paths) // 2]}">{moving}</path>'


def _dot(points: FloatArray, look: str, radius: int, clock: _Clock) -> str:
    """Return a disk at points (F, 2)."""
    places = [[str(value) for value in axis] for axis in np.rint(points.T).astype(int)]
    x, y = (axis[len(axis) // 2] for axis in places)
    moving = [
        clock.animate(name, axis)
        for name, axis in zip(("cx", "cy"), places, strict=True)
        if len({*axis}) > 1
    ]
    return f'<circle class="{look}" r="{radius}" cx="{x}" cy="{y}">{"".join(moving)}</circle>'


def _trace(path: FloatArray, scene: Scene, clock: _Clock) -> str:
    """Return the path of the tip up to the current time."""
    gone = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1)))
    if gone[-1] == 0.0:
        return ""
    rest = 1e4 * (1.0 - np.interp(scene.times, scene.path_times, gone) / gone[-1])
    moving = clock.animate("stroke-dashoffset", [f"{value:.0f}" for value in rest])
    kept = path[np.unique(np.linspace(0, len(path) - 1, 300).round().astype(int))]
    shape = f'pathLength="10000" stroke-dasharray="10000" d="{_path(kept[None])}"'
    return f'<path class="tip" {shape}>{moving}</path>'


def _history(
    signals: Signals,
    values: FloatArray,
    clock: _Clock,
    frame: tuple[float, float, float, float],
    named: bool,
) -> str:
    """Return lines over time with a cursor in a frame: left, top, width, height.

    ``values`` of all scenes decide about the scale. ``named`` states whether the title is shown.
    """
    left, top, wide, tall = frame
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    x = left + wide * (signals.time - signals.time[0]) / clock.span
    y = top + 150.0 + (tall - 220.0) * (high - signals.values) / max(high - low, 1e-300)
    end, start = f"{left + wide:.0f}", f"{left:.0f}"
    names = list(zip(signals.labels, series_colors(len(signals.labels)), strict=True))
    text = ""
    if named:
        least = 1e-6 * max(high, -low)  # smaller values are errors of rounding
        ends = [value if abs(value) > least else 0.0 for value in (low, high)]
        bounds = f"{ends[0]:.3g} to {ends[1]:.3g} {signals.unit}".replace("-", "−")
        title = f"{escape(signals.title)}, {bounds}"
        text = f'\n<text x="{start}" y="{top + 90:.0f}">{title}</text>'
    if len(names) > 1:
        shown = " ".join(f'<tspan style="fill:{c}">{escape(name)}</tspan>' for name, c in names)
        text += f'<text class="right" x="{end}" y="{top + 90:.0f}">{shown}</text>'
    for line, (_, color) in zip(y.T, names, strict=True):
        path = _path(np.stack([x, line], axis=1)[None, np.isfinite(line)])
        text += f'<path class="line" style="stroke:{color}" d="{path}"/>'
    cursor = f'y1="{top + 130:.0f}" y2="{top + tall - 50:.0f}" class="axis"'
    moving = "".join(clock.animate(name, [start, end]) for name in ("x1", "x2"))
    return f'{text}<line x1="{end}" x2="{end}" {cursor}>{moving}</line>'


def _notes(scene: Scene, speed: float, scale: float, across: float, bottom: float) -> str:
    """Return the factors of a picture, and a bar with a round length."""
    factors = [f"bending × {scene.magnify:g}"] * (scene.true is not None)
    factors += [f"speed × {speed:g}"] * (speed != 1.0)
    power = 10.0 ** math.floor(math.log10(0.25 * across / scale))
    length = max(step * power for step in (1.0, 2.0, 5.0) if step * power * scale < 0.25 * across)
    unit = f"{length:g} m" if length >= 0.1 else f"{1e3 * length:g} mm"
    right, low = across - 80.0, bottom - 70.0
    bar = f"M{right:.0f} {low:.0f}h-{length * scale:.0f}"
    return (
        f'\n<text x="70" y="{low:.0f}">{", ".join(factors)}</text><path class="edge" d="{bar}"/>'
        f'<text class="right" x="{right:.0f}" y="{low - 40:.0f}">{unit}</text>'
    )
