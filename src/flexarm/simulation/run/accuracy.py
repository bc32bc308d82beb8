"""Tolerances of a run from the error of the tip that a user accepts.

One relative tolerance suits all methods: that of order 8 makes long steps on an arm that hardly
vibrates, and that of order 5 adds the errors of all steps where vibrations have no damping. Of 114
runs at the default accuracy on random arms of 1 to 4 links (0.3 to 12 s; smooth and held torques,
full meshes, rigid links, friction, stops, contacts, loops), five whirl and warn. The others err by
0.01 of it in the median, by 0.2 in nine of ten and by at most 0.9; except for two loops that are
almost unstable, which are not compared: 2 and 146. They take 0.1 to 1.6 times the evaluations of
runs at a relative tolerance of 1e-7, 0.8 in the median: links that bend far are integrated twice.
"""

from __future__ import annotations

from flexarm.arm.arm import Arm
from flexarm.integrate.base import FloatArray

#: Error of the tip over the reach that a run may have without settings: a hundredth of a line in a
#: plot. None leaves runs to the default tolerances.
DEFAULT: float | None = 1e-5
#: Least smoothing rate of friction, relative to that of the Stribeck effect, over the relative
#: tolerance: below, it is less than the rate errors of implicit steps.
SMOOTH = 1e3
#: Request over the relative tolerance of steps and of functions of time.
_DIVISOR = 10.0
#: Relative tolerance below which order 8 is cheaper than order 5 at equal error.
FINEST_OF_ORDER_5 = 1e-8
#: Least relative tolerance that rounding errors allow, and the largest at which estimated errors of
#: steps mean anything.
_LEAST, _LARGEST = 1e-13, 3e-2


def default_request(arm: Arm) -> float | None:
    """Return the error over the reach that a run without settings may have.

    It is smaller for a joint whose friction is smoothed over low rates, so that errors of rates do
    not let it slide where it should stick. None if the default tolerances decide: for an arm
    without free joints, whose vibration is the whole motion, and adds the errors of all steps.
    """
    if DEFAULT is None or not arm.joints:
        return None
    rubs = [joint.friction for joint in arm.spec.joints if joint.friction is not None]
    smooth = [one.smoothing_rate / one.stribeck_rate for one in rubs if one.smoothing_rate]
    return min([DEFAULT, *(ratio * _DIVISOR / SMOOTH for ratio in smooth)])


def bent(state: FloatArray) -> bool:
    """Return whether links are bent or vibrate in a state (2, n, 1 + m)."""
    return bool(state[:, :, 1:].any())


def tolerance_of_request(request: float) -> float:
    """Return the relative tolerance at which nine of ten errors are below a request.

    Args:
        request: accepted error of the tip over the reach.
    """
    return min(max(request / _DIVISOR, _LEAST), _LARGEST)
