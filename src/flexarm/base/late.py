"""SciPy and xarray, imported at their first use, because many calls and commands need neither."""

from __future__ import annotations

from functools import cached_property
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

__all__ = ["interpolate", "linalg", "optimize", "scipy", "xr"]


class _Late:
    """A module, imported when an attribute of it is first used."""

    def __init__(self, name: str) -> None:
        self._name = name

    @cached_property
    def _module(self) -> ModuleType:
        return import_module(self._name)

    def __getattr__(self, attribute: str) -> Any:
        if attribute.startswith("__"):  # of copies, which are made without a name
            raise AttributeError(attribute)
        return getattr(self._module, attribute)


if TYPE_CHECKING:
    import scipy
    import xarray as xr
    from scipy import interpolate, linalg, optimize
else:
    scipy, xr = _Late("scipy"), _Late("xarray")
    interpolate, linalg = _Late("scipy.interpolate"), _Late("scipy.linalg")
    optimize = _Late("scipy.optimize")
