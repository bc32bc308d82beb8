"""How every figure looks: one style, colours that colour-blind readers tell apart.

Figures are made without pyplot: nothing is registered anywhere, no window opens, and the user's own
Matplotlib settings stay as they are.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

# M. Okabe and K. Ito, "Color Universal Design" (2008): distinct for every kind of colour vision.
BLUE = "#0072B2"
VERMILLION = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
SKY = "#56B4E9"
ORANGE = "#E69F00"
INK = "#262626"
GREY = "#8C8C8C"
#: Order in which lines of one plot take their colours.
SERIES = (BLUE, VERMILLION, GREEN, PURPLE, SKY, ORANGE)

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

#: Distances of axis labels from their axes, inches.
_LABEL_LEFT, _LABEL_BELOW = 0.41, 0.22

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


def styled() -> AbstractContextManager[None]:
    """Make and save figures in this package's style; what was set before comes back."""
    return rc_context(_STYLE)


class Sheet(Figure):
    """A figure in the style of this package, on screen and in files.

    Matplotlib reads some settings when a figure is made and others when it is saved.

    Args:
        width, height: inches.
    """

    def __init__(self, width: float, height: float) -> None:
        with styled():
            super().__init__(figsize=(width, height), dpi=DPI)

    def savefig(self, fname: Any, *, format: str | None = None, **options: Any) -> None:
        """See ``Figure.savefig``; the same figure gives the same bytes on every day."""
        if format in ("pdf", "svg"):
            date = {"pdf": "CreationDate", "svg": "Date"}[format]
            options = {"metadata": {date: None}, **options}
        if format == "png":
            # Line art: the fastest compression costs a few per cent of size.
            options = {"pil_kwargs": {"compress_level": 1}, **options}
        with styled():
            super().savefig(fname, format=format, **options)


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
    axes.yaxis.set_label_coords(-_LABEL_LEFT / width, 0.5)
    axes.xaxis.set_label_coords(0.5, -_LABEL_BELOW / height)


def legend_above(axes: Axes) -> None:
    """Put the legend in one row above the axes, at the right, where no line can hide it."""
    handles, labels = axes.get_legend_handles_labels()
    axes.legend(handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(handles))
