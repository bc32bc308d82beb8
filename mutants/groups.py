"""Areas and groups of `make mutants`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def sources(patterns: Iterable[str]) -> set[Path]:
    """Return the files of the package that match one of the globs."""
    return {path for pattern in patterns for path in (ROOT / "src" / "flexarm").glob(pattern)}


@dataclass(frozen=True)
class Group:
    """Sources with the same tests.

    sources: globs below ``src/flexarm``. tests: files, or single tests in them, below
    ``tests``. plain: whether kernels run as plain Python, so that changed ones are not compiled.
    """

    sources: tuple[str, ...]
    tests: tuple[str, ...]
    plain: bool = False

    @property
    def environment(self) -> Mapping[str, str]:
        """Variables of the environment for the tests."""
        return {"NUMBA_DISABLE_JIT": "1"} if self.plain else {}


@dataclass(frozen=True)
class Area:
    """mutants: size of the sample. without: globs below ``src/flexarm`` that are left out."""

    mutants: int
    groups: tuple[Group, ...]
    without: tuple[str, ...] = ()

    def files(self) -> Iterator[tuple[Path, Group]]:
        """Iterate over the files of the area, sorted, with the first group that has each."""
        taken = sources(self.without)
        for group in self.groups:
            found = sources(group.sources) - taken
            taken |= found
            yield from ((path, group) for path in sorted(found))
