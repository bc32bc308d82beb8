"""Choice of the integrator of a run, with the reason for it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_positive
from flexarm.base.errors import InputError, Problem, shown
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
from flexarm.linear.statics.gaps import refuse_bristles, refuse_sticking
from flexarm.simulation.run.tolerance import SMOOTH, TIGHT, damping_rate, friction_rate

#: Ratio of the fastest to the slowest vibration above which "auto" is implicit in bending, at a
#: relative tolerance of 1e-5; it grows as tolerance^-1/2. On the arm of Table I the implicit method
#: needs fewer evaluations from a tenth of this ratio on, but at equal tolerance its error is up to
#: ten times that of the explicit method of order 8. The default keeps the accuracy.
_STIFF, _AT = 1300.0, 1e-5
#: Divisor of this ratio for arms whose joints stick: steps that end at each change gain less from
#: order 8.
_STICKING = 30.0
#: Rate of friction over the frequency of the fastest vibration above which "auto" is implicit, at a
#: relative tolerance of 1e-7, where the explicit method takes two to three times the evaluations;
#: it grows as tolerance^-1/5. If the rate times the duration of the run is below the least number,
#: the explicit method needs at most a few thousand evaluations.
_STEEP, _STEEP_AT, _LEAST_STEEP = 5.0, 1e-7, 1000.0
#: Largest phase (rad) of the fastest vibration, and decay of the fastest friction, per step at
#: which rk4 is stable.
_STABLE = 2.8
#: First step of the implicit method over the time in which friction stops a joint, times the
#: relative tolerance, up to which the error estimate sees that friction is missed: a link that
#: falls against friction has nine times the allowed error at 20 times this value, and a fifth of
#: it at 200 times.
_ESTIMATED = 1e-2
#: First step over that time where a longer one could miss friction.
_SETTLING = 0.5
#: Phase (rad) of the fastest vibration per evaluation of an explicit method whose steps are limited
#: by stability; if accuracy limits them, the phase is a third of this.
_PHASE = 0.5


class Choice(NamedTuple):
    """Chosen integrator and the reason for the choice."""

    integrator: Integrator
    reason: str
    by_drive: bool = False  # "auto" with a step: the drive may still change the choice
    doubt: str = ""  # warning about the choice
    fastest: float = 1.0  # rad/s, which limits the steps of an explicit method
    open: bool = False  # "auto" without a step: the work of the run may still change the choice
    insisted: bool = False  # an integrator object, which is used whatever its work
    work: float = 0.0  # estimated evaluations of an open-loop run


def check_integrator(
    requested: str | Integrator, step: float | None, touching: bool = False
) -> None:
    """Validate the requested integrator and step, independently of the arm."""
    if step is not None:
        check_positive("step", step)
    known = isinstance(requested, str) and requested in ("auto", *INTEGRATORS)
    if not known and not isinstance(requested, Integrator):
        names = ", ".join(repr(name) for name in ("auto", *INTEGRATORS))
        gone = isinstance(requested, str) and requested in REMOVED
        hint = f"It was removed; use {REMOVED[str(requested)]!r}." if gone else ""
        raise InputError(Problem("integrator", f"be one of {names}", shown(requested), hint))
    if step is not None and not isinstance(requested, str):
        rule = "cannot be combined with an integrator object"
        hint = f"Use integrator={type(requested).__name__}(step={shown(step)})."
        raise InputError(Problem("step", rule, hint=hint))
    kind = INTEGRATORS.get(requested) if isinstance(requested, str) else requested
    if touching and kind is not None and not kind.follows_contacts:
        followers = [repr(name) for name, kind in INTEGRATORS.items() if kind.follows_contacts]
        rule = f"be one of 'auto', {', '.join(followers)} for an arm with contacts"
        raise InputError(Problem("integrator", rule, shown(kind.name)))


def choose_integrator(
    requested: str | Integrator,
    step: float | None,
    arm: Arm,
    tolerance: Tolerance,
    touch: float = 0.0,
    prescribed: tuple[int, ...] = (),
    duration: float = math.inf,
) -> Choice:
    """Return the integrator of a run; "auto" uses the arm's vibrations and the tolerance."""
    check_integrator(requested, step, touch > 0.0)
    _refuse_unfollowed(requested, step, arm)
    if isinstance(requested, Integrator):
        choice = Choice(requested, "given by the user", insisted=True)
    elif requested != "auto":
        method = INTEGRATORS[requested](step=step)
        choice = Choice(method, "named by the user", doubt=_smoothing_doubt(method, arm, tolerance))
    elif step is not None:
        method = RungeKutta4(step=step)
        choice = Choice(method, "fixed step requested", by_drive=touch == 0.0)
    elif arm.assembly.has_bristles:
        reason = "order 5 with friction implicit: bristles of a sliding joint follow its rate too "
        choice = Choice(KennedyCarpenter5(), f"{reason}fast for an explicit method", open=True)
    else:
        steep = _is_steep(arm, tolerance, touch, prescribed, duration)
        choice = _by_stiffness(arm, tolerance, touch, steep)
        choice = choice._replace(doubt=_smoothing_doubt(choice.integrator, arm, tolerance))
    choice = choice._replace(integrator=settling(choice.integrator, arm, tolerance, prescribed))
    return choice._replace(fastest=fastest_of(arm, tolerance, prescribed))


