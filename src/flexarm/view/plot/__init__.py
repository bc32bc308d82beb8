"""Plots of results, modes and linear models: the only package that imports Matplotlib.

``fa.plot.history(result)`` and the other plots draw into given Matplotlib axes, or into a new
figure of pyplot, and return the axes. Functions with names that end in ``_figure`` return a
``matplotlib.figure.Figure`` that is not registered with pyplot, for programs without a screen. No
file is written; use ``figure.savefig(path)``. The names in ``__init__.pyi`` are loaded when they
are first used, because some modules of this package do not need Matplotlib.
"""

from typing import Any

import lazy_loader

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    try:
        return _load(name)
    except AttributeError as error:
        from flexarm.base.errors import with_nearest

        raise with_nearest(error, name, __all__) from None
