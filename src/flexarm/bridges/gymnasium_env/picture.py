"""Picture of the arm and its task as an array of pixels."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_PIXELS, _DPI = 480, 100
_LINK, _JOINT, _TARGET, _PATH = "#0072B2", "#262626", "#D55E00", "#8C8C8C"


class Picture:
    """Square picture around the base, reused for all frames."""

    def __init__(self, reach: float) -> None:
        size = _PIXELS / _DPI
        figure = Figure(figsize=(size, size), dpi=_DPI)
        self._canvas: Any = FigureCanvasAgg(figure)  # Matplotlib has no complete type hints
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        half = 1.1 * reach
        axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal")
        thin: dict[str, Any] = {"color": _PATH, "linewidth": 1.0}
        turn = np.linspace(0.0, 2.0 * np.pi, 181)
        axes.plot(reach * np.cos(turn), reach * np.sin(turn), linestyle=":", **thin)
        (self._path,) = axes.plot([], [], linestyle="--", **thin)
        (self._target,) = axes.plot([], [], "o", color=_TARGET, markersize=12, fillstyle="none")
        (self._links,) = axes.plot([], [], color=_LINK, linewidth=4.0, solid_capstyle="round")
        (self._joints,) = axes.plot([], [], "o", color=_JOINT, markersize=9)

    def draw(self, shape: FloatArray, table: FloatArray, tick: int) -> NDArray[np.uint8]:
        """Draw links (links, stations, 2) m and the target, (480, 480, 3) pixels.

        ``table`` (1 or more, values) are the values of a task at sample times, see ``ArmEnv``.
        """
        self._links.set_data(*shape.reshape(-1, 2).T)
        self._joints.set_data(*shape[:, 0].T)
        self._target.set_data(*table[min(tick, len(table) - 1), :2, None])
        path = table[:, :2] if len(table) > 1 else table[:0, :2]
        self._path.set_data(*path.T)
        self._canvas.draw()
        return np.asarray(self._canvas.buffer_rgba())[:, :, :3].copy()
