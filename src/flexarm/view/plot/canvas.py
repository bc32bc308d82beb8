"""Axes for plots: those of the caller, or of a new figure in the package's style."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from flexarm.base.errors import InputError, Problem, shown
from flexarm.view.plot.style import SCREEN_DPI, Sheet, margins, place_labels, styled

#: Array of axes, as returned by ``plt.subplots``.
AxesArray = NDArray[np.object_]
Arrange = Callable[[Sheet], Sequence[Axes]]

#: Width of the text on an A4 page with the usual margins, inches.
WIDTH = 6.5


@contextmanager
def panels(
    axes: object, count: int, size: tuple[float, float], arrange: Arrange
) -> Iterator[list[Axes]]:
    """Yield ``count`` axes: the given ones, or those of a new figure of pyplot.

    The figure is registered with pyplot, so that notebooks and ``plt.show()`` display it. Axes of
    the caller keep the caller's settings.

    Args:
        axes: Matplotlib axes, several as a list or array of any shape; None for a new figure.
        size: width and height of the new figure, inches.
        arrange: function that adds the axes to the new figure.

    Raises:
        InputError: if ``axes`` is not that number of Matplotlib axes.
    """
    if axes is not None:
        yield checked_axes(axes, count)
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


def checked_axes(axes: object, count: int) -> list[Axes]:
    """Return ``count`` Matplotlib axes as a list.

    Raises:
        InputError: if ``axes`` is not that number of Matplotlib axes.
    """
    if isinstance(axes, np.ndarray):
        given = list(axes.ravel())
    else:
        given = list(axes) if isinstance(axes, list | tuple) else [axes]
    if len(given) == count and all(isinstance(each, Axes) for each in given):
        return given
    rule = "be Matplotlib axes" if count == 1 else f"be {count} Matplotlib axes, one for each panel"
    found = f"{len(given)} axes" if all(isinstance(e, Axes) for e in given) else shown(axes)
    raise InputError(Problem("axes", rule, found))


def rows(count: int, **edges: float) -> Arrange:
    """Return an arrangement of panels in one column with a common horizontal axis."""

    def arrange(sheet: Sheet) -> list[Axes]:
        made = sheet.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
        margins(sheet, **{"left": 0.7, "bottom": 0.45, "right": 0.2, "top": 0.4, **edges})
        return list(made)

    return arrange


def array_of(axes: Sequence[Axes], *shape: int) -> AxesArray:
    """Return axes as an array of the given shape; by default one-dimensional."""
    found = np.empty(len(axes), dtype=object)
    found[:] = axes
    return found.reshape(shape) if shape else found
