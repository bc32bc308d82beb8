"""NetCDF 4 files: the complete result with labels, units, the arm and the settings of the run.

Files are encoded in memory, because HDF5 crashes the process if a disk is full while it writes,
and leaves the file open. A digest follows after the end of the HDF5 content, where readers of
NetCDF do not look. HDF5 detects most damage of its own structures, but none of the numbers. An
attribute announces the digest, so that damage to its mark does not disable the check.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from typing import TYPE_CHECKING

from flexarm.base.errors import InputError, Problem
from flexarm.base.writing.places import AnyPath
from flexarm.cases.results.base import Format

if TYPE_CHECKING:
    import xarray as xr

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


def _read(path: AnyPath) -> xr.Dataset:
    import h5py
    import xarray as xr

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
    """Compare a file with the digest at its end; return whether there is one.

    Raises:
        OSError: if the file cannot be read or its content differs from the digest.
    """
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


NETCDF = Format("NetCDF", ".nc", encode_netcdf, _read)
