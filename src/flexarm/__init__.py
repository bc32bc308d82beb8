"""Planar serial manipulators with flexible links: modelling, simulation and control.

The public names are listed in ``__init__.pyi``. They are loaded at their first use, so that
``import flexarm`` stays fast.
"""

from __future__ import annotations

import sys
from typing import Any

import lazy_loader

_load, __dir__, _names = lazy_loader.attach_stub(__name__, __file__)
__all__ = sorted({*_names} - {"plot"})

#: Deprecated public names: the new name, and the version that removes the old one.
_RENAMED: dict[str, tuple[str, str]] = {"Needs": ("ControllerRequirements", "0.3")}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from flexarm.base.references import package_version

        return package_version()
    if name in _RENAMED:
        from flexarm.base.errors import warn_deprecated

        new, removal = _RENAMED[name]
        warn_deprecated(f"flexarm.{name}", f"flexarm.{new}", removal)
        return getattr(sys.modules[__name__], new)  # not cached, so that every use warns
    try:
        return _load(name)
    except AttributeError as error:
        from flexarm.base.errors import with_nearest

        raise with_nearest(error, name, __all__) from None
