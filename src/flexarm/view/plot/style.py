"""Style of all figures, with colours that are distinct for colour-blind readers.

The user's own Matplotlib settings do not change: a `Sheet` applies the style while it is created,
drawn and saved.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from importlib.resources import as_file, files
from typing import Any

import numpy as np
from cycler import cycler
from matplotlib import rc_context, rc_params_from_file
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flexarm.base.arguments import check_choice
from flexarm.base.errors import InputError, Problem, public_call_as, shown
from flexarm.view.plot.palette import BLUE as BLUE
from flexarm.view.plot.palette import GREEN as GREEN
from flexarm.view.plot.palette import GREY as GREY
from flexarm.view.plot.palette import INK as INK
from flexarm.view.plot.palette import ORANGE as ORANGE
from flexarm.view.plot.palette import PURPLE as PURPLE
from flexarm.view.plot.palette import SERIES as SERIES
from flexarm.view.plot.palette import SKY as SKY
from flexarm.view.plot.palette import VERMILLION as VERMILLION

#: Lines of the flexible arm, the rigid arm (dashed, as in the paper) and the second-order theory.
FLEXIBLE: dict[str, Any] = {"color": BLUE, "linewidth": 1.0, "label": "flexible"}
RIGID: dict[str, Any] = {
    "color": INK,
    "linewidth": 0.8,
    "linestyle": (0, (4.0, 2.2)),
    "label": "rigid",
}
SECOND_ORDER: dict[str, Any] = {"color": VERMILLION, "linewidth": 1.0, "label": "second order"}

#: Colours by time: early postures light, late ones dark.
AGES = LinearSegmentedColormap.from_list("ages", ["#BBDDF0", BLUE])
#: Dots per inch of bitmaps, sufficient for print at the width of a column.
DPI = 200
#: Dots per inch of windows and notebooks.
SCREEN_DPI = 110

#: Distances of axis labels from their axes by medium, to the left and below, inches.
_LABELS = {"print": (0.41, 0.22), "screen": (0.5, 0.26)}

_INKED = ("axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color", "text.color")
_COLORS: dict[Any, Any] = {**dict.fromkeys(_INKED, INK), "axes.prop_cycle": cycler(color=SERIES)}


def _settings(medium: str) -> dict[Any, Any]:
    """Return the settings in the style file of a medium."""
    with as_file(files(__package__) / f"{medium}.mplstyle") as path:
        return dict(rc_params_from_file(path, use_default_template=False))


_PRINT = _COLORS | _settings("print")
#: Settings by medium.
MEDIA = {"print": _PRINT, "screen": _PRINT | _settings("screen")}

_medium: ContextVar[str] = ContextVar("medium", default="print")


@public_call_as("plot.styled")
def styled(medium: str | None = None) -> AbstractContextManager[None]:
    """Create and save figures in this package's style; the previous settings return at the end.

    Args:
        medium: "print" for papers, "screen" for slides and videos; None for that of the enclosing
            ``with`` block, or "print".

    Raises:
        InputError: if ``medium`` is not one of these.
    """
    if medium is not None:
        check_choice("medium", medium, MEDIA)
    return _styled(medium)


@contextmanager
def _styled(medium: str | None) -> Iterator[None]:
    chosen = _medium.get() if medium is None else medium
    before = _medium.set(chosen)
    try:
        with rc_context(MEDIA[chosen]):
            yield
    finally:
        _medium.reset(before)


class Sheet(Figure):
    """Figure of ``width`` and ``height`` in inches in the style of this package, also in files.

    The style is applied several times, because Matplotlib reads some settings when a figure is
    created and others when it is drawn or saved.
    """

    def __init__(self, width: float, height: float, **options: Any) -> None:
        self._medium = _medium.get()
        options = {**options, "figsize": (width, height), "dpi": options.get("dpi") or DPI}
        with styled(self._medium):
            super().__init__(**options)

    def draw(self, renderer: Any) -> None:
        with styled(self._medium):
            super().draw(renderer)

    def savefig(self, fname: Any, *, format: str | None = None, **options: Any) -> None:
        """See ``Figure.savefig``; the output does not depend on the date."""
        if format in ("pdf", "svg"):
            date = {"pdf": "CreationDate", "svg": "Date"}[format]
            options = {"metadata": {date: None}, **options}
        if format == "png":
            # For line art the fastest compression increases the size by a few per cent.
            options = {"pil_kwargs": {"compress_level": 1}, **options}
        with styled(self._medium):
            super().savefig(fname, format=format, **{"dpi": DPI, **options})


def margins(
    sheet: Figure, left: float, bottom: float, right: float, top: float, **spacing: float
) -> None:
    """Set the margins around all axes, in inches: a layout engine takes twice as long."""
    width, height = sheet.get_size_inches()
    sheet.subplots_adjust(
        left=left / width,
        bottom=bottom / height,
        right=1.0 - right / width,
        top=1.0 - top / height,
        **spacing,
    )


def place_labels(axes: Axes) -> None:
    """Put the axis labels at fixed distances, so that they are aligned in a column of plots."""
    width, height = axes.figure.get_size_inches() * axes.get_position().size  # type: ignore[union-attr]
    left, below = _LABELS[_medium.get()]
    axes.yaxis.set_label_coords(-left / width, 0.5)
    axes.xaxis.set_label_coords(0.5, -below / height)
    # The factor of small numbers is above the axis by default, where the title begins.
    axes.yaxis.get_offset_text().set(x=-0.01, horizontalalignment="right")


def legend_above(
    axes: Axes,
    handles: Sequence[Any] | None = None,
    labels: Sequence[str] | None = None,
    columns: int | None = None,
) -> None:
    """Put the legend above the axes, at the right, in one row by default."""
    if handles is None or labels is None:
        handles, labels = axes.get_legend_handles_labels()
    columns = len(handles) if columns is None else columns
    axes.legend(handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns)


#: Array of axes, as returned by ``plt.subplots``.
AxesArray = NDArray[np.object_]
_Arrange = Callable[[Sheet], Sequence[Axes]]

#: Width of the text on an A4 page with the usual margins, inches.
WIDTH = 6.5


@contextmanager
def panels(
    axes: object, count: int, size: tuple[float, float], arrange: _Arrange
) -> Iterator[list[Axes]]:
    """Yield ``count`` axes: the given ones, or those of a new figure of pyplot.

    The figure of ``size`` inches is registered with pyplot, so that notebooks and ``plt.show()``
    display it. Axes of the caller keep the caller's settings.
    """
    if axes is not None:
        yield _checked_axes(axes, count)
        return
    import matplotlib.pyplot as plt

    # Load the backend before the style changes the settings, which it restores at the end: that of
    # notebooks turns on the interactive mode, and without it they do not show later figures.
    plt.draw_if_interactive()  # type: ignore[no-untyped-call]
    with styled():
        width, height = size
        sheet = plt.figure(FigureClass=Sheet, width=width, height=height, dpi=SCREEN_DPI)
        assert isinstance(sheet, Sheet)
        own = list(arrange(sheet))
        yield own
        for each in own:
            place_labels(each)


def _checked_axes(axes: object, count: int) -> list[Axes]:
    if isinstance(axes, np.ndarray):
        given = list(axes.ravel())
    else:
        given = list(axes) if isinstance(axes, list | tuple) else [axes]
    if len(given) == count and all(isinstance(each, Axes) for each in given):
        return given
    rule = "be Matplotlib axes" if count == 1 else f"be {count} Matplotlib axes, one for each panel"
    value = f"{len(given)} axes" if all(isinstance(e, Axes) for e in given) else shown(axes)
    raise InputError(Problem("axes", rule, value))


def rows(count: int, **edges: float) -> _Arrange:
    """Return an arrangement of panels in one column with a common horizontal axis."""

    def arrange(sheet: Sheet) -> list[Axes]:
        made = sheet.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
        margins(sheet, **{"left": 0.7, "bottom": 0.45, "right": 0.2, "top": 0.4, **edges})
        return list(made)

    return arrange


def array_of(axes: Sequence[Axes], *shape: int) -> AxesArray:
    """Return axes as an array of the given shape; by default one-dimensional."""
    array = np.empty(len(axes), dtype=object)
    array[:] = axes
    return array.reshape(shape) if shape else array


class Drawing(ABC):
    """Panels with ``size`` (inches) as a page and ``shape`` as an array, and their content."""

    size: tuple[float, float]
    shape: tuple[int, ...]

    @abstractmethod
    def arrange(self, sheet: Sheet) -> list[Axes]:
        """Add the axes, row by row."""

    @abstractmethod
    def draw(self, made: Sequence[Axes]) -> None:
        """Draw into the axes."""

    def on(self, axes: object) -> AxesArray:
        """Draw into the given axes or those of a new figure of pyplot, and return them."""
        with panels(axes, math.prod(self.shape), self.size, self.arrange) as made:
            self.draw(made)
        return array_of(made, *self.shape)

    def page(self, labels: bool = True) -> Sheet:
        """Return a sheet that is not registered with pyplot, by default with aligned labels."""
        sheet = Sheet(*self.size)
        with styled():
            made = self.arrange(sheet)
            self.draw(made)
            for each in made if labels else ():
                place_labels(each)
        return sheet