def fastest_of(arm: Arm, tolerance: Tolerance, prescribed: tuple[int, ...] = ()) -> float:
    """Return what limits the steps of an explicit method: rad/s, or decay in 1/s."""
    damping = float(arm.assembly.constants.damping.max(initial=0.0))
    return max(tolerance.fastest, damping, damping_rate(arm, prescribed))


def explicit_work(fastest: float, duration: float) -> float:
    """Return the least evaluations of an explicit method; ``fastest``: rad/s, or decay in 1/s."""
    return fastest * duration / _PHASE


def settling(
    method: Integrator, arm: Arm, tolerance: Tolerance, prescribed: tuple[int, ...] = ()
) -> Integrator:
    """Return a method whose first step does not miss smoothed friction.

    The implicit method takes the slope of friction at the start of a step for damping. In a step
    far longer than friction needs to stop a joint, friction itself is a rounding error beside this
    damping: the joint falls as without friction, and the estimated error is small.
    """
    if not isinstance(method, KennedyCarpenter5):
        return method
    rate = friction_rate(arm, prescribed)
    first = method.first_step(tolerance.fastest)
    if rate * first * tolerance.relative <= _ESTIMATED:
        return method
    return replace(method, step=_SETTLING / rate)


def _refuse_unfollowed(requested: str | Integrator, step: float | None, arm: Arm) -> None:
    """Raise if a requested integrator does not follow bristles, sticking or closures of the arm."""
    kind = INTEGRATORS.get(requested) if isinstance(requested, str) else requested
    control = "Bristles of a sliding joint need step control; use"
    if kind is None:
        if step is not None:
            refuse_bristles(arm, "step", hint=f"{control} rtol and atol.")
        return

    def following(what: str) -> str:
        names = (name for name, one in INTEGRATORS.items() if getattr(one, f"follows_{what}"))
        return ", ".join(map(repr, names))

    if not kind.follows_bristles:
        hint = f"{control} one of {following('bristles')}."
        refuse_bristles(arm, "integrator", shown(kind.name), hint)
    if not kind.follows_sticking:
        hint = f"Use one of {following('sticking')}, or friction that creeps: smoothing_rate=0.01."
        refuse_sticking(arm, "integrator", shown(kind.name), hint)
    if arm.closure_rows and not kind.follows_closures:
        rule = f"be one of 'auto', {following('closures')} for an arm with closures"
        raise InputError(Problem("integrator", rule, shown(kind.name)))


def choose_by_drive(choice: Choice, arm: Arm, stops: FloatArray, duration: float) -> Choice:
    """Return the integrator of an open-loop run from the times at which its drive is not smooth."""
    if choice.integrator.adaptive or choice.integrator.step is None:
        return choice
    inside = stops[(stops > 0.0) & (stops < duration)]
    longest = float(np.diff(np.unique([0.0, *inside, duration])).max())
    choice = _choose_by_longest(choice, arm, longest) if choice.by_drive else choice
    doubt = friction_doubt(choice.integrator, arm, longest)
    return choice._replace(doubt=f"{choice.doubt} {doubt}".strip()) if doubt else choice


def friction_doubt(integrator: Integrator, arm: Arm, longest: float) -> str:
    """Return a warning if a fixed step is too long to follow friction; otherwise empty text.

    Unlike a vibration, friction cannot grow beyond bounds: the joint shakes instead of sticking,
    and the result looks plausible.
    """
    if integrator.adaptive or integrator.step is None:
        return ""
    step, rate = min(integrator.step, longest), friction_rate(arm)
    if step * rate <= _STABLE:
        return ""
    return (
        f"a step of {step:.3g} s is too long for friction, which stops a joint at a rate of "
        f"{rate:.3g} 1/s: above {_STABLE / rate:.2g} s, {integrator.name} shakes a joint that "
        "should stick, and the motion is wrong. Use integrator='auto' without a step, or raise "
        "smoothing_rate."
    )


