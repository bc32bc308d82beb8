"""Values of a wrong kind, shape or size, as users pass them by mistake, created for each call."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import scipy.sparse
import xarray as xr

import flexarm as fa


class Unhelpful:
    """An object whose `repr` raises."""

    def __repr__(self) -> str:
        raise RuntimeError("no repr")


def _fails(*_: Any) -> Any:
    raise ZeroDivisionError("from the user's own function")


async def _later(*_: Any) -> Any:
    return 0.1


def _one_by_one(*_: Any) -> Any:
    yield 0.1


class Later:
    """An object whose call is asynchronous."""

    async def __call__(self, *_: Any) -> Any:
        return 0.1


def _folder(suffix: str) -> Path:
    """Return a folder whose name ends as that of a file."""
    place = Path(f"folder{suffix}").absolute()
    place.mkdir(exist_ok=True)
    return place


#: Functions that create each wrong value, by a name that a failing example shows.
WRONG: dict[str, Callable[[], Any]] = {
    "None": lambda: None,
    "empty text": lambda: "",
    "text": lambda: "no",
    "long text": lambda: "x" * 5000,
    "text with line breaks": lambda: "a\nb\x00c",
    "number as text": lambda: "1.0",
    "bytes": lambda: b"1.0",
    "True": lambda: True,
    "False": lambda: False,
    "nan": lambda: math.nan,
    "inf": lambda: math.inf,
    "-inf": lambda: -math.inf,
    "zero": lambda: 0,
    "-1": lambda: -1,
    "-0.5": lambda: -0.5,
    "1e200": lambda: 1e200,
    "1e300": lambda: 1e300,
    "-1e300": lambda: -1e300,
    "5e-324": lambda: 5e-324,
    "10**30": lambda: 10**30,
    "10**400": lambda: 10**400,
    "complex": lambda: 1.0 + 2.0j,
    "nan of NumPy": lambda: np.float64("nan"),
    "0-d array": lambda: np.array(0.5),
    "empty list": list,
    "empty array": lambda: np.zeros(0),
    "one number": lambda: [0.1],
    "three numbers": lambda: [0.1, 0.2, 0.3],
    "matrix": lambda: np.zeros((2, 2)),
    "cube": lambda: np.zeros((2, 2, 2)),
    "many dimensions": lambda: np.zeros((1,) * 33),
    "ragged": lambda: [[0.1], [0.1, 0.2]],
    "nested": lambda: [[[[0.1]]]],
    "list with nan": lambda: [0.1, math.nan],
    "list with None": lambda: [None, 0.1],
    "list of text": lambda: ["a", "b"],
    "list of huge": lambda: [1e300, -1e300],
    "huge state": lambda: [1e200] * 6,
    "complex array": lambda: np.array([1j, 2.0]),
    "object array": lambda: np.array([0.1, 0.2], dtype=object),
    "object array of objects": lambda: np.array([object(), None], dtype=object),
    "text array": lambda: np.array(["a", "b"]),
    "times of NumPy": lambda: np.array(["2020-01-01", "2021-01-01"], dtype="datetime64[s]"),
    "structured array": lambda: np.zeros(2, dtype=[("a", float)]),
    "bool array": lambda: np.array([True, False]),
    "masked array": lambda: np.ma.array([0.1, 0.2], mask=[True, False]),
    "masked number": lambda: np.ma.masked,
    "sparse matrix": lambda: scipy.sparse.eye(2, format="csr"),
    "dict": lambda: {"a": 1.0},
    "empty dict": dict,
    "dict of numbers": lambda: {1: 2, None: 3},
    "dict of ranges": lambda: {None: (0.1, 0.2)},
    "dict of a number": lambda: {1.5: 1.0},
    "set": lambda: {0.1, 0.2},
    "generator": lambda: (x for x in (0.1, 0.2)),
    "range": lambda: range(2),
    "memoryview": lambda: memoryview(b"12"),
    "pandas Series": lambda: pd.Series([0.1, 0.2]),
    "pandas DataFrame": lambda: pd.DataFrame({"a": [0.1, 0.2]}),
    "xarray DataArray": lambda: xr.DataArray([0.1, 0.2]),
    "xarray Dataset": lambda: xr.Dataset({"a": ("time", [0.1, 0.2])}),
    "object": object,
    "unhelpful object": Unhelpful,
    "class": lambda: fa.JointPD,
    "class of arms": lambda: fa.Arm,
    "module": lambda: np,
    "function": lambda: lambda *_: 0.1,
    "function that fails": lambda: _fails,
    "asynchronous function": lambda: _later,
    "generator function": lambda: _one_by_one,
    "object with an asynchronous call": Later,
    "function of nothing": lambda: lambda: 0.1,
    "function that returns text": lambda: lambda *_: "no",
    "payload": lambda: fa.Payload(mass=0.1),
    "link": lambda: fa.Link(length=1.0, flexural_rigidity=1.0, mass_per_length=1.0),
    "list of links": lambda: [fa.Link(length=1.0, flexural_rigidity=1.0, mass_per_length=1.0)],
    "load": lambda: fa.Load(1, (0.0, 1.0)),
    "wall": lambda: fa.Wall((0.0, 0.0), (0.0, 1.0)),
    "other arm": lambda: fa.Arm(links=[fa.Link(length=1.0, flexible=False, mass_per_length=1.0)]),
    "path of nothing": lambda: Path("/nowhere/at/all.yaml"),
    "folder": lambda: Path("/"),
    "long name": lambda: Path("x" * 300 + ".nc"),
    "long name of a table": lambda: "x" * 300 + ".csv",
    "name with a null": lambda: "a\x00b.nc",
    "below a file": lambda: "/etc/hostname/a.nc",
    "folder with a suffix": lambda: _folder(".nc"),
    "error": lambda: ValueError("a value"),
    "slice": lambda: slice(2),
    "...": lambda: ...,
}
