"""CSV table for spreadsheets and MATLAB: one row per time, one column per number.

The header contains the channel and unit of every column: ``joint_angle_1 [rad]``, ``tip_x [m]``,
``strain_1 [1]``, ``joint_force_2_x [N]``. Data at other times, such as readings of instruments and
events, are only in NetCDF files.
"""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from flexarm.cases.results.base import Format

if TYPE_CHECKING:
    import xarray as xr

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
            yield part, unit


def _labels(result: xr.Dataset, dimension: str) -> list[object]:
    """Return the labels of a dimension: its values, or numbers from 1 for gauges and stations."""
    values = result[dimension].values
    counted = dimension in ("gauge", "station")
    return list(range(1, values.size + 1)) if counted else list(values)


def _encode(result: xr.Dataset) -> Iterator[bytes]:
    times = result["time"].values
    blocks = [result[name].values.reshape(times.size, -1) for name in _over_time(result)]
    table = np.column_stack([times, *blocks])
    yield _lines([columns(result)])
    for start in range(0, len(table), _ROWS_AT_ONCE):
        # The csv module writes floats with digits that read back as the same float.
        yield _lines(table[start : start + _ROWS_AT_ONCE].tolist())


def _lines(rows: list[list[str]] | list[list[float]]) -> bytes:
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


CSV = Format("CSV", ".csv", _encode)
