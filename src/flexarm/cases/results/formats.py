"""File formats of results by suffix; a new format needs a module here and a row in ``FORMATS``."""

from __future__ import annotations

import os
import stat
from typing import TYPE_CHECKING

from flexarm.base.arguments import check_dataset, check_path
from flexarm.base.errors import InputError, Problem, public_call, shown
from flexarm.base.writing.places import AnyPath, check_place, write_whole
from flexarm.cases.results.base import Format
from flexarm.cases.results.csv_table import CSV
from flexarm.cases.results.netcdf import NETCDF

if TYPE_CHECKING:
    import xarray as xr

#: All formats by file suffix.
FORMATS: dict[str, Format] = {form.suffix: form for form in (NETCDF, CSV)}


@public_call
def write_result(result: xr.Dataset, path: AnyPath) -> None:
    """Write the dataset of ``simulate`` in the format of the suffix of ``path``.

    That of ``Identification.to_dataset`` requires ``.nc``.

    The file is written completely or not at all.

    Raises:
        InputError: if the suffix is unknown or the path cannot be written.
    """
    if "identification" in getattr(result, "attrs", {}):
        # A dataset of Identification.to_dataset, which has no common time, requires names and text.
        place = check_place("path", path, (NETCDF.suffix,))
    else:
        result = check_dataset("result", result)
        place = check_place("path", path, FORMATS)
    write_whole(place, FORMATS[place.suffix.lower()].encode(result))


@public_call
def read_result(path: AnyPath) -> xr.Dataset:
    """Read a result written by ``write_result``, in a format that stores all of it.

    Raises:
        InputError: if the file is missing, damaged, or not a result.
    """
    path = check_path("path", path)
    suffix = path.suffix.lower()
    form = FORMATS.get(suffix)
    if form is None or form.read is None:
        readable = " or ".join(name for name, known in FORMATS.items() if known.read)
        rule = f"be a {readable} file, which contains the whole result"
        raise InputError(Problem("path", rule, shown(str(path))))
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise OSError("it is not an ordinary file")
        result = form.read(path)
    except FileNotFoundError:
        raise InputError(Problem("the file", "does not exist", where=str(path))) from None
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        reason = getattr(error, "strerror", None) or error
        rule = f"is not an intact {form.name} file: {reason}"
        raise InputError(Problem("the file", rule, where=str(path))) from None
    if "flexarm_version" not in result.attrs:
        rule = f"is a {form.name} file that was not written by flexarm"
        raise InputError(Problem("the file", rule, where=str(path)))
    return result
