"""How every figure looks: one style, colours that colour-blind readers tell apart.

The user's own Matplotlib settings stay as they are: a `Sheet` applies the style while it is made,
drawn and saved.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flexarm.arguments import check_choice
from flexarm.plot.palette import BLUE as BLUE
from flexarm.plot.palette import GREEN as GREEN
from flexarm.plot.palette import GREY as GREY
from flexarm.plot.palette import INK as INK
from flexarm.plot.palette import ORANGE as ORANGE
from flexarm.plot.palette import PURPLE as PURPLE
from flexarm.plot.palette import SERIES as SERIES
from flexarm.plot.palette import SKY as SKY
from flexarm.plot.palette import VERMILLION as VERMILLION

#: The arm with bending links, the rigid arm (dashed, as in the paper), the second-order theory.
FLEXIBLE: dict[str, Any] = {"color": BLUE, "linewidth": 1.0, "label": "flexible"}
RIGID: dict[str, Any] = {
    "color": INK,
    "linewidth": 0.8,
    "linestyle": (0, (4.0, 2.2)),
    "label": "rigid",
}
SECOND_ORDER: dict[str, Any] = {"color": VERMILLION, "linewidth": 1.0, "label": "second order"}

#: Dots per inch of the bitmaps: sharp in print at the width of a column.
DPI = 200
#: Dots per inch of windows and notebooks.
SCREEN_DPI = 110

#: Distances of axis labels from their axes in each medium, to the left and below, inches.
_LABELS = {"print": (0.41, 0.22), "screen": (0.5, 0.26)}

_STYLE: Any = {
    # Times, as journals set it. It comes with Matplotlib, so figures look alike everywhere, and
    # goes into a PDF in half the time of the default font, whose tables are far larger.
    "font.family": ["STIXGeneral"],
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # a given place: finding one costs as much as drawing the lines
    "axes.titlepad": 5.0,
    "axes.labelsize": 9.0,
    "axes.labelpad": 3.0,
    "axes.labelcolor": INK,
    "axes.edgecolor": INK,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.xmargin": 0.0,
    "axes.ymargin": 0.07,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "grid.color": "#E3E3E3",
    "grid.linewidth": 0.5,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "legend.borderpad": 0.0,
    "legend.borderaxespad": 0.65,
    "legend.columnspacing": 1.0,
    "lines.solid_capstyle": "round",
    "text.color": INK,
    "pdf.fonttype": 42,  # whole fonts: journals refuse Matplotlib's own Type 3
    "svg.fonttype": "none",
}


#: For slides and videos: a typeface without serifs, which low resolution keeps legible, and larger.
_SCREEN: Any = {
    **_STYLE,
    "font.family": ["DejaVu Sans"],
    "font.size": 9.5,
    "axes.titlesize": 10.0,
    "axes.labelsize": 9.5,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "legend.fontsize": 9.0,
    "axes.linewidth": 0.8,
}
#: The settings of each medium.
MEDIA = {"print": _STYLE, "screen": _SCREEN}

_medium: ContextVar[str] = ContextVar("medium", default="print")


@contextmanager
def styled(medium: str | None = None) -> Iterator[None]:
    """Make and save figures in this package's style; the settings from before return at the end.

    Args:
        medium: "print" for papers, "screen" for slides and videos; None for that of the ``with``
            block around this one, or "print".

    Raises:
        InputError: if ``medium`` is none of these.
    """
    chosen = _medium.get() if medium is None else check_choice("styled", "medium", medium, MEDIA)
    before = _medium.set(chosen)
    try:
        with rc_context(MEDIA[chosen]):
            yield
    finally:
        _medium.reset(before)


class Sheet(Figure):
    """A figure in the style of this package, on screen and in files.

    Matplotlib reads some settings when a figure is made and others when it is drawn or saved.

    Args:
        width, height: inches.
        options: of ``Figure``.
    """

    def __init__(self, width: float, height: float, **options: Any) -> None:
        self._medium = _medium.get()
        options = {**options, "figsize": (width, height), "dpi": options.get("dpi") or DPI}
        with styled(self._medium):
            super().__init__(**options)

    def draw(self, renderer: Any) -> None:
        """See ``Figure.draw``."""
        with styled(self._medium):
            super().draw(renderer)

    def savefig(self, fname: Any, *, format: str | None = None, **options: Any) -> None:
        """See ``Figure.savefig``; the same figure gives the same bytes on every day."""
        if format in ("pdf", "svg"):
            date = {"pdf": "CreationDate", "svg": "Date"}[format]
            options = {"metadata": {date: None}, **options}
        if format == "png":
            # Line art: the fastest compression costs a few per cent of size.
            options = {"pil_kwargs": {"compress_level": 1}, **options}
        with styled(self._medium):
            super().savefig(fname, format=format, **{"dpi": DPI, **options})


def margins(
    sheet: Figure, left: float, bottom: float, right: float, top: float, **spacing: float
) -> None:
    """Set the margins around all axes, in inches, whatever the size of the sheet.

    Fixed margins, and not a layout engine: figures of a series line up, and are drawn twice as
    fast.
    """
    width, height = sheet.get_size_inches()
    sheet.subplots_adjust(
        left=left / width,
        bottom=bottom / height,
        right=1.0 - right / width,
        top=1.0 - top / height,
        **spacing,
    )


def place_labels(axes: Axes) -> None:
    """Put the axis labels at fixed distances, so that those of a column of plots line up."""
    width, height = axes.figure.get_size_inches() * axes.get_position().size  # type: ignore[union-attr]
    left, below = _LABELS[_medium.get()]
    axes.yaxis.set_label_coords(-left / width, 0.5)
    axes.xaxis.set_label_coords(0.5, -below / height)


def legend_above(
    axes: Axes, handles: Sequence[Any] | None = None, labels: Sequence[str] | None = None
) -> None:
    """Put the legend in one row above the axes, at the right, where no line can hide it.

    ``handles`` and ``labels``: of the legend; by default those of all labelled lines.
    """
    if handles is None or labels is None:
        handles, labels = axes.get_legend_handles_labels()
    axes.legend(handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(handles))
