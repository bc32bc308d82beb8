"""Tolerances of a run from the error of the tip that a user accepts.

One relative tolerance suits all methods. That of order 8, which most arms get, then errs far less,
because its steps are limited by stability: 18 undamped links under a step of force err by 0.01 to
0.05 of the request. That of order 5, which stiff arms get, adds the errors of all steps where
vibrations have no damping: on the same links by 0.7 of the request in the median, by 4 at most.
A run whose joints turn far or whose vibrations last is therefore compared with another one.
"""

from __future__ import annotations

from flexarm.arm.arm import Arm

#: Error of the tip over the reach that a run may have without settings: a hundredth of a line in a
#: plot.
_DEFAULT = 1e-5
#: Least smoothing rate of friction, relative to that of the Stribeck effect, over the relative
#: tolerance: below, it is less than the rate errors of implicit steps.
SMOOTH = 1e3
#: Request over the relative tolerance of steps and of functions of time.
_DIVISOR = 100.0
#: Least relative tolerance that rounding errors allow, and the largest at which estimated errors of
#: steps mean anything.
LEAST, _LARGEST = 1e-13, 3e-2
#: Exponent of the ratio of two tolerances by which the difference of their runs becomes the error
#: of the finer one: errors at tolerances with a ratio of 10 differ by 2 or more in nine of ten.
_POWER = 0.3


def default_request(arm: Arm) -> float | None:
    """Return the error over the reach that a run without settings may have.

    It is smaller for a joint whose friction is smoothed over low rates, so that errors of rates do
    not let it slide where it should stick. None if the default tolerances decide: for an arm
    without free joints, whose vibration is the whole motion, and adds the errors of all steps.
    """
    if not arm.joints:
        return None
    rubs = [joint.friction for joint in arm.spec.joints if joint.friction is not None]
    smooth = [one.smoothing_rate / one.stribeck_rate for one in rubs if one.smoothing_rate]
    return min([_DEFAULT, *(ratio * _DIVISOR / SMOOTH for ratio in smooth)])


def tolerance_of_request(request: float) -> float:
    """Return the relative tolerance of a request.

    Args:
        request: accepted error of the tip over the reach.
    """
    return min(max(float(f"{request / _DIVISOR:.12g}"), LEAST), _LARGEST)


def share_of_finer(ratio: float) -> float:
    """Return the error of the finer of two runs over their difference, from the tolerances."""
    return float(ratio**-_POWER)
