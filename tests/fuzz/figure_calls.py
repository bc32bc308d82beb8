"""Valid arguments for every public figure, as `base_calls` has them for the other names."""

from __future__ import annotations

from functools import cache
from typing import Any

import flexarm as fa
from fuzz.base_calls import arm, controller, end, motion, result, start

#: Functions of ``fa.plot``.
FIGURES: dict[str, dict[str, Any]] = {
    "comparison_figure": {
        "table": cache(lambda: fa.compare(arm(), {"pd": controller()}, 0.01, {"line": motion()}))
    },
    "modes_figure": {"modes": cache(lambda: fa.modes(arm())), "count": 2},
    "response_figure": {
        "model": cache(lambda: fa.linearize(arm(), outputs=["joint_angle"])),
        "omega": [1.0, 10.0],
    },
    "signals_figure": {"result": result},
    "tracks_figure": {
        "tracks": cache(lambda: fa.track_modes(arm(), [start, end], count=2, samples=2))
    },
}
