"""A study of short runs, and the comparison of stores, for the tests of this folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

LINK = {"flexural_rigidity": 40.0, "mass_per_length": 0.5, "elements": 1}
#: Two links that turn for 0.05 s, so that a run takes a few milliseconds.
CONTENT: dict[str, Any] = {
    "arm": {
        "links": [{"length": 1.0, **LINK}, {"length": 0.8, **LINK}],
        "joints": [{"hub_inertia": 0.1}, {"mass": 0.3, "hub_inertia": 0.02}],
        "payload": {"mass": 0.1},
    },
    "motions": {
        "move": {"kind": "joint", "start": [0.2, -0.4], "end": [0.3, -0.3], "duration": 0.04}
    },
    "drives": {"torque": {"kind": "rigid_inverse_dynamics"}},
    "vary": {
        "payload.mass": {"kind": "uniform", "low": 0.0, "high": 0.3},
        "links[0].flexural_rigidity": {
            "kind": "normal",
            "mean": 1.0,
            "deviation": 0.1,
            "relative": True,
        },
    },
    "samples": {"method": "random", "count": 12, "seed": 5},
    "run": {"duration": 0.05, "rate": 200.0},
}
PD = {"kind": "joint_pd", "proportional": [20.0, 6.0], "derivative": [5.0, 1.0]}
READING = {"instruments": [{"signal": "joint_angle", "noise": 1e-4, "rate_cutoff": 80.0}]}


def content(count: int = 12, **changes: Any) -> dict[str, Any]:
    """Return the content of the study with another number of samples, and other changes."""
    return {**CONTENT, "samples": {**CONTENT["samples"], "count": count}, **changes}


def files_of(store: Path) -> dict[str, bytes]:
    """Return the content of every file of a store by its path."""
    return {
        str(file.relative_to(store)): file.read_bytes()
        for file in sorted(store.rglob("*"))
        if file.is_file()
    }
