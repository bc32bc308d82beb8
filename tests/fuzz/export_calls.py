"""Valid arguments for exports to other programs, in addition to `base_calls`."""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec
from typing import Any

import flexarm as fa
from conformance.controller_examples import kalman_filter
from fuzz.arm_calls import QD, STATE, Q
from fuzz.base_calls import arm, controller, folder, result


@cache
def jax_model() -> Any:
    return fa.to_jax(arm(), ["payload.mass"])


#: Public functions.
EXPORTS: dict[str, dict[str, Any]] = {
    "export_c": {
        "arm": arm,
        "folder": lambda: folder() / "c",
        "controller": controller,
        "observer": kalman_filter,
    },
    "export_fmu": {"arm": arm, "path": lambda: folder() / "arm.fmu", "controller": controller},
    "export_mat": {"arm": arm, "path": lambda: folder() / "arm.mat", "result": result},
    "export_mjcf": {"arm": arm, "path": lambda: folder() / "arm.xml"},
    "export_exudyn": {"arm": arm, "path": lambda: folder() / "arm.py"},
    "export_urdf": {"arm": arm, "path": lambda: folder() / "arm.urdf"},
    "to_casadi": {"arm": arm, "parameters": ["payload.mass"]},
    "to_jax": {"arm": arm, "parameters": ["payload.mass"]},
}
_GIVEN = {"parameters": [1.0]}
_MOVING = {**STATE, "qdd": QD, "tip_force": [0.0, 0.0, 0.0], **_GIVEN}
#: Methods of the objects that these return, where the optional packages are installed.
EXPORT_METHODS: dict[str, Any] = {}
if find_spec("jax") is not None:
    EXPORT_METHODS["to_jax()"] = (
        jax_model,
        {
            "bias_force": {**STATE, **_GIVEN},
            "closure_forces": {**STATE, "torque": [0.1, 0.2], **_GIVEN},
            "closure_gaps": {"q": Q, **_GIVEN},
            "energy": {**STATE, **_GIVEN},
            "forward_dynamics": {**STATE, "torque": [0.1, 0.2], **_GIVEN},
            "inverse_dynamics": _MOVING,
            "joint_reactions": _MOVING,
            "mass_matrix": {"q": Q, **_GIVEN},
            "residual": {**STATE, "qdd": QD, "torque": [0.1, 0.2], **_GIVEN},
            "strain": {"q": Q, **_GIVEN},
            "tip": {"q": Q, **_GIVEN},
            "tip_velocity": {**STATE, **_GIVEN},
        },
    )
