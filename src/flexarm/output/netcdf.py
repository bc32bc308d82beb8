"""NetCDF 4: the whole result, with labels, units, the arm and how it was computed.

Files are encoded in memory: HDF5 crashes the process if a disk is full while it writes, and it
leaves the file open. After the end of the HDF5 content, where readers of NetCDF do not look,
comes a digest of it. HDF5 notices most damage of its own structures and none of the numbers.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from typing import TYPE_CHECKING

from flexarm.output.base import Format
from flexarm.places import AnyPath

if TYPE_CHECKING:
    import xarray as xr

_MARK = b"flexarm: SHA-256 "
_DIGEST_BYTES = hashlib.sha256().digest_size
_AT_ONCE = 1 << 20


def encode_netcdf(dataset: xr.Dataset) -> Iterator[bytes | memoryview]:
    """Yield the content of the NetCDF file of a dataset, its digest last."""
    # A copy: a view that outlives its buffer, as in an error's traceback, ends in a message.
    content = bytes(dataset.to_netcdf(engine="h5netcdf"))
    yield content
    yield _MARK + hashlib.sha256(content).digest()


def _read(path: AnyPath) -> xr.Dataset:
    import h5py
    import xarray as xr

    _check_digest(path)
    try:
        with h5py.File(path, "r") as file:
            # h5netcdf begins with this too, and prints a traceback of its own where it fails.
            file.attrs.get("_nc3_strict")
        return xr.load_dataset(path, engine="h5netcdf")
    except FileNotFoundError:
        raise
    except Exception as error:
        # A damaged file raises whatever the line that meets the damage raises: KeyError,
        # RuntimeError, UnicodeDecodeError, MemoryError and others.
        raise OSError(f"{type(error).__name__}: {error}") from None


def _check_digest(path: AnyPath) -> None:
    """Compare a file with the digest at its end, if it has one: files of other programs do not.

    Raises:
        OSError: if the file cannot be read or differs from what was written.
    """
    with open(path, "rb") as stream:
        end = stream.seek(0, 2) - len(_MARK) - _DIGEST_BYTES
        if end < 0:
            return
        stream.seek(end)
        if stream.read(len(_MARK)) != _MARK:
            return
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
        raise OSError("the file is damaged, or another program has changed it")


NETCDF = Format("NetCDF", ".nc", encode_netcdf, _read)
