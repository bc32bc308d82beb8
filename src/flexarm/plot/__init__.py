"""Figures of results, modes and linear models: the only package that imports Matplotlib.

``fa.plot.NAME`` makes a ``matplotlib.figure.Figure`` and saves nothing; ``figure.savefig(path)``
does. Names are loaded when they are first used, because other modules of this package need no
Matplotlib.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flexarm.plot.comparison import comparison_figure as comparison_figure
    from flexarm.plot.response import response_figure as response_figure
    from flexarm.plot.signals import signals_figure as signals_figure
    from flexarm.plot.vibration import modes_figure as modes_figure
    from flexarm.plot.vibration import tracks_figure as tracks_figure

#: Every public figure, and the module that holds it.
_HOME = {
    "comparison_figure": "comparison",
    "modes_figure": "vibration",
    "response_figure": "response",
    "signals_figure": "signals",
    "tracks_figure": "vibration",
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'flexarm.plot' has no attribute {name!r}")
    return getattr(import_module(f"flexarm.plot.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
