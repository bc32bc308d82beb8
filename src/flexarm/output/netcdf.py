"""NetCDF 4: the whole result, with labels, units, the arm and how it was computed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from flexarm.output.base import Format
from flexarm.output.places import AnyPath

if TYPE_CHECKING:
    import xarray as xr


def _write(result: xr.Dataset, path: Path) -> None:
    result.to_netcdf(path, engine="h5netcdf")


def _read(path: AnyPath) -> xr.Dataset:
    import xarray as xr

    return xr.load_dataset(path, engine="h5netcdf")


NETCDF = Format("NetCDF", ".nc", _write, _read)