def _smoothing_doubt(integrator: Integrator, arm: Arm, tolerance: Tolerance) -> str:
    """Return a warning if friction is smoothed over less than the rate errors of its steps."""
    if not isinstance(integrator, KennedyCarpenter5):
        return ""
    least = SMOOTH * tolerance.relative  # below, a joint may not stick at all
    for i, joint in enumerate(arm.spec.joints):
        rubs = joint.friction
        rate = None if rubs is None else rubs.smoothing_rate
        if rubs is None or rate is None:
            continue
        if rate < least * rubs.stribeck_rate * (1.0 - 1e-9):
            return (
                f"arm.joints[{i}].friction.smoothing_rate ({rate:.3g} rad/s) is "
                f"below the errors that rtol={tolerance.relative:.3g} permits, so that the joint "
                "may slide where it should stick. Leave it out: friction then holds."
            )
    return ""


def _choose_by_longest(choice: Choice, arm: Arm, longest: float) -> Choice:
    """Return the integrator of "auto" with a fixed step, of which the longest takes ``longest``."""
    step = float(choice.integrator.step or 0.0)
    angle = min(step, longest) * choice.fastest
    if angle <= _STABLE:
        return choice
    reason = f"a step covers {angle:.3g} rad of the fastest vibration, at which rk4 is unstable"
    if arm.closure_rows or arm.assembly.has_sticking:
        lost = "keeps loops" if arm.closure_rows else "sticks"
        doubt = f"The step is only the first one: no method with fixed steps is stable and {lost}."
        reason = f"order 5 with bending implicit: {reason}"
        return choice._replace(integrator=KennedyCarpenter5(step=step), reason=reason, doubt=doubt)
    doubt = (
        f"{reason}: generalized_alpha damps such vibrations instead of resolving them. A fixed "
        "step has no error estimate: halve it once and compare."
    )
    method = GeneralizedAlpha(step=step)
    reason = f"order 2 with bending implicit: {reason}"
    return choice._replace(integrator=method, reason=reason, doubt=doubt)


def _by_stiffness(arm: Arm, tolerance: Tolerance, touch: float, steep: bool) -> Choice:
    """Choose an explicit method, or for stiff arms one that is implicit in bending.

    Contacts are always explicit: if a contact is faster than every vibration, an implicit method
    has no advantage.
    """
    if steep:
        reason = "order 5 with friction implicit: a sticking joint settles too fast for an "
        return Choice(KennedyCarpenter5(), f"{reason}explicit method")
    c = arm.assembly.constants
    real = c.w2 > 0.0
    if real.any():
        # Strong damping limits an explicit step in the same way as a vibration.
        fastest = max(tolerance.fastest, float(c.damping.max()))
        ratio = fastest / float(np.sqrt(c.w2[real].min()))
        limit = _STIFF / (_STICKING if arm.assembly.has_sticking else 1.0)
        stiff = ratio > limit * np.sqrt(_AT / tolerance.relative)
        if stiff and touch > tolerance.fastest:
            reason = "order 8 with step control: a touch is faster than any vibration and has to "
            return Choice(DormandPrince8(), f"{reason}be followed")
        if stiff:
            return Choice(
                KennedyCarpenter5(),
                f"order 5 with bending implicit: the fastest vibration ({ratio:.0f} times the "
                "slowest) need not be followed at the tolerances in use",
            )
    reason = "order 8 with step control: fewest evaluations at the tolerances in use"
    return Choice(DormandPrince8(), reason, open=touch <= tolerance.fastest)


def _is_steep(
    arm: Arm, tolerance: Tolerance, touch: float, prescribed: tuple[int, ...], duration: float
) -> bool:
    """Return whether friction limits the steps of an explicit method far more than vibrations."""
    rate = friction_rate(arm, prescribed)
    if rate * duration < _LEAST_STEEP:
        return False
    relative = tolerance.relative
    if np.any(arm.assembly.constants.limits[:, 2]):
        relative *= TIGHT
    limit = _STEEP * (_STEEP_AT / relative) ** 0.2
    return bool(rate > limit * max(tolerance.fastest, touch))
