"""Files of figures. A protocol stands for the figure, so that Matplotlib stays in ``plot``."""

from __future__ import annotations

from io import BytesIO
from typing import Any, Protocol

from flexarm.base.errors import public_call
from flexarm.base.writing.places import AnyPath, check_place, write_whole

#: File suffixes of figures.
FIGURE_SUFFIXES = (".png", ".pdf", ".svg")


class Savable(Protocol):
    """Matplotlib figure or similar object."""

    def savefig(self, fname: Any, /, *, format: str) -> None:
        """Write the picture to a file or stream."""


@public_call
def write_figure(figure: Savable, path: AnyPath) -> None:
    """Write a figure in the format of the suffix of ``path``.

    The file is written completely or not at all.

    Raises:
        InputError: if the suffix is unknown or the path cannot be written.
    """
    place = check_place("path", path, FIGURE_SUFFIXES)
    picture = BytesIO()
    figure.savefig(picture, format=place.suffix.lower().removeprefix("."))
    write_whole(place, [picture.getvalue()])
