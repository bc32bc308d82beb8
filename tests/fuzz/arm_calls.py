"""Valid arguments of the methods of an arm."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

import flexarm as fa
from conformance.controller_examples import two_links

arm = cache(two_links)
start = [0.1, 0.3]
Q, QD = [0.1, 0.0, 0.0, 0.3, 0.0, 0.0], [0.0] * 6
STATE = {"q": Q, "qd": QD}


@cache
def wound() -> fa.Arm:
    """Return the arm with motors that voltages drive."""
    winding = fa.Winding(torque_constant=0.05, resistance=2.0)
    spec = arm().spec
    return fa.Arm(spec.replace(joints=[joint.replace(winding=winding) for joint in spec.joints]))


#: Methods of an arm.
ARM: dict[str, dict[str, Any]] = {
    "bias_force": STATE,
    "damping_matrix": {},
    "derivatives": {**STATE, "torque": [0.1, 0.2]},
    "energy": STATE,
    "forward_dynamics": {**STATE, "torque": [0.1, 0.2]},
    "from_nodal": {"joint_angles": start, "nodal": [[[0.0, 0.0]], [[0.0, 0.0]]]},
    "inverse_dynamics": {**STATE, "qdd": QD},
    "inverse_dynamics_many": {"q": [Q], "qd": [QD], "qdd": [QD]},
    "joint_angles": {"q": Q},
    "joint_reactions": {**STATE, "qdd": QD},
    "closure_forces": {**STATE, "torque": [0.1, 0.2]},
    "closure_gaps": {"q": Q},
    "closure_jacobian": {"q": Q},
    "mass_matrix": {"q": Q},
    "motor_torque": {"voltage": [1.0, 2.0], "rate": [0.0, 0.1]},
    "nodal": {"q": Q},
    "padded": {"vector": Q},
    "padded_torque": {"torque": [0.1, 0.2]},
    "rest": {"joint_angles": start},
    "rigid": {},
    "section_forces": {**STATE, "qdd": QD, "stations": 3},
    "shape": {"q": Q, "stations": 3},
    "stiffness_matrix": {"q": Q},
    "strain": {"q": Q},
    "strains": {"states": np.zeros((1, 2, 2, 3)).tolist()},
    "tip": {"q": Q},
    "tip_velocity": STATE,
    "unpadded": {"array": np.zeros((2, 3)).tolist()},
}
