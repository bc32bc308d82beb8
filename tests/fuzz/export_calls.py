"""Valid arguments for exports to other programs, in addition to `base_calls`."""

from __future__ import annotations

from typing import Any

from conformance.controller_examples import kalman_filter
from fuzz.base_calls import arm, controller, folder, result

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
