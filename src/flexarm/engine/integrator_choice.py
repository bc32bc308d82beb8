"""Which integrator a run gets, and why."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.arguments import check_positive
from flexarm.arm import Arm
from flexarm.errors import InputError, Problem, shown
from flexarm.integrate import (
    INTEGRATORS,
    DormandPrince8,
    Integrator,
    KennedyCarpenter5,
    RungeKutta4,
)
from flexarm.integrate.base import Tolerance

#: Ratio of the fastest to the slowest vibration above which "auto" goes implicit, at a relative
#: tolerance of 1e-5; it grows as tolerance^-1/2. On the arm of Table I the implicit method needs
#: fewer evaluations from a tenth of this ratio on, but at equal tolerance its error is up to ten
#: times that of the explicit one of order 8: accuracy is not traded for speed unasked.
_STIFF, _AT = 1300.0, 1e-5


class Choice(NamedTuple):
    """An integrator and the sentence that explains it."""

    integrator: Integrator
    reason: str


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
        raise InputError(Problem(where, "integrator", f"be one of {names}", shown(asked)))
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
            return Choice(RungeKutta4(step=step), "fixed step asked for")
        return _by_stiffness(arm, tolerance, touch)
    return Choice(INTEGRATORS[asked](step=step), "named by the user")  # type: ignore[call-arg]


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
