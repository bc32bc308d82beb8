"""Planar serial manipulators with flexible links: model, simulate, control.

Public names are listed in ``__init__.pyi`` and loaded when they are first used, so that ``import
flexarm`` stays fast.
"""

from __future__ import annotations

from typing import Any

import lazy_loader

_load, __dir__, _names = lazy_loader.attach_stub(__name__, __file__)
__all__ = sorted({*_names} - {"plot"})


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("flexarm")
    return _load(name)
