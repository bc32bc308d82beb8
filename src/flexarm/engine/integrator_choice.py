"""Which integrator a run gets, and why."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.arguments import check_positive
from flexarm.arm import Arm
from flexarm.errors import InputError, Problem, shown
from flexarm.integrate import (
    INTEGRATORS,
    REMOVED,
    DormandPrince8,
    GeneralizedAlpha,
    Integrator,
    KennedyCarpenter5,
    RungeKutta4,
)
from flexarm.integrate.base import FloatArray, Tolerance

#: Ratio of the fastest to the slowest vibration above which "auto" goes implicit, at a relative
#: tolerance of 1e-5; it grows as tolerance^-1/2. On the arm of Table I the implicit method needs
#: fewer evaluations from a tenth of this ratio on, but at equal tolerance its error is up to ten
#: times that of the explicit one of order 8: accuracy is not traded for speed unasked.
_STIFF, _AT = 1300.0, 1e-5
#: Largest angle (rad) of the fastest vibration in a step at which rk4 is stable.
_STABLE = 2.8


class Choice(NamedTuple):
    """An integrator and the sentence that explains it."""

    integrator: Integrator
    reason: str
    by_drive: bool = False  # "auto" with a step: the drive may still change it
    doubt: str = ""  # warning that the choice deserves


def check_integrator(
    asked: str | Integrator, step: float | None, where: str, touching: bool = False
) -> None:
    """Refuse what no arm could be integrated with; ``touching``: there are contacts.

    Raises:
        InputError: no integrator has that name, it does not follow contacts and there are some, the
            step is not a positive time, or it is given beside an object, which has its own.
    """
    if step is not None:
        check_positive(where, "step", step)
    known = isinstance(asked, str) and asked in ("auto", *INTEGRATORS)
    if not known and not isinstance(asked, Integrator):
        names = ", ".join(repr(name) for name in ("auto", *INTEGRATORS))
        gone = isinstance(asked, str) and asked in REMOVED
        hint = f"It was removed; use {REMOVED[str(asked)]!r}." if gone else ""
        raise InputError(Problem(where, "integrator", f"be one of {names}", shown(asked), hint))
    if step is not None and not isinstance(asked, str):
        rule = "be left out where the integrator is an object, which has its own"
        hint = f"Give it there: {type(asked).__name__}(step={shown(step)})."
        raise InputError(Problem(where, "step", rule, shown(step), hint))
    kind = INTEGRATORS.get(asked) if isinstance(asked, str) else asked
    if touching and kind is not None and not kind.follows_contacts:
        followers = [repr(name) for name, kind in INTEGRATORS.items() if kind.follows_contacts]
        rule = f"be one of 'auto', {', '.join(followers)} where there are contacts"
        raise InputError(Problem(where, "integrator", rule, shown(kind.name)))


def choose_integrator(
    asked: str | Integrator,
    step: float | None,
    arm: Arm,
    tolerance: Tolerance,
    touch: float = 0.0,
    where: str = "simulate",
) -> Choice:
    """Resolve what the user asked for; "auto" looks at the arm's vibrations and the tolerance.

    Args:
        touch: frequency (rad/s) of the arm on the stiffest surface that it may touch; 0 for none.
        where: the call, for messages.

    Raises:
        InputError: as ``check_integrator``; a method that does not follow contacts, with some.
    """
    check_integrator(asked, step, where, touch > 0.0)
    if isinstance(asked, Integrator):
        return Choice(asked, "given by the user")
    if asked == "auto":
        if step is not None:
            return Choice(RungeKutta4(step=step), "fixed step asked for", by_drive=touch == 0.0)
        return _by_stiffness(arm, tolerance, touch)
    return Choice(INTEGRATORS[asked](step=step), "named by the user")


def choose_by_drive(
    choice: Choice, arm: Arm, tolerance: Tolerance, stops: FloatArray, duration: float
) -> Choice:
    """Return the choice for an open-loop run, once it is known when its drive is not smooth.

    Args:
        choice: without the drive; returned as it is unless "auto" was to find one for a given step.
        stops: (k,) times (s) at which torques and loads jump or bend: steps end there.
        duration: s.
    """
    if not choice.by_drive:
        return choice
    inside = stops[(stops > 0.0) & (stops < duration)]
    longest = float(np.diff(np.unique([0.0, *inside, duration])).max())
    step = float(choice.integrator.step or 0.0)
    # Strong damping limits an explicit step as a vibration does.
    fastest = max(tolerance.fastest, float(arm.assembly.constants.damping.max(initial=0.0)))
    angle = min(step, longest) * fastest
    if angle <= _STABLE:
        return choice
    reason = f"the step turns the fastest vibration by {angle:.3g} rad, at which rk4 is unstable"
    doubt = (
        f"{reason}: generalized_alpha damps such vibrations instead of following them. A fixed "
        "step has no estimate of its error; halve it once and compare."
    )
    method = GeneralizedAlpha(step=step)
    return Choice(method, f"order 2 with bending implicit: {reason}", doubt=doubt)


def _by_stiffness(arm: Arm, tolerance: Tolerance, touch: float) -> Choice:
    """Explicit where the fastest vibration has to be followed anyway, else implicit in bending.

    Contacts are never implicit: one that is faster than every vibration leaves nothing to gain.
    """
    c = arm.assembly.constants
    real = c.w2 > 0.0
    if real.any():
        # Strong damping limits an explicit step as a vibration does.
        fastest = max(tolerance.fastest, float(c.damping.max()))
        ratio = fastest / float(np.sqrt(c.w2[real].min()))
        stiff = ratio > _STIFF * np.sqrt(_AT / tolerance.relative)
        if stiff and touch > tolerance.fastest:
            return Choice(
                DormandPrince8(),
                "order 8 with step control: a touch is faster than any vibration and has to be "
                "followed",
            )
        if stiff:
            return Choice(
                KennedyCarpenter5(),
                f"order 5 with bending implicit: the fastest vibration ({ratio:.0f} times the "
                "slowest) need not be followed at the tolerances in use",
            )
    return Choice(
        DormandPrince8(),
        "order 8 with step control: fewest evaluations at the tolerances in use",
    )
