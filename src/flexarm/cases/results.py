"""Files of results, figures and linear models; a new format of results needs a row in ``FORMATS``.

NetCDF 4 files contain the complete result with labels, units, the arm and the settings of the run.
They are encoded in memory, because HDF5 crashes the process if a disk is full while it writes, and
leaves the file open. A digest follows after the end of the HDF5 content, where readers of NetCDF do
not look. HDF5 detects most damage of its own structures, but none of the numbers. An attribute
announces the digest, so that damage to its mark does not disable the check.

CSV tables are for spreadsheets and MATLAB: one row per time, one column per number. The header
contains the channel and unit of every column: ``joint_angle_1 [rad]``, ``tip_x [m]``,
``strain_1 [1]``, ``joint_force_2_x [N]``. Data at other times, such as readings of instruments and
events, are only in NetCDF files. A protocol stands for figures, so that Matplotlib stays in
``plot``.
"""

from __future__ import annotations

import csv
import hashlib
import io
import itertools
import json
import os
import stat
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from flexarm.base.arguments import check_dataset, check_kind, check_path
from flexarm.base.errors import InputError, Problem, public_call, shown
from flexarm.base.late import xr
from flexarm.base.writing.mat_file import mat_bytes
from flexarm.base.writing.places import AnyPath, check_place, write_text, write_whole
from flexarm.simulation.run.channels import unit_of_part

if TYPE_CHECKING:
    from flexarm.linear import LinearModel


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


_MARK = b"flexarm: SHA-256 "
_DIGEST_BYTES = hashlib.sha256().digest_size
_AT_ONCE = 1 << 20
_ANNOUNCED = "digest"
_CHANGED = "the file is damaged, or another program has changed it"


def encode_netcdf(dataset: xr.Dataset) -> Iterator[bytes | memoryview]:
    """Yield the content of the NetCDF file of a dataset, followed by its digest.

    Raises:
        InputError: if a variable or an attribute that was added or edited cannot be stored.
    """
    # Copy the content: a view that outlives its buffer, as in a traceback, prints an error message.
    announced = dataset.assign_attrs({_ANNOUNCED: "SHA-256 after the end of the HDF5 content"})
    try:
        content = bytes(announced.to_netcdf(engine="h5netcdf"))
    except (TypeError, ValueError) as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(Problem("result", f"cannot be stored: {reason}")) from None
    yield content
    yield _MARK + hashlib.sha256(content).digest()


def _read_netcdf(path: AnyPath) -> xr.Dataset:
    import h5py

    checked = _check_digest(path)
    try:
        with h5py.File(path, "r") as file:
            # h5netcdf also reads this first, and prints its own traceback if it fails.
            file.attrs.get("_nc3_strict")
        result = xr.load_dataset(path, engine="h5netcdf")
    except FileNotFoundError:
        raise
    except Exception as error:
        # A damaged file may raise anything: KeyError, RuntimeError, UnicodeDecodeError, MemoryError
        # and others, depending on the damage.
        raise OSError(f"{type(error).__name__}: {error}") from None
    if result.attrs.pop(_ANNOUNCED, None) is not None and not checked:
        raise OSError(_CHANGED)
    return result


def _check_digest(path: AnyPath) -> bool:
    """Return whether a file has a digest at its end; raise `OSError` if it is another one."""
    with open(path, "rb") as stream:
        end = stream.seek(0, 2) - len(_MARK) - _DIGEST_BYTES
        if end < 0:
            return False
        stream.seek(end)
        if stream.read(len(_MARK)) != _MARK:
            return False
        written = stream.read()
        stream.seek(0)
        digest = hashlib.sha256()
        while end > 0:
            part = stream.read(min(end, _AT_ONCE))
            if not part:
                break
            digest.update(part)
            end -= len(part)
    if digest.digest() != written:
        raise OSError(_CHANGED)
    return True


NETCDF = Format("NetCDF", ".nc", encode_netcdf, _read_netcdf)


_ROWS_AT_ONCE = 4096  # limits the memory for the text of long runs


def columns(result: xr.Dataset) -> list[str]:
    """Return the header of the table of a result, time first."""
    names = ["time [s]"]
    for name in _over_time(result):
        variable = result[name]
        names += [
            f"{name}{part} [{unit}]" for part, unit in _parts(result, variable) if unit is not None
        ]
    return names


def _over_time(result: xr.Dataset) -> list[str]:
    """Return the names of variables over time; measurements have their own times."""
    return [str(name) for name, item in result.data_vars.items() if item.dims[:1] == ("time",)]


def _parts(result: xr.Dataset, variable: xr.DataArray) -> Iterator[tuple[str, str]]:
    """Yield the suffix and the unit of each column of a channel."""
    unit = str(variable.attrs.get("units", "1"))
    labels = [_labels(result, str(dimension)) for dimension in variable.dims[1:]]
    for parts in itertools.product(*labels):
        part = "".join(f"_{label}" for label in parts)
        if variable.dims[1:] == ("coordinate",):
            # Joint angles and modal coordinates share a channel: "rad or m kg^0.5".
            angle, _, modal = unit.partition(" or ")
            yield part, angle if part.startswith("_joint") else modal
        else:
            yield part, unit_of_part({"units": unit} | variable.attrs, parts[-1] if parts else "")


def _labels(result: xr.Dataset, dimension: str) -> list[object]:
    """Return the labels of a dimension: its values, or numbers from 1 for gauges and stations."""
    values = result[dimension].values
    counted = dimension in ("gauge", "station")
    return list(range(1, values.size + 1)) if counted else list(values)


def _encode_csv(result: xr.Dataset) -> Iterator[bytes]:
    times = result["time"].values
    blocks = [result[name].values.reshape(times.size, -1) for name in _over_time(result)]
    table = np.column_stack([times, *blocks])
    yield _csv_lines([columns(result)])
    for start in range(0, len(table), _ROWS_AT_ONCE):
        # The csv module writes floats with digits that read back as the same float.
        yield _csv_lines(table[start : start + _ROWS_AT_ONCE].tolist())


def _csv_lines(rows: list[list[str]] | list[list[float]]) -> bytes:
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


CSV = Format("CSV", ".csv", _encode_csv)


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


#: File suffixes of linear models.
MODEL_SUFFIXES = (".mat", ".json")


@public_call
def save_linear(model: LinearModel, path: AnyPath) -> None:
    """Write a linear model to a ``.mat`` or ``.json`` file, completely or not at all.

    Both contain the same names: ``A``, ``B``, ``C``, ``D``, ``mass``, ``damping``, ``stiffness``,
    the operating point, and the names and units of states, inputs and outputs. In MATLAB
    ``load model.mat; sys = ss(A, B, C, D)``; the names are cell arrays.

    Missing folders are created.

    Raises:
        InputError: if ``model`` is not a linear model, the suffix is unknown, or the path cannot
            be written.
    """
    from flexarm.linear import LinearModel

    check_kind("model", model, LinearModel, hint="fa.linearize returns one.")
    place = check_place("path", path, MODEL_SUFFIXES)
    if place.suffix.lower() == ".json":
        write_text(json.dumps(model.arrays(), indent=1, default=np.ndarray.tolist) + "\n", place)
    else:
        write_whole(place, [mat_bytes(model.arrays())])
