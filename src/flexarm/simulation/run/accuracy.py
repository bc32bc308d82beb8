"""Tolerances of a run from the error of the tip that a user accepts.

The factors were measured on 110 random arms with smooth and held torques, closed loops, friction,
stops and contacts, of 1 to 4 links with 2 to 18 coordinates a link, over 1 to 8 s.
"""

from __future__ import annotations

from flexarm.arm.arm import Arm
from flexarm.integrate import DormandPrince8, Integrator, KennedyCarpenter5

#: Relative tolerance of functions of time over the request.
FUNCTIONS = 0.1
#: Request below which order 8 is cheaper than order 5 at equal error.
FINEST_OF_ORDER_5 = 1e-7
#: Least relative tolerance that rounding errors allow, and the largest at which estimated errors of
#: steps mean anything.
_LEAST, _LARGEST = 1e-13, 3e-2


def relative_tolerance(method: Integrator, arm: Arm, request: float) -> float:
    """Return the relative tolerance at which the error of a method is about a tenth of a request.

    Nine of ten errors are below the request. The method of order 8 is limited by stability on an
    arm that bends, and its errors are far smaller; a rigid arm has no fast vibrations that limit
    its steps.

    Args:
        request: accepted error of the tip over the reach.
    """
    factor = 1.0
    if isinstance(method, DormandPrince8):
        factor = 10.0 if arm.assembly.constants.w2.any() else 0.1
    elif isinstance(method, KennedyCarpenter5) and arm.assembly.constants.friction[:, :2].any():
        factor = 0.3  # steps restart where a joint sticks or slips
    return min(max(factor * request, _LEAST), _LARGEST)
