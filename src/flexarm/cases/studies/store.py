"""Zarr store of a study: written chunk by chunk, so that an interrupted study can be resumed.

A chunk consists of one file in each of the arrays ``parameters``, ``metrics``, ``failure`` and
``warning``, each of which is replaced as a whole, and of a checksum of their contents, which is
written last. A chunk without its checksum, or with another one, is executed again. The numbers of a
run depend on nothing but the study, so a chunk that is written twice has the same content.

A study may end before all of its samples, if a quantile of a metric is known well enough. That
follows from the first 64, 128, 256, ... samples alone. It is therefore the same for all workers,
chunks and interruptions, and a store needs no record of it.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property, lru_cache
from hashlib import blake2b
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from flexarm.base.arguments import library_missing
from flexarm.base.errors import (
    AccuracyWarning,
    FlexarmError,
    FlexarmWarning,
    InputError,
    Problem,
    shown,
    warn_caller,
)
from flexarm.base.late import scipy, xr
from flexarm.base.references import package_version
from flexarm.cases.studies.execution import DIMS, RECORDED, Executor, Outcomes, table_of
from flexarm.cases.studies.samples import Samples
from flexarm.integrate.base import FloatArray
from flexarm.model.file_format.files import record_of_bytes
from flexarm.model.scenarios.study import SamplePlan
from flexarm.simulation.calls.result import software_versions

#: Samples of the first decision; each other one has twice as many.
FIRST = 64


class Ending:
    """The number of samples of a study, which may depend on their metrics.

    Attributes:
        decisions: numbers of samples after which the study may end; the last one is ``count``.
    """

    def __init__(self, plan: SamplePlan | None, count: int) -> None:
        self._stop = plan.stop if plan is not None else None
        sizes = [FIRST * 2**k for k in range(count.bit_length()) if FIRST * 2**k < count]
        self.decisions: list[int] = [*(sizes if self._stop is not None else []), count]

    def after(self, metrics: FloatArray) -> int | None:
        """Return at how many samples the study ends by their metrics; None if it takes more."""
        for size in self.decisions:
            if size > len(metrics):
                return None
            if size == self.decisions[-1] or self._width(metrics[:size]) <= self._within:
                return size
        return None

    def lacking(
        self, missing: Callable[[int], list[int]], metrics: Callable[[int], FloatArray]
    ) -> tuple[int, list[int]]:
        """Return how many samples the study needs so far, and their missing chunks."""
        size = 0
        for size in self.decisions:
            if chunks := missing(size):
                return size, chunks
            if self.after(metrics(size)) is not None:
                break
        return size, []

    def warn(self, metrics: FloatArray) -> None:
        """Warn if all samples do not suffice."""
        if self._stop is None or len(metrics) < self.decisions[-1]:
            return
        if (width := self._width(metrics)) <= self._within:
            return
        verb = "determine" if np.isfinite(width) else "do not determine"
        precision = f" within {100.0 * width:.2g} %" if np.isfinite(width) else ""
        text = (
            f"{len(metrics)} samples {verb} the {self._stop.quantile:g} quantile of "
            f"{self._stop.metric}{precision}; {100.0 * self._within:g} % were requested. Use more."
        )
        warn_caller(text, AccuracyWarning)

    @property
    def _within(self) -> float:
        return 0.0 if self._stop is None else self._stop.within

    def _width(self, metrics: FloatArray) -> float:
        """Return half the widest interval of the quantile of any drive, plant and motion."""
        # It is divided by the quantile. Each decision has its part of the probability of an error,
        # so that the study ends rightly with the confidence. Runs without a value are left out.
        assert self._stop is not None
        rule, names = self._stop, [metric.name for metric in RECORDED]
        confidence = 1.0 - (1.0 - rule.confidence) / len(self.decisions)
        widths = [0.0]
        values = metrics[..., names.index(rule.metric)].reshape(len(metrics), -1)
        for column in values.T:
            finite = column[np.isfinite(column)]
            low, high = quantile_interval(finite, rule.quantile, confidence)
            size = abs(np.quantile(finite, rule.quantile)) if finite.size else 0.0
            widths.append(0.5 * (high - low) / size if high > low else 0.0)
        return float(np.max(widths))


def quantile_interval(
    values: FloatArray, quantile: float, confidence: float
) -> tuple[float, float]:
    """Return the interval of a quantile from independent samples, for any distribution."""
    # Its ends are order statistics (David and Nagaraja, Order Statistics, 2003, section 7.1), and
    # infinite if there are too few samples.
    tail = 0.5 * (1.0 - confidence)
    low = int(scipy.stats.binom.ppf(tail, values.size, quantile)) if values.size else 0
    high = int(scipy.stats.binom.ppf(1.0 - tail, values.size, quantile)) + 1 if values.size else 1
    ordered: NDArray[np.float64] = np.sort(values)
    return (
        float(ordered[low - 1]) if low >= 1 else -np.inf,
        float(ordered[high - 1]) if high <= values.size else np.inf,
    )


#: Version of the layout of a store, and the suffix of folders and files that are not complete.
_LAYOUT, _PARTIAL = 2, ".partial"
_OTHERS = "cannot be continued"
T = TypeVar("T")


def versions() -> dict[str, str]:
    """Return the versions on which the last digits of a run depend."""
    return {"flexarm_version": package_version(), "software": software_versions()}


class Store:
    """A store of a study that exists.

    Attributes:
        text: the study as a file. chunk: number of samples of a chunk. count: of all samples.
        versions: of the software that computes it.
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
    def digest(self) -> str:
        """The digest of the study and of its division into chunks."""
        return digest_of(self.text, self.chunk)

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.count // self.chunk)

    def range_of(self, i: int) -> range:
        """Return the samples of chunk i."""
        return range(i * self.chunk, min((i + 1) * self.chunk, self.count))

    def missing(self, count: int) -> list[int]:
        """Return the chunks of the first samples that are not recorded, or damaged."""
        sums = self._recorded()[: -(-count // self.chunk)]
        return [i for i, own in enumerate(sums) if not own or _intact(self.read, i, own) is None]

    def metrics(self, count: int) -> NDArray[np.float64]:
        """Return the metrics of the first samples, which are recorded."""
        return self._part(slice(0, count)).metrics

    @cached_property
    def _ending(self) -> Ending:
        try:
            study = record_of_bytes(self.text.encode(), "the study")
        except FlexarmError:  # a store of another version, which can be read only
            return Ending(None, self.count)
        return Ending(getattr(study, "samples", None), self.count)

    def lacking(self) -> tuple[int, list[int]]:
        """Return how many samples the study needs so far, and their missing chunks."""
        return self._ending.lacking(self.missing, self.metrics)

    def _recorded(self) -> list[int]:
        """Return the checksums of all chunks; 0 for one that is not recorded, or is damaged."""

        def read(part: Any) -> list[int]:
            found: list[int] = self._checksums[part].tolist()
            return found

        def one(i: int) -> int:
            return (_readable(lambda: read(slice(i, i + 1))) or [0])[0]

        return _readable(lambda: read(slice(None))) or [one(i) for i in range(self.chunks)]

    def read(self, i: int) -> Outcomes:
        """Return the content of chunk i."""
        return self._part(self._slice(i))

    def _slice(self, i: int) -> slice:
        return slice(self.range_of(i).start, self.range_of(i).stop)

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
        """Record chunk i, whether or not it exists."""
        part = self._slice(i)
        with _writing(self.path):
            for name, array in self._arrays.items():
                array[part] = getattr(outcomes, name)
            self._checksums[i] = checksum(outcomes)

    def clean(self) -> None:
        """Remove the files that killed processes did not complete.

        Their age is not considered, because a process may have been killed just now, and a resumed
        store must have the same files as an undisturbed one. Another driver of the same store that
        is writing such a file stops with an `InputError`, and can be resumed.
        """
        for folder, _, files in os.walk(self.path):
            for name in files:
                if name.endswith(_PARTIAL):
                    Path(folder, name).unlink(missing_ok=True)

    def table(self) -> xr.Dataset:
        """Return the dataset of the recorded samples.

        Warns:
            FlexarmWarning: if chunks are damaged, which are left out.
        """
        names = {dim: [str(name) for name in self._group[dim][:]] for dim in DIMS[1:]}
        recorded = {i: own for i, own in enumerate(self._recorded()) if own}
        # Zarr reads all chunks at once much faster than one after the other.
        whole = _readable(lambda: self._part(slice(0, self.count)))

        def read(i: int) -> Outcomes:
            return self.read(i) if whole is None else whole.at(self._slice(i))

        found = {i: _intact(read, i, own) for i, own in recorded.items()}
        kept = {i: part for i, part in found.items() if part is not None}
        if damaged := len(recorded) - len(kept):
            text = f"the table leaves out {damaged} of {self.chunks} chunks, whose files are "
            warn_caller(f"{text}missing or damaged. Resume the study.", FlexarmWarning)
        parts = zip(self._part(slice(0, 0)), *kept.values(), strict=True)
        numbers = np.array([k for i in kept for k in self.range_of(i)], dtype=np.int64)
        attributes = dict(self._group.attrs)
        attributes.pop("layout")
        outcomes = Outcomes(*map(np.concatenate, parts))
        prefix = int(np.cumprod(numbers == np.arange(numbers.size)).sum())
        # The last chunk may have more samples than the study needs.
        part = slice(0, self._ending.after(outcomes.metrics[:prefix]))
        return table_of(outcomes.at(part), numbers[part], names, self.paths, attributes)


def create_store(
    path: Path, text: str, executor: Executor, names: Mapping[str, Sequence[str]], chunk: int
) -> Store:
    """Create the folder of a store, completely or not at all."""
    zarr = _zarr()
    unfinished = path.with_name(path.name + _PARTIAL)
    samples = executor.samples
    with _writing(path):
        # Threads of a creation that has just failed may still write and remove files there.
        shutil.rmtree(unfinished, ignore_errors=True)
        unfinished.parent.mkdir(parents=True, exist_ok=True)
        group = zarr.create_group(unfinished, overwrite=True)
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


def _intact(read: Callable[[int], Outcomes], i: int, recorded: int) -> Outcomes | None:
    """Return the content of chunk i if its checksum is the recorded one."""
    found = _readable(lambda: read(i))
    return found if found is not None and checksum(found) == recorded else None


def _readable(read: Callable[[], T]) -> T | None:
    """Return what a function reads, or None if it is damaged."""
    try:
        return read()
    except Exception:  # zarr and its codecs raise many kinds for damaged content
        return None


def digest_of(text: str, chunk: int) -> str:
    """Return the digest of the text of a study and of the number of samples of a chunk."""
    return blake2b(f"{chunk}\0{text}".encode(), digest_size=16).hexdigest()


@lru_cache(maxsize=4)
def opened(path: str, digest: str) -> Store:
    """Return a store, kept because a process writes many chunks.

    Args:
        digest: that of the store, because another study may be in the same folder later.
    """
    store = Store(Path(path))
    if store.digest != digest:
        raise InputError(Problem("store", f"{shown(path)} belongs to another study"))
    check_versions(store)
    return store


def check_versions(store: Store) -> None:
    """Raise if a store was begun with other versions of the software, which give other digits."""
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
