"""`fa.compare` for long tables on pages: all controllers, each on a sample of the plants."""

from __future__ import annotations

import re
from typing import Any

import xarray as xr

import flexarm as fa


class SampledComparison:
    """`fa.compare` with two plants only for each controller.

    These are the first plant, to which a table relates the others, and one of the others. The next
    controller takes the next plant, so that every row and every column of a table with at least as
    many controllers as other plants is simulated. All other cells are NaN.
    """

    def __init__(self) -> None:
        self._compare = fa.compare
        self._rows = 0

    def __call__(
        self,
        arm: fa.Arm,
        controllers: dict[str, fa.Controller],
        duration: float,
        references: dict[str, Any],
        plants: dict[str, Any],
        **options: Any,
    ) -> xr.Dataset:
        first, *others = plants
        rows = []
        for name, controller in controllers.items():
            chosen = {plant: plants[plant] for plant in (first, others[self._rows % len(others)])}
            row = self._compare(arm, {name: controller}, duration, references, chosen, **options)
            blank = {"failure": "", "warning": ""}
            rows.append(row.reindex(plant=[first, *others], fill_value=blank))
            self._rows += 1
        return xr.concat(rows, "controller")


def fits_sample(printed: str, shown: str) -> bool:
    """Return whether a page agrees with printed lines, in which `nan` stands for any number.

    At least one line must have numbers, and none may consist of `nan` alone.
    """
    pairs = list(zip(printed.split("\n"), shown.split("\n"), strict=False))
    if printed.count("\n") != shown.count("\n"):
        return False
    for line, on_page in pairs:
        numbers = re.findall(r"\bnan|-?\d+\.\d+", line)
        if numbers and set(numbers) == {"nan"}:
            return False
        words = (re.escape(word).replace("nan", r"-?\d+\.\d+") for word in line.split())
        if not re.fullmatch(r"\s+".join(words), on_page.strip()):
            return False
    return "nan" in printed
