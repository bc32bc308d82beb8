"""Plots of results, modes and linear models: the only package that imports Matplotlib.

``fa.plot.history(result)`` and the other plots draw into given Matplotlib axes, or into a new
figure of pyplot, and return the axes. Functions with names that end in ``_figure`` return a
``matplotlib.figure.Figure`` that is not registered with pyplot, for programs without a screen. No
file is written; use ``figure.savefig(path)``. Names are loaded when they are first used, because
some modules of this package do not need Matplotlib.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flexarm.plot.bodies import bending_moment as bending_moment
    from flexarm.plot.bodies import deflection as deflection
    from flexarm.plot.bodies import postures as postures
    from flexarm.plot.comparison import comparison_figure as comparison_figure
    from flexarm.plot.comparison import study as study
    from flexarm.plot.histories import compare as compare
    from flexarm.plot.histories import history as history
    from flexarm.plot.histories import phase_portrait as phase_portrait
    from flexarm.plot.response import bode as bode
    from flexarm.plot.response import response_figure as response_figure
    from flexarm.plot.signals import signals_figure as signals_figure
    from flexarm.plot.style import styled as styled
    from flexarm.plot.vibration import campbell as campbell
    from flexarm.plot.vibration import modes as modes
    from flexarm.plot.vibration import modes_figure as modes_figure
    from flexarm.plot.vibration import tracks_figure as tracks_figure

#: Module of each public plot.
_HOME = {
    "bending_moment": "bodies",
    "bode": "response",
    "campbell": "vibration",
    "compare": "histories",
    "comparison_figure": "comparison",
    "deflection": "bodies",
    "history": "histories",
    "modes": "vibration",
    "modes_figure": "vibration",
    "phase_portrait": "histories",
    "postures": "bodies",
    "response_figure": "response",
    "signals_figure": "signals",
    "study": "comparison",
    "styled": "style",
    "tracks_figure": "vibration",
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'flexarm.plot' has no attribute {name!r}")
    return getattr(import_module(f"flexarm.plot.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
