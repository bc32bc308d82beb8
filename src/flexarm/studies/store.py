"""Zarr store of a study: written chunk by chunk, so that an interrupted study can be resumed.

A chunk consists of one file in each of the arrays ``parameters``, ``metrics``, ``failure`` and
``warning``, each of which is replaced as a whole, and of a checksum of their contents, which is
written last. A chunk without its checksum, or with another one, is executed again. The numbers of a
run depend on nothing but the study, so a chunk that is written twice has the same content.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from hashlib import blake2b
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexarm.arguments import library_missing
from flexarm.errors import InputError, Problem, shown
from flexarm.simulation.result import package_version, software_versions
from flexarm.studies.execution import RECORDED, Executor, Outcomes
from flexarm.studies.samples import Samples
from flexarm.studies.table import DIMS, table_of

if TYPE_CHECKING:
    import xarray as xr

#: Version of the layout of a store, and the suffix of folders and files that are not complete.
_LAYOUT, _PARTIAL = 1, ".partial"
_OTHERS = "cannot be continued"


def versions() -> dict[str, str]:
    """Return the versions on which the last digits of a run depend."""
    return {"flexarm_version": package_version(), "software": software_versions()}


class Store:
    """A store of a study that exists.

    Args:
        path: its folder.

    Attributes:
        text: the study as a file. chunk: number of samples of a chunk. count: of all samples.
        versions: of the software that computes it.

    Raises:
        InputError: if the folder is not a store of a study.
    """

    def __init__(self, path: Path) -> None:
        zarr = _zarr()
        self.path = path
        try:
            self._group: Any = zarr.open_group(path, mode="r+", use_consolidated=False)
            attributes: dict[str, Any] = dict(self._group.attrs)
            if attributes["layout"] != _LAYOUT:
                raise ValueError
            self.text: str = attributes["study"]
            self.chunk, self.count = int(attributes["chunk"]), int(attributes["samples"])
            self.paths: list[str] = attributes["parameters"]
            self.versions = {name: str(attributes[name]) for name in versions()}
            self._arrays = {name: self._group[name] for name in _arrays(self.paths)}
            self._checksums = self._group["checksum"]
        except (OSError, KeyError, ValueError):
            raise InputError(
                Problem("store", "be the folder of a study", shown(str(path)))
            ) from None

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.count // self.chunk)

    def range_of(self, i: int) -> range:
        """Return the samples of chunk i."""
        return range(i * self.chunk, min((i + 1) * self.chunk, self.count))

    def missing(self) -> list[int]:
        """Return the chunks that are not recorded, or whose content is damaged."""
        checksums = self._checksums[:]
        return [i for i in range(self.chunks) if not checksums[i] or self._sum(i) != checksums[i]]

    def _sum(self, i: int) -> int:
        try:
            return checksum(self.read(i))
        except Exception:  # zarr and its codecs raise many kinds for damaged content
            return 0

    def read(self, i: int) -> Outcomes:
        """Return the content of chunk i."""
        return self._part(slice(self.range_of(i).start, self.range_of(i).stop))

    def _part(self, part: slice) -> Outcomes:
        own = {name: np.asarray(array[part]) for name, array in self._arrays.items()}
        own.setdefault("parameters", np.zeros((len(own["metrics"]), 0)))
        return Outcomes(
            own["parameters"],
            own["metrics"],
            own["failure"].astype(object),
            own["warning"].astype(object),
        )

    def write(self, i: int, outcomes: Outcomes) -> None:
        """Record chunk i, whether or not it exists.

        Raises:
            InputError: if writing fails, for example because the disk is full.
        """
        part = slice(self.range_of(i).start, self.range_of(i).stop)
        with _writing(self.path):
            for name, array in self._arrays.items():
                array[part] = getattr(outcomes, name)
            self._checksums[i] = checksum(outcomes)

    def clean(self) -> None:
        """Remove the files that killed processes did not complete."""
        for folder, _, files in os.walk(self.path):
            for name in files:
                if name.endswith(_PARTIAL):
                    Path(folder, name).unlink(missing_ok=True)

    def table(self) -> xr.Dataset:
        """Return the dataset of the recorded samples."""
        names = {dim: [str(name) for name in self._group[dim][:]] for dim in DIMS[1:]}
        recorded = np.repeat(self._checksums[:] != 0, self.chunk)[: self.count]
        kept = self._part(slice(0, self.count)).at(recorded)
        attributes = dict(self._group.attrs)
        attributes.pop("layout")
        return table_of(kept, np.flatnonzero(recorded), names, self.paths, attributes)


def create_store(
    path: Path, text: str, executor: Executor, names: Mapping[str, Sequence[str]], chunk: int
) -> Store:
    """Create the folder of a store, completely or not at all.

    Args:
        text: the study as a file.
        names: of drives, plants and motions.
        chunk: number of samples of a chunk.

    Raises:
        InputError: if it cannot be written.
    """
    zarr = _zarr()
    unfinished = path.with_name(path.name + _PARTIAL)
    samples = executor.samples
    with _writing(path):
        if unfinished.exists():
            shutil.rmtree(unfinished)
        unfinished.parent.mkdir(parents=True, exist_ok=True)
        group = zarr.create_group(unfinished)
        _create_arrays(group, samples, names, min(chunk, samples.count))
        attributes = {"layout": _LAYOUT, "study": text, "samples": samples.count, "chunk": chunk}
        group.attrs.update({**attributes, "parameters": list(samples.paths), **versions()})
        os.rename(unfinished, path)
    return Store(path)


def _create_arrays(
    group: Any, samples: Samples, names: Mapping[str, Sequence[str]], chunk: int
) -> None:
    """Create the arrays of a store, and those with the labels of their dimensions."""
    labels = {
        **names,
        "metric": [metric.name for metric in RECORDED],
        "parameter": samples.paths,
    }
    sizes = {"sample": samples.count, **{dim: len(own) for dim, own in labels.items()}}
    for name, (dims, dtype, fill) in _arrays(samples.paths).items():
        shape = tuple(sizes[dim] for dim in dims)
        chunks = (chunk, *shape[1:])
        kind = {"dtype": dtype, "fill_value": fill, "dimension_names": dims}
        group.create_array(name, shape=shape, chunks=chunks, **kind)
    for dim, own in labels.items():
        if own:
            array = group.create_array(dim, shape=(len(own),), dtype="str", dimension_names=(dim,))
            array[:] = np.array(own, dtype=object)
    kind = {"dtype": "uint64", "fill_value": 0, "dimension_names": ("chunk",)}
    group.create_array("checksum", shape=(-(-samples.count // chunk),), chunks=(1,), **kind)


def _arrays(paths: Sequence[str]) -> dict[str, tuple[tuple[str, ...], str, Any]]:
    """Return dimensions, type and fill value of the arrays of a store."""
    arrays: dict[str, tuple[tuple[str, ...], str, Any]] = {
        "metrics": ((*DIMS, "metric"), "float64", np.nan),
        "failure": (DIMS, "str", ""),
        "warning": (DIMS, "str", ""),
    }
    if paths:
        arrays["parameters"] = (("sample", "parameter"), "float64", np.nan)
    return arrays


def checksum(outcomes: Outcomes) -> int:
    """Return a positive number that differs for other outcomes, with all digits."""
    digest = blake2b(digest_size=8)
    for array in outcomes:
        if array.dtype == object:
            texts: NDArray[Any] = array.ravel()
            digest.update("\0".join(texts.tolist()).encode())
        else:
            digest.update(np.where(np.isnan(array), np.nan, array).tobytes())  # one kind of NaN
    return int.from_bytes(digest.digest(), "little") | 1


@lru_cache(maxsize=4)
def opened(path: str) -> Store:
    """Return a store, kept because a process writes many chunks.

    Raises:
        InputError: if it is not a store, or this process has other versions of the software.
    """
    store = Store(Path(path))
    check_versions(store)
    return store


def check_versions(store: Store) -> None:
    """Raise if a store was begun with other versions of the software, which give other digits.

    Raises:
        InputError: if they differ.
    """
    own = versions()
    problems = [
        Problem("store", f"{_OTHERS} with {own[name]}: it was begun with {begun}")
        for name, begun in store.versions.items()
        if begun != own[name]
    ]
    if problems:
        raise InputError(*problems)


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        rule = f"could not be written: {error.strerror or error}"
        hint = "Everything that is recorded remains: resume the study afterwards."
        raise InputError(Problem("store", rule, hint=hint, where=str(path))) from None


def _zarr() -> Any:
    try:
        import zarr
    except ImportError:
        raise library_missing("zarr", "cluster") from None
    return zarr
