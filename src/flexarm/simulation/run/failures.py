"""Errors of runs that fail: reason, hint and last valid state."""

from __future__ import annotations

from flexarm.base.errors import SimulationError
from flexarm.integrate.base import FloatArray, Status

#: Hints for failures that neither a smaller step nor other gains avoid.
_HINTS = {
    Status.PRESSED_THROUGH: "Increase the stiffness of the contact or the radius of the surface.",
}


def failure_of(
    status: Status,
    time: float,
    state: tuple[FloatArray, FloatArray],
    reason: str = "",
    hint: str = "",
) -> SimulationError:
    """Return the error for a run that ended at a time and state (q, qd) for the given reason."""
    reason = reason or status.sentence
    hint = (
        hint
        or _HINTS.get(status)
        or (
            "Try integrator='auto', a smaller step or tighter rtol and atol, fewer elements or "
            "modes=k on the links; check torques, gains and damping signs."
        )
    )
    return SimulationError(time, reason, hint, state)
