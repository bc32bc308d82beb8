"""Tables in files of measurements: text, MATLAB, NetCDF and Parquet."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexarm.base.arguments import library_missing
from flexarm.base.errors import FlexarmWarning, InputError, Problem, shown, warn_caller
from flexarm.identification import record
from flexarm.simulation.run.channels import unit_of_part

#: Lines in which the header of a text file is looked for.
_PREAMBLE = 100
#: Columns (samples,) by name, of numbers or of dates.
Table = dict[str, NDArray[Any]]
#: Entry of a file of MATLAB with objects.
_OPAQUE = "__function_workspace__"
#: Cells of a line of units for a column without a unit.
_UNITLESS = ("", "-", "1")
#: Beginning of a date and time of ISO 8601.
_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d")
_HDF5 = b"\x89HDF\r\n\x1a\n"


def read_table(path: Path, encoding: str = "utf-8", skip: int = 0) -> Table:
    """Return the columns of a file of measurements.

    An array of several columns becomes ``name[0]``, ``name[1]``, ...; the fields of structures are
    joined by dots. ``skip`` is the number of lines before the header of a text file.
    """
    read = _READERS.get(path.suffix.lower())
    if read is None:
        rule = f"have one of the suffixes {', '.join(_READERS)}"
        raise InputError(Problem("path", rule, repr(path.name)))
    if not path.is_file():
        rule = "which is not a file" if path.exists() else "which does not exist"
        raise InputError(Problem("path", f"is {str(path)!r}, {rule}"))
    try:
        return _csv(path, encoding, skip) if read is _csv else read(path)
    except InputError:
        raise
    except Exception as error:  # damaged files raise anything, depending on the damage
        rule = f"{path.name!r} cannot be read: {type(error).__name__}: {error}"
        raise InputError(Problem("path", " ".join(rule.split())[:300])) from None


def _csv(path: Path, encoding: str = "utf-8", skip: int = 0) -> Table:
    """Return the columns of a text file; a line of units after the header names their units."""
    import pandas as pd

    lines = _text_of(path, encoding).splitlines()[skip:]
    lines = [line for line in lines if line.strip() and line.lstrip()[0] != "#"]
    if not lines:
        rule = f"{path.name!r} has no lines" + (f" after the first {skip}" if skip else "")
        raise InputError(Problem("path", rule))
    first = 0 if skip else _header_line(lines)
    lines = lines[first:]
    mark, decimal = _separators(lines)
    cells = [[cell.strip() for cell in line.split(mark)] for line in lines[:3]]
    units: list[str] = []
    if [_has_number(line, mark, decimal) for line in lines[:3]] == [False, False, True]:
        units = [cell.strip('"[]() ') for cell in cells[1]]
        del lines[1]
    named = not all(record.is_number(cell.replace(decimal, ".")) for cell in cells[0])
    frame = pd.read_csv(
        StringIO("\n".join(lines)),
        sep=mark or r"\s+",
        header=0 if named else None,
        comment="#",
        skipinitialspace=True,
        decimal=decimal,
    )
    if not named:
        frame.columns = [f"column[{k}]" for k in frame.columns]
    if len(units) == len(frame.columns):
        frame.columns = [
            f"{name} [{unit}]" if unit not in _UNITLESS and not record.split_unit(name)[1] else name
            for name, unit in zip(map(str, frame.columns), units, strict=True)
        ]
    return _of_frame(frame)


def _separators(lines: Sequence[str]) -> tuple[str | None, str]:
    """Return the mark between cells, None for spaces, and the decimal mark."""
    mark = next((mark for mark in ";\t," if mark in lines[0]), None)
    return mark, "," if mark != "," and "," in "".join(lines[1:]) else "."


def _has_number(line: str, mark: str | None, decimal: str) -> bool:
    cells = (cell.strip().strip('"').replace(decimal, ".") for cell in line.split(mark))
    return any(map(record.is_number, cells))


def _header_line(lines: Sequence[str]) -> int:
    """Return the index of the header: the line of names before the first row of numbers."""
    for k, line in enumerate(lines[:_PREAMBLE]):
        mark, decimal = _separators(lines[k:])
        width = len(line.split(mark))
        below = lines[k + 1 : k + 4]
        rows = [len(row.split(mark)) == width and _has_number(row, mark, decimal) for row in below]
        cells = [cell.strip(' "[]()') for cell in below[0].split(mark)] if below else []
        units = rows[0:1] == [False] and any(map(record.is_unit, cells))
        if not _has_number(line, mark, decimal) and rows and all(rows[units:] or [False]):
            return k
    return 0


def _text_of(path: Path, encoding: str) -> str:
    """Return the text of a file in an encoding; UTF-16 and Latin-1 are recognised."""
    if encoding.lower() in ("utf-8", "utf8"):
        with path.open("rb") as file:
            marked = file.read(2) in (b"\xff\xfe", b"\xfe\xff")
        encoding = "utf-16" if marked else "utf-8-sig"
    try:
        return path.read_text(encoding)
    except LookupError:
        rule, hint = "be the name of an encoding", "Common ones are utf-8, latin-1 and utf-16."
        raise InputError(Problem("encoding", rule, repr(encoding), hint)) from None
    except UnicodeError:
        if encoding != "utf-8-sig":
            rule = f"{path.name!r} is not a text in {encoding}"
            raise InputError(Problem("path", rule, hint="Try encoding='latin-1'.")) from None
        return path.read_text("latin-1")


def _parquet(path: Path) -> Table:
    import pandas as pd

    try:
        import pyarrow  # noqa: F401
    except ImportError:
        raise library_missing("pyarrow", "identify") from None
    return _of_frame(pd.read_parquet(path))


def _of_frame(frame: Any) -> Table:
    """Return the columns of numbers of a table; text in them is missing, with a warning."""
    import pandas as pd

    table: Table = {}
    for name in frame:
        instants = _instants(frame[name])
        if instants is not None:
            table[str(name).strip()] = instants
            continue
        numbers = pd.to_numeric(frame[name], errors="coerce")
        text = frame[name][numbers.isna() & frame[name].notna()]
        if text.size and numbers.notna().any():  # a column of text alone may be a remark
            some = f"text in {text.size} of {numbers.size} cells, such as {shown(text.iloc[0])}"
            warn_caller(f"column {name!r} has {some}; they count as missing.", FlexarmWarning)
        table[str(name).strip()] = np.asarray(numbers, dtype=np.float64)
    return table


def _instants(column: Any) -> NDArray[Any] | None:
    """Return the dates and times of a column in UTC; None for other columns."""
    import pandas as pd

    if column.dtype.kind != "M":
        if pd.api.types.is_numeric_dtype(column) or not _DATE.match(str(column.iloc[0])):
            return None
        column = pd.to_datetime(column, format="ISO8601", utc=True, errors="coerce")
    zone = column.dt.tz
    return np.asarray(column if zone is None else column.dt.tz_convert(None))


def _netcdf(path: Path) -> Table:
    import xarray as xr

    with xr.open_dataset(path, engine=_engine(path), decode_times=False) as dataset:
        arrays = {str(name): dataset[name] for name in dataset.variables}
        columns: Table = {}
        for name, array in arrays.items():
            if array.dtype.kind not in "iuf" or array.ndim == 0:
                continue
            rows = np.asarray(array.values, dtype=np.float64).reshape(array.shape[0], -1)
            # Suffixes are those of a CSV file of a result.
            labels = [""]
            for dimension in array.dims[1:]:
                index: Any = array[dimension].values if dimension in array.coords else []
                numbered = len(index) == 0 or dimension == "gauge"
                labels_here = range(1, array.sizes[dimension] + 1) if numbered else index
                labels = [f"{label}_{item}" for label in labels for item in labels_here]
            for label, column in zip(labels, rows.T, strict=True):
                unit = unit_of_part(array.attrs, label.rpartition("_")[2])
                columns[f"{name}{label} [{unit}]" if unit else f"{name}{label}"] = column
    return columns


def attributes_of(path: Path) -> dict[str, Any]:
    """Return the attributes of a dataset in NetCDF; empty for other formats."""
    import xarray as xr

    if _READERS[path.suffix.lower()] is not _netcdf:
        return {}
    with xr.open_dataset(path, engine=_engine(path), decode_times=False) as dataset:
        return dict(dataset.attrs)


def _engine(path: Path) -> str:
    with path.open("rb") as file:
        return "h5netcdf" if file.read(8) == _HDF5 else "scipy"


def _mat(path: Path) -> Table:
    with path.open("rb") as file:
        head = file.read(520)
    # MATLAB writes 512 bytes of its own before the HDF5 content of version 7.3.
    if _HDF5 in (head[:8], head[512:520]):
        return _mat_73(path)
    from scipy.io import loadmat

    content = loadmat(path, simplify_cells=True)
    if _OPAQUE in content:
        text = f"{path.name} has objects that only MATLAB reads, such as timeseries"
        warn_caller(f"{text}. Save arrays or structures with time instead.", FlexarmWarning)
    return _flat((name, value) for name, value in content.items() if not name.startswith("__"))


def _mat_73(path: Path) -> Table:
    import h5py

    def items(group: Any, before: str) -> Iterator[tuple[str, Any]]:
        for name, item in group.items():
            if name.startswith("#"):
                continue
            if isinstance(item, h5py.Group):
                yield from items(item, f"{before}{name}.")
            elif item.dtype == h5py.ref_dtype:  # a field of a list of structures
                for k, reference in enumerate(np.ravel(item)):
                    inner = {name: file[reference]}
                    yield from items(inner, f"{before.removesuffix('.')}[{k}].")
            elif item.dtype.kind in "iuf" and "MATLAB_empty" not in item.attrs:
                yield f"{before}{name}", np.asarray(item).T  # MATLAB orders by columns

    with h5py.File(path, "r") as file:
        return _flat(items(file, ""))


def _flat(items: Iterator[tuple[str, Any]], samples: int = 0) -> Table:
    """Return the columns of arrays and nested structures, whose times have ``samples``."""
    table: Table = {}
    for name, value in items:
        if isinstance(value, Mapping):
            count = np.size(value["time"]) if "time" in value else samples
            table |= _flat(((f"{name}.{key}", inner) for key, inner in value.items()), count)
            continue
        if isinstance(value, list):  # of structures, such as the signals of a scope
            table |= _flat(((f"{name}[{k}]", inner) for k, inner in enumerate(value)), samples)
            continue
        array = np.asarray(value)
        if array.dtype.kind not in "iuf" or array.ndim == 0 or array.size < 2:
            continue
        array = array.astype(np.float64)
        if array.ndim == 2 and 1 in array.shape:
            array = array.ravel()
        if array.ndim == 1:
            table[name] = array
        elif array.ndim == 2:
            # Simulink has the samples of matrices along the last axis, and those of the block To
            # File, with the times in the first row.
            wide = array.shape[0] < array.shape[1]
            wide = wide and (array.shape[1] == samples or bool(np.all(np.diff(array[0]) > 0.0)))
            table |= {f"{name}[{k}]": column for k, column in enumerate(array if wide else array.T)}
    return table


#: Readers by suffix.
_READERS: dict[str, Callable[[Path], Table]] = {
    ".csv": _csv,
    ".txt": _csv,
    ".dat": _csv,
    ".mat": _mat,
    ".nc": _netcdf,
    ".parquet": _parquet,
}
