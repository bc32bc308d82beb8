"""Tolerances of a run from the error of the tip that a user accepts.

TODO
"""

from __future__ import annotations

from flexarm.arm.arm import Arm
from flexarm.integrate import DormandPrince8, Integrator

#: Error of the tip over the reach that a run may have without settings: a hundredth of a line in a
#: plot. None leaves runs to the default tolerances.
DEFAULT: float | None = 1e-5
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
    c, factor = arm.assembly.constants, 1.0
    if isinstance(method, DormandPrince8):
        factor = 10.0 if c.w2.any() else 0.1
    if c.w2.any() and c.friction[:, :2].any():
        factor *= 0.3  # steps restart where a joint sticks or slips
    return min(max(factor * request, _LEAST), _LARGEST)
