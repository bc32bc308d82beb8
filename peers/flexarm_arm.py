"""A case in flexarm."""

from __future__ import annotations

import numpy as np

import flexarm as fa
from peers.arms import Case


class Torque:
    """A case's torques, telling flexarm where they are not smooth."""

    def __init__(self, case: Case) -> None:
        self._torque = case.torque
        self.breaks = case.breaks

    def __call__(self, t: float) -> tuple[float, ...]:
        return self._torque(t)


def tip(case: Case) -> np.ndarray:
    """Return the tip's path (samples, 2), m.

    Bending is large, so each link is cut into segments, of one element each; what the second-order
    theory leaves out is cubic in the bending of one segment.
    """
    arm = fa.Arm(
        links=[
            fa.Link(
                length=length,
                flexural_rigidity=case.flexural_rigidity,
                mass_per_length=case.mass_per_length,
                elements=case.segments,
                segments=case.segments,
            )
            for length in case.lengths
        ],
        gravity=(0.0, -case.gravity),
        theory="second_order",
    )
    result = fa.simulate(
        arm,
        case.duration,
        torque=Torque(case),
        initial=arm.rest(case.joint_angles),
        rate=case.rate,
        progress=False,
    )
    return np.asarray(result["tip"])
