"""Valid arguments for motions and inverse kinematics, in addition to `base_calls`."""

from __future__ import annotations

from typing import Any

from fuzz.base_calls import arm, end, start

_OF = {"arm": arm, "duration": 1.0}
_PLACES = [[1.0, 0.2], [1.0, 0.4], [0.8, 0.6]]

#: Public functions.
MOTIONS: dict[str, dict[str, Any]] = {
    "circle_motion": {**_OF, "center": _PLACES[0], "start": _PLACES[1], "angle": 1.0},
    "inverse_kinematics": {"arm": arm, "point": _PLACES[0]},
    "joint_motion": {**_OF, "start": start, "end": end},
    "line_motion": {**_OF, "start": _PLACES[0], "end": _PLACES[1]},
    "spline_motion": {**_OF, "points": _PLACES},
    "via_point_motion": {**_OF, "points": _PLACES, "blend": 0.01},
}
