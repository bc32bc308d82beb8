"""Valid arguments for every public figure, in addition to `base_calls`."""

from __future__ import annotations

from functools import cache
from typing import Any

import flexarm as fa
from fuzz.base_calls import arm, controller, end, motion, result, start
from fuzz.study_calls import study_table

_TABLE = cache(lambda: fa.compare(arm(), {"pd": controller()}, 0.01, {"line": motion()}))
_MODES = cache(lambda: fa.modes(arm()))
_MODEL = cache(lambda: fa.linearize(arm(), outputs=["joint_angle"]))
_TRACKS = cache(lambda: fa.track_modes(arm(), [start, end], count=2, samples=2))
_LOADED = cache(lambda: fa.simulate(arm(), 0.01, rate=500.0, stations=3))

#: Functions of ``fa.plot``.
FIGURES: dict[str, dict[str, Any]] = {
    "bending_moment": {"result": _LOADED},
    "bode": {"model": _MODEL, "omega": [1.0, 10.0]},
    "campbell": {"tracks": _TRACKS},
    "compare": {"results": lambda: {"one": result(), "two": result()}, "channels": "torque"},
    "comparison_figure": {"table": _TABLE},
    "deflection": {"result": result, "count": 2},
    "history": {"result": result, "channels": ["torque", "tip[y]"]},
    "modes": {"found": _MODES, "count": 2},
    "modes_figure": {"modes": _MODES, "count": 2},
    "phase_portrait": {"result": result, "channel": "joint_angle[1]"},
    "postures": {"result": result, "count": 2, "rigid": True},
    "response_figure": {"model": _MODEL, "omega": [1.0, 10.0]},
    "samples": {"table": study_table},
    "samples_figure": {"table": study_table},
    "signals_figure": {"result": result},
    "study": {"table": _TABLE},
    "styled": {"medium": "screen"},
    "tracks_figure": {"tracks": _TRACKS},
}
