"""Results of simulations as structures of MATLAB."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import xarray as xr


def result_structure(result: xr.Dataset) -> dict[str, Any]:
    """Return channels and coordinates by name, ``units`` and ``attributes``.

    Arrays keep the order of their dimensions. Integers become floating-point numbers, because in
    MATLAB arithmetic with integers rounds; texts become cell arrays.
    """
    arrays = {str(name): array for name, array in result.variables.items()}
    found: dict[str, Any] = {name: _numbers(array.values) for name, array in arrays.items()}
    found["units"] = {name: str(array.attrs.get("units", "")) for name, array in arrays.items()}
    found["attributes"] = {
        str(name): _numbers(np.asarray(value)) for name, value in result.attrs.items()
    }
    return found


def _numbers(values: np.ndarray[Any, Any]) -> Any:
    if values.dtype.kind in "iu":
        return values.astype(np.float64)
    return values.tolist() if values.dtype.kind in "OUST" else values
