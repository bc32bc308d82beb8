"""Frames of an animation as pictures, with a static background that is drawn once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from flexarm.base.errors import InputError, Problem
from flexarm.view.plot import style
from flexarm.view.plot.animation.scene import Scene
from flexarm.view.plot.drawn_result import joined
from flexarm.view.plot.histories import draw_signals

Picture = NDArray[np.uint8]

DPI = 100
#: Width of links without a depth, and minimum width of links to scale, points.
_LINK = 3.2
_LEFT, _BOTTOM, _TOP, _RIGHT = 0.75, 0.5, 0.62, 0.2  # inches
_GAP, _LEAST = 0.85, 0.5


class Stage:
    """Picture of scenes side by side: a static background, and artists that change."""

    def __init__(self, scenes: Sequence[Scene], width: int) -> None:
        with style.styled("screen"):
            self._sheet, arms, panels = _arrange(scenes, width / DPI)
            self._canvas = cast(Any, FigureCanvasAgg(self._sheet))  # its methods are untyped
            self._moving: list[tuple[Axes, _Arm | _Cursor]] = []
            # A square contains the views of all scenes, so that all arms have one scale.
            views = np.array([scene.view for scene in scenes])
            low, high = views[:, [0, 2]].min(axis=0), views[:, [1, 3]].max(axis=0)
            half, middle = 0.5 * float((high - low).max()), 0.5 * (low + high)
            left, bottom = middle - half
            right, top = middle + half
            view = float(left), float(right), float(bottom), float(top)
            for scene, arm, own in zip(scenes, arms, panels, strict=True):
                self._moving.append((arm, _Arm(arm, scene, view)))
                for panel, signals in zip(own, scene.histories, strict=True):
                    draw_signals(panel, signals)
                    style.place_labels(panel)
                    self._moving.append((panel, _Cursor(panel, scene.times, signals)))
                for panel in own[:-1]:
                    panel.set_xlabel("")
                for panel in own:
                    _keep_title_free(panel)
            self._canvas.draw()
        self._still = self._canvas.copy_from_bbox(self._sheet.bbox)
        self.arms = arms
        self.size = self._canvas.get_width_height()

    def pictures(self) -> Iterator[Picture]:
        """Yield the frames, (height, width, 4) RGBA, in one array that is reused."""
        frames = len(self._moving[0][1].times)
        for k in range(frames):
            self._canvas.restore_region(self._still)
            for axes, moving in self._moving:
                for artist in moving.at(k):
                    axes.draw_artist(artist)
            yield np.asarray(self._canvas.buffer_rgba())


def _arrange(
    scenes: Sequence[Scene], width: float
) -> tuple[style.Sheet, list[Axes], list[list[Axes]]]:
    """Create the axes, with histories beside a single arm or below several arms."""
    count = len(scenes[0].histories)
    share = 0.56 if count else 1.0
    side = share * width - _LEFT - _RIGHT
    if len(scenes) == 1 and side > 0.75 * count - 0.5:  # the histories have room beside the arm
        height = _even(side + _BOTTOM + _TOP)
        sheet = style.Sheet(width, height, dpi=DPI)
        arm = _placed(sheet, _LEFT, _BOTTOM, side, side)
        left = share * width + _GAP - _RIGHT
        own = _column(sheet, count, left, _BOTTOM, width - left - _RIGHT, side)
        return sheet, [arm], [own]
    each = (width - _LEFT + _GAP - _RIGHT) / len(scenes) - _GAP
    if each < _LEAST:
        least = np.ceil(DPI * (len(scenes) * (_LEAST + _GAP) + _LEFT - _GAP + _RIGHT))
        rule = f"be at least {least:.0f} for {len(scenes)} results"
        raise InputError(Problem("width", rule, f"{DPI * width:.0f}"))
    below = count * 1.5
    height = _even(each + below + _BOTTOM + _TOP + (0.55 if count else 0.0))
    sheet = style.Sheet(width, height, dpi=DPI)
    arms, panels = [], []
    for k in range(len(scenes)):
        left = _LEFT + k * (each + _GAP)
        arms.append(_placed(sheet, left, height - _TOP - each, each, each))
        panels.append(_column(sheet, count, left, _BOTTOM, each, below - 0.35))
    return sheet, arms, panels


def _even(inches: float) -> float:
    """Round a height to an even number of pixels, which video formats need."""
    return 2 * round(inches * DPI / 2) / DPI


def _placed(sheet: style.Sheet, left: float, bottom: float, width: float, height: float) -> Axes:
    across, up = sheet.get_size_inches()
    return sheet.add_axes((left / across, bottom / up, width / across, height / up))


def _column(
    sheet: style.Sheet, count: int, left: float, bottom: float, width: float, height: float
) -> list[Axes]:
    """Add axes in a column, from the top, with room for a title above each."""
    gap = 0.5
    each = (height - (count - 1) * gap) / max(count, 1)
    places = [bottom + (count - 1 - k) * (each + gap) for k in range(count)]
    return [_placed(sheet, left, place, width, each) for place in places]


class _Arm:
    """Artists of an arm; ``at`` yields them after setting them to a frame."""

    def __init__(self, axes: Axes, scene: Scene, view: tuple[float, float, float, float]) -> None:
        self.scene, self.times = scene, scene.times
        axes.set(xlim=view[:2], ylim=view[2:], xlabel="x [m]", ylabel="y [m]")
        axes.set_aspect("equal", adjustable="box")
        axes.grid(True, axis="both")
        axes.locator_params(nbins=7)
        style.place_labels(axes)
        if scene.title:
            axes.text(0.98, 0.98, scene.title, transform=axes.transAxes, ha="right", va="top")
        for solid in scene.solids:
            outline = np.concatenate([solid.course, solid.behind[::-1]])
            axes.add_patch(Polygon(outline, closed=True, facecolor="#D9D9D9", edgecolor="none"))
            axes.plot(*solid.course.T, color=style.INK, linewidth=1.2, label="_")
        self.goal = None
        if scene.reference is not None:
            look: dict[str, Any] = {"color": style.GREEN, "linestyle": (0, (4.0, 2.2))}
            axes.plot(*scene.reference[0].T, linewidth=1.2, label="reference", **look)
            self.goal = _line(axes, color=style.GREEN, marker="x", markersize=7, linestyle="none")
        self.path = _line(axes, color=style.VERMILLION, linewidth=1.2, label="tip")
        self.ghost = _line(axes, color=style.GREY, linewidth=1.4, linestyle="--", label="rigid")
        scale = 72.0 * axes.get_window_extent().width / DPI / (view[1] - view[0])  # points per m
        self.rails = [_line(axes, color=style.GREY, linewidth=1.2) for _ in scene.marks.rails[0]]
        self.body = _line(axes, color=style.GREY, linewidth=7.0, solid_capstyle="round")
        self.true = _line(axes, color=style.GREY, linewidth=1.0, alpha=0.6, label="true shape")
        self.note = "" if scene.true is None else f"   bending × {scene.magnify:g}"
        self.links = []
        for depth, bends in zip(scene.depths, scene.bends, strict=True):
            color, width = style.BLUE if bends else style.INK, max(_LINK, scale * depth)
            self.links.append(_line(axes, color=color, linewidth=width, solid_capstyle="round"))
        self.arrows = _line(axes, color=style.PURPLE, linewidth=1.8, label="torque")
        white: dict[str, Any] = {"markerfacecolor": "white", "markeredgecolor": style.INK}
        self.joints = _line(axes, marker="o", markersize=6, linestyle="none", **white)
        self.tip = _line(axes, marker="o", linestyle="none", markeredgewidth=0.0)
        self.tip.set(
            color=style.ORANGE if scene.payload else style.INK, markersize=9 if scene.payload else 4
        )
        self.clock = axes.text(0.02, 0.98, "", transform=axes.transAxes, va="top", animated=True)
        _feet(axes, scene.marks.feet, view)
        shown = [self.ghost] * (scene.ghost is not None) + [self.path] * (scene.path is not None)
        shown += [self.arrows] * (scene.arrows is not None)
        shown += [self.true] * (scene.true is not None)
        shown = [line for line in axes.get_lines() if line.get_label() == "reference"] + shown
        if shown:
            names = [str(line.get_label()) for line in shown]
            style.legend_above(axes, shown, names)
            legend: Any = axes.get_legend()
            if legend.get_window_extent().width > axes.get_window_extent().width:
                style.legend_above(axes, shown, names, columns=(len(shown) + 1) // 2)

    def at(self, frame: int) -> Iterator[Any]:
        scene = self.scene
        time = scene.times[frame]
        if scene.path is not None:
            now = int(np.searchsorted(scene.path_times, time, side="right"))
            tip = scene.links[frame, -1, -1]
            self.path.set_data(*np.vstack([scene.path[:now], tip]).T)
            yield self.path
        if scene.ghost is not None:
            self.ghost.set_data(*joined(scene.serial, scene.ghost[frame]).T)
            yield self.ghost
        if scene.true is not None:
            self.true.set_data(*joined(scene.serial, scene.true.links[frame]).T)
            yield self.true
        for line, ends in zip(self.rails, scene.marks.rails[frame], strict=True):
            line.set_data(*ends.T)
            yield line
        if scene.marks.body is not None:
            self.body.set_data(*scene.marks.body[frame].T)
            yield self.body
        for line, points in zip(self.links, scene.links[frame], strict=True):
            line.set_data(*points.T)
            yield line
        if scene.arrows is not None:
            gap = np.full((scene.arrows.shape[1], 1, 2), np.nan)
            arcs = np.concatenate([scene.arrows[frame], gap], axis=1)
            self.arrows.set_data(*arcs.reshape(-1, 2).T)
            yield self.arrows
        self.joints.set_data(*scene.joints[frame].T)
        yield self.joints
        self.tip.set_data(*scene.links[frame, -1, -1:].T)
        yield self.tip
        if self.goal is not None and scene.reference is not None:
            self.goal.set_data(*scene.reference[1][frame : frame + 1].T)
            yield self.goal
        self.clock.set_text(f"t = {time:.3f} s{self.note}")
        yield self.clock


class _Cursor:
    """Line at the current time, and a dot on each line of a history."""

    def __init__(self, axes: Axes, times: Any, signals: Any) -> None:
        self.times, self.signals = times, signals
        self.line = axes.axvline(times[0], color=style.INK, linewidth=0.9, animated=True)
        self.dots = [
            _line(axes, marker="o", markersize=4.5, linestyle="none", color=line.get_color())
            for line in axes.get_lines()[: signals.values.shape[1]]
        ]

    def at(self, frame: int) -> Iterator[Any]:
        time = self.times[frame]
        self.line.set_xdata([time, time])
        yield self.line
        for dot, values in zip(self.dots, self.signals.values.T, strict=True):
            dot.set_data([time], [np.interp(time, self.signals.time, values)])
            yield dot


def _line(axes: Axes, **look: Any) -> Line2D:
    """Add an empty line that is drawn in every frame."""
    (line,) = axes.plot([], [], animated=True, **{"label": "_", **look})
    return line


def _keep_title_free(panel: Axes) -> None:
    """Put a legend for which there is no room beside the title into the panel."""
    legend: Any = panel.get_legend()
    title = panel.set_title(panel.get_title(loc="left"), loc="left")
    if legend is not None and legend.get_window_extent().x0 < title.get_window_extent().x1 + 6.0:
        look: dict[str, Any] = {"frameon": True, "framealpha": 0.75, "edgecolor": "none"}
        panel.legend(loc="upper right", ncols=2, borderpad=0.1, **look)


def _feet(axes: Axes, feet: Any, view: tuple[float, float, float, float]) -> None:
    """Mark points (k, 2) of the ground by a foot below each."""
    size = 0.028 * (view[1] - view[0])
    shape = np.array([[0.0, 0.0], [-size, -1.4 * size], [size, -1.4 * size]])
    look: dict[str, Any] = {"facecolor": "#BFBFBF", "edgecolor": style.INK, "linewidth": 0.8}
    for point in feet:
        axes.add_patch(Polygon(point + shape, closed=True, **look))
