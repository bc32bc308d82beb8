"""The warning that a linear model holds only between the contacts of a backlash."""

from __future__ import annotations

from flexarm.arm import Arm
from flexarm.assembly.assemble import FloatArray
from flexarm.errors import FlexarmWarning, warn_caller


def warn_of_backlash(arm: Arm, q: FloatArray) -> None:
    """Warn if q (dof,) is between the contacts of a joint's backlash, where no spring acts."""
    for seat in arm.assembly.seats:
        joint = arm.spec.joints[seat.link]
        if seat.twist is None or not seat.backlash:
            continue
        if abs(q[seat.twist]) < 0.5 * joint.backlash:
            warn_caller(
                f"arm.joints[{seat.link}]: between the contacts of the backlash "
                f"({joint.backlash:g} rad) nothing but damping connects motor and link, and the "
                "linear model has no spring there. Use backlash=0 for modes and designs, and "
                "simulate for the effect of the backlash.",
                FlexarmWarning,
            )
