"""BibTeX references of the methods that a result used."""

from __future__ import annotations

from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from typing import ClassVar, Protocol

from flexarm.base.errors import InputError, Problem, public_call, shown
from flexarm.base.late import xr


@cache
def package_version() -> str:
    """Return the version of this package, cached because the look-up takes a millisecond."""
    try:
        return version("flexarm")
    except PackageNotFoundError:  # sources that are not installed, as in the build of a wheel
        return "unknown"


def _entries(package: str) -> dict[str, str]:
    """Return the BibTeX entries by key; ``package`` is the version in that of this package."""
    path = files("flexarm.base") / "references.bib"
    texts = path.read_text(encoding="utf-8").replace("%s", package).strip().split("\n\n")
    return {text.partition("{")[2].partition(",")[0]: text for text in texts}


class Cited(Protocol):
    """Object with the BibTeX keys of its methods, separated by spaces."""

    references: ClassVar[str]


@public_call
def citation(result: xr.Dataset | Cited) -> str:
    """Return BibTeX entries of the package and of the methods of a result.

    Args:
        result: dataset of ``simulate``, a linear model, or tracked modes.

    Raises:
        InputError: if ``result`` is none of these.
    """
    attributes = getattr(result, "attrs", None)
    if isinstance(attributes, dict):
        used, made_by = attributes.get("references", ""), attributes.get("flexarm_version", "")
    elif isinstance(getattr(result, "references", None), str):
        used, made_by = getattr(result, "references", ""), package_version()
    else:
        raise InputError(Problem("result", "be a result of simulate", shown(result)))
    keys = ["flexarm", *str(used).split()]
    entries = _entries(str(made_by))
    unknown = [key for key in keys if key not in entries]
    if unknown:
        raise InputError(Problem("result", f"cites unknown methods: {shown(unknown)}"))
    return "\n\n".join(entries[key] for key in keys)
