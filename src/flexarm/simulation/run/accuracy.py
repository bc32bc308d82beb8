"""Tolerances of a run from the error of the tip that a user accepts.

With these factors and a request of 1e-5 of the reach, 88 runs of 1 s on random arms of 1 to 4
links (smooth and held torques, full meshes, rigid links, friction, stops, contacts, and four closed
loops) err by 0.03 of the request in the median, by 0.24 in nine of ten, and by 20 in a closed loop;
verified runs by 0.5 at most. Order 8 is more accurate than requested, because stability limits it.
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
    """Return the relative tolerance at which nine of ten errors of a method are below a request.

    A rigid arm has no fast vibrations that limit the steps of order 8, so its factor is smaller.

    Args:
        request: accepted error of the tip over the reach.
    """
    factor = 1.0
    if isinstance(method, DormandPrince8):
        factor = 10.0 if arm.assembly.constants.w2.any() else 0.1
    elif isinstance(method, KennedyCarpenter5) and arm.assembly.constants.friction[:, :2].any():
        factor = 0.3  # steps restart where a joint sticks or slips
    return min(max(factor * request, _LEAST), _LARGEST)
