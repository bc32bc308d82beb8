"""Figures to files. Any figure that can save itself will do: Matplotlib stays in ``plot``."""

from __future__ import annotations

from io import BytesIO
from typing import Any, Protocol

from flexarm.places import AnyPath, check_place, write_whole

#: What a figure's file may end in.
FIGURE_SUFFIXES = (".png", ".pdf", ".svg")


class Savable(Protocol):
    """A Matplotlib figure, or what behaves like one."""

    def savefig(self, fname: Any, /, *, format: str) -> None:
        """Write the picture to a file or stream."""


def write_figure(figure: Savable, path: AnyPath) -> None:
    """Write a figure in the format that the suffix of ``path`` names.

    The file appears complete or not at all.

    Raises:
        InputError: unknown suffix, or a path that cannot be written.
    """
    place = check_place("write_figure", "path", path, FIGURE_SUFFIXES)
    picture = BytesIO()
    figure.savefig(picture, format=place.suffix.lower().removeprefix("."))
    write_whole(place, [picture.getvalue()])
