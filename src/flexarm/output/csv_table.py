"""A table for spreadsheets and MATLAB: one row for each time, one column for each number.

The header names every column after its channel, with the unit: ``joint_angle_1 [rad]``, ``tip_x
[m]``, ``strain_1 [1]``.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from flexarm.output.base import Format

if TYPE_CHECKING:
    import xarray as xr

_ROWS_AT_ONCE = 4096  # bounds the memory of the text of long runs


def columns(result: xr.Dataset) -> list[str]:
    """Return the header of the table of a result, time first."""
    names = ["time [s]"]
    for name, variable in result.data_vars.items():
        names += [
            f"{name}{part} [{unit}]" for part, unit in _parts(result, variable) if unit is not None
        ]
    return names


def _parts(result: xr.Dataset, variable: xr.DataArray) -> Iterator[tuple[str, str]]:
    """Yield what tells the columns of a channel apart, and the unit of each."""
    unit = str(variable.attrs.get("units", "1"))
    if variable.ndim == 1:
        yield "", unit
        return
    (dimension,) = variable.dims[1:]
    for number, label in enumerate(result[dimension].values, start=1):
        if dimension == "coordinate":
            # Joint angles and modal coordinates share a channel: "rad or m kg^0.5".
            angle, _, modal = unit.partition(" or ")
            yield f"_{label}", angle if str(label).startswith("joint") else modal
        else:
            yield f"_{label if dimension == 'axis' else number}", unit


def _write(result: xr.Dataset, path: Path) -> None:
    blocks = [result["time"].values, *(result[name].values for name in result.data_vars)]
    table = np.column_stack(blocks)
    with open(path, "w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns(result))
        # The writer spells a float with the digits that read back as the same float.
        for start in range(0, len(table), _ROWS_AT_ONCE):
            writer.writerows(table[start : start + _ROWS_AT_ONCE].tolist())


CSV = Format("CSV", ".csv", _write)
