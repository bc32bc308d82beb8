"""What a file format is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr

    from flexarm.output.places import AnyPath


@dataclass(frozen=True)
class Format:
    """A file format of results. The rules that ``write_result`` relies on:

    1. ``write`` creates the file it is given, which does not exist and whose name says nothing of
       the format; it raises ``OSError`` where it cannot.
    2. A written number reads back as the same float, to the bit.
    3. Names and units are in the file.
    4. ``read`` returns a dataset equal to the one written, attributes included, and raises
       ``OSError`` for what is not of this format; None where the format cannot hold all of it.
    """

    name: str
    suffix: str
    write: Callable[[xr.Dataset, Path], None]
    read: Callable[[AnyPath], xr.Dataset] | None = None
