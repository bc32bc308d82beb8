"""Interface of a file format for results."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr

    from flexarm.base.writing.places import AnyPath


@dataclass(frozen=True)
class Format:
    """File format of results.

    ``write_result`` requires that:

    1. ``encode`` returns the content of the file in parts; it opens no file.
    2. A written number reads back as the same float, to the bit.
    3. Names and units are in the file.
    4. ``read`` returns a dataset equal to the one written, attributes included, and raises
       ``OSError`` if the file is not of this format or damaged. It is None if the format cannot
       store a complete result.
    """

    name: str
    suffix: str
    encode: Callable[[xr.Dataset], Iterable[bytes | memoryview]]
    read: Callable[[AnyPath], xr.Dataset] | None = None
