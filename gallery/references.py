"""Reference values: read from ``gallery/data``, each group with its source."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gallery.case import Source

DATA = Path(__file__).parent / "data"


@dataclass(frozen=True)
class Reference:
    """Values from one source."""

    source: Source
    values: Any


@cache
def reference(file: str, group: str) -> Reference:
    """Return one group of a data file, such as ``reference("beams", "hub")``."""
    entry = json.loads((DATA / f"{file}.json").read_text(encoding="utf-8"))[group]
    return Reference(Source(entry["cite"], entry["source"]), entry["values"])


@cache
def history(file: str) -> dict[str, NDArray[np.float64]]:
    """Return the columns of a CSV file by the names in its first line."""
    path = DATA / f"{file}.csv"
    names = path.read_text(encoding="utf-8").partition("\n")[0].split(",")
    columns = np.loadtxt(path, delimiter=",", skiprows=1).T
    return dict(zip(names, columns, strict=True))
